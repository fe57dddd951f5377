#!/usr/bin/env python3
"""Estimates the most that local time steps could save on a mesh.

Every vertex has its own step, rounded down to the shortest step times a power of two. A tetrahedron's force is computed as often as its fastest
vertex needs; nothing is lost where steps meet.

python tests/bench/local_steps.py MESH.msh... [--young 5e3] [--poisson 0.4] [--density 1050]"""
import argparse
from pathlib import Path

import numpy as np

FORCE = 0.8  # share of a substep that is the force pass; the remainder is work per vertex (tm-sim --explain)


def read(path):
    """Reads vertices [n, 3] m and tetrahedra [m, 4] of a .msh of version 2.2."""
    text = Path(path).read_text()
    points = np.array([line.split()[1:] for line in text.split("$Nodes\n")[1].split("$EndNodes")[0].splitlines()[1:]], float)
    elements = [line.split() for line in text.split("$Elements\n")[1].split("$EndElements")[0].splitlines()[1:]]
    return points, np.array([e[-4:] for e in elements if e[1] == "4"], int) - 1


def own_steps(x, tet, young, poisson, density):
    """Returns the critical step of each tetrahedron alone, s (Irons' bound; a cut may leave it alone)."""
    lam, mu = young * poisson / (1 + poisson) / (1 - 2 * poisson), young / 2 / (1 + poisson)
    edges = np.stack([x[tet[:, k]] - x[tet[:, 0]] for k in (1, 2, 3)], 2)
    rows = np.linalg.inv(edges)
    shape = np.concatenate([-rows.sum(1)[:, None, :], rows], 1)  # [n, 4, 3]
    stiffness = lam * np.einsum("nai,nbj->naibj", shape, shape) + mu * np.einsum("naj,nbi->naibj", shape, shape)
    stiffness += mu * np.einsum("nak,nbk,ij->naibj", shape, shape, np.eye(3))
    highest = np.linalg.eigvalsh(stiffness.reshape(-1, 12, 12))[:, -1]
    return 2 / np.sqrt(highest / (density / 4))  # both proportional to volume


def ceiling(tet, steps, levels):
    """Returns the shortest step, s, and the remaining share of the work with that many levels."""
    vertex = np.full(tet.max() + 1, np.inf)
    np.minimum.at(vertex, tet.ravel(), np.repeat(steps, 4))
    shortest, used = vertex.min(), np.isfinite(vertex)
    level = np.clip(np.floor(np.log2(vertex[used] / shortest) + 1e-9), 0, levels - 1)
    every = np.zeros(len(vertex))
    every[used] = level
    return shortest, FORCE * (2.0 ** -every[tet].min(1)).mean() + (1 - FORCE) * (2.0 ** -level).mean()


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("mesh", nargs="+")
    for name, default in (("young", 5e3), ("poisson", 0.4), ("density", 1050.0)):
        parser.add_argument("--" + name, type=float, default=default)
    o = parser.parse_args()
    for mesh in o.mesh:
        x, tet = read(mesh)
        steps = own_steps(x, tet, o.young, o.poisson, o.density)
        told = [f"{levels} levels: {1 / left:.2f} times" for levels in (2, 3, 6) for _, left in [ceiling(tet, steps, levels)]]
        print(f"{mesh}: {len(tet)} tetrahedra, shortest step {1e3 * steps.min():.4f} ms, median {1e3 * np.median(steps):.4f} ms; cheaper by at most: " + ", ".join(told))


if __name__ == "__main__":
    main()
