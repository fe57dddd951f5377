"""tests/patience.py and tests/run.py: which tests run again. On a machine in time no failure is excused, nor is a repeated failure alone, nor one of
a test that computes."""
import os
import shutil
import subprocess
import sys

import pytest

CONFTEST = """
import sys
sys.path.insert(0, {tests!r})
import patience
from patience import pytest_runtest_protocol
patience.LATE_S, patience.SLOWER, patience.CALM_WITHIN_S = {late}, {slower}, 0

def pytest_configure(config):
    config.addinivalue_line("markers", "clock: of the clock")
"""
TESTS = """
import pytest
tries = dict.fromkeys("abcd", 0)

@pytest.fixture(scope="module")
def made():
    tries["a"] += 1
    assert tries["a"] > 1
    return tries["a"]

def once_more(name):
    tries[name] += 1
    assert tries[name] == 2, f"{name} was played {tries[name]} times"

@pytest.mark.clock
def test_of_a_setup(made, tmp_path):
    once_more("b")

@pytest.mark.clock
def test_that_fails():
    tries["d"] += 1
    assert not tries["d"], f"test_that_fails was played {tries['d']} times"

def test_of_no_clock():
    once_more("c")
"""


@pytest.mark.parametrize("late, slower, count", [(0, 1e9, "1 failed, 1 passed, 1 skipped"), (1e9, 0, "1 failed, 1 passed, 1 skipped"), (1e9, 1e9, "2 failed, 1 error")])
def test_it_plays_again_where_the_machine_was_late_or_slow(root, tmp_path, late, slower, count):
    (tmp_path / "conftest.py").write_text(CONFTEST.format(tests=str(root / "tests"), late=late, slower=slower))
    (tmp_path / "test_some.py").write_text(TESTS)
    run = subprocess.run([sys.executable, "-m", "pytest", "-q", "-rs", "-p", "no:cacheprovider", "-p", "no:xdist", tmp_path], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    out_of_time = 0 in (late, slower)
    assert run.returncode == 1 and count in run.stdout, run.stdout
    assert (run.stdout.count("test_that_fails was played 3 times") > 0) == out_of_time, run.stdout
    assert "c was played 1 times" in run.stdout, run.stdout
    assert ("played again" in run.stdout) == ("not judged: each time it failed, the machine" in run.stdout) == out_of_time


SUITE = """
import pathlib
import time
import pytest

def first(name):
    seen = pathlib.Path(__file__).with_name(f"seen-{{name}}")
    was_there = seen.exists()
    seen.touch()
    return not was_there

@pytest.mark.clock
@pytest.mark.xdist_group("devices/some")
@pytest.mark.parametrize("count", range({many}))
def test_beside_others(count):
    assert not first(count)

@pytest.mark.clock
def test_that_fails():
    assert {sound}

def test_that_computes():
    time.sleep(1.1)
    assert {sound} or not first("compute")
"""


@pytest.mark.parametrize("many, sound, late, last", [
    (2, False, 1e9, "2 passed, 2 failed, 0 skipped, 3 retried"), (2, False, 0, "2 passed, 1 failed, 1 skipped, 3 retried"),
    (41, True, 1e9, "2 passed, 41 failed, 0 skipped, 0 retried")])
def test_what_watches_the_clock_is_run_again_by_itself(root, tmp_path, many, sound, late, last):
    """Tests that compute are never repeated, nor are so many that they have another cause."""
    (tmp_path / "tests").mkdir()
    for name in ("conftest.py", "paths.py", "rooms.py"):
        shutil.copy(root / "tests" / name, tmp_path / "tests")
    patience = (root / "tests/patience.py").read_text().replace("LATE_S = 0.05", f"LATE_S = {late}").replace("SLOWER = 2\n", "SLOWER = 1e9\n").replace("CALM_WITHIN_S = 60", "CALM_WITHIN_S = 0")
    (tmp_path / "tests/patience.py").write_text(patience)
    (tmp_path / "tests/test_some.py").write_text(SUITE.format(many=many, sound=sound))
    run = subprocess.run([sys.executable, root / "tests/run.py"], cwd=tmp_path, env={**os.environ, "TM_JOBS": "0", "TM_OUT": str(tmp_path / "build")}, capture_output=True, text=True, timeout=300)
    assert run.stdout.rstrip().endswith(last) and run.returncode == (" 0 failed" not in last), run.stdout
    assert "costliest: 1 s test_some::test_that_computes\nprocessor: " in run.stdout and (tmp_path / "build/tests/clock.xml").exists(), run.stdout
    assert ("retried, by themselves: tests/test_some.py::" in run.stdout) == (many == 2)
