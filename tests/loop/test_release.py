"""A grasper that releases: the force falls to zero and stays there, for every extrapolator. While the jaws open, the force falls without motion;
extrapolators that mistook this for stiffness once pulled with 1 N (position) and 8 N (broyden)."""
import csv
import math
import subprocess

import pytest
from paths import LONG


@pytest.mark.parametrize("extrapolator", ["hold", "position", "broyden", "tangent", "local_model"] if LONG else ["position", "broyden"])
def test_force_falls_after_the_jaws_open(bin, root, tmp_path, extrapolator):
    out = tmp_path / "ticks.csv"
    run = subprocess.run([bin / "tm-sim", root / "apps" / "scenes" / "liver-cut.yaml", "--lockstep", "--duration", "9 s", "--set",
                          f"haptics.extrapolator={extrapolator}", "--csv", out], capture_output=True, text=True, timeout=900)
    assert run.returncode == 0, run.stderr
    with open(out) as file:
        rows = [(float(r["time_s"]), math.dist((0, 0, 0), [float(r[k]) for k in ("fx_N", "fy_N", "fz_N")])) for r in csv.DictReader(file) if r["instrument"] == "0"]
    held = max(f for t, f in rows if 7.8 < t < 8.0)
    after = [f for t, f in rows if t >= 8.0]
    assert held > 0.3
    assert max(after) < 1.03 * held
    assert max(b - a for a, b in zip(after, after[1:])) < 0.02
    assert after[-1] == 0
