"""A blind test: a body that an independent code simulates, of another law and mesh, with 1 % noise. tm-fit gets one load and predicts three others and the
period after a release: within 5 % and 3 %."""
import itertools
import json
import math
import pathlib
import subprocess
import sys

import numpy as np
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / f) for f in ("apps/fit", "apps/studies/reality", "apps/studies/accuracy/reference")]
import bodies  # noqa: E402
import law_solver  # noqa: E402

SIZE, DENSITY, YOUNG, POISSON = (0.08, 0.02, 0.016), 1050.0, 150e3, 0.45
TRUE = {"mu": YOUNG / 2 / (1 + POISSON), "lambda": YOUNG * POISSON / (1 + POISSON) / (1 - 2 * POISSON), "second": 0.5}
FITTED, OTHERS = (0.0, 0.0, -9.81), ((0.0, 0.0, -4.0), (0.0, 0.0, -16.0), (0.0, -9.81, 0.0))
SCENE = """title: A cantilever by its user, who knows size and weight
tissue:
  mesh: beam.msh
  materials:
    "*": {young: 100 kPa, poisson: 0.47, density: 1050 kg/m3, law: neo-hooke}
strain_smoothing:
gravity: {acceleration: [0, 0, 0]}
supports:
  - {name: clamp, plane: {point: [0, 0, 0], normal: [1, 0, 0]}}
time: {frame_rate: 200 Hz}
"""


def integral(a, b=None):
    """Returns the integral over a unit volume of the product of two shape functions of a ten-node tetrahedron, or of one."""
    def shape(n):
        if n < 4:
            power = np.eye(4, dtype=int)[n]
            return [(2.0, 2 * power), (-1.0, power)]
        i, j = law_solver.PAIRS[n - 4]
        return [(4.0, np.eye(4, dtype=int)[i] + np.eye(4, dtype=int)[j])]
    terms = [(p * q, x + y) for (p, x), (q, y) in itertools.product(shape(a), shape(b) if b is not None else [(1.0, np.zeros(4, int))])]
    return sum(c * 6 * math.prod(map(math.factorial, x)) / math.factorial(int(x.sum()) + 3) for c, x in terms)


@pytest.fixture(scope="module")
def measured():
    """Displacements of the tip and the middle under each load, m, and the period about the rest under the fitted one, s."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.linalg import eigsh
    block = law_solver.Block(SIZE, (8, 2, 2), 2)
    volume = block.weight.sum(1)
    load = np.zeros(len(block.rest))
    for n in range(10):
        np.add.at(load, block.tet[:, n], DENSITY * volume * integral(n))
    fixed = np.array([3 * v + a for v in np.flatnonzero(block.rest[:, 0] < 1e-9) for a in range(3)])
    free = np.setdiff1d(np.arange(block.rest.size), fixed)
    at = [int(np.linalg.norm(block.rest - np.array(p), axis=1).argmin()) for p in ((0.08, 0.01, 0.008), (0.04, 0.01, 0.008))]
    found = {}
    for g in (FITTED, *OTHERS):
        (_, u, _, _), = law_solver.follow(block, law_solver.mooney_rivlin, TRUE, lambda t: (fixed, np.zeros(len(fixed))), [1.0], load[:, None] * np.array(g), first=0.25)
        found[g] = u[at]
        if g == FITTED:
            mass = np.array([[integral(i, j) for j in range(10)] for i in range(10)])
            rows, columns = (np.repeat(block.tet, 10, 1), np.tile(block.tet, (1, 10)))
            values = DENSITY * volume[:, None] * mass.ravel()
            M = sum(coo_matrix((values.ravel(), (3 * rows.ravel() + a, 3 * columns.ravel() + a)), shape=(block.rest.size,) * 2) for a in range(3)).tocsr()
            K = block.stiffness(law_solver.mooney_rivlin, TRUE, u)
            period_s = 2 * np.pi / np.sqrt(eigsh(K[free][:, free].tocsc(), 1, M[free][:, free].tocsc(), sigma=0)[0][0])
    assert np.isclose(load.sum(), DENSITY * np.prod(SIZE)) and 0.1 < abs(found[FITTED][0, 2]) / SIZE[0] < 0.3
    return found, float(period_s)


def table(path, rows):
    head = ["gx", "gy", "gz", *(f"{p}_{a}_m" for p in ("tip", "middle") for a in "yz"), "period_s"]
    path.write_text(",".join(head) + "\n" + "".join(",".join("" if v is None else f"{v:.9g}" for v in row) + "\n" for row in rows))
    return path


def test_one_load_predicts_three_others_and_the_period(bin, tmp_path, measured, seed=1):
    found, period_s = measured
    noise = np.random.default_rng(seed)

    def row(g, period=None):
        moved = found[g][:, 1:].ravel()
        seen = np.abs(moved) > 0.1 * np.abs(moved).max()  # a user does not measure what hardly moves
        return [*g, *(m * (1 + 0.01 * noise.standard_normal()) if s else None for m, s in zip(moved, seen)), period]
    bodies.write_mesh(tmp_path / "beam.msh", *bodies.box((16, 5, 4), SIZE))
    (tmp_path / "beam.yaml").write_text(SCENE)
    fitted, others = table(tmp_path / "fitted.csv", [row(FITTED)]), table(tmp_path / "others.csv", [*(row(g) for g in OTHERS), [*FITTED, *[None] * 4, period_s]])
    words = [w for p, x in (("tip", 0.08), ("middle", 0.04)) for w in ("--point", f"{p}={x},0.01,0.008")]
    words += [w for p in ("tip", "middle") for a in "yz" for w in ("--compare", f"{p}_{a}_m=point {p} {a}", "--noise", f"{p}_{a}_m=1%")]
    done = subprocess.run([bin / "tm-fit", tmp_path / "beam.yaml", "-o", tmp_path / "fit", "--data", fitted, "--predict", others, "--swing", "0.7", "--row",
                           "gravity.acceleration=[{gx}, {gy}, {gz}]", "--fit", "tissue.materials.*.young=40 kPa..400 kPa", *words, "--compare", "period_s=period tip z"],
                          capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    predicted, = json.loads((tmp_path / "fit/fit.json").read_text())["predicted"]
    checked = {"m": 0, "s": 0}
    for m, s in zip(predicted["measured"], predicted["simulated"]):
        for column, a, b in zip(predicted["columns"], m, s):
            if a is not None:
                checked[column[-1]] += 1
                assert abs(b / a - 1) < (0.03 if column == "period_s" else 0.05), (column, a, b)
    assert checked == {"m": 6, "s": 1}
