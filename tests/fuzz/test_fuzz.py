"""Short fuzzing in every check: some thousand inputs a target, from the committed seeds and findings; TM_LONG=1: every target, a minute each."""
import fcntl
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys

import pytest

HERE = pathlib.Path(__file__).resolve().parent
TARGETS = sorted(p.stem for p in HERE.glob("fuzz_*.c"))
INPUTS = {"fuzz_mesh_text": 20000, "fuzz_mesh": 4000, "fuzz_sample": 1500, "fuzz_tables": 3000, "fuzz_can": 1500,
          "fuzz_lcm": 1500, "fuzz_receiver": 4000, "fuzz_scene": 400, "fuzz_snapshot": 150}
# They alone need the solving library, a third of the build, which tests/solve runs under the same sanitizers in every check.
SOLVING = ("fuzz_calls", "fuzz_responses")


@pytest.fixture(scope="session")
def fuzz_build(build, root, long_run):
    """build/fuzz, made with clang and its sanitizers; one make at a time."""
    assert shutil.which("clang"), "clang is not installed; make check installs it"
    base = build.parent if build.name in ("debug", "asan", "tsan", "clang") else build
    base.mkdir(exist_ok=True)
    env = {k: v for k, v in os.environ.items() if not k.startswith("MAKE") and k != "MFLAGS"}
    programs = ["fuzz-programs"] if long_run else [f"{base}/fuzz/tests/fuzz/{target}" for target in TARGETS if target not in SOLVING]
    with open(base / "fuzz.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        made = subprocess.run(["make", "-C", str(root), "--no-print-directory", "config=fuzz", f"BUILD={base}", "-j2", *programs], env=env,
                              capture_output=True, text=True, timeout=1200)
    assert made.returncode == 0, (made.stdout + made.stderr)[-4000:]
    return base / "fuzz"


def test_every_target_is_run():
    listed = set(re.findall(r"fuzzer,(fuzz_\w+),", (HERE / "module.mk").read_text()))
    assert listed == set(TARGETS) == {*INPUTS, *SOLVING}
    for target in TARGETS:
        assert any((HERE / "corpus" / target).iterdir()), f"{target} has no seeds"


@pytest.mark.parametrize("target", [pytest.param(target, marks=pytest.mark.long) if target in SOLVING else target for target in TARGETS])
def test_no_input_breaks_a_promise(target, fuzz_build, long_run, tmp_path):
    out = tmp_path / "fuzz"
    (out / "tests").mkdir(parents=True)
    (out / "tests" / "fuzz").symlink_to(fuzz_build / "tests" / "fuzz")
    (out / "lib").symlink_to(fuzz_build / "lib")
    how = ["--seconds", "60"] if long_run else ["--runs", str(INPUTS[target])]
    run = subprocess.run([sys.executable, str(HERE / "run.py"), "--build", str(out), "--jobs", "1", *how, target], capture_output=True, text=True, timeout=900)
    assert run.returncode == 0, run.stdout + run.stderr[-6000:]
    result = json.loads((out / "fuzz.json").read_text())["targets"][target]
    assert result["inputs"] >= (1 if long_run else INPUTS[target]) and result["edges_covered"] > 50, result
