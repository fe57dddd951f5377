"""Finite elements and Newton's method for the reference of nonlinear laws: an implementation of its own, from the textbook (Bonet and Wood, Nonlinear
Continuum Mechanics), that shares nothing with the library. law_cases.py runs it.

Four-node and ten-node tetrahedra. A law is its energy and first Piola stress in the deformation gradient F, each written from its invariants; the tangent is the
stress's complex step, so it has no step of differences. No limit of stretch or of volume, which the library has.
"""
import itertools

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

try:  # several times quicker, the same figures
    from pypardiso import spsolve
except ImportError:
    from scipy.sparse.linalg import spsolve

UNIT = np.eye(3)


# --- laws: (energy density, first Piola stress) of F [..., 3, 3], Pa ---

def cofactor(F):
    """Returns dJ/dF: the columns' cross products."""
    a, b, c = F[..., 0], F[..., 1], F[..., 2]
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], -1)


def det(F):
    return (F[..., 0] * np.cross(F[..., 1], F[..., 2])).sum(-1)


def square(A):
    return (A * A).sum((-1, -2))


def scale(s, A):
    return s[..., None, None] * A


def transposed(A):
    return np.swapaxes(A, -1, -2)


def neo_hooke(F, m):
    a, l, I, J = 4 / 3 * m["mu"], m["lambda"] + 5 / 6 * m["mu"], square(F), det(F)
    W = a / 2 * (I - 3) - a / 2 * np.log((I + 1) / 4) + l / 2 * (J - 1) ** 2 - 0.75 * m["mu"] * 4 / 3 * (J - 1)
    return W, scale(a - a / (I + 1), F) + scale(l * (J - 1) - 0.75 * a, cofactor(F))


def mooney_rivlin(F, m):
    b = m["second"] * m["mu"]
    a = m["mu"] - b
    l, J, C = m["lambda"] + a, det(F), transposed(F) @ F
    I = square(F)
    II = (I * I - square(C)) / 2
    W = a / 2 * (I - 3) + b / 2 * (II - 3) - (a + 2 * b) * (J - 1) + l / 2 * (J - 1) ** 2
    return W, scale(a + b * I, F) - b * F @ C + scale(l * (J - 1) - a - 2 * b, cofactor(F))


def green(F, m):
    """Returns w and dw/dE of the linear law without lambda, in Green's strain; with fibres along m["fibre"] if it has them."""
    E = (transposed(F) @ F - UNIT) / 2
    w, S = m["mu"] * square(E), 2 * m["mu"] * E
    if "fibre" in m:
        a = np.asarray(m["fibre"])
        M, I1, Ea = np.outer(a, a), np.trace(E, axis1=-2, axis2=-1), E @ a
        I4, I5 = Ea @ a, (Ea * Ea).sum(-1)
        w = w + m["dlambda"] * I1 * I4 + 2 * m["dmu"] * I5 + m["beta"] / 2 * I4 ** 2
        S = S + scale(m["dlambda"] * I4, UNIT) + scale(m["dlambda"] * I1 + m["beta"] * I4, M) + 2 * m["dmu"] * (E @ M + M @ E)
        pushed = np.where(I4.real < 0, I4, 0)  # fibres that push less: w - loose/2 min(I4, 0)^2
        w, S = w - m.get("loose", 0) / 2 * pushed ** 2, S - scale(m.get("loose", 0) * pushed, M)
    return w, S, E


def st_venant_kirchhoff(F, m):
    c, J = m["compression"], det(F)
    w, S, E = green(F, m)
    trace = np.trace(E, axis1=-2, axis2=-1)
    W = w + (1 - c) * m["lambda"] / 2 * trace ** 2 + c * m["lambda"] / 2 * (J - 1) ** 2
    return W, F @ (S + scale((1 - c) * m["lambda"] * trace, UNIT)) + scale(c * m["lambda"] * (J - 1), cofactor(F))


def fung(F, m):
    J = det(F)
    w, S, _ = green(F, m)
    steep = np.exp(2 * w / m["C"])
    return m["C"] / 2 * (steep - 1) + m["lambda"] / 2 * (J - 1) ** 2, scale(steep, F @ S) + scale(m["lambda"] * (J - 1), cofactor(F))


def holzapfel(F, m):
    W, P = neo_hooke(F, m)
    a, k1, k2, kappa = np.asarray(m["fibre"]), m["k1"], m["k2"], m["dispersion"]
    Fa = F @ a
    y = kappa * (square(F) - 3) + (1 - 3 * kappa) * ((Fa * Fa).sum(-1) - 1)
    y = np.where(y.real > 0, y, 0)
    steep = np.exp(k2 * y * y)
    return W + k1 / (2 * k2) * (steep - 1), P + scale(k1 * y * steep, 2 * kappa * F + 2 * (1 - 3 * kappa) * Fa[..., None] * a)


def calculix_neo_hooke(F, m):
    """CalculiX's *HYPERELASTIC, NEO HOOKE: mu/2 (J^(-2/3) I - 3) + K/2 (J - 1)^2. For the comparison of this file with CalculiX."""
    mu, bulk, I, J = m["mu"], m["lambda"] + 2 / 3 * m["mu"], square(F), det(F)
    r = J ** (-2 / 3)
    W = mu / 2 * (r * I - 3) + bulk / 2 * (J - 1) ** 2
    return W, scale(mu * r, F) + scale(bulk * (J - 1) - mu / 3 * r * I / J, cofactor(F))


def tangent(law, F, m, h=1e-100):
    """Returns dP/dF [..., 9, 9]."""
    A = np.empty(F.shape[:-2] + (9, 9))
    for k in range(9):
        G = F.astype(complex)
        G[..., k // 3, k % 3] += 1j * h
        A[..., k] = (law(G, m)[1].imag / h).reshape(F.shape[:-2] + (9,))
    return A


# --- elements ---

PAIRS = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))


def shapes(nodes_per_tet):
    """Returns weights [q] (of the volume) and gradients by barycentric coordinates [q, node, 4]."""
    if nodes_per_tet == 4:
        return np.ones(1), np.eye(4)[None]
    high, low = 0.58541020, 0.13819660  # four points, exact to second degree
    gradients = []
    for q in range(4):
        b = np.full(4, low)
        b[q] = high
        g = np.zeros((10, 4))
        g[np.arange(4), np.arange(4)] = 4 * b - 1
        for n, (i, j) in enumerate(PAIRS, 4):
            g[n, i], g[n, j] = 4 * b[j], 4 * b[i]
        gradients.append(g)
    return np.full(4, 0.25), np.array(gradients)


class Block:
    """A block of `size` m, on `cells` cubes of six tetrahedra around the same diagonal; order 1 or 2."""

    def __init__(self, size, cells, order):
        self.size, self.lattice = np.array(size), np.array(cells) * order
        grid = [range(n + 1) for n in self.lattice]
        self.at = np.array([(i, j, k) for k in grid[2] for j in grid[1] for i in grid[0]])
        self.rest = self.at / self.lattice * self.size
        tets = []
        for corner in itertools.product(*(range(n) for n in cells)):
            for path in itertools.permutations(range(3)):
                v = [np.array(corner) * order]
                for axis in path:
                    v.append(v[-1] + order * UNIT[axis].astype(int))
                if path not in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                    v[1], v[2] = v[2], v[1]
                tets.append(v + [(v[i] + v[j]) // 2 for i, j in PAIRS] * (order - 1))
        tets = np.array(tets)
        self.tet = tets[..., 0] + (self.lattice[0] + 1) * (tets[..., 1] + (self.lattice[1] + 1) * tets[..., 2])
        corners = self.rest[self.tet[:, :4]]
        edges = corners[:, 1:] - corners[:, :1]
        volume = np.linalg.det(edges) / 6
        assert (volume > 0).all()
        inverse = np.linalg.inv(edges)  # rows: gradients by columns
        bary = np.concatenate([-inverse.sum(2)[:, :, None], inverse], 2)  # [tet, axis, corner]
        weights, g = shapes(self.tet.shape[1])
        self.gradient = np.einsum("qnb,tab->tqna", g, bary)
        self.weight = volume[:, None] * weights
        # [tet, q, 9, 3 nodes]: dF by displacements
        count = self.tet.shape[1]
        self.B = np.zeros(self.gradient.shape[:2] + (9, 3 * count))
        for i in range(3):
            for j in range(3):
                self.B[:, :, 3 * i + j, i::3] = self.gradient[:, :, :, j]
        self.dofs = (3 * self.tet[:, :, None] + np.arange(3)).reshape(len(self.tet), -1)

    def gradients(self, u):
        return UNIT + (self.B @ u.ravel()[self.dofs][:, None, :, None])[..., 0].reshape(self.weight.shape + (3, 3))

    def force(self, law, m, u):
        """Returns internal force [3 nodes] and energy."""
        W, P = law(self.gradients(u), m)
        local = (self.weight[..., None] * (P.reshape(P.shape[:2] + (1, 9)) @ self.B)[:, :, 0]).sum(1)
        return np.bincount(self.dofs.ravel(), local.ravel(), self.rest.size), (W * self.weight).sum()

    def stiffness(self, law, m, u):
        A = tangent(law, self.gradients(u), m)
        local = (transposed(self.B) @ (self.weight[..., None, None] * A @ self.B)).sum(1)
        n = self.dofs.shape[1]
        rows, columns = np.repeat(self.dofs, n, 1).ravel(), np.tile(self.dofs, (1, n)).ravel()
        return scipy.sparse.csr_matrix((local.ravel(), (rows, columns)), shape=(self.rest.size,) * 2)


def balance(block, law, m, u, fixed, traction=None, tolerance=1e-9):
    """Newton's method from u, whose prescribed components stay; returns u, or None if it does not converge. traction: force on nodes, N."""
    free = np.setdiff1d(np.arange(u.size), fixed)
    load = np.zeros(u.size) if traction is None else traction.ravel()
    for _ in range(25):
        f, _ = block.force(law, m, u)
        r = (load - f)[free]
        norm = np.abs(r).max()
        if not np.isfinite(norm):
            return None
        if norm < tolerance * max(np.abs(f).max(), 1e-30):
            return u
        K = block.stiffness(law, m, u)[free][:, free]
        step = spsolve(K.tocsr(), r)
        if not np.isfinite(step).all() or np.abs(step).max() > block.size.max():
            return None
        u = u.copy()
        u.ravel()[free] += step
        if (det(block.gradients(u)) <= 0).any() and np.abs(step).max() < 1e-12:
            return None
    return None


def follow(block, law, m, prescribed, levels, traction=None, first=0.05):
    """Yields (level, u, force, energy) at each of `levels`; prescribed(level) gives components and values. Steps are halved where Newton fails."""
    u, at, step, older = np.zeros_like(block.rest), 0.0, first, None
    for level in levels:
        while at < level - 1e-12:
            target = min(at + step, level)
            dof, value = prescribed(target)
            # Begins where the last two states point to.
            trial = u + (u - older[1]) * (target - at) / (at - older[0]) if older else u.copy()
            trial.ravel()[dof] = value
            found = balance(block, law, m, trial, dof, None if traction is None else traction * target)
            if found is None:
                step /= 2
                if step < 1e-3:
                    return
                older = None
                continue
            older, u, at = (at, u), found, target
            step = min(step * 1.3, 0.1)
        f, energy = block.force(law, m, u)
        yield level, u, f, energy
