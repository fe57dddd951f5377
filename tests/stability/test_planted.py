"""Planted faults: each known fault, switched in by a test-only flag, must turn the named tests red. A suite that stays green would not have caught it."""
import os
import subprocess

import pytest
from paths import BUILD, ROOT

# fault: (flag, test program, test in it that must fail)
FAULTS = {
    "one block's sign on removal": ("PLANT_REMOVAL=1", "physics/test_cut", "twenty_orders"),
    "the unsigned ratio of `position`": ("PLANT_UNSIGNED=1", "loop/test_extrapolate", "reversal"),
    "the sign of gamma": ("PLANT_GAMMA=1", "physics/test_motion", "one_free_vertex"),
    "eq. 12's factor": ("PLANT_EQ12=1", "physics/test_oracle", "isotropic"),
    "h_min/c as the step": ("PLANT_H_MIN=1", "physics/test_tissue", "critical_steps"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_is_caught(fault, once):
    flag, program, name = FAULTS[fault]

    def build(folder):
        out = folder / "build"
        run = subprocess.run(["make", "--no-print-directory", "config=release", f"BUILD={out}", f"VENV={BUILD / 'venv'}", f"CFLAGS_EXTRA=-D{flag}",
                              "OPT_release=-O1 -DNDEBUG", f"{out}/tests/{program}"], cwd=ROOT, capture_output=True, text=True, timeout=600)
        assert run.returncode == 0, run.stdout + run.stderr

    folder = once("planted-" + flag.split("=")[0], build)
    env = dict(os.environ, TM_ROOT=str(ROOT), TM_OUT=str(BUILD))
    run = subprocess.run([folder / "build/tests" / program], cwd=ROOT, env=env, capture_output=True, text=True, timeout=600)
    assert run.returncode not in (0, 77), f"{program} did not notice: {fault}"
    failed = {line.split("]", 1)[1].split()[0] for line in (run.stdout + run.stderr).splitlines() if line.startswith("[  FAILED  ]") and "test(s)" not in line}
    assert name in failed, failed
