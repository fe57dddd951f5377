"""Draws what tm-accuracy measured: `python page.py FIGURES.json [--rates EVALUATE.json] -o FOLDER`."""
import argparse
import itertools
import json
import math
import pathlib
import sys

import matplotlib.pyplot as plt
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent.parent / "pages"))
import page_effects as effects  # noqa: E402
import page_laws  # noqa: E402
from page import Page, draw_frontier, label_line, label_upright, loglog, series, times  # noqa: E402

MEASURES = [("displacement", "displacement"), ("reaction", "reaction"), ("energy", "energy")]


def order(rows, key):
    """Computes the observed order p of error ~ h^p, between each mesh and the next finer one."""
    return [math.log(a[key] / b[key]) / math.log(a["h_m"] / b["h_m"]) for a, b in zip(rows, rows[1:])]


def mesh_words(own):
    """Describes the figure of isotropic meshes: which run in real time, and cost and gain of halving the edge."""
    fast = [r for r in own if r["wall_per_simulated"] <= 1]
    if fast:
        best = max(fast, key=lambda r: r["tets"])
        words = f"Choose the finest mesh that keeps real time: of these, here, {best['tets']:,} tetrahedra, {100 * best['displacement']:.1f} % off in displacement"
        words += f" and {100 * best['reaction']:.1f} % in the reaction. "
    else:
        words = "None of these meshes keeps real time here. "
    pairs = [(a, b) for a in own for b in own if abs(a["h_m"] / b["h_m"] - 2) < 1e-3]
    if pairs:
        a, b = pairs[-1]
        words += (f"Half the edge, {a['tets']:,} to {b['tets']:,} tetrahedra: {times(b['tets'] / a['tets'])} the tetrahedra, {times(a['step_s'] / b['step_s'])} the steps, "
                  f"{times(b['wall_per_simulated'] / a['wall_per_simulated'])} the time; the error in displacement divided by {a['displacement'] / b['displacement']:.1f}.")
    return words


def step_words(rows, meshes):
    """Describes the largest step's error in free vibration relative to the meshes', its order, and whether equilibrium depends on the step."""
    largest = max(rows, key=lambda r: r["dt_s"])
    errors = [r["displacement"] for r in meshes if r["law"] == "isotropic"]
    off = f"At the largest step here, {largest['of_guaranteed']:.2f} of the guaranteed one, ten periods of free vibration are off by {100 * largest['trajectory']:.1f} % in trajectory"
    if not errors:
        beside = "."
    elif largest["trajectory"] < 0.1 * min(errors):
        beside = f", far less than the meshes' own error in displacement ({100 * min(errors):.1f} to {100 * max(errors):.1f} %)."
    elif largest["trajectory"] < min(errors):
        beside = f", less than the meshes' own error in displacement ({100 * min(errors):.1f} to {100 * max(errors):.1f} %)."
    else:
        below = [r for r in rows if r["trajectory"] < min(errors)]
        enough = f"; below that of the finest from {max(r['of_guaranteed'] for r in below):.2f} of the guaranteed step down" if below else ""
        beside = f", which is not less than the meshes' own error in displacement ({100 * min(errors):.1f} to {100 * max(errors):.1f} %){enough}."
    spread = max(r["settle_s"] for r in rows) / min(r["settle_s"] for r in rows) - 1
    rest = (f"The time to rest changes by {100 * spread:.1f} % over all steps" +
            (": what a tool held still feels does not depend on the step." if spread < 0.02 else ", so that rest is reached at another time with another step."))
    return f"{off}{beside} {rest}"


def precision_words(rows):
    single = [r for r in rows if r["precision"] == "single"]
    worst, mesh_error = max(r["displacement"] for r in single), min(r["mesh_displacement"] for r in rows)
    double = {r["tets"]: r for r in rows if r["precision"] == "double"}
    finest = max(single, key=lambda r: r["tets"])
    ratio, speed = double[finest["tets"]]["bytes"] / finest["bytes"], double[finest["tets"]]["seconds_per_step"] / finest["seconds_per_step"]
    return (f"Single tensors add at most {worst:.0e} to the displacement, {mesh_error / worst:,.0f} times less than the finest mesh's own error; on it they take {ratio:.2f} times less memory "
            f"and the step {'is' if speed >= 1 else 'is not'} faster here ({speed:.2f} times). Choose double where results are compared bit for bit.")


def model_words(rows, alone):
    at10 = min(rows, key=lambda r: abs(r["depth"] - 0.10))
    words = (f"Pressed by {100 * at10['depth']:.0f} % a linear model is off by {100 * at10['displacement']:.1f} % in displacement and {100 * at10['reaction']:.1f} % in force "
             f"(dotted: what the mesh alone is off by, {100 * alone['displacement']:.1f} and {100 * alone['reaction']:.1f} %). ")
    within = list(itertools.takewhile(lambda r: r["displacement"] < 0.10, rows))
    words += f"Displacements stay within 10 % up to a press of {100 * within[-1]['depth']:.0f} %" if within else "Displacements are off by more than 10 % at every depth"
    force = list(itertools.takewhile(lambda r: r["reaction"] < 0.10, rows))
    return words + (f", forces up to {100 * force[-1]['depth']:.0f} %." if force else "; forces by more than 10 % from the first on.")


def fibre_words(rows):
    extra = rows[0]["seconds_per_step"] / np.median([r["seconds_per_step"] for r in rows[1:]]) - 1
    memory, best = rows[0]["bytes"] / rows[1]["bytes"] - 1, min(r["displacement"] for r in rows[1:])
    return (f"Fibres change the step's price by {100 * extra:+.0f} % and the tissue's memory by {100 * memory:+.0f} %; modelled with them displacements are off by {100 * rows[0]['displacement']:.0f} % "
            f"(the mesh's share), by the best isotropic stand-in {100 * best:.0f} %.")


def rates_words(rows):
    """States the frame rate at which `hold` equals the best extrapolator at about 20 Hz."""
    rate = min({r["rate_Hz"] for r in rows}, key=lambda x: abs(x - 20))
    best = min((r for r in rows if r["rate_Hz"] == rate), key=lambda r: r["rms"])
    hold = sorted((r for r in rows if r["extrapolator"] == "hold"), key=lambda r: r["rate_Hz"])
    enough = [r["rate_Hz"] for r in hold if r["rms"] <= best["rms"]]
    reach = f"needs {min(enough):.0f} frames a second for the same" if enough else f"has {100 * hold[-1]['rms']:.2f} % even at {hold[-1]['rate_Hz']:.0f}"
    return f"At {rate:.0f} frames a second <code>{best['extrapolator']}</code> has {100 * best['rms']:.3f} % of the peak; <code>hold</code> {reach}."


def mesh(page, data, bandwidth):
    rows = data["rows"]
    laws = ("isotropic", "fibred")
    page.section("Mesh", "Truth: CalculiX, ten-node tetrahedra, three times finer than our coarsest second mesh (<code>apps/studies/accuracy/reference</code>). "
                 "The pressed quarter block is settled on each mesh and its free vibration timed.")
    figure, axis = plt.subplots()
    points = []
    for i, law in enumerate(laws):
        for j, (key, name) in enumerate(MEASURES):
            own = [r for r in rows if r["law"] == law]
            style = dict(series(3 * i + j))
            x, y = [r["wall_per_simulated"] for r in own], [r[key] for r in own]
            axis.plot(x, y, **style)
            label_line(axis, x[-1], y[-1], f"{name}, {law}", style)
            if key == "displacement" and law == "isotropic":
                points = [(a, b, r["tets"]) for a, b, r in zip(x, y, own)]
                for a, b, tets in points:
                    axis.annotate(f"{tets}", (a, b), xytext=(0, 6), textcoords="offset points", fontsize=8, ha="center")
    best = draw_frontier(axis, points)
    axis.axvline(1, color="#999999", linewidth=1)
    label_upright(axis, 1, "real time")
    loglog(axis, "wall seconds per simulated second", "relative error")
    page.figure("mesh", figure, mesh_words([r for r in rows if r["law"] == "isotropic"]), "tm-accuracy --knob mesh")
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
    own = [r for r in rows if r["law"] == "isotropic"]
    tets = [r["tets"] for r in own]
    for j, (key, name) in enumerate(MEASURES):
        axes[0].plot(tets, [r[key] for r in own], **series(j))
        label_line(axes[0], tets[-1], own[-1][key], name, series(j))
    loglog(axes[0], "tetrahedra", "relative error, isotropic")
    axes[1].plot(tets, [r["seconds_per_step"] * 1e6 for r in own], **series(0))
    axes[1].plot(tets, [1 / r["step_s"] for r in own], **series(1))
    label_line(axes[1], tets[-1], own[-1]["seconds_per_step"] * 1e6, "µs a step", series(0))
    label_line(axes[1], tets[-1], 1 / own[-1]["step_s"], "steps a second", series(1))
    loglog(axes[1], "tetrahedra", "the two factors of the price")
    page.figure("mesh_factors", figure, "The price is the product of the two lines on the right. The critical step shrinks with the smallest altitude, "
                "so that one bad element makes all others expensive: look at <code>tm-mesh info</code> before refining.")
    table, orders = [], {}
    for law in laws:
        own = [r for r in rows if r["law"] == law]
        found = {key: [None] + order(own, key) for key, _ in MEASURES}
        orders[law] = {key: values[1:] for key, values in found.items()}
        for i, r in enumerate(own):
            share = r["bytes"] / r["seconds_per_step"] / bandwidth
            table.append([law, r["tets"], *(r[k] for k, _ in MEASURES), *("" if found[k][i] is None else round(found[k][i], 2) for k, _ in MEASURES),
                          r["step_s"], r["seconds_per_step"] * 1e6, r["wall_per_simulated"], round(share, 3)])
    page.table("mesh", ["law", "tets", "displacement", "reaction", "energy", "order u", "order F", "order W", "critical step s", "µs/step",
                        "wall s per s", "tissue bytes per step / bandwidth"], table)
    page.record("mesh", {"rows": rows, "orders": orders, "frontier_tets": [p[2] for p in best]})


def step(page, data, meshes):
    rows = data["rows"]
    page.section("Time step", f"Guaranteed step {data['guaranteed_s'] * 1e6:.0f} µs, sharp {data['sharp_s'] * 1e6:.0f} µs, lowest period {data['period_s'] * 1e3:.0f} ms. "
                 "Truth: the same model with a step 200 times smaller than the largest.")
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
    for j, (key, name) in enumerate((("trajectory", "trajectory"), ("phase", "phase"), ("energy", "energy"))):
        x = [r["wall_per_simulated"] for r in rows]
        y = [max(r[key], 1e-16) for r in rows]
        axes[0].plot(x, y, **series(j))
        label_line(axes[0], x[0], y[0], name, series(j), dx=6)
    draw_frontier(axes[0], [(r["wall_per_simulated"], r["trajectory"]) for r in rows])
    loglog(axes[0], "wall seconds per simulated second", "relative error after ten periods")
    axes[1].plot([r["of_sharp"] for r in rows], [r["settle_s"] for r in rows], **series(0))
    axes[1].axvline(data["guaranteed_s"] / data["sharp_s"], color="#999999", linewidth=1)
    axes[1].axvline(1, color="#c1440e", linewidth=1)
    label_upright(axes[1], data["guaranteed_s"] / data["sharp_s"], "guaranteed step")
    label_upright(axes[1], 1, "sharp critical step", "#c1440e")
    axes[1].set(xlabel="step / sharp critical step", ylabel="seconds until within 1 % of rest", ylim=(0, 1.3 * max(r["settle_s"] for r in rows)))
    page.figure("step", figure, step_words(rows, meshes), "tm-accuracy --knob step")
    page.table("step", ["step µs", "of guaranteed", "of sharp", "trajectory", "phase", "energy", "settles in s", "wall s per s"],
               [[r["dt_s"] * 1e6, r["of_guaranteed"], r["of_sharp"], r["trajectory"], r["phase"], r["energy"], r["settle_s"], r["wall_per_simulated"]] for r in rows])
    small = [r for r in rows if r["of_guaranteed"] < 0.9]
    page.record("step", {**data, "orders": {k: math.log(small[-1][k] / small[0][k]) / math.log(small[-1]["dt_s"] / small[0]["dt_s"])
                                            for k in ("trajectory", "phase", "energy")}})


def mass(page, data):
    rows = data["rows"]
    page.section("Mass scaling", f"A cuttable block with flat tetrahedra, whose own guaranteed step is {data['own_s'] * 1e6:.0f} µs, pressed within 0.1 s and held. "
                 "Truth: its own mass with a step ten times smaller. Cutting costs a tissue most of its step; mass scaling gives that back before it adds anything.")
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
    axes[0].plot([r["wall_per_simulated"] for r in rows], [r["force"] for r in rows], **series(0))
    draw_frontier(axes[0], [(r["wall_per_simulated"], r["force"]) for r in rows])
    loglog(axes[0], "wall seconds per simulated second", "force at the indenter, relative RMS error")
    axes[1].plot([r["of_own"] for r in rows], [100 * r["added"] for r in rows], **series(0))
    axes[1].set(xlabel="step / its own guaranteed step", ylabel="mass added, %")
    free = max(r["of_own"] for r in rows if r["added"] < 1e-3)
    page.figure("mass", figure, f"Up to {free:.3g} times the step nothing is added; at {rows[-1]['of_own']:.2g} times {100 * rows[-1]['added']:.3g} % of the mass, and the force is off by {100 * rows[-1]['force']:.2g} %.",
                "tm-accuracy --knob mass")
    page.table("mass", ["mass scaling", "step µs", "of its own", "mass added %", "vertices", "lowest frequency", "force", "held force", "wall s per s"],
               [["yes" if r["scaled"] else "no", r["dt_s"] * 1e6, r["of_own"], 100 * r["added"], r["vertices"], r["frequency"], r["force"], r["held_force"], r["wall_per_simulated"]] for r in rows])
    page.record("mass", data)


def precision(page, data):
    rows = data["rows"]
    page.section("Precision of the stored tensors", "Positions stay double; tensors are stored as float or double. Error against double on the same mesh.")
    figure, axis = plt.subplots()
    points = []
    for j, kind in enumerate(("double", "single")):
        own = [r for r in rows if r["precision"] == kind]
        total = [max(r["mesh_displacement"], 1e-16) for r in own]
        x = [r["seconds_per_step"] * 1e6 for r in own]
        points += list(zip(x, total))
        axis.plot(x, total, **series(j))
        label_line(axis, x[-1], total[-1], f"{kind}: mesh and rounding", series(j), dy=6 * (1 - 2 * j))
        if kind == "single":
            axis.plot(x, [r["displacement"] for r in own], **series(2))
            label_line(axis, x[-1], own[-1]["displacement"], "rounding alone", series(2))
    draw_frontier(axis, points)
    loglog(axis, "µs a step", "relative displacement error")
    page.figure("precision", figure, precision_words(rows), "tm-accuracy --knob precision")
    page.table("precision", ["tensors", "tets", "displacement", "reaction", "energy", "mesh error", "bytes", "µs/step"],
               [[r["precision"], r["tets"], r["displacement"], r["reaction"], r["energy"], r["mesh_displacement"], r["bytes"], r["seconds_per_step"] * 1e6] for r in rows])
    page.record("precision", data)


def model(page, data):
    rows = data["rows"]
    page.section("Model: linear against large displacements", "Truth: CalculiX, neo-Hookean, ten-node tetrahedra. "
                 "Tensor/mass, hybrid and precomputed are all linear" +
                 (f" and agree at rest to {max(p['difference'] for p in data['prices']):.0e}, so one line stands for all three." if data.get("prices") else "."))
    figure, axis = plt.subplots()
    depth = [100 * r["depth"] for r in rows]
    for j, (key, name) in enumerate(MEASURES):
        axis.plot(depth, [100 * r[key] for r in rows], **series(j))
        label_line(axis, depth[-1], 100 * rows[-1][key], name, series(j))
        axis.axhline(100 * data["mesh_alone"][key], color=series(j)["color"], linewidth=0.8, linestyle=":")
        label_line(axis, depth[-1], 100 * data["mesh_alone"][key], f"{name}, mesh alone", series(j))
    axis.axvline(10, color="#999999", linewidth=1)
    label_upright(axis, 10, "the paper's 10 %")
    axis.set(xlabel="pressed by % of the tissue's size", ylabel="error, %", ylim=(0, None))
    page.figure("model", figure, model_words(rows, data["mesh_alone"]), "tm-accuracy --knob model")
    page.table("model", ["pressed %", "displacement", "reaction", "energy", "force N", "true force N"],
               [[100 * r["depth"], r["displacement"], r["reaction"], r["energy"], r["force_N"], r["true_force_N"]] for r in rows])
    prices = data.get("prices", [])
    if prices:
        page.table("model_prices", ["model", "ms per frame", "set-up s", "bytes", "may be cut", "difference at rest"],
                   [[p["model"], 1e3 * p["seconds_per_frame"], p["setup_s"], p["bytes"], p["cuttable"], p["difference"]] for p in prices],
                   "One frame of 1/30 s of the same block and the same press. Take precomputed where nothing is cut, hybrid where a part is, tensor/mass where everything may be.")
    page.record("model", data)


def fibre(page, data):
    rows = data["rows"]
    page.section("Fibres", "Tissue with fibres along x, modelled with them and without. Truth: CalculiX, transversely isotropic.")
    figure, axis = plt.subplots()
    for j, (key, name) in enumerate(MEASURES):
        own = rows[1:]
        axis.plot([r["seconds_per_step"] * 1e6 for r in own], [r[key] for r in own], **{**series(j), "linestyle": ""}, fillstyle="none")
        axis.plot(rows[0]["seconds_per_step"] * 1e6, rows[0][key], **{**series(j), "linestyle": ""})
        label_line(axis, rows[0]["seconds_per_step"] * 1e6, rows[0][key], f"{name}, fibred", series(j))
    for r in rows[1:]:  # at the reaction, which distinguishes them; displacements are equal for every E
        label_line(axis, r["seconds_per_step"] * 1e6, r["reaction"], f"E = {r['young_Pa'] / 1e3:.0f} kPa", series(1), dx=8)
    label_line(axis, rows[1]["seconds_per_step"] * 1e6, rows[1]["displacement"], "open: isotropic stand-ins", series(0), dx=14)
    axis.set(yscale="log", xlabel="µs a step", ylabel="relative error")
    axis.set_xlim(0, 1.6 * max(r["seconds_per_step"] * 1e6 for r in rows))
    page.figure("fibre", figure, fibre_words(rows), "tm-accuracy --knob fibre")
    page.table("fibre", ["model", "E Pa", "displacement", "reaction", "energy", "µs/step", "step s", "bytes"],
               [[r["model"], r["young_Pa"], r["displacement"], r["reaction"], r["energy"], r["seconds_per_step"] * 1e6, r["step_s"], r["bytes"]] for r in rows])
    page.record("fibre", data)


def rates(page, evaluation):
    """Plots the force error at the hand against frame rate and extrapolator, from rows of tm-evaluate."""
    rows = evaluation["rows"]
    page.section("Rates", "Frame rate and extrapolator against the force's error at the hand, from <code>make evaluate</code>.")
    figure, axis = plt.subplots()
    names = list(dict.fromkeys(r["extrapolator"] for r in rows))
    for j, name in enumerate(names):
        own = sorted((r for r in rows if r["extrapolator"] == name), key=lambda r: r["rate_Hz"])
        x, y = [r["rate_Hz"] for r in own], [100 * r["rms"] for r in own]
        axis.plot(x, y, **series(j))
        label_line(axis, x[-1], y[-1], name, series(j))
    loglog(axis, "frames a second (the price)", "RMS force error, % of peak")
    page.figure("rates", figure, rates_words(rows), "tm-evaluate")
    page.table("rates", ["extrapolator", "Hz", "RMS % of peak", "peak %"], [[r["extrapolator"], r["rate_Hz"], 100 * r["rms"], 100 * r["peak"]] for r in rows])
    page.record("rates", evaluation)


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("figures")
    arguments.add_argument("--rates")
    arguments.add_argument("-o", "--out", required=True)
    options = arguments.parse_args()
    data = json.loads(pathlib.Path(options.figures).read_text())
    page = Page(options.out, "What accuracy costs in time",
                "Every choice has an error and a price. Each figure shows both; the grey band joins the choices that nothing beats.",
                {"memory bandwidth in this run": f"{data['bandwidth_B_s'] / 1e9:.1f} GB/s, triad over 4 MiB, one thread",
                 "form": "quick" if data["quick"] else "whole"})
    page.record("bandwidth_B_s", data["bandwidth_B_s"])
    mesh(page, data["mesh"], data["bandwidth_B_s"])
    effects.strain_smoothing(page, data["strain_smoothing"])
    step(page, data["step"], data.get("mesh", {}).get("rows", []))
    mass(page, data["mass"])
    precision(page, data["precision"])
    model(page, data["model"])
    effects.rotation(page, data["rotation"])
    page_laws.laws(page, data["law"])
    effects.viscosity(page, data["viscosity"])
    effects.friction(page, data["friction"])
    fibre(page, data["fibre"])
    if options.rates:
        rates(page, json.loads(pathlib.Path(options.rates).read_text()))
    print(page.write("accuracy"))


if __name__ == "__main__":
    main()
