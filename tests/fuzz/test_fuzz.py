"""Short fuzzing in every check: some thousand inputs per target from the committed seeds and findings, and unguided mutations of them. TM_LONG=1:
guided by coverage, a minute each."""
import json
import pathlib
import re
import shutil
import subprocess
import sys

import pytest

HERE = pathlib.Path(__file__).resolve().parent
TARGETS = sorted(p.stem for p in HERE.glob("fuzz_*.c"))
INPUTS = {"fuzz_mesh_text": 20000, "fuzz_mesh": 20000, "fuzz_sample": 15000, "fuzz_tables": 20000, "fuzz_can": 3000, "fuzz_lcm": 6000, "fuzz_receiver": 20000,
          "fuzz_scene": 1500, "fuzz_snapshot": 1000, "fuzz_responses": 300, "fuzz_calls": 50}


@pytest.fixture(scope="session")
def fuzz_build(make_config, long_run):
    """A minute each: built for coverage, which guides the fuzzer. Some thousand inputs each: linked to the AddressSanitizer build, which exists
    anyway."""
    assert shutil.which("clang"), "clang is not installed; make check installs it"
    return make_config("fuzz" if long_run else "asan", "fuzz-programs")


def test_every_target_is_run():
    listed = {name for names in re.findall(r"fuzzer,([^,]+),", (HERE / "module.mk").read_text()) for name in names.split() if name.startswith("fuzz_")}
    assert listed == set(TARGETS) == set(INPUTS)
    for target in TARGETS:
        assert any((HERE / "corpus" / target).iterdir()), f"{target} has no seeds"


@pytest.mark.parametrize("target", TARGETS)
def test_no_input_violates_a_property(target, fuzz_build, long_run, tmp_path):
    out = tmp_path / "fuzz"
    (out / "tests").mkdir(parents=True)
    (out / "tests" / "fuzz").symlink_to(fuzz_build / "tests" / "fuzz")
    (out / "lib").symlink_to(fuzz_build / "lib")
    how = ["--seconds", "60"] if long_run else ["--runs", str(INPUTS[target])]
    run = subprocess.run([sys.executable, str(HERE / "run.py"), "--build", str(out), "--jobs", "1", *how, target], capture_output=True, text=True, timeout=900)
    assert run.returncode == 0, run.stdout + run.stderr[-6000:]
    result = json.loads((out / "fuzz.json").read_text())["targets"][target]
    # Without coverage of the library, the edges are the target's own.
    assert result["inputs"] >= (1 if long_run else INPUTS[target]) and result["edges_covered"] > (50 if long_run else 15), result
