"""Paths of the sources and of the build under test."""
import os
import pathlib

ROOT = pathlib.Path(__file__).resolve().parent.parent
BUILD = pathlib.Path(os.environ.get("TM_OUT", ROOT / "build")).resolve()
LONG = os.environ.get("TM_LONG") == "1"
