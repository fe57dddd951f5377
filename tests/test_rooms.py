"""tests/rooms.py: every test is in one component, and every row matches an existing test."""
import shutil
import subprocess
import sys

import pytest
import rooms
from paths import ROOT

TESTS = ROOT / "tests"


def test_every_row_is_of_a_test_that_is_there():
    files = [p.relative_to(TESTS).as_posix() for p in TESTS.rglob("test_*") if p.suffix in (".py", ".c")]
    names = [f"{f}::{line.split('(')[0][4:]}" for f in files if f.endswith(".py") for line in (TESTS / f).read_text().splitlines() if line.startswith("def test_")]
    names += [f[:-2] for f in files if f.endswith(".c")]
    rows = {*rooms.IN, *rooms.CLOCK, *rooms.TOGETHER, *rooms.LEFTOVER, *rooms.PLAIN, *rooms.PLAIN_OF_TSAN}
    assert not [row for row in rows if not any(name.startswith(row) for name in names)]
    assert set(rooms.IN.values()) == set(rooms.ROOMS) and not [name for name in names if not rooms.room_of(name)]


@pytest.mark.parametrize("name, mark, says", [("attic/test_new.py", "", "attic/test_new.py::test_some is in no room"), ("unit/test_new.py", "@pytest.mark.clock", "is in unit, and watches the clock"),
                                              ("unit/test_new.py", "", None)])
def test_a_test_without_a_room_is_refused(root, tmp_path, name, mark, says):
    for file in ("conftest.py", "paths.py", "patience.py", "rooms.py"):
        (tmp_path / "tests").mkdir(exist_ok=True)
        shutil.copy(TESTS / file, tmp_path / "tests")
    (tmp_path / "tests" / name).parent.mkdir()
    (tmp_path / "tests" / name).write_text(f"import pytest\n\n{mark}\ndef test_some():\n    pass\n")
    run = subprocess.run([sys.executable, "-m", "pytest", "tests", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--room", "unit"], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert says in run.stdout + run.stderr if says else run.returncode == 0, run.stdout + run.stderr
    assert (run.returncode == 0) == (says is None)
