"""Meshes of measured bodies, and displacements without the mesh's error."""
import itertools

import numpy as np


def box(cells, size_m, corner_m=(0.0, 0.0, 0.0)):
    """Returns vertices (V, 3), m, and tetrahedra (T, 4) of a box of cells, six tetrahedra each, mirrored from cell to cell."""
    axes = [c + np.linspace(0, s, n + 1) for c, s, n in zip(corner_m, size_m, cells)]
    vertex = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    number = np.arange(len(vertex)).reshape([n + 1 for n in cells])
    tets = []
    for cell in itertools.product(*map(range, cells)):
        odd = [c & 1 for c in cell]
        for order in itertools.permutations(range(3)):
            corner, tet = [0, 0, 0], []
            for axis in (None, *order):
                if axis is not None:
                    corner[axis] = 1
                tet.append(number[tuple(c + (k ^ o) for c, k, o in zip(cell, corner, odd))])
            edges = vertex[tet[1:]] - vertex[tet[0]]
            tets.append(tet if np.linalg.det(edges) > 0 else [tet[1], tet[0], *tet[2:]])
    return vertex, np.array(tets)


def write_mesh(path, vertex, tets, region=None, names=("body",)):
    """Writes a .msh of Gmsh 2.2; region (T,) counts from 0."""
    region = np.zeros(len(tets), int) if region is None else region
    with open(path, "w") as out:
        out.write("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n%d\n" % len(names))
        out.writelines('3 %d "%s"\n' % (i, name) for i, name in enumerate(names, 1))
        out.write("$EndPhysicalNames\n$Nodes\n%d\n" % len(vertex))
        out.writelines("%d %.12g %.12g %.12g\n" % (i, *x) for i, x in enumerate(vertex, 1))
        out.write("$EndNodes\n$Elements\n%d\n" % len(tets))
        out.writelines("%d 4 2 %d %d %d %d %d %d\n" % (i, r + 1, r + 1, *(t + 1)) for i, (t, r) in enumerate(zip(tets, region), 1))
        out.write("$EndElements\n")
    return path


def without_mesh_error(sizes, values):
    """Extrapolates values on three meshes of these edges (coarse to fine) to edge 0, by the order that they show, between 1 and 3. Returns (value, order)."""
    (h0, h1, h2), (a, b, c) = sizes, values
    ratio = (b - a) / (c - b) if c != b else np.inf

    def lack(order):
        return (h0**order - h1**order) / (h1**order - h2**order) - ratio
    low, high = 1.0, 3.0
    if not lack(low) < 0 < lack(high):
        order = low if lack(low) >= 0 else high
    else:
        for _ in range(60):
            order = (low + high) / 2
            low, high = (order, high) if lack(order) < 0 else (low, order)
    return c + (c - b) * h2**order / (h1**order - h2**order), order
