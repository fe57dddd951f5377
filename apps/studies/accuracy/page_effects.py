"""Sections on strain smoothing, rotation, viscosity and friction in the accuracy report: what each costs and gains. page.py calls them, after it has put the module `page` on the path."""
import math

import matplotlib.pyplot as plt
import numpy as np
from page import draw_frontier, label_line, label_upright, loglog, series, times


def strain_smoothing_words(rows, beams):
    """Describes strain smoothing on the finest mesh: its error and cost against linear tetrahedra, and what refining these would cost for the same error."""
    tets = max(r["tets"] for r in rows)
    own = {r["shear"] if r["form"] == "strain_smoothing" else None: r for r in rows if r["tets"] == tets}
    linear, best = own[None], min((r for s, r in own.items() if s is not None), key=lambda r: r["displacement"])
    price = best["wall_per_simulated"] / linear["wall_per_simulated"]
    words = (f"On {tets:,} tetrahedra the effect with shear {best['shear']:g} is {100 * best['displacement']:.1f} % off in displacement instead of {100 * linear['displacement']:.1f} %, "
             f"at {price:.1f} times the price of a simulated second ({best['seconds_per_step'] / linear['seconds_per_step']:.1f} times the step, which is {best['step_s'] / linear['step_s']:.2f} times as long). ")
    line = sorted((r for r in rows if r["form"] == "linear"), key=lambda r: r["tets"])
    a, b = line[-2:]
    slope = math.log(b["wall_per_simulated"] / a["wall_per_simulated"]) / math.log(a["displacement"] / b["displacement"])
    equal = linear["wall_per_simulated"] * (linear["displacement"] / best["displacement"])**slope / best["wall_per_simulated"]
    words += f"Along the last stretch of their line linear tetrahedra would need {times(equal)} its price for the same error. "
    at = {b["nu"]: b for b in beams}
    low, high = min(at), max(at)
    return words + (f"A cantilever of 2,304 tetrahedra reaches {100 * at[low]['shear_1']:.0f} % of Timoshenko's tip at ν = {low:g} and {100 * at[high]['shear_1']:.0f} % at ν = {high:g} with shear 1; "
                    f"linear tetrahedra {100 * at[low]['linear']:.0f} % and {100 * at[high]['linear']:.0f} %.")


def strain_smoothing(page, data):
    """Adds the section on strain smoothing: error against cost of a pressed block, and a bent cantilever as nu nears 0.5."""
    rows, beams = data["rows"], data["cantilever"]
    forms = sorted({(r["form"], r["shear"]) for r in rows})
    page.section("Strain smoothing", "The effect <code>strain_smoothing</code> (averaged changes of volume, and a share of the shear averaged over edges) beside linear tetrahedra, on the block above (ν = 0.45), "
                 "and a cantilever of 1 × 1 × 6 pulled sideways from ν = 0.3 towards 0.5.")
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
    points = []
    for j, (form, shear) in enumerate(forms):
        own = sorted((r for r in rows if (r["form"], r["shear"]) == (form, shear)), key=lambda r: r["tets"])
        x, y, name = [r["wall_per_simulated"] for r in own], [r["displacement"] for r in own], form if form == "linear" else f"shear {shear:g}"
        axes[0].plot(x, y, **series(j))
        label_line(axes[0], x[-1], y[-1], name, series(j))
        points += [(a, b) for a, b in zip(x, y)]
        key = form if form == "linear" else f"shear_{shear:g}"
        steps = [1 - 2 * b["nu"] for b in beams]
        axes[1].plot(steps, [b[key] for b in beams], **series(j))
        label_line(axes[1], steps[-1], beams[-1][key], name, series(j))
    draw_frontier(axes[0], points)
    axes[0].axvline(1, color="#999999", linewidth=1)
    label_upright(axes[0], 1, "real time")
    loglog(axes[0], "wall seconds per simulated second", "displacement, relative error")
    axes[1].axhline(1, color="#999999", linewidth=1)
    axes[1].set(xscale="log", xlabel="1 − 2ν", ylabel="tip of the cantilever over Timoshenko's")
    axes[1].invert_xaxis()
    page.figure("strain_smoothing", figure, strain_smoothing_words(rows, beams), "tm-accuracy --knob strain_smoothing")
    page.table("strain_smoothing", ["form", "shear", "tets", "displacement", "reaction", "energy", "critical step s", "estimated step s", "µs/step", "wall s per s", "bytes", "pairs a vertex"],
               [[r["form"], r["shear"] if r["form"] == "strain_smoothing" else "", r["tets"], r["displacement"], r["reaction"], r["energy"], r["step_s"], r.get("sharp_s", ""),
                 r["seconds_per_step"] * 1e6, r["wall_per_simulated"], r["bytes"], round(r["pairs"] / (round((r["tets"] / 6)**(1 / 3)) + 1)**3, 1)] for r in rows] +
               [["cantilever", key[6:] if key != "linear" else "", f"nu {b['nu']:g}", b[key], "", "", "", "", "", "", "", ""] for b in beams for key in b if key != "nu"])
    page.record("strain_smoothing", data)


def rotation(page, data):
    """Adds the section on corotational elasticity: displacement error against the depth of a press, and cost."""
    rows, price = data["rows"], data["price"]
    page.section("Rotation", f"The effect <code>rotation</code> on {data['tets']:,.0f} tetrahedra, without <code>strain_smoothing</code> and with it (shear 0), against CalculiX with large displacements: neo-Hookean, "
                 "and of St. Venant and Kirchhoff, whose block has no rest beyond 15 %. The mesh's own error (dotted) is that of linear tissue against linear CalculiX.")
    figure, axis = plt.subplots()
    neo = {volume: [r for r in rows if r["law"] == "neo" and r["volume"] == volume] for volume in (False, True)}
    for j, (volume, key, name) in enumerate(((False, "displacement", "turning"), (False, "linear_displacement", "linear"), (True, "displacement", "turning, strain_smoothing"))):
        depth, error = [100 * r["depth"] for r in neo[volume]], [100 * r[key] for r in neo[volume]]
        axis.plot(depth, error, **series(j))
        label_line(axis, depth[-1], error[-1], name, series(j))
    for j, own in ((0, "mesh_alone"), (2, "mesh_alone_volume")):
        axis.axhline(100 * data[own], color=series(j)["color"], linewidth=0.8, linestyle=":")
    axis.set(xlabel="pressed by % of the tissue's size", ylabel="displacement error, %", ylim=(0, None))
    worst = max(r["displacement"] for r in rows if not r["volume"]) / data["mesh_alone"]
    first, last = neo[True][0], neo[True][-1]
    page.figure("rotation", figure, f"Without <code>strain_smoothing</code> at most {worst:.2f} times the mesh's own error, {100 * data['mesh_alone']:.1f} %. With it the mesh's own is {100 * data['mesh_alone_volume']:.1f} %, and what is left grows from "
                f"{100 * first['displacement']:.1f} % pressed by {100 * first['depth']:.0f} % to {100 * last['displacement']:.1f} % by {100 * last['depth']:.0f} %: the law's difference from that of the reference, which no mesh takes away. "
                f"{price['tets']:,} tetrahedra that all turn cost {price['turning_ns']:.1f} ns a tetrahedron and step, "
                f"linear ones {price['linear_ns']:.1f}; the step is {price['step_ratio']:.3f} of the linear one.", "tm-accuracy --knob rotation")
    page.table("rotation", ["against", "strain_smoothing", "pressed %", "displacement", "reaction", "energy", "linear displacement", "linear reaction"],
               [[r["law"], "yes" if r["volume"] else "no", 100 * r["depth"], r["displacement"], r["reaction"], r["energy"], r["linear_displacement"], r["linear_reaction"]] for r in rows])
    page.record("rotation", data)


def viscosity(page, data):
    """Adds the section on viscosity: error of the complex modulus, cost of a step, and a ramp that is held."""
    rows, prices = data["rows"], data["price"]
    page.section("Viscosity", "The effect <code>viscosity</code>. Error: the complex modulus of one term at the frequency where it loses most, against the closed form, by steps a cycle; "
                 "a step is far shorter than any strain that a hand makes. Price: a step of the same block, beside the same without the effect.")
    figure, axis = plt.subplots()
    x = [r["steps_a_cycle"] for r in rows]
    axis.plot(x, [r["modulus"] for r in rows], **series(0))
    label_line(axis, x[-1], rows[-1]["modulus"], "complex modulus", series(0))
    loglog(axis, "steps a cycle (the price)", "relative error")
    page.figure("viscosity", figure, f"{prices[1]['terms']} term whose shares are alike costs {100 * (prices[1]['price'] - 1):.0f} % of a step of {data['tets']:,} tetrahedra; "
                f"{prices[-1]['terms']} that relax the shear alone cost {100 * (prices[-1]['price'] - 1):.0f} %.", "tm-accuracy --knob viscosity")
    page.table("viscosity", ["steps a cycle", "error of the modulus"], [[r["steps_a_cycle"], r["modulus"]] for r in rows])
    page.table("viscosity_price", ["terms", "shares", "µs/step", "times elastic", "bytes"],
               [[p["terms"], p["shares"], 1e6 * p["seconds_per_step"], p["price"], p["bytes"]] for p in prices])
    ramp(page, data["ramp"])
    page.record("viscosity", data)


def ramp(page, data):
    """Adds stress over time of a ramp and hold, against the closed form."""
    rows, terms = data["rows"], data["terms"]
    page.text(f"A ramp of {100 * data['strain']:.0f} % in {1e3 * data['ramp_s']:g} ms, then a hold, of tissue with the constants of a perfused liver under fast compression (Sato et al., IRCOBI 2013, as the open human body model VIVA+ of February 2021 "
              f"has them: {1e-3 * data['sudden_shear_Pa']:.1f} kPa of shear modulus at once, "
              "of which " + ", ".join(f"{100 * t['shear']:.1f} % relax in {1e3 * t['time_s']:g} ms" for t in terms) + "), pulled without a change of volume, every vertex led.")
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
    time, peak = [1e3 * r["time_s"] for r in rows], max(r["closed_Pa"] for r in rows)
    fine = np.geomspace(rows[0]["time_s"], rows[-1]["time_s"], 400)
    risen = np.minimum(fine, data["ramp_s"])
    left = (1 - sum(t["shear"] for t in terms)) * risen + sum(t["shear"] * t["time_s"] * (np.exp((risen - fine) / t["time_s"]) - np.exp(-fine / t["time_s"])) for t in terms)
    axes[0].plot(1e3 * fine, 3e-3 * data["sudden_shear_Pa"] * data["strain"] / data["ramp_s"] * left, color="#999999", linewidth=1)
    axes[0].plot(time, [1e-3 * r["stress_Pa"] for r in rows], **{**series(0), "linestyle": "none"})
    axes[0].axvline(1e3 * data["ramp_s"], color="#999999", linewidth=0.8, linestyle=":")
    axes[0].set(xscale="log", xlabel="ms (dotted: the ramp's end)", ylabel="stress, kPa", ylim=(0, None))
    axes[1].plot(time, [max(abs(r["stress_Pa"] - r["closed_Pa"]) / peak, 1e-17) for r in rows], **series(0))
    loglog(axes[1], "ms", "off the closed form, of the peak")
    page.figure("viscosity_ramp", figure, f"Dots: tissue; line: the closed form. At most {data['worst']:.1e} of the peak apart in any step.", "tm-accuracy --knob viscosity")
    page.table("viscosity_ramp", ["s", "stress Pa", "closed form Pa"], [[r["time_s"], r["stress_Pa"], r["closed_Pa"]] for r in rows])


def friction(page, data):
    """Adds the section on friction: error of leaving it out while a tool slides, and its cost."""
    rows = data["rows"]
    page.section("Friction", f"The effect <code>friction</code>: a tool 3 mm deep in {data['tets']:,.0f} tetrahedra slides 8 mm at {1e3 * data['speed_m_s']:.0f} mm/s and back. Error: what leaving it out changes of the force at the hand, "
                 "along the slide and altogether. Price: a step of that slide, beside the same without the effect.")
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
    own = [r for r in rows if r["at_rest"] == r["sliding"]]
    x = [r["sliding"] for r in own]
    for j, (key, name) in enumerate((("along", "along the slide"), ("force", "whole force"))):
        axes[0].plot(x[1:], [100 * r[key] for r in own[1:]], **series(j))
        label_line(axes[0], x[-1], 100 * own[-1][key], name, series(j))
    axes[0].set(xlabel="coefficient", ylabel="force at the hand, left out, %", ylim=(0, None))
    axes[1].plot(x, [1e6 * r["seconds_per_step"] for r in own], **series(0))
    axes[1].set(xlabel="coefficient", ylabel="µs a step", ylim=(0, None))
    default = next(r for r in rows if r["at_rest"] != r["sliding"])
    page.figure("friction", figure, f"With {default['at_rest']:g} at rest and {default['sliding']:g} sliding, a tool without friction misses {100 * default['along']:.0f} % of the force along its slide and "
                f"{100 * default['force']:.0f} % of the whole; the effect costs {100 * (default['price'] - 1):.0f} % of a step in contact. What slips bears its coefficient within {max(r['off_law'] for r in rows):.0e} of what presses.",
                "tm-accuracy --knob friction")
    page.table("friction", ["at rest", "sliding", "left out along the slide", "left out of the whole", "along N", "pressed N", "off Coulomb", "µs/step", "times without"],
               [[r["at_rest"], r["sliding"], r["along"], r["force"], r["along_N"], r["normal_force_N"], r["off_law"], 1e6 * r["seconds_per_step"], r["price"]] for r in rows])
    page.record("friction", data)
