"""The fibred beam of Land et al. (2015), problem 1, by law_solver.py's ten-node tetrahedra: the limit that tests/physics/test_pressure's meshes go to.

    python land.py            the tip's place, mm, by mesh and bulk modulus
"""
import numpy as np

import law_solver as solver

MU = 2e3
# Points and weights exact to the fourth degree on a triangle (Dunavant).
A, B = 0.445948490915965, 0.091576213509771
POINTS = [(A, A), (1 - 2 * A, A), (A, 1 - 2 * A), (B, B), (1 - 2 * B, B), (B, 1 - 2 * B)]
WEIGHTS = [0.223381589678011 / 2] * 3 + [0.109951743655322 / 2] * 3


def faces(block):
    """Returns the six-node triangles of the side z = 0, their normals inward."""
    found, low = [], block.at[:, 2] == 0
    for tet in block.tet:
        corner = [k for k in range(4) if low[tet[k]]]
        if len(corner) == 3:
            a, b, c = corner
            mid = {frozenset(p): tet[n] for n, p in enumerate(solver.PAIRS, 4)}
            x = block.rest[tet[[a, b, c]]]
            if np.cross(x[1] - x[0], x[2] - x[0])[2] < 0:
                b, c = c, b
            found.append([tet[a], tet[b], tet[c], mid[frozenset((a, b))], mid[frozenset((b, c))], mid[frozenset((c, a))]])
    return np.array(found)


def load(block, face, u, pressure):
    """Returns the force of a pressure on the deformed faces, [3 nodes] N."""
    x, out = (block.rest + u)[face], np.zeros_like(block.rest)
    for (s, t), w in zip(POINTS, WEIGHTS):
        r = 1 - s - t
        N = np.array([r * (2 * r - 1), s * (2 * s - 1), t * (2 * t - 1), 4 * r * s, 4 * s * t, 4 * t * r])
        ds = np.array([1 - 4 * r, 4 * s - 1, 0, 4 * (r - s), 4 * t, -4 * t])
        dt = np.array([1 - 4 * r, 0, 4 * t - 1, -4 * s, 4 * s, 4 * (r - t)])
        n = np.cross(np.einsum("a,fai->fi", ds, x), np.einsum("a,fai->fi", dt, x))
        np.add.at(out, face, w * pressure * N[None, :, None] * n[:, None, :])
    return out.ravel()


def tip_mm(cells, bulk):
    m = {"mu": MU, "lambda": bulk, "C": 2e3, "fibre": [1.0, 0, 0], "dlambda": 0.0, "dmu": 2e3, "beta": 4e3}
    block = solver.Block((0.01, 0.001, 0.001), cells, 2)
    face, u = faces(block), np.zeros_like(block.rest)
    free = np.flatnonzero(np.repeat(block.at[:, 0] > 0, 3))
    for step in range(1, 13):
        for _ in range(80):  # the load's own stiffness is left out of the tangent
            f, _ = block.force(solver.fung, m, u)
            r = (load(block, face, u, 4.0 * step / 12) - f)[free]
            if np.abs(r).max() < 1e-6 * np.abs(f).max() + 1e-14:
                break
            K = block.stiffness(solver.fung, m, u)[free][:, free]
            u = u.copy()
            u.ravel()[free] += solver.spsolve(K.tocsr(), r)
        else:
            raise SystemExit("no rest was found; take more load steps")
    end = np.flatnonzero((block.at[:, 0] == block.lattice[0]) & (2 * block.at[:, 1] == block.lattice[1]) & (block.at[:, 2] == block.lattice[2]))
    return 1e3 * (block.rest + u)[end[0], 2]


if __name__ == "__main__":
    for cells in ((20, 2, 2), (40, 2, 4)):
        for bulk in (1e5, 4e5):
            print(f"{cells[0]} x {cells[1]} x {cells[2]} boxes, bulk modulus {bulk / 1e3:g} kPa: {tip_mm(cells, bulk):.3f} mm", flush=True)
