"""`tm-sim --settle` of organs that touch: the shape that a long damped simulation ends in, and the balance of forces."""
import numpy as np
import pytest
from simkit import report, run
from test_series import read_vtu

SCENE = """\
tissue:
  materials:
    "liver.*": {{young: 3 kPa, poisson: 0.4, density: 1050 kg/m3}}
    "gallbladder.*": {{young: 6 kPa, poisson: 0.4}}
bodies:
  liver: {{mesh: {meshes}/liver_1k.msh}}
  gallbladder: {{mesh: {meshes}/gallbladder_1k.msh, move: [0, 0, -18 mm]}}  # apart at rest
damping: {{rate: 40 /s}}
gravity: {{acceleration: [0, 0, -2]}}
contact:
touch: {{friction: {{static: 0, kinetic: 0}}}}
supports:
  - {{name: vena cava, group: liver.vena_cava}}
  - {{name: ligament, group: liver.ligament}}
  - {{name: cystic duct, group: gallbladder.neck}}
instruments:
  - {{mode: probe, radius: 4 mm, trocar: [-20 mm, -80 mm, -240 mm]}}
hand:
  - {{instrument: 0, path: [{{time: 0 s, tip: [-20 mm, -60 mm, {tip_mm} mm]}}]}}
time: {{frame_rate: 25 Hz}}
"""


GRAVITY_M_S2 = 2


def settle(path, bin, tmp_path):
    said = report(bin / "tm-sim", path, "--settle", "1e-8", "--write", tmp_path / "u.csv", tmp=tmp_path)
    return said, np.loadtxt(tmp_path / "u.csv", delimiter=",", skiprows=1)[:, 4:7]


def simulate(path, bin, tmp_path):
    run(bin / "tm-sim", path, "--lockstep", "--duration", "6 s", "--paraview", tmp_path / "series", "--paraview-every", "150")
    return read_vtu(sorted((tmp_path / "series").glob("*.vtu"))[-1])


def weight_N(said, end):
    x = end["Points"]
    a, b, c, d = x[end["connectivity"].reshape(-1, 4)].transpose(1, 0, 2)
    volume = np.abs(np.einsum("ij,ij->i", b - a, np.cross(c - a, d - a))) / 6
    liver = said["bodies"][0]["tets"][1]
    return GRAVITY_M_S2 * (1050 * volume[:liver].sum() + 1000 * volume[liver:].sum())


@pytest.mark.parametrize("tip_mm", [-200, -76])
def test_organs_settle_where_a_simulation_ends_and_supports_bear_them(root, bin, tmp_path, tip_mm):
    """Without and with an instrument that presses against them from below. There the shape depends on its way in."""
    path = tmp_path / "organs.yaml"
    path.write_text(SCENE.format(meshes=root / "meshes", tip_mm=tip_mm))
    said, u = settle(path, bin, tmp_path)
    end = simulate(path, bin, tmp_path)
    tool = said["instruments"][0]
    assert said["touch"]["rows"] >= 3 and said["touch"]["normal_sum_N"] > 0.1 and bool(tool["rows"]) == (tip_mm == -76)
    if not tool["rows"]:
        print("%.1e" % (np.abs(end["displacement_m"] - u).max() / np.abs(u).max()))
        assert np.abs(end["displacement_m"] - u).max() < 1e-4 * np.abs(u).max()
    borne = np.sum([support["reaction_N"] for support in said["supports"]], 0) - tool["force_N"]
    assert np.abs(borne - [0, 0, weight_N(said, end)]).max() < 1e-6 * borne[2]
