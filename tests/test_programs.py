"""Runs every C test program of the build; one item each. Exit 0 passes, 77 is a skip with its reason on the last line."""
import os
import pathlib
import subprocess

import pytest
from paths import BUILD, ROOT

MANIFEST = BUILD / "tests" / "manifest.txt"
PROGRAMS = [pathlib.Path(p) for p in MANIFEST.read_text().split()] if MANIFEST.exists() else []


def test_manifest_is_there():
    assert PROGRAMS, f"{MANIFEST} is missing or empty; run `make tests`"


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda p: "/".join(p.parts[-2:]))
def test_program(program):
    path = program if program.is_absolute() else ROOT / program
    env = dict(os.environ, TM_ROOT=str(ROOT), TM_OUT=str(BUILD))
    run = subprocess.run([str(path)], cwd=ROOT, env=env, capture_output=True, text=True, timeout=3600)
    output = run.stdout + run.stderr
    if run.returncode == 77:
        pytest.skip(output.strip().splitlines()[-1] if output.strip() else "no reason given")
    assert run.returncode == 0, output[-8000:]
