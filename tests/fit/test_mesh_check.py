"""`tm-fit --mesh-check`: a beam of 24 x 16 mm on a coarse mesh, fitted to its bending downwards; sideways it is bent by another length of the section, so that the
mesh's error does not cancel. Truth: ten-node tetrahedra of the independent code."""
import json
import re
import subprocess
import sys

import numpy as np
import pytest
from paths import ROOT

sys.path[:0] = [str(ROOT / "tests/fit")]
import test_blind as blind  # noqa: E402

SIZE, DOWN, SIDE = (0.08, 0.024, 0.016), (0.0, 0.0, -9.81), (0.0, -9.81, 0.0)
TRUE = {"mu": blind.TRUE["mu"], "lambda": blind.TRUE["lambda"]}


@pytest.fixture(scope="module")
def tip_m():
    """Displacements of the tip under both loads."""
    solver = blind.law_solver
    block = solver.Block(SIZE, (8, 2, 2), 2)
    load = np.zeros(len(block.rest))
    for n in range(10):
        np.add.at(load, block.tet[:, n], blind.DENSITY * block.weight.sum(1) * blind.integral(n))
    fixed = np.array([3 * v + a for v in np.flatnonzero(block.rest[:, 0] < 1e-9) for a in range(3)])
    at = int(np.linalg.norm(block.rest - np.array((0.08, 0.012, 0.008)), axis=1).argmin())
    rests = {g: next(solver.follow(block, solver.neo_hooke, TRUE, lambda t: (fixed, np.zeros(len(fixed))), [1.0], load[:, None] * np.array(g), first=0.5))[1] for g in (DOWN, SIDE)}
    return {g: u[at] for g, u in rests.items()}


def fit(bin, folder, tip_m, scene=blind.SCENE, *more, code=0):
    blind.bodies.write_mesh(folder / "beam.msh", *blind.bodies.box((10, 3, 2), SIZE))
    (folder / "beam.yaml").write_text(scene.replace("poisson: 0.47", "poisson: 0.45"))
    for name, g in (("down", DOWN), ("side", SIDE)):
        (folder / f"{name}.csv").write_text("gy,gz,tip_y_m,tip_z_m\n" + ",".join(map(str, g[1:])) + f",{tip_m[g][1] if g is SIDE else ''},{tip_m[g][2] if g is DOWN else ''}\n")
    done = subprocess.run([bin / "tm-fit", folder / "beam.yaml", "-o", folder / "fit", "--data", folder / "down.csv", "--predict", folder / "side.csv", "--row", "gravity.acceleration=[0, {gy}, {gz}]",
                           "--fit", "tissue.materials.*.young=40 kPa..400 kPa", "--point", "tip=0.08,0.012,0.008", "--compare", "tip_y_m=point tip y", "--compare", "tip_z_m=point tip z",
                           "--quiet", *more], capture_output=True, text=True, timeout=300)
    assert done.returncode == code, done.stderr
    return done.stdout + done.stderr


def test_constants_and_predictions_lose_the_error_of_the_mesh(bin, tmp_path, tip_m):
    said = fit(bin, tmp_path, tip_m, blind.SCENE, "--mesh-check")
    print(said)
    found = json.loads((tmp_path / "fit/fit.json").read_text())
    check, young, side = found["mesh_check"], found["constants"][0]["value"], found["predicted"][0]
    column = side["columns"].index("tip_y_m")
    plain, limit = (side[key][0][column] / side["measured"][0][column] - 1 for key in ("simulated", "without_mesh"))
    assert check["refined"] == 8 * check["tets"] and "without it: tissue.materials.*.young = " in said and "without the mesh's error" in said
    assert abs(plain) > 0.1 and abs(limit) < 0.02, (plain, limit)
    assert abs(young / 150 - 1) > 0.2 and abs(check["values"][0] / 150 - 1) < 0.06, (young, check["values"])


def test_a_force_on_each_vertex_is_refused(bin, tmp_path, tip_m):
    pull = "loads:\n  - {name: pull, plane: {point: [0.08, 0, 0], normal: [1, 0, 0]}, force: [0, 0, -1 mN]}\n"
    said = "acts on each vertex, so that a finer mesh is loaded more; use 'total' or 'traction'"
    assert re.search(re.escape(said), fit(bin, tmp_path, tip_m, blind.SCENE + pull, "--mesh-check", code=2))


FIBRED = """title: A fibred cantilever
tissue:
  mesh: beam.msh
  materials:
    "*": {young: 100 kPa, poisson: 0.4, law: holzapfel, k1: 40 kPa, k2: 0.5}
anisotropy: {file: fibres.csv}
supports:
  - {name: wall, plane: {point: [0, 0, 0], normal: [1, 0, 0]}}
loads:
  - {name: tip, plane: {point: [0.08, 0, 0], normal: [1, 0, 0]}, total: [0, 0, -1 mN]}
"""


def test_total_forces_and_fibres_of_a_file_are_carried_to_the_finer_mesh(bin, tmp_path):
    """Fibres turn along the beam. The finer mesh has those of a file made for it by hand, and the same load."""
    points, tets = blind.bodies.box((6, 2, 2), SIZE)
    blind.bodies.write_mesh(tmp_path / "beam.msh", points, tets)

    def write_fibres(path, rows):
        path.write_text("tet,ax,ay,az\n" + "".join(f"{i},{a[0]:.9g},0,{a[2]:.9g}\n" for i, a in enumerate(rows)))
    angle = np.array(points)[np.array(tets)].mean(1)[:, 0] / SIZE[0]
    fibres = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], 1)
    write_fibres(tmp_path / "fibres.csv", fibres)
    (tmp_path / "beam.yaml").write_text(FIBRED)
    (tmp_path / "pull.csv").write_text("pull_N,tip_m\n0.02,-0.0008\n0.05,-0.0019\n0.1,-0.0036\n")
    done = subprocess.run([bin / "tm-fit", tmp_path / "beam.yaml", "-o", tmp_path / "fit", "--data", tmp_path / "pull.csv", "--row", "loads[0].total=[0, 0, -{pull_N}]", "--quiet", "--mesh-check",
                           "--fit", "tissue.materials.*.young=10 kPa..900 kPa", "--point", "tip=0.08,0.012,0.008", "--compare", "tip_m=point tip z"], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0 and "mesh check: refined from 144 to" in done.stdout, done.stdout + done.stderr
    made = np.loadtxt(tmp_path / "fit/mesh_check.csv", delimiter=",", skiprows=1)[:, 1:]
    assert len(made) == json.loads((tmp_path / "fit/fit.json").read_text())["mesh_check"]["refined"]
    assert all(np.abs(fibres @ a).max() > 1 - 1e-6 for a in made[::17])  # each part has its parent's


def test_a_total_force_does_not_depend_on_the_mesh(bin, tmp_path):
    """An uneven face: the support bears the total, at the middle of the face, where equal forces on vertices would not be."""
    points, tets = blind.bodies.box((4, 3, 3), SIZE)
    points = [(x, SIZE[1] * (y / SIZE[1]) ** 2, z) for x, y, z in points]
    blind.bodies.write_mesh(tmp_path / "beam.msh", points, tets)
    (tmp_path / "beam.yaml").write_text(FIBRED.replace(", law: holzapfel, k1: 40 kPa, k2: 0.5", "").replace("anisotropy: {file: fibres.csv}\n", ""))

    def rest(*sets):
        words = [w for s in sets for w in ("--set", s)]
        done = subprocess.run([bin / "tm-sim", tmp_path / "beam.yaml", "--settle", "1e-10", "--write", tmp_path / "rest.csv", *words], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        rows = np.loadtxt(tmp_path / "rest.csv", delimiter=",", skiprows=1)
        return rows[:, 7:10].sum(0), np.cross(rows[:, 1:4], rows[:, 7:10]).sum(0)
    force, moment = rest()
    pull = np.array((0, 0, -1e-3))
    assert np.abs(force + pull).max() < 1e-11 and np.abs(moment + np.cross((0.08, 0.012, 0.008), pull)).max() < 1e-12
    force, moment = rest("loads[0].plane.point=[0.08, 0, 0]", "loads[0].plane.normal=[0, 1, 1]")  # an edge of the base has no triangle
    assert np.abs(force + pull).max() < 1e-11
