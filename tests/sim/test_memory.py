"""Exhausted memory while opening a scene: reported, exit code 1, no abort (in Python: tests/python/inside_scene.py)."""
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
        lines = [line for line in run.stderr.splitlines() if "out of memory; " in line]
        assert not lines or run.returncode == 1, f"call {n}: {run.returncode} {run.stderr}"
        said += lines
    assert sum("block-press.yaml: out of memory; close other programs" in line for line in said) > 50
    assert any(line.endswith("out of memory; use a smaller mesh") for line in said)
