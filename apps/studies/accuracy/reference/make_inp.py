"""Writes the CalculiX inputs of the accuracy study and gathers CalculiX's results into reference.json.

    python make_inp.py                write neo.inp, iso.inp and fibre.inp (64,000 lines, not committed)
    python make_inp.py --gather       read neo.dat, iso.dat, fibre.dat after `ccx neo`, ... into reference.json (committed)

The problem, a quarter of a block of tissue pressed by a smooth round indenter (docs/accuracy.md):
edge L = 30 mm, bottom clamped, symmetry on x = 0 and y = 0, top displaced by u_z = -d L (1 - (r/R)^2)^2 inside
r < R = 20 mm, free to slide; the other faces are free. Ten-node tetrahedra (C3D10), Kuhn's six in each cube.
  neo    neo-Hookean, large displacements, d from 1 % to 40 %: the error of linear elasticity
  iso    linear isotropic, d = 5 %: the limit of mesh refinement, by other elements and another code
  fibre  linear transversely isotropic, fibre along x, d = 5 %
"""
import itertools
import json
import pathlib
import re
import sys

import numpy as np

HERE = pathlib.Path(__file__).resolve().parent
L_m, R_m = 0.03, 0.02
YOUNG_Pa, POISSON = 5e3, 0.45
FIBRE = dict(E_L=30e3, E_T=6e3, nu_LT=0.4, nu_TT=0.45, G_L=5e3)
DEPTHS = [0.01, 0.02, 0.05, 0.10, 0.15, 0.20, 0.25, 0.30, 0.35, 0.40]
LINEAR_DEPTH = 0.05
CELLS = {"neo": 9, "iso": 12, "fibre": 12}


def kuhn(cells, node):
    """Yields the nodes of the C3D10 of a lattice with `cells` boxes per axis, six in each; node(i, j, k): number at a half cell."""
    for corner in itertools.product(*(range(0, 2 * c, 2) for c in cells)):
        for order in itertools.permutations(range(3)):
            v = [corner]
            for axis in order:
                step = list(v[-1])
                step[axis] += 2
                v.append(tuple(step))
            if np.linalg.det([np.subtract(q, v[0]) for q in v[1:]]) < 0:
                v[1], v[2] = v[2], v[1]
            pairs = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))
            yield [node(*q) for q in v + [tuple((a + b) // 2 for a, b in zip(v[p], v[q])) for p, q in pairs]]


def node_set(name, nodes):
    return [f"*NSET, NSET={name}"] + [", ".join(map(str, nodes[k:k + 12])) + "," for k in range(0, len(nodes), 12)]


class Grid:
    """Nodes on a lattice of half cells, so that midside nodes are numbered too."""

    def __init__(self, cells):
        self.cells, self.side = cells, 2 * cells + 1
        self.half_m = L_m / cells / 2

    def node(self, i, j, k):
        return 1 + i + self.side * (j + self.side * k)

    def nodes(self):
        r = range(self.side)
        return ((self.node(i, j, k), i * self.half_m, j * self.half_m, k * self.half_m) for k in r for j in r for i in r)

    def pressed(self):
        """Yields (node, profile in 0..1) under the indenter."""
        for j in range(self.side):
            for i in range(self.side):
                s = (i * i + j * j) * self.half_m ** 2 / R_m ** 2
                if s < 1:
                    yield self.node(i, j, self.side - 1), (1 - s) ** 2


def fibre_stiffness():
    """Returns the 6x6 stiffness, fibre along x, rows xx yy zz xy xz yz (CalculiX's order), Pa."""
    f = FIBRE
    S = np.zeros((6, 6))
    S[0, 0] = 1 / f["E_L"]
    S[1, 1] = S[2, 2] = 1 / f["E_T"]
    S[0, 1] = S[1, 0] = S[0, 2] = S[2, 0] = -f["nu_LT"] / f["E_L"]
    S[1, 2] = S[2, 1] = -f["nu_TT"] / f["E_T"]
    S[3, 3] = S[4, 4] = 1 / f["G_L"]
    S[5, 5] = 2 * (1 + f["nu_TT"]) / f["E_T"]
    return np.linalg.inv(S)


def material(name):
    mu, bulk = YOUNG_Pa / 2 / (1 + POISSON), YOUNG_Pa / 3 / (1 - 2 * POISSON)
    if name == "neo":
        return ["*HYPERELASTIC, NEO HOOKE", f"{mu / 2:.12g}, {2 / bulk:.12g}"]
    if name == "iso":
        return ["*ELASTIC", f"{YOUNG_Pa:.12g}, {POISSON}"]
    C = fibre_stiffness()
    values = [C[i, j] for j in range(6) for i in range(j + 1)]  # 11 12 22 13 23 33 ...
    lines = [", ".join(f"{v:.12g}" for v in values[k:k + 8]) for k in (0, 8, 16)]
    return ["*ELASTIC, TYPE=ANISO", *lines]


def write(name):
    grid = Grid(CELLS[name])
    r, top = range(grid.side), grid.side - 1
    out = ["** made by make_inp.py", "*NODE, NSET=ALL"]
    out += [f"{n}, {x:.9g}, {y:.9g}, {z:.9g}" for n, x, y, z in grid.nodes()]
    out.append("*ELEMENT, TYPE=C3D10, ELSET=TISSUE")
    out += [f"{e}, " + ", ".join(map(str, nodes)) for e, nodes in enumerate(kuhn((grid.cells,) * 3, grid.node), 1)]
    sets = {
        "BOTTOM": [grid.node(i, j, 0) for i in r for j in r],
        "XSYM": [grid.node(0, j, k) for j in r for k in r if k],
        "YSYM": [grid.node(i, 0, k) for i in r for k in r if k],
        "PATCH": [n for n, _ in grid.pressed()],
        # A lattice of 3x3x3 corner nodes whose displacements are compared.
        "PROBE": [grid.node(i, j, k) for k in probe(top) for j in probe(top) for i in probe(top)],
    }
    for label, ids in sets.items():
        out += node_set(label, ids)
    out += ["*MATERIAL, NAME=LIVER", *material(name), "*SOLID SECTION, ELSET=TISSUE, MATERIAL=LIVER"]
    depth = DEPTHS[-1] if name == "neo" else LINEAR_DEPTH
    if name == "neo":
        times = [f"{d / depth:.9g}" for d in DEPTHS]
        out += ["*AMPLITUDE, NAME=PRESS", "0., 0., 1., 1.", "*TIME POINTS, NAME=DEPTHS", ", ".join(times[:8]) + ",",
                ", ".join(times[8:]), "*STEP, NLGEOM, INC=1000", "*STATIC", "0.025, 1., 1e-5, 0.05"]
    else:
        out += ["*STEP", "*STATIC"]
    out += ["*BOUNDARY", "BOTTOM, 1, 3", "XSYM, 1, 1", "YSYM, 2, 2", "*BOUNDARY" + (", AMPLITUDE=PRESS" if name == "neo" else "")]
    out += [f"{n}, 3, 3, {-depth * L_m * p:.12g}" for n, p in grid.pressed()]
    when = ", TIME POINTS=DEPTHS" if name == "neo" else ""
    out += [f"*NODE PRINT, NSET=PATCH, TOTALS=ONLY{when}", "RF", f"*NODE PRINT, NSET=PROBE{when}", "U",
            f"*EL PRINT, ELSET=TISSUE, TOTALS=ONLY{when}", "ELSE", "*END STEP"]
    (HERE / f"{name}.inp").write_text("\n".join(out) + "\n")


def probe(top):
    """Returns lattice indices at 1/3, 2/3 and 1 of the edge: corner nodes if the cells are a multiple of 3, else the nearest even index."""
    return [2 * round(top * t / 6) for t in (1, 2, 3)]


def gather(name):
    grid = Grid(CELLS[name])
    cases, block, mode = [], None, None
    for line in (HERE / f"{name}.dat").read_text().splitlines():
        head = re.match(r" (total force|displacements|total internal energy).*time\s+(\S+)", line)
        if head:
            mode = head.group(1)
            if mode == "total force":
                block = {"depth": float(head.group(2)) * (DEPTHS[-1] if name == "neo" else LINEAR_DEPTH), "u_m": {}}
                cases.append(block)
        elif line.strip():
            value = line.split()
            if mode == "total force":
                block["force_z_N"] = float(value[2])
            elif mode == "displacements":
                block["u_m"][int(value[0])] = [float(v) for v in value[1:4]]
            else:
                block["energy_J"] = float(value[0])
    for case in cases:
        case["probe_u_m"] = [u for _, u in sorted(case.pop("u_m").items())]
    return {"cells": CELLS[name], "nodes": grid.side ** 3, "cases": cases}


def dump(facts):
    """Writes reference.json with one vector per line."""
    text = re.sub(r"\[[^][{}]*\]", lambda row: " ".join(row[0].split()), json.dumps(facts, indent=1))
    (HERE / "reference.json").write_text(text + "\n")


if __name__ == "__main__":
    if "--gather" in sys.argv:
        facts = {"L_m": L_m, "R_m": R_m, "young_Pa": YOUNG_Pa, "poisson": POISSON, "fibre_constants": FIBRE, "code": "CalculiX 2.20, C3D10"}
        facts.update({name: gather(name) for name in CELLS})
        dump(facts)
    else:
        for each in CELLS:
            write(each)
