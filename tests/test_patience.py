"""tests/patience.py: what it plays again, and that it pardons nothing on a machine in time."""
import subprocess
import sys

import pytest

CONFTEST = """
import sys
sys.path.insert(0, {tests!r})
import patience
from patience import pytest_runtest_protocol
patience.LATE_S, patience.CALM_WITHIN_S = {late}, 0

def pytest_configure(config):
    config.addinivalue_line("markers", "alone: of the clock")
"""
TESTS = """
import pytest
tries = dict.fromkeys("abc", 0)

@pytest.fixture(scope="module")
def made():
    tries["a"] += 1
    assert tries["a"] > 1
    return tries["a"]

def once_more(name):
    tries[name] += 1
    assert tries[name] == 2, f"{name} was played {tries[name]} times"

@pytest.mark.alone
def test_of_a_setup(made, tmp_path):
    once_more("b")

@pytest.mark.alone
def test_that_fails():
    print("played")
    assert False

def test_of_no_clock():
    once_more("c")
"""


@pytest.mark.parametrize("late, count, played", [(0, "2 failed, 1 passed", 3), (1e9, "2 failed, 1 error", 1)])
def test_it_plays_again_where_the_machine_was_late(root, tmp_path, late, count, played):
    (tmp_path / "conftest.py").write_text(CONFTEST.format(tests=str(root / "tests"), late=late))
    (tmp_path / "test_some.py").write_text(TESTS)
    run = subprocess.run([sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", tmp_path], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert run.returncode == 1 and count in run.stdout.replace("4 warnings, ", ""), run.stdout
    assert run.stdout.count("\nplayed\n") == played and "c was played 1 times" in run.stdout, run.stdout
    assert ("played again" in run.stdout) == (late == 0)
