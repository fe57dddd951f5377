"""Draws what tm-accuracy measured: `python page.py FIGURES.json [--rates EVALUATE.json] -o FOLDER`."""
import argparse
import json
import math
import pathlib
import sys

import matplotlib.pyplot as plt
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "pages"))
from page import Page, frontier, label_line, series  # noqa: E402

MEASURES = [("displacement", "displacement"), ("reaction", "reaction"), ("energy", "energy")]


def order(rows, key):
    """Observed order p of error ~ h^p, between each mesh and the next finer one."""
    return [math.log(a[key] / b[key]) / math.log(a["h_m"] / b["h_m"]) for a, b in zip(rows, rows[1:])]


def loglog(axis, xlabel, ylabel):
    axis.set(xscale="log", yscale="log", xlabel=xlabel, ylabel=ylabel)


def draw_frontier(axis, points):
    """The choices nothing beats, joined; dominated ones stay as drawn."""
    best = frontier(points)
    axis.plot([p[0] for p in best], [p[1] for p in best], color="#bbbbbb", linewidth=5, alpha=0.6, zorder=0, solid_capstyle="round")
    return best


def mesh(page, data, bandwidth):
    rows = data["rows"]
    laws = ("isotropic", "fibred")
    page.section("Mesh", "Truth: CalculiX, ten-node tetrahedra, three times finer than our coarsest second mesh (<code>apps/accuracy/reference</code>). "
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
    axis.annotate("real time", (1, axis.get_ylim()[0]), xytext=(3, 4), textcoords="offset points", rotation=90, fontsize=8, color="#777777")
    loglog(axis, "wall seconds per simulated second", "relative error")
    finest = [r for r in rows if r["law"] == "isotropic" and r["wall_per_simulated"] <= 1]
    choose = max(finest, key=lambda r: r["tets"]) if finest else min(rows, key=lambda r: r["wall_per_simulated"])
    page.figure("mesh", figure, f"Choose the finest mesh that keeps real time: here {choose['tets']} tetrahedra, {100 * choose['displacement']:.1f} % off in displacement. "
                "Each halving of the edge costs eight times the tetrahedra and more than twice the steps, so halving the error costs at least as much again.",
                "tm-accuracy --knob mesh")
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
                "so one bad element can cost more than ten thousand good ones: look at <code>tm-mesh info</code> before refining.")
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


def step(page, data):
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
    axes[1].set(xlabel="step / sharp critical step", ylabel="seconds until within 1 % of rest", ylim=(0, 1.3 * max(r["settle_s"] for r in rows)))
    page.figure("step", figure, "Take the largest step the guaranteed bound allows: even there the trajectory is off by far less than the mesh's own error. "
                "Smaller steps buy accuracy in free vibration (second order) and nothing at rest, where a tool held still is felt.",
                "tm-accuracy --knob step")
    page.table("step", ["step µs", "of guaranteed", "of sharp", "trajectory", "phase", "energy", "settles in s", "wall s per s"],
               [[r["dt_s"] * 1e6, r["of_guaranteed"], r["of_sharp"], r["trajectory"], r["phase"], r["energy"], r["settle_s"], r["wall_per_simulated"]] for r in rows])
    small = [r for r in rows if r["of_guaranteed"] < 0.9]
    page.record("step", {**data, "orders": {k: math.log(small[-1][k] / small[0][k]) / math.log(small[-1]["dt_s"] / small[0]["dt_s"])
                                            for k in ("trajectory", "phase", "energy")}})


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
    worst = max(r["displacement"] for r in rows)
    ratio = rows[-2]["bytes"] / rows[-1]["bytes"]
    page.figure("precision", figure, f"Single tensors add at most {worst:.0e} to the displacement, thousands of times less than the mesh's own error, and shrink the tissue by {ratio:.2f}. "
                "Choose single when the mesh no longer fits the cache; choose double where results are compared bit for bit or to 1e-7.", "tm-accuracy --knob precision")
    page.table("precision", ["tensors", "tets", "displacement", "reaction", "energy", "mesh error", "bytes", "µs/step"],
               [[r["precision"], r["tets"], r["displacement"], r["reaction"], r["energy"], r["mesh_displacement"], r["bytes"], r["seconds_per_step"] * 1e6] for r in rows])
    page.record("precision", data)


def model(page, data):
    rows = data["rows"]
    page.section("Model: linear against large displacements", "Truth: CalculiX, neo-Hookean, ten-node tetrahedra. "
                 "Tensor/mass, hybrid and precomputed are all linear and agree at rest, so one line stands for all three.")
    figure, axis = plt.subplots()
    depth = [100 * r["depth"] for r in rows]
    for j, (key, name) in enumerate(MEASURES):
        axis.plot(depth, [100 * r[key] for r in rows], **series(j))
        label_line(axis, depth[-1], 100 * rows[-1][key], name, series(j))
        axis.axhline(100 * data["mesh_alone"][key], color=series(j)["color"], linewidth=0.8, linestyle=":")
    axis.axvline(10, color="#999999", linewidth=1)
    axis.annotate("the paper's 10 %", (10, axis.get_ylim()[1]), xytext=(3, -10), textcoords="offset points", fontsize=8, color="#777777")
    axis.set(xlabel="pressed by % of the tissue's size", ylabel="error, %", ylim=(0, None))
    at10 = next(r for r in rows if abs(r["depth"] - 0.10) < 1e-6)
    good = max((r["depth"] for r in rows if r["displacement"] < 0.10), default=rows[0]["depth"])
    page.figure("model", figure, f"At the paper's 10 % a linear model is off by {100 * at10['displacement']:.1f} % in displacement and {100 * at10['reaction']:.1f} % in force "
                f"(dotted: what the mesh alone is off by). Displacements stay within 10 % up to a press of {100 * good:.0f} %; press deeper only where the force matters and the shape does not.",
                "tm-accuracy --knob model")
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
    for r in rows[1:]:
        axis.annotate(f"E = {r['young_Pa'] / 1e3:.0f} kPa", (r["seconds_per_step"] * 1e6, r["displacement"]), xytext=(5, 0),
                      textcoords="offset points", fontsize=8, va="center")
    axis.set(yscale="log", xlabel="µs a step", ylabel="relative error")
    axis.set_xlim(0, 1.6 * max(r["seconds_per_step"] * 1e6 for r in rows))
    extra = rows[0]["seconds_per_step"] / np.median([r["seconds_per_step"] for r in rows[1:]]) - 1
    best = min(r["displacement"] for r in rows[1:])
    page.figure("fibre", figure, f"Fibres change the step's price by {100 * extra:+.1f} % (the tensors have the same shape, so nothing but the machine's noise) and the best isotropic stand-in is off by {100 * best:.0f} % in displacement. "
                "Name the fibres wherever they are known: the price is paid once, when the tensors are built.", "tm-accuracy --knob fibre")
    page.table("fibre", ["model", "E Pa", "displacement", "reaction", "energy", "µs/step", "step s", "bytes"],
               [[r["model"], r["young_Pa"], r["displacement"], r["reaction"], r["energy"], r["seconds_per_step"] * 1e6, r["step_s"], r["bytes"]] for r in rows])
    page.record("fibre", data)


def rates(page, evaluation):
    """Frame rate and extrapolator against the force error at the hand: the rows come from tm-evaluate."""
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
    page.figure("rates", figure, "A better extrapolator buys what only many times the frame rate would buy otherwise. "
                "Choose <code>contact</code> or <code>tangent</code> where the simulation sends what they need, and spend the frame on the mesh.", "tm-evaluate")
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
    step(page, data["step"])
    precision(page, data["precision"])
    model(page, data["model"])
    fibre(page, data["fibre"])
    if options.rates:
        rates(page, json.loads(pathlib.Path(options.rates).read_text()))
    print(page.write("accuracy"))


if __name__ == "__main__":
    main()
