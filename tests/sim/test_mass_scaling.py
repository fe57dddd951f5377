"""time.mass_scaling of a scene: reaches the step, --explain reports the cost, and impossible values are rejected with their line."""
import pytest
from simkit import block_scene, report, run

ASKED = "cut:\ncontact:\ngravity:\ntime: {{step: {} ms, mass_scaling: yes{}}}\ninstruments:\n  - {{trocar: [50 mm, 50 mm, 200 mm], mode: cautery}}\n"


def test_a_longer_step_with_its_price_told(bin, root, tmp_path):
    scene = block_scene(tmp_path, root, ASKED.format(1, ""), mesh="block_10k.msh")
    own = report(bin / "tm-sim", scene, "--explain", "--unset", "time", tmp=tmp_path)
    step = own["critical_step"]["guaranteed_s"]
    assert "mass_scaling" not in own
    asked = ["--set", f"time.step={1.05 * step}", "--set", "time.mass_scaling_max=0.5"]
    scaled = report(bin / "tm-sim", scene, "--explain", *asked, tmp=tmp_path)
    m = scaled["mass_scaling"]
    assert step < scaled["dt_s"] <= scaled["critical_step"]["guaranteed_s"] == pytest.approx(1.05 * step)
    assert 0 < m["added_kg"] <= 0.2 * m["physical_kg"] and m["max_factor"] > 1 and m["vertices"] > 100
    assert sum(r["physical_kg"] for r in m["regions"]) == pytest.approx(m["physical_kg"]) and sum(r["added_kg"] for r in m["regions"]) == pytest.approx(m["added_kg"])
    assert all(0.8 * a < b < a for a, b in zip(m["own_frequency_Hz"], m["frequency_Hz"]))
    text, _ = run(bin / "tm-sim", scene, "--explain", *asked)
    assert "mass scaling:" in text and "lowest frequencies" in text and "set by time.mass_scaling" in text
    text, _ = run(bin / "tm-sim", scene, "--explain", "--unset", "time")
    assert "set by tetrahedron" in text


@pytest.mark.parametrize("step, more, extra, line, words", [
    (4, "", "", 11, "physical mass"),
    (1, ", mass_scaling_max: 2", "model: precomputed\n", 11, "dynamic model"),
])
def test_invalid_mass_scaling_is_refused(bin, root, tmp_path, step, more, extra, line, words):
    scene = block_scene(tmp_path, root, ASKED.format(step, more) + extra)
    _, err = run(bin / "tm-sim", scene, "--check", code=2)
    assert f"scene.yaml:{line}: " in err and words in err, err


def test_goes_with_tissue_that_turns_and_averages(bin, root, tmp_path):
    scene = block_scene(tmp_path, root, ASKED.format(1, "") + "rotation:\nstrain_smoothing:\nviscosity: {terms: [{time: 1 s, shear: 0.5}]}\n")
    step = report(bin / "tm-sim", scene, "--explain", "--unset", "time", tmp=tmp_path)["critical_step"]["guaranteed_s"]
    scaled = report(bin / "tm-sim", scene, "--frames", "5", "--lockstep", "--set", f"time.step={1.2 * step}", "--set", "time.mass_scaling_max=1", tmp=tmp_path)
    assert step < scaled["dt_s"] <= scaled["critical_step"]["guaranteed_s"] == pytest.approx(1.2 * step)


@pytest.mark.parametrize("time, words", [("{mass_scaling: yes}", "needs time.step"), ("{mass_scaling_max: 0.1}", "needs mass scaling")])
def test_mass_scaling_reports_its_requirements(bin, root, tmp_path, time, words):
    scene = block_scene(tmp_path, root, f"time: {time}\n")
    _, err = run(bin / "tm-sim", scene, "--check", code=2)
    assert "scene.yaml:8: " in err and words in err, err
