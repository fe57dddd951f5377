"""Solves one case of law_cases.py on meshes each finer by the same ratio, and extrapolates the force (Richardson).

    python refine.py press "fung, fibred"                    ten-node tetrahedra of law_solver.py, 4, 6 and 9 cells across
    python refine.py press "fung, fibred" --order 1 --cells 8 12 18
    python refine.py press "fung, fibred" --library --cells 8 12 18      the library on the same four-node meshes (needs its Python package, make wheel)
    python refine.py press "fung, fibred" --slack 1          fibres that do not push

Also prints the largest stretch of a tetrahedron, of all |F| (the uniaxial one at constant volume with the same |F|) and along the fibres, and the share of the
volume where the law is not elliptic (150 directions): a solution there depends on the mesh, however fine that is.
"""
import argparse
import math
import time

import law_cases
import law_solver as solver
import numpy as np


def stretches(F, m):
    """Returns the largest s with s^2 + 2/s = |F|^2, and the largest |F a|."""
    norm2 = max((F * F).sum((-1, -2)).max(), 3.0)
    return max(np.roots([1, 0, -norm2, 2]).real), np.linalg.norm(F @ np.asarray(m["fibre"]), axis=-1).max() if "fibre" in m else math.nan


def lost(block, function, m, u):
    """Returns the share of the volume where the acoustic tensor has an eigenvalue below 0."""
    normals = np.random.default_rng(0).standard_normal((150, 3))
    A = solver.tangent(function, block.gradients(u), m).reshape(block.weight.shape + (3,) * 4)
    least = np.full(block.weight.shape, np.inf)
    for n in normals / np.linalg.norm(normals, axis=1)[:, None]:
        Q = np.einsum("...ijkl,j,l->...ik", A, n, n)
        least = np.minimum(least, np.linalg.eigvalsh((Q + solver.transposed(Q)) / 2)[..., 0])
    return block.weight[least < 0].sum() / block.weight.sum()


def with_slack(m, slack):
    """Returns the constants with k = slack (E_L - E_T), from the inverse of the stiffness."""
    C = np.full((3, 3), m["lambda"]) + 2 * m["mu"] * np.eye(3)
    C[0] += m["dlambda"]
    C[:, 0] += m["dlambda"]
    C[0, 0] += 4 * m["dmu"] + m["beta"]
    along, across = 1 / np.linalg.inv(C).diagonal()[:2]
    return {**m, "slack": slack, "loose": slack * max(along - across, 0)}


def by_the_solver(case, function, m, cells, levels, order):
    """Yields (block, level, force, displacement)."""
    block = solver.Block(law_cases.CASES[case], cells, order)
    for level, u, f, _ in solver.follow(block, function, m, law_cases.supports(case, block), levels):
        yield block, level, law_cases.reaction(case, block, u, f), u


def by_the_library(case, law, m, cells, levels, stretch):
    import tensormass
    block, name = solver.Block(law_cases.CASES[case], cells, 1), law.split(",")[0]
    material = tensormass.Material(m["lambda"], m["mu"], *(m.get(k, 0.0) for k in ("dlambda", "dmu", "beta")))
    material = material.with_law(name, stretch, [m[k] for k in tensormass.Material.laws()[name] if k in m])
    fibres = np.tile(m["fibre"], (len(block.tet), 1)) if "fibre" in m else None
    world = tensormass.World(tensormass.Tissue(tensormass.Mesh(block.rest, block.tet, orient=True), material, fibres=fibres), threads=2)
    supports = law_cases.supports(case, block)
    dof, _ = supports(0.0)
    world.add_support_components(dof, np.zeros(len(dof)))
    for level in levels:
        for component, value in enumerate(supports(level)[1]):
            world.move_support(component, value)
        world.settle(1e-8)
        yield block, level, law_cases.reaction(case, block, world.u_m, world.support_reaction_N.ravel()), world.u_m


def extrapolate(case, level, cells, force):
    one, two, three = force[-3:]
    ratio = (one - two) / (two - three)
    if ratio > 1:
        return f"{case} by {100 * level:g} %: extrapolated {three + (three - two) / (ratio - 1):.5g}, order {math.log(ratio) / math.log(cells[-1] / cells[-2]):.2f}"
    return f"{case} by {100 * level:g} %: does not converge yet"


def main():
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("case", choices=law_cases.CASES)
    p.add_argument("law", choices=law_cases.LAWS)
    p.add_argument("--cells", type=int, nargs="+", default=[4, 6, 9], help="cells across")
    p.add_argument("--level", type=float, nargs="+", help="share of the size to press, shear, twist, bend or indent by, ascending [that of the case]")
    p.add_argument("--order", type=int, choices=(1, 2), default=2, help="four-node (1) or ten-node tetrahedra")
    p.add_argument("--library", action="store_true", help="solve by the library, four-node tetrahedra")
    p.add_argument("--stretch", type=float, default=0, help="the library's limit, 0: its default")
    p.add_argument("--slack", type=float, default=0, help="share of the fibres' additional modulus that does not push")
    a = p.parse_args()
    levels = a.level or law_cases.LEVELS.get(a.case, [0.4])
    (function, m), found, size = law_cases.LAWS[a.law], {}, law_cases.CASES[a.case]
    m = with_slack(m, a.slack) if a.slack else m
    for n in a.cells:
        cells, start = (n, n, n * round(size[2] / size[0])), time.time()
        for block, level, force, u in by_the_library(a.case, a.law, m, cells, levels, a.stretch) if a.library else by_the_solver(a.case, function, m, cells, levels, a.order):
            all_F, fibre = stretches(block.gradients(u), m)
            found.setdefault(level, []).append(force)
            print(f"{a.case} by {100 * level:g} %, {n} cells: {force:.5g}, largest stretch {all_F:.2f}, along the fibres {fibre:.2f}, not elliptic {100 * lost(block, function, m, u):.2f} % ({time.time() - start:.0f} s)",
                  flush=True)
    for level, force in found.items():
        if len(force) >= 3:
            print(extrapolate(a.case, level, a.cells, force))


if __name__ == "__main__":
    main()
