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


@pytest.mark.parametrize("more,said", [
    ("loads:\n  - {name: pull, plane: {point: [0.08, 0, 0], normal: [1, 0, 0]}, force: [0, 0, -1 mN]}\n", "acts on each vertex, so that a finer mesh is loaded more; use 'traction'"),
    ("anisotropy: {rule: file, file: fibres.csv}\n", "tm-mesh refine --fibres")])
def test_scenes_that_a_finer_mesh_changes_are_refused(bin, tmp_path, tip_m, more, said):
    assert re.search(re.escape(said), fit(bin, tmp_path, tip_m, blind.SCENE + more, "--mesh-check", code=2))
