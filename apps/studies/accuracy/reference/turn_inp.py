"""Writes the CalculiX inputs for the effect `rotation` and gathers CalculiX's results into reference.json.

    python turn_inp.py                write twist_neo.inp, twist_svk.inp and press_svk.inp
    python turn_inp.py --gather       read the .dat files after `ccx twist_neo`, ... into reference.json (after make_inp.py --gather)

  twist   a bar of 20 x 20 x 60 mm, clamped at one end, the other end's cross-section rotated by 90 degrees about the axis
          and free to move along it; 3 x 3 x 9 boxes of six C3D10 each. Compared: torque, shortening.
  press   the block of make_inp.py with the St. Venant-Kirchhoff law, up to the depth at which CalculiX converges.
neo: neo-Hookean; svk: St. Venant and Kirchhoff (*ELASTIC with NLGEOM). Young's modulus 5 kPa, Poisson's ratio 0.45.
"""
import json
import math
import re
import sys

import numpy as np

import make_inp

SIZE_m, CELLS = (0.02, 0.02, 0.06), (3, 3, 9)
TURN = math.pi / 2


def node(i, j, k):
    return 1 + i + (2 * CELLS[0] + 1) * (j + (2 * CELLS[1] + 1) * k)


def position(i, j, k):
    return [SIZE_m[a] * (q / (2 * CELLS[a]) - (0.5 if a < 2 else 0)) for a, q in enumerate((i, j, k))]


def material(law):
    return make_inp.material("neo" if law == "neo" else "iso")


def write_twist(law):
    r = [range(2 * c + 1) for c in CELLS]
    out = ["** made by turn_inp.py", "*NODE, NSET=ALL"]
    out += [f"{node(i, j, k)}, " + ", ".join(f"{x:.9g}" for x in position(i, j, k)) for k in r[2] for j in r[1] for i in r[0]]
    out.append("*ELEMENT, TYPE=C3D10, ELSET=TISSUE")
    out += [f"{e}, " + ", ".join(map(str, n)) for e, n in enumerate(make_inp.kuhn(CELLS, node), 1)]
    end = [(i, j, r[2][-1]) for j in r[1] for i in r[0]]
    out += make_inp.node_set("BOTTOM", [node(i, j, 0) for j in r[1] for i in r[0]])
    out += make_inp.node_set("END", [node(*q) for q in end])
    out += ["*MATERIAL, NAME=LIVER", *material(law), "*SOLID SECTION, ELSET=TISSUE, MATERIAL=LIVER"]
    # The rotation consists of chords, each in a separate step.
    steps = 20
    for s in range(1, steps + 1):
        c, q = math.cos(TURN * s / steps), math.sin(TURN * s / steps)
        out += ["*STEP, NLGEOM, INC=100", "*STATIC", "1., 1."]
        out += ["*BOUNDARY", "BOTTOM, 1, 3"]
        for n in end:
            x, y, _ = position(*n)
            out += [f"{node(*n)}, 1, 1, {x * (c - 1) - y * q:.12g}", f"{node(*n)}, 2, 2, {x * q + y * (c - 1):.12g}"]
        if s == steps:
            out += ["*NODE PRINT, NSET=END", "RF", "*NODE PRINT, NSET=END", "U"]
        else:
            out += ["*NODE PRINT, NSET=END, FREQUENCY=0", "U"]
        out.append("*END STEP")
    (make_inp.HERE / f"twist_{law}.inp").write_text("\n".join(out) + "\n")


def write_press():
    text = (make_inp.HERE / "neo.inp").read_text()
    law = "\n".join(material("svk"))
    (make_inp.HERE / "press_svk.inp").write_text(re.sub(r"\*HYPERELASTIC, NEO HOOKE\n.*\n", law + "\n", text))


def gather_twist(law):
    mode, force, moved = None, {}, {}
    for line in (make_inp.HERE / f"twist_{law}.dat").read_text().splitlines():
        value = line.split()
        if "forces (fx" in line:
            mode, force = force, {}
            mode = force
        elif "displacements (vx" in line:
            moved = {}
            mode = moved
        elif len(value) == 4 and mode is not None:
            mode[int(value[0])] = [float(v) for v in value[1:]]
    r = [range(2 * c + 1) for c in CELLS]
    torque = 0
    for j in r[1]:
        for i in r[0]:
            n = node(i, j, r[2][-1])
            x, y, _ = np.add(position(i, j, r[2][-1]), moved[n])
            torque += x * force[n][1] - y * force[n][0]
    middle = moved[node(CELLS[0], CELLS[1], r[2][-1])][2]
    corner = moved[node(0, 0, r[2][-1])][2]
    return {"torque_Nm": torque, "axis_m": middle, "corner_m": corner}


def gather_press():
    make_inp.CELLS["press_svk"] = make_inp.CELLS["neo"]
    answer = make_inp.gather("press_svk")
    for case in answer["cases"]:
        case["depth"] *= make_inp.DEPTHS[-1] / make_inp.LINEAR_DEPTH
    return answer["cases"]


if __name__ == "__main__":
    if "--gather" in sys.argv:
        facts = json.loads((make_inp.HERE / "reference.json").read_text())
        facts.update(svk={"cases": gather_press()}, twist={law: gather_twist(law) for law in ("neo", "svk")})
        make_inp.dump(facts)
    else:
        write_twist("neo")
        write_twist("svk")
        write_press()
