"""tests/patience.py and tests/run.py: what is played again, and that nothing is pardoned on a machine in time, nor what fails by itself too."""
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
    config.addinivalue_line("markers", "alone: of the clock")
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

@pytest.mark.alone
def test_of_a_setup(made, tmp_path):
    once_more("b")

@pytest.mark.alone
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


ONCE_MORE = """
import pathlib
import pytest

@pytest.mark.parametrize("count", range({many}))
def test_beside_others(count):
    seen = pathlib.Path(__file__).with_name(f"seen-{{count}}")
    first = not seen.exists()
    seen.touch()
    assert not first

def test_that_fails():
    assert {sound}
"""


@pytest.mark.parametrize("many, sound, last", [(2, False, "2 passed, 1 failed, 0 skipped"), (9, True, "1 passed, 9 failed, 0 skipped")])
def test_what_failed_beside_others_runs_once_more(root, tmp_path, many, sound, last):
    (tmp_path / "tests").mkdir()
    for name in ("conftest.py", "paths.py", "patience.py"):
        shutil.copy(root / "tests" / name, tmp_path / "tests")
    (tmp_path / "tests/test_some.py").write_text(ONCE_MORE.format(many=many, sound=sound))
    run = subprocess.run([sys.executable, root / "tests/run.py"], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert run.stdout.rstrip().endswith(last) and run.returncode == (" 0 failed" not in last), run.stdout
    assert ("once more, by themselves: tests/test_some.py::" in run.stdout) == (many == 2)
