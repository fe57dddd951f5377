"""Makes laws.json: force, energy and shape of blocks that are pressed, sheared, twisted, bent and indented by up to 40 %, under each nonlinear law.

    python law_cases.py            all cases, into laws.json (committed); an hour, with pypardiso half of it
    python law_cases.py --finer    neo-Hooke on finer ten-node meshes still: what is left of the fine mesh's error
    python law_cases.py --check    compares law_solver.py with CalculiX: writes and runs its input in a temporary folder (needs ccx)

Meshes: `fine` (ten-node tetrahedra), the reference; `ten` and `small` (four-node tetrahedra, those of tm-accuracy --knob law), for the mesh's own error. Each case is
solved by law_solver.py. A row: displacement at the probes (fine), or the largest difference there from the fine mesh over the largest displacement (others).
"""
import argparse
import json
import pathlib
import re
import subprocess
import tempfile
import time

import numpy as np

import law_solver as solver
import make_inp

HERE = pathlib.Path(__file__).resolve().parent
YOUNG_Pa, POISSON = 5e3, 0.45
MU, LAMBDA = YOUNG_Pa / 2 / (1 + POISSON), YOUNG_Pa * POISSON / (1 + POISSON) / (1 - 2 * POISSON)
FIBRE = [0.6, 0.0, 0.8]
BASE = {"mu": MU, "lambda": LAMBDA}
LAWS = {
    "neo-hooke": (solver.neo_hooke, {**BASE}),
    "st-venant-kirchhoff": (solver.st_venant_kirchhoff, {**BASE, "compression": 0.5}),
    "mooney-rivlin": (solver.mooney_rivlin, {**BASE, "second": 0.3}),
    "fung": (solver.fung, {**BASE, "C": 1e4}),
    "fung, fibred": (solver.fung, {**BASE, "C": 1e4, "fibre": FIBRE, "dlambda": 0.0, "dmu": MU, "beta": MU}),
    "holzapfel": (solver.holzapfel, {**BASE, "k1": 4e3, "k2": 0.8, "dispersion": 0.1, "fibre": FIBRE}),
}
CUBE, BAR = (0.03,) * 3, (0.02, 0.02, 0.06)
MESHES = {"fine": ((6, 6, 6), (4, 4, 12), 2), "ten": ((12, 12, 12), (8, 8, 24), 1), "small": ((6, 6, 6), (4, 4, 12), 1)}
CASES = {"press": CUBE, "shear": CUBE, "twist": BAR, "bend": BAR, "indent": CUBE}
LEVELS = {"indent": [0.1, 0.2, 0.4]}
ANGLE = 6.0  # of the twist at level 1: at 0.4 the middle of a side is sheared by 0.4


def probes(case):
    """Returns shares of the size: x, y and z."""
    across = (1 / 3, 1) if CASES[case] == CUBE else (1 / 2, 1)
    return [(x, y, z) for z in (1 / 3, 2 / 3, 1) for y in across for x in across]


def supports(case, block):
    """Returns a function of the level that gives components and displacements, m."""
    x, at, top = block.rest, block.at, block.at[:, 2] == block.lattice[2]
    L, number = block.size[2], np.arange(len(x))
    base = [3 * v + a for v in number[at[:, 2] == 0] for a in range(3)]
    if case in ("press", "indent"):  # a quarter
        base += [3 * v + a for a in range(2) for v in number[(at[:, a] == 0) & (at[:, 2] > 0) & ~(top & (case == "press"))]]
    if case == "indent":
        s = (x[:, 0] ** 2 + x[:, 1] ** 2) / make_inp.R_m ** 2
        moved = [(3 * v + 2, lambda t, v=v: -t * L * (1 - s[v]) ** 2) for v in number[top & (s < 1 - 1e-9)]]
    elif case == "press":
        moved = [(3 * v + a, lambda t, a=a: -t * L if a == 2 else 0.0) for v in number[top] for a in range(3)]
    elif case == "shear":
        moved = [(3 * v + a, lambda t, a=a: t * L if a == 0 else 0.0) for v in number[top] for a in range(3)]
    elif case == "bend":
        moved = [(3 * v, lambda t: t * L) for v in number[top]]
    else:
        def turned(t, v, a):
            c, s = np.cos(ANGLE * t), np.sin(ANGLE * t)
            p = x[v, :2] - block.size[:2] / 2
            return c * p[a] - s * p[1 - a] - p[a] if a == 0 else c * p[1] + s * p[0] - p[1]
        moved = [(3 * v + a, lambda t, v=v, a=a: turned(t, v, a)) for v in number[top] for a in range(2)]
    dof = np.array(base + [d for d, _ in moved])
    return lambda t: (dof, np.array([0.0] * len(base) + [f(t) for _, f in moved]))


def reaction(case, block, u, f):
    """Returns what moves the far face: N, or N m of the twist."""
    top = block.at[:, 2] == block.lattice[2]
    f = f.reshape(-1, 3)[top]
    if case == "twist":
        p = (block.rest + u)[top, :2] - block.size[:2] / 2
        return (p[:, 0] * f[:, 1] - p[:, 1] * f[:, 0]).sum()
    return f[:, 0 if case in ("shear", "bend") else 2].sum()


def solve(case, law, mesh):
    """Yields (level, reaction, energy, displacement of the probes [n, 3])."""
    cells = MESHES[mesh][0 if CASES[case] == CUBE else 1]
    block = solver.Block(CASES[case], cells, MESHES[mesh][2])
    index = [int(i @ (1, block.lattice[0] + 1, (block.lattice[0] + 1) * (block.lattice[1] + 1)))
             for i in np.round(np.array(probes(case)) * block.lattice).astype(int)]
    function, constants = LAWS[law]
    for level, u, f, energy in solver.follow(block, function, constants, supports(case, block), LEVELS.get(case, [0.4])):
        yield level, reaction(case, block, u, f), energy, u[index]


def row(case, law, mesh, fine):
    out = []
    for level, force, energy, u in solve(case, law, mesh):
        figures = {"level": level, "force": float(f"{force:.7g}"), "energy_J": float(f"{energy:.7g}")}
        if mesh == "fine":
            figures["u_m"] = [[float(f"{v:.6g}") for v in p] for p in u]
        else:
            truth = np.array(next(r["u_m"] for r in fine if r["level"] == level))
            figures["shape"] = float(f"{np.linalg.norm(u - truth, axis=1).max() / np.linalg.norm(truth, axis=1).max():.5g}")
        out.append(figures)
    return out


def make(only):
    path = HERE / "laws.json"
    facts = json.loads(path.read_text()) if only and path.exists() else {"rows": []}
    facts.update(young_Pa=YOUNG_Pa, poisson=POISSON, fibre=FIBRE, angle=ANGLE, code="law_solver.py", probes={c: probes(c) for c in CASES})
    for case in CASES:
        for law in LAWS:
            name = f"{case} {law}"
            if only and not re.search(only, name):
                continue
            facts["rows"] = [r for r in facts["rows"] if (r["case"], r["law"]) != (case, law)]
            one, start = {"case": case, "law": law}, time.time()
            for mesh in MESHES:
                one[mesh] = row(case, law, mesh, one.get("fine"))
            facts["rows"].append(one)
            print(f"{name}: {[(m, [(r['level'], r['force'], r.get('shape')) for r in one[m]]) for m in MESHES]}, {time.time() - start:.0f} s", flush=True)
            text = re.sub(r"\[[^][{}]*\]", lambda r: " ".join(r[0].split()), json.dumps(facts, indent=1))
            path.write_text(text + "\n")


def finer():
    facts = json.loads((HERE / "laws.json").read_text())
    MESHES["finer"] = ((9, 9, 9), (6, 6, 18), 2)
    for case in CASES:
        fine = next(r["fine"] for r in facts["rows"] if (r["case"], r["law"]) == (case, "neo-hooke"))
        for old, new in zip(fine, row(case, "neo-hooke", "finer", fine)):
            print(f"{case}, {100 * old['level']:g} %: force {100 * abs(old['force'] / new['force'] - 1):.2f} %, shape {100 * new['shape']:.2f} %", flush=True)


# --- the solver itself against CalculiX ---

def calculix(law, order, depth, cells=6):
    """Returns CalculiX's force of the indented quarter block, N."""
    lines = {"neo": ["*HYPERELASTIC, NEO HOOKE", f"{MU / 2:.12g}, {2 / (LAMBDA + 2 / 3 * MU):.12g}"], "svk": ["*ELASTIC", f"{YOUNG_Pa:.12g}, {POISSON}"]}[law]
    block = solver.Block(CUBE, (cells,) * 3, order)
    dof, value = supports("indent", block)(depth)
    out = ["*NODE, NSET=ALL"] + [f"{n}, {x:.12g}, {y:.12g}, {z:.12g}" for n, (x, y, z) in enumerate(block.rest, 1)]
    out += [f"*ELEMENT, TYPE=C3D{(4, 10)[order - 1]}, ELSET=TISSUE"] + [f"{e}, " + ", ".join(str(v + 1) for v in t) for e, t in enumerate(block.tet, 1)]
    out += make_inp.node_set("TOP", [n + 1 for n in range(len(block.rest)) if block.at[n, 2] == block.lattice[2]])
    out += ["*MATERIAL, NAME=LIVER", *lines, "*SOLID SECTION, ELSET=TISSUE, MATERIAL=LIVER", "*STEP, NLGEOM, INC=1000", "*STATIC", "0.1, 1., 1e-5, 0.1", "*BOUNDARY"]
    out += [f"{d // 3 + 1}, {d % 3 + 1}, {d % 3 + 1}, {v:.12g}" for d, v in zip(dof, value)]
    out += ["*NODE PRINT, NSET=TOP, TOTALS=ONLY, FREQUENCY=1000", "RF", "*END STEP"]
    with tempfile.TemporaryDirectory() as folder:
        (pathlib.Path(folder) / "run.inp").write_text("\n".join(out) + "\n")
        subprocess.run(["ccx", "run"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
        text = (pathlib.Path(folder) / "run.dat").read_text()
    # Forces on nodes of the symmetry planes are reactions in x and y only; z is the indenter's.
    return float(text.split("total force")[-1].split("\n")[2].split()[2])


def check():
    for law, function, extra, depth in (("neo", solver.calculix_neo_hooke, {}, 0.4), ("svk", solver.st_venant_kirchhoff, {"compression": 0.0}, 0.1)):
        for order in (1, 2):
            block = solver.Block(CUBE, (6,) * 3, order)
            _, u, f, _ = list(solver.follow(block, function, {**BASE, **extra}, supports("indent", block), [depth]))[-1]
            ours, theirs = reaction("indent", block, u, f), calculix(law, order, depth)
            print(f"{law}, order {order}, indented by {100 * depth:g} %: law_solver.py {ours:.7g} N, CalculiX {theirs:.7g} N, apart {abs(ours / theirs - 1):.1e}")


if __name__ == "__main__":
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--check", action="store_true", help="compare with CalculiX")
    arguments.add_argument("--finer", action="store_true", help="the fine mesh's own error")
    arguments.add_argument("--only", metavar="PATTERN", help="cases whose 'CASE LAW' matches; the others stay")
    options = arguments.parse_args()
    check() if options.check else finer() if options.finer else make(options.only)
