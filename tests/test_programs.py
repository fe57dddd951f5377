"""Runs every C test program of the build; one item each. Exit 0 passes, 77 is a skip with its reason on the last line."""
import os
import pathlib
import subprocess

import pytest
from paths import BUILD, LONG, ROOT

MANIFEST = BUILD / "tests" / "manifest.txt"
PROGRAMS = [pathlib.Path(p) for p in MANIFEST.read_text().split()] if MANIFEST.exists() else []

# Long forms of many minutes, in parts that share the processors: number of parts, and the environment of part i.
PARTS = {"physics/test_sessions": (10, lambda i: {"TM_SESSIONS": "1000", "TM_SESSIONS_FROM": str(1 + 1000 * i)})}


# Cases that a sanitizer's short form leaves out (tests/sanitize/choose.py), by program.
LEFT_OUT = {}
for program, *case in (line.split() for line in pathlib.Path(os.environ.get("TM_LEFT_OUT", os.devnull)).read_text().splitlines() if line[:1] != "#"):
    LEFT_OUT.setdefault(program, []).extend(case)


def cases():
    for program in PROGRAMS:
        name = "/".join(program.parts[-2:])
        count, settings = PARTS.get(name, (1, None)) if LONG else (1, None)
        for i in range(count):
            yield pytest.param(program, settings(i) if settings else {"TM_LEAVE_OUT": ",".join(LEFT_OUT[name])} if name in LEFT_OUT else {}, id=f"{name}-{i}" if settings else name)


def test_manifest_is_there():
    assert PROGRAMS, f"{MANIFEST} is missing or empty; run `make tests`"


@pytest.mark.parametrize("program, settings", cases())
def test_program(program, settings):
    path = program if program.is_absolute() else ROOT / program
    env = dict(os.environ, TM_ROOT=str(ROOT), TM_OUT=str(BUILD), **settings)
    run = subprocess.run([str(path)], cwd=ROOT, env=env, capture_output=True, text=True, timeout=3600)
    output = run.stdout + run.stderr
    if run.returncode == 77:
        pytest.skip(output.strip().splitlines()[-1] if output.strip() else "no reason given")
    assert run.returncode == 0, output[-8000:]
