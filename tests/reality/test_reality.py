"""The silicone beam on a coarse mesh: fitted values are reproduced, predictions are as accurate as docs/reality.md says."""
import json
import math
import pathlib
import subprocess
import sys

import numpy as np
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "apps/studies/reality"), str(ROOT / "apps/fit")]
import beam  # noqa: E402
import bodies  # noqa: E402
import fitted  # noqa: E402
import samples  # noqa: E402
import swing  # noqa: E402
from trials import Refused, Trials  # noqa: E402


@pytest.fixture(scope="module")
def measured():
    return json.loads((ROOT / "apps/studies/reality/measured.json").read_text())


def test_a_box_is_filled_and_conforming():
    vertex, tets = bodies.box((2, 3, 4), (0.1, 0.03, 0.02))
    edges = vertex[tets[:, 1:]] - vertex[tets[:, :1]]
    volume = np.linalg.det(edges) / 6
    assert volume.min() > 0 and math.isclose(volume.sum(), 6e-5, rel_tol=1e-12)
    faces = np.sort(np.concatenate([np.delete(tets, k, 1) for k in range(4)]), 1)
    count = np.unique(faces, axis=0, return_counts=True)[1]
    assert count.max() == 2 and (count == 1).sum() == 2 * 2 * (2 * 3 + 3 * 4 + 2 * 4)


def test_the_hook_hangs_on_the_edge_with_its_weight(tmp_path, measured):
    of = measured["beam"]
    model = beam.Beam("unused", tmp_path, of)
    scene, regions = model.scene(4, of["load_N"])
    assert regions == ("beam", "hook")
    lines = (tmp_path / "beam_4_0.51.msh").read_text().split("\n")
    nodes, elements = lines.index("$Nodes"), lines.index("$Elements")
    vertex = np.array([line.split()[1:] for line in lines[nodes + 2:nodes + 2 + int(lines[nodes + 1])]], float)
    element = np.array([line.split() for line in lines[elements + 2:elements + 2 + int(lines[elements + 1])]], int)
    tets, hook = element[:, 5:] - 1, element[:, 3] == 2
    volume = np.abs(np.linalg.det(vertex[tets[:, 1:]] - vertex[tets[:, :1]])) / 6
    density = float(scene.read_text().split("hook")[1].split("density: ")[1].split()[0])
    mass, centre = density * volume * hook, vertex[tets].mean(1)
    own = 1070 * 0.1 * 0.03 * 0.03
    total = mass.sum() + 1070 * volume[~hook].sum()
    assert math.isclose(total - own, of["load_N"] / of["gravity_m_s2"], rel_tol=1e-6)
    assert math.isclose((mass @ centre)[0] / mass.sum(), 0.1, rel_tol=1e-9)  # the edge, in the mean of both rows


def test_a_swing_is_read_from_its_curve():
    t = np.arange(0, 2, 0.01)
    x = -6 + 6 * np.exp(-1.5 * t) * np.cos(2 * np.pi * t / 0.23)
    period, decrement = swing.swing(t, x)
    assert math.isclose(period, 0.23, rel_tol=1e-4) and math.isclose(decrement, 1.5 * 0.23, rel_tol=1e-3)


def test_the_mesh_error_is_taken_off():
    h = [1 / 4, 1 / 6, 1 / 9]
    value, order = bodies.without_mesh_error(h, [7 - 3 * x**1.8 for x in h])
    assert math.isclose(value, 7, rel_tol=1e-6) and math.isclose(order, 1.8, rel_tol=1e-4)


def test_one_load_predicts_the_other(bin, tmp_path, measured):
    """Fails if mass, weight, hook, viscosity or the equilibrium of viscous tissue is off by more than docs/reality.md states."""
    of, meshes = measured["beam"], (3, 4, 6)
    model = beam.Beam(bin / "tm-sim", tmp_path, of)
    apart = np.mean([np.subtract(of["weight"]["rest_mm"][m], of["loaded"]["rest_mm"][m]) for m in beam.MARKERS])
    young_Pa = 213e3
    rest = {load: np.mean(model.rest(load, young_Pa, 0.49, meshes)[0]) for load in (0.0, of["load_N"])}
    assert abs((rest[of["load_N"]] - rest[0.0]) / apart - 1) < 0.05
    terms = beam.spectrum(0.0407, 0.0993)
    period, decrement = model.swings(0.0, young_Pa, 0.49, 3, terms, 0.8)
    assert abs(period / np.mean(of["weight"]["period_s"]) - 1) < 0.03
    assert abs(decrement / np.mean(of["weight"]["decrement"]) - 1) < 0.10


def test_the_hook_of_a_fitted_beam_weighs_as_much_as_its_load(tmp_path, measured):
    """Fails if load, mass of the beam's own part, or the table for tm-fit is wrong."""
    of = measured["beam"]
    body = fitted.FittedBeam(None, tmp_path, of, 3)
    part_kg = of["authors"]["density_kg_m3"] * body.volume / 2
    assert math.isclose(body.hook(0.51) * body.volume - part_kg, 0.51 / of["gravity_m_s2"], rel_tol=1e-9) and math.isclose(body.hook(0) * body.volume, part_kg)
    weight, loaded = fitted.measured_rows(of)
    lines = body.table("t.csv", [(0.0, [0.0] * 3, None, None), loaded]).read_text().split("\n")
    assert lines[0] == "hook_kg_m3,m0_m,m1_m,m2_m,period_s,decrement" and lines[1].endswith(",0,0,0,,") and lines[2].split(",")[4] == "0.232"
    assert math.isclose(-1e3 * np.mean(loaded[1]), 10.69, abs_tol=0.01) and weight[2] < loaded[2]


def test_a_strip_has_its_modulus_at_small_strain_and_its_curve(bin, tmp_path, measured):
    """Its grips share vertices with planes of symmetry: each support's force is that of the components that it fixes."""
    assert abs(samples.strip(bin / "tm-sim", tmp_path, "law: neo-hooke", [1.001])[0] / 100 - 1) < 0.005
    of = measured["ecoflex"]
    middle, near, far = samples.strip(bin / "tm-sim", tmp_path, "law: neo-hooke", [1.5, 1.25, 2.0])
    scale = of["stress_kPa"][2] / middle
    assert abs(scale * near / of["stress_kPa"][1] - 1) < 0.05 and abs(scale * far / of["stress_kPa"][3] - 1) < 0.05


def test_trials_answer_in_order_and_refuse_by_name(bin, tmp_path, measured):
    scene, _ = beam.Beam("unused", tmp_path, measured["beam"]).scene(2, 0.0)
    with Trials(bin / "tm-sim", scene) as trials:
        point = [[0.1, 0.0, 0.03]]
        soft, hard = (trials.ask([f"tissue.materials.beam.young={e}"], settle=1e-9, points_m=point)["points_m"][0][0][2] for e in (1e5, 2e5))
        assert soft < hard < 0 and abs(soft / hard - 2) < 0.02
        again = trials.ask(["tissue.materials.beam.young=1e5"], settle=1e-9, points_m=point)
        cold = trials.ask(["tissue.materials.beam.young=1e5"], settle=1e-9, points_m=point, cold=True)
        assert math.isclose(again["points_m"][0][0][2], cold["points_m"][0][0][2], rel_tol=1e-7)
        assert math.isclose(cold["supports_N"][0][0][2], 1070 * 9e-5 * 9.80709, rel_tol=1e-6)
        with pytest.raises(Refused, match="unknown key 'yung'"):
            trials.ask(["tissue.materials.beam.yung=1e5"], settle=1e-9)
        with pytest.raises(Refused, match="neither or both of 'settle' and 'duration'"):
            trials.ask()
        moved = trials.ask(duration_s=0.05, points_m=point)
        assert len(moved["time_s"]) == 6 and moved["points_m"][0] == [[0, 0, 0]] and moved["points_m"][5][0][2] < 0


def test_a_file_of_requests_that_is_not_there_is_refused(bin, tmp_path, measured):
    scene, _ = beam.Beam("unused", tmp_path, measured["beam"]).scene(2, 0.0)
    done = subprocess.run([bin / "tm-sim", scene, "--trials", tmp_path / "none"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and "none: cannot be read" in done.stderr and "; " in done.stderr
