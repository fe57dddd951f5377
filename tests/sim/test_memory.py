"""No memory for a scene: said, with exit code 1, and never an abort (in Python: tests/python/inside_scene.py)."""
import os
import subprocess

import pytest


@pytest.fixture(scope="module")
def failing(build):
    return str(build / "tests/sim/fail_calloc.so")


def outcomes(failing, command, calls):
    for n in calls:
        yield n, subprocess.run(command, capture_output=True, text=True, timeout=60, env=dict(os.environ, LD_PRELOAD=failing, FAIL_CALLOC=str(n)))


def test_a_scene_without_memory_is_an_error(bin, root, failing):
    said = []
    for n, run in outcomes(failing, [bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--check"], range(1, 320, 2)):
        assert run.returncode in (0, 1, 2, 127), f"call {n}: {run.returncode} {run.stderr}"
        assert "not YAML" not in run.stderr, f"call {n}: {run.stderr}"
        said += ["block-press.yaml: out of memory; close other programs" in run.stderr]
        assert not said[-1] or run.returncode == 1
    assert sum(said) > 50
