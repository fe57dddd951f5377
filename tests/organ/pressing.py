#!/usr/bin/env python3
"""Presses a scene of tm-scene new at random, and judges it by the verdicts of `make stability`.

python tests/organ/pressing.py SCENE.yaml --seed 1 --duration 600 [-o FOLDER]"""
import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

LIMIT_N = 8.9  # limit of the built-in Impulse Engine (docs/controller.md)
SURPLUS = 0.35  # share of the hand's work that tissue and springs may have: as in sessions of two hands (docs/stability.md), without the heat of viscous drag
AWAY_S = 4  # time to come to rest at the end


def upper_vertices(mesh, up):
    """Returns the vertices of the group 'surface' that are about the highest of their column, where a hand presses. [n, 3] m"""
    text = mesh.read_text()
    lines = text.split("$Nodes\n")[1].split("$EndNodes")[0].splitlines()[1:]
    points = np.array([[float(x) for x in line.split()[1:]] for line in lines])
    elements = [line.split() for line in text.split("$Elements\n")[1].split("$EndElements")[0].splitlines()[1:]]
    tets = np.array([[int(x) for x in e[-4:]] for e in elements if e[1] == "4"]) - 1
    face = np.concatenate([tets[:, c] for c in ([1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1])])
    _, first, count = np.unique(np.sort(face, axis=1), axis=0, return_index=True, return_counts=True)
    face = face[first[count == 1]]
    a, b, c = (points[face[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    return (a + b + c)[normal @ up > 0.5] / 3


def hand(places, depth_m, seed, duration_s):
    """Draws waypoints of presses, slides and jabs: depths up to three times the scene's own, 20 mm to 1 m in a second."""
    dice, path, t = np.random.default_rng(seed), [], 0.0

    def go(seconds, place, above_m):
        nonlocal t
        t += seconds
        x, y, z = 1e3 * place
        path.append(f"      - {{time: {t:.4f} s, tip: [{x:.3f} mm, {y:.3f} mm, {z:.3f} mm], above: {1e3 * above_m:.3f} mm}}")

    place = places[dice.integers(len(places))]
    go(0, place, 0.02)
    while t < duration_s - AWAY_S - 6:
        nearest = np.argsort(np.linalg.norm(places - place, axis=1))
        deep = depth_m * dice.uniform(0.1, 3)
        go((0.02 + deep) / dice.choice([0.02, 0.1, 0.3, 1.0]), place, -deep)
        go(dice.uniform(0, 1), place, -deep)
        for _ in range(dice.integers(3)):  # slides while pressed
            place = places[nearest[dice.integers(min(8, len(nearest)))]]
            deep = depth_m * dice.uniform(0.1, 2)
            go(dice.uniform(0.1, 1), place, -deep)
        go((0.02 + deep) / dice.choice([0.05, 0.3, 1.0]), place, 0.02)
        place = places[dice.integers(len(places))]
        go(dice.uniform(0.15, 0.4), place, 0.02)
    go(1, place, 0.02)
    return "\n".join(path)


def write_scene(scene, seed, duration_s, out):
    text = scene.read_text()
    mesh = scene.parent / re.search(r'mesh: "([^"]+)"', text).group(1)
    axis = [float(x) for x in re.search(r"axis: \[(.*?)\]", text).group(1).split(",")]
    up = np.zeros(3)
    up[np.argmax(np.abs(axis))] = -np.sign(axis[np.argmax(np.abs(axis))])
    depth_m = max(-float(d) for d in re.findall(r"above: (-\S+) mm", text)) * 1e-3
    path = hand(upper_vertices(mesh, up), depth_m, seed, duration_s)
    text = re.sub(r"(hand:\n  - instrument: 0\n    path:\n)(      - .*\n)+", lambda m: m.group(1) + path + "\n", text)
    text = re.sub(r"duration: \S+ s", f"duration: {duration_s} s", text).replace(mesh.name, str(mesh.resolve()), 1).replace("\nrendering:", "\nenergy:\n#")
    out.write_text(text)
    return path.count("\n") + 1


def judged(f, rows, duration_s):
    """Returns figures of tm-sim's `f` and its ticks, with a verdict."""
    force = np.sqrt(rows["fx_N"] ** 2 + rows["fy_N"] ** 2 + rows["fz_N"] ** 2)
    e = f["energy"]
    out = {"simulated_s": f["sim_s"], "computed_s": round(f["compute_s"], 1), "peak_N": float(force.max()), "felt": float((force > 0.01).mean()),
           "tool_work_J": e["tool_work_J"][0], "surplus": (e["generated_J"] - e["drag_J"]) / e["tool_work_J"][0], "left_J": e["kinetic_J"] + e["elastic_J"], "residual_J": abs(e["residual_J"]), "faults": int((rows["fault"] != 0).sum())}
    broken = [what for what, is_so in (
        ("a force is not finite", not np.isfinite(force).all()), ("a force above the device's limit", not force.max() <= LIMIT_N), ("the controller latched a fault", out["faults"] > 0),
        ("nothing was felt", out["felt"] < 0.05), ("more energy than the hand put in", not out["surplus"] <= SURPLUS), ("the account does not close", not out["residual_J"] <= 1e-6 * out["tool_work_J"]),
        ("not at rest after the hand had gone", not out["left_J"] <= 1e-6 * out["tool_work_J"]), ("it ended early", abs(f["sim_s"] - duration_s) > 0.1)) if is_so]
    return {**out, "verdict": "; ".join(broken) or "stable"}


def press(programs, scene, seed, duration_s, folder):
    """Returns the figures of one run; 'verdict' is 'stable' or the failure."""
    copy, figures, ticks = (folder / f"press-{seed}.{e}" for e in ("yaml", "json", "csv"))
    waypoints = write_scene(scene, seed, duration_s, copy)
    run = subprocess.run([str(programs / "tm-sim"), str(copy), "--lockstep", "--quiet", "--json", str(figures), "--csv", str(ticks)], capture_output=True, text=True)
    if run.returncode:
        return {"seed": seed, "verdict": f"exit {run.returncode}: {run.stderr.strip()}"}
    f, rows = json.loads(figures.read_text()), np.genfromtxt(ticks, delimiter=",", names=True)
    ticks.unlink()
    return {"seed": seed, "waypoints": waypoints, **judged(f, rows, duration_s)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("--seed", type=int, nargs="+", default=[1])
    parser.add_argument("--duration", type=float, default=600, help="simulated seconds of each seed")
    parser.add_argument("-o", "--out", type=Path, help="keeps what was run")
    args = parser.parse_args()
    programs = Path(os.environ.get("TM_OUT", Path(__file__).resolve().parents[2] / "build")) / "bin"
    good = True
    with tempfile.TemporaryDirectory() as folder:
        (args.out or Path(folder)).mkdir(exist_ok=True)
        for seed in args.seed:
            said = press(programs, args.scene, seed, args.duration, args.out or Path(folder))
            print(json.dumps(said), flush=True)
            good = good and said["verdict"] == "stable"
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
