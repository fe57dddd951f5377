"""Cook's membrane at Poisson's ratios 0.3 and 0.4999 by a mixed element that does not lock: the reference of tests/sim/test_cook.py.

    python cook.py            the tip's rise under each law, on finer and finer meshes

Plane strain; corners (0, 0), (48, 44), (48, 60), (0, 44) mm, the left side held, a traction of 6.25 N/mm2 upwards on the right side (its undeformed area),
mu = 80.1938 N/mm2. Taylor and Hood's triangles: displacements of second degree, pressure of first, so that l/2 (J - 1)^2 becomes p (J - 1) - p^2/(2 l).
With Mooney-Rivlin's law of second = 0, which without a change of volume is mu/2 (I - 3), literature has 6.9 mm (Simo and Armero, Int. J. Numer. Methods Eng. 33 (1992) 1413).
"""
import sys

import numpy as np
import scipy.sparse
from scipy.sparse.linalg import spsolve

import law_solver as solver

MU, TRACTION = 80.1938, 6.25
LAWS = {"neo-hooke": (solver.neo_hooke, {}), "mooney-rivlin": (solver.mooney_rivlin, {"second": 0.0}), "mooney-rivlin, second 0.3": (solver.mooney_rivlin, {"second": 0.3}),
        "st-venant-kirchhoff": (solver.st_venant_kirchhoff, {"compression": 1.0}), "fung": (solver.fung, {"C": 400.0})}
POINTS = [(1 / 6, 1 / 6), (2 / 3, 1 / 6), (1 / 6, 2 / 3)]


def place(s, t):
    return np.array([48 * s, 44 * s * (1 - t) + (44 + 16 * s) * t])


def bulk_of(law, m, lame):
    """Returns l of the law's term l/2 (J - 1)^2."""
    return {"neo-hooke": lame + 5 / 6 * MU, "mooney-rivlin": lame + (1 - m.get("second", 0)) * MU}.get(law.split(",")[0], lame)


def membrane(law, poisson, n):
    """Returns the tip's rise, mm."""
    function, more = LAWS[law]
    lame = 2 * MU * poisson / (1 - 2 * poisson)
    m, bulk = {"mu": MU, "lambda": lame, **more}, bulk_of(law, more, lame)
    side = 2 * n + 1
    x = np.array([place(i / (2 * n), j / (2 * n)) for j in range(side) for i in range(side)])
    tri = []
    for j in range(0, 2 * n, 2):
        for i in range(0, 2 * n, 2):
            a, b, c, d = (i, j), (i + 2, j), (i + 2, j + 2), (i, j + 2)
            for p, q, r in ((a, b, c), (a, c, d)):
                mid = [tuple((u + v) // 2 for u, v in zip(*e)) for e in ((p, q), (q, r), (r, p))]
                tri.append([k + side * l for k, l in (p, q, r, *mid)])
    tri = np.array(tri)
    bary = np.array([(1 - s - t, s, t) for s, t in POINTS])
    corner = x[tri[:, :3]]
    inverse = np.linalg.inv(np.stack([corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]], 2))
    grad = np.concatenate([-(inverse[:, :1] + inverse[:, 1:]), inverse], 1)  # [tri, corner, axis]
    area = 0.5 / np.linalg.det(inverse)
    shape = np.zeros((3, 6, 3))
    for q, b in enumerate(bary):
        shape[q, np.arange(3), np.arange(3)] = 4 * b - 1
        for k, (a, c) in enumerate(((0, 1), (1, 2), (2, 0)), 3):
            shape[q, k, a], shape[q, k, c] = 4 * b[c], 4 * b[a]
    g = np.einsum("qnb,tba->tqna", shape, grad)
    B = np.zeros(g.shape[:2] + (9, 12))
    for i in range(2):
        for j in range(2):
            B[:, :, 3 * i + j, i::2] = g[..., j]
    weight = np.repeat(area[:, None] / 3, 3, 1)
    udof = (2 * tri[:, :, None] + np.arange(2)).reshape(len(tri), -1)
    pnode = {v: k for k, v in enumerate(sorted(set(tri[:, :3].ravel())))}
    pdof = 2 * len(x) + np.array([[pnode[v] for v in t] for t in tri[:, :3]])
    size = 2 * len(x) + len(pnode)
    dofs = np.concatenate([udof, pdof], 1)
    free = np.setdiff1d(np.arange(size), [2 * j * side + a for j in range(side) for a in range(2)])
    load = np.zeros(size)
    for j in range(0, 2 * n, 2):  # Simpson's rule along the right side
        for k, w in ((0, 1), (1, 4), (2, 1)):
            load[2 * ((j + k) * side + 2 * n) + 1] += TRACTION * 16 / n * w / 6
    z, at, step = np.zeros(size), 0.0, 0.1
    while at < 1 - 1e-12:
        target, trial, done = min(1, at + step), z.copy(), False
        for _ in range(15):
            F = np.eye(3) + (B @ trial[udof][:, None, :, None])[..., 0].reshape(weight.shape + (3, 3))
            p = trial[pdof] @ bary.T
            own = lambda F, m: mixed(function, F, m, bulk)  # noqa: E731
            P, J, cof = own(F, m)[1], solver.det(F), solver.cofactor(F)
            A = solver.tangent(own, F, m) + p[..., None, None] * solver.tangent(lambda F, _: (None, solver.cofactor(F)), F, m)
            stress = (P + solver.scale(p, cof)).reshape(P.shape[:2] + (9,))
            fu = (weight[..., None] * np.einsum("tqk,tqkn->tqn", stress, B)).sum(1)
            fp = np.einsum("tq,tq,qb->tb", weight, J - 1 - p / bulk, bary)
            residual = np.bincount(dofs.ravel(), np.concatenate([fu, fp], 1).ravel(), size) - target * load
            if not np.isfinite(residual).all():
                break
            if np.abs(residual[free]).max() < 1e-9 * TRACTION:
                done = True
                break
            Kuu = (np.swapaxes(B, -1, -2) @ (weight[..., None, None] * A @ B)).sum(1)
            Kup = np.einsum("tq,tqk,tqkn,qb->tnb", weight, cof.reshape(stress.shape), B, bary)
            Kpp = -np.einsum("tq,qa,qb->tab", weight, bary, bary) / bulk
            K = np.concatenate([np.concatenate([Kuu, Kup], 2), np.concatenate([np.swapaxes(Kup, 1, 2), Kpp], 2)], 1)
            c = dofs.shape[1]
            full = scipy.sparse.csc_matrix((K.ravel(), (np.repeat(dofs, c, 1).ravel(), np.tile(dofs, (1, c)).ravel())), shape=(size, size))
            trial[free] -= spsolve(full[free][:, free], residual[free])
        if done:
            z, at, step = trial, target, min(0.2, 1.3 * step)
        else:
            step /= 2
    return z[2 * (side * side - 1) + 1]


def mixed(function, F, m, bulk):
    """Returns energy and stress of the law without its term bulk/2 (J - 1)^2."""
    W, P = function(F, m)
    J = solver.det(F)
    return W - bulk / 2 * (J - 1) ** 2, P - solver.scale(bulk * (J - 1), solver.cofactor(F))


if __name__ == "__main__":
    for name in LAWS:
        for nu in (0.3, 0.4999):
            print(f"{name}, nu {nu}: " + ", ".join(f"{n} x {n} {membrane(name, nu, n):.4f} mm" for n in map(int, sys.argv[1:] or (8, 16, 32))), flush=True)
