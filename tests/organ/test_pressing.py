"""Random pressing on a mesh of tm-mesh image: no failure verdict of `make stability`. An hour in the long form."""
import subprocess
import sys

import numpy as np
import pytest

sys.path[:0] = ["tests/mesh", "tests/organ"]
import pressing  # noqa: E402


def made(bin, folder, budget):
    import phantom
    phantom.write(folder / "seg.nii.gz", phantom.phantom((5, 5, 5)), (5, 5, 5))
    for words in (["tm-mesh", "image", folder / "seg.nii.gz", "--budget", budget, "--label", "1=liver", "--label", "3=tumour", "--label", "4=ribs", "-o", folder / "organ.msh"],
                  ["tm-scene", "new", "--up", "-y", folder / "organ.msh"]):
        subprocess.run([bin / words[0], *words[1:]], check=True, capture_output=True, timeout=400)
    return folder / "organ.yaml"


def test_random_pressing(bin, image_module, tmp_path):
    said = pressing.press(bin, made(bin, tmp_path, "2500"), 1, 15, tmp_path)
    assert said["verdict"] == "stable" and said["waypoints"] > 12, said


@pytest.mark.parametrize("what, energy, tick", [
    ("stable", {}, {}), ("not finite", {}, {"fy_N": np.nan}), ("above the device's limit", {}, {"fx_N": 9.0}), ("latched a fault", {}, {"fault": 3}),
    ("more energy than the hand put in", {"generated_J": 1.2}, {}), ("does not close", {"residual_J": -1e-3}, {}), ("not at rest", {"kinetic_J": 1e-3}, {})])
def test_verdict_detects_planted_failures(what, energy, tick):
    rows = np.zeros(100, [(n, float) for n in ("fx_N", "fy_N", "fz_N", "fault")])
    rows["fz_N"][:60] = 0.5
    for name, value in tick.items():
        rows[name][50] = value
    figures = {"sim_s": 15.0, "compute_s": 1.0, "energy": {"tool_work_J": [1.0], "generated_J": 0.3, "drag_J": 0.8, "kinetic_J": 0.0, "elastic_J": 0.0, "residual_J": 0.0, **energy}}
    assert what in pressing.judged(figures, rows, 15)["verdict"]
    assert "ended early" in pressing.judged(figures, rows, 20)["verdict"]
    rows["fz_N"] = 0
    assert "nothing was felt" in pressing.judged(figures, rows, 15)["verdict"]


@pytest.mark.parametrize("seed", range(1, 7))
@pytest.mark.long
def test_an_hour_of_random_pressing(bin, image_module, once, tmp_path, seed):
    scene = once("pressed-organ", lambda folder: made(bin, folder, "3000")) / "organ.yaml"
    said = pressing.press(bin, scene, seed, 600, tmp_path)
    print(said)
    assert said["verdict"] == "stable" and said["waypoints"] > 500, said
