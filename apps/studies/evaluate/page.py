"""Draws what tm-evaluate measured: `python page.py FIGURES.json -o FOLDER`. Leaves index.html, evaluate.json, rates.json (for `make accuracy`)."""
import argparse
import json
import pathlib
import sys

import matplotlib.pyplot as plt
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent.parent / "pages"))
from aims import aims  # noqa: E402
from page import Page, label_line, series  # noqa: E402

NAMES = ["hold", "time", "position", "broyden", "tangent", "local_model", "paper_position", "adaptive"]
SKETCH = {0: dict(hold=3.0, time=3.5, position=3.3, broyden=2.0, tangent=0.9, local_model=0.03),
          1: dict(hold=6.4, time=8.0, position=7.6, broyden=5.5, tangent=3.7, local_model=0.08)}


def pick(rows, **wanted):
    base = dict(truth="model", path="tour", rate_Hz=20, speed_m_s=0.01, tremor_m=40e-6, latency_frames=0, jitter=0, loss=0, encoders=True)
    base.update(wanted)
    def same(row, key, value):
        return value is ... or (abs(row[key] - value) < 1e-9 if isinstance(value, float) or isinstance(value, int) and not isinstance(value, bool) else row[key] == value)
    return [r for r in rows if all(same(r, k, v) for k, v in base.items())]


def by_name(rows, key):
    """Returns {extrapolator: [(x, rms %)]} sorted by x."""
    out = {}
    for name in NAMES:
        points = sorted((r[key], 100 * r["rms"]) for r in rows if r["extrapolator"] == name)
        if points:
            out[name] = points
    return out


def curves(axis, rows, key, xlabel, log=True):
    for i, (name, points) in enumerate(by_name(rows, key).items()):
        x, y = [p[0] for p in points], [max(p[1], 1e-4) for p in points]
        axis.plot(x, y, **series(i))
        label_line(axis, x[-1], y[-1], name, series(i))
    axis.set(xlabel=xlabel, ylabel="RMS force error, % of peak", yscale="log", **({"xscale": "log"} if log else {}))


def roughness(page, rows):
    page.section("The force itself", "Second difference of the unfiltered force from tick to tick (2 ms), contact made and lost left out, over the peak. "
                 "No extrapolator can be smoother than this.")
    figure, axis = plt.subplots()
    for i, model in enumerate(dict.fromkeys(r["model"] for r in rows)):
        own = [r for r in rows if r["model"] == model]
        x = [1e3 * r["depth_m"] for r in own]
        axis.plot(x, [100 * r["largest"] for r in own], **series(i))
        axis.plot(x, [100 * r["p99"] for r in own], **{**series(i), "fillstyle": "none"}, alpha=0.6)
        label_line(axis, x[-1], 100 * own[-1]["largest"], f"{model}, largest", series(i))
        label_line(axis, x[-1], 100 * own[-1]["p99"], f"{model}, 99 %", series(i))
    axis.axhline(0.5, color="#999999", linewidth=1)
    axis.annotate("aim: 0.5 %", (axis.get_xlim()[0], 0.5), xytext=(3, 3), textcoords="offset points", fontsize=8, color="#777777")
    axis.set(xlabel="deepest press, mm", ylabel="second difference per tick, % of peak", yscale="log")
    worst = max(rows, key=lambda r: r["largest"])
    page.figure("roughness", figure, f"The worst is {100 * worst['largest']:.2f} % ({worst['model']}, {1e3 * worst['depth_m']:.0f} mm); 99 % of the ticks of every model stay below "
                f"{100 * max(r['p99'] for r in rows):.2f} %.", "tm-evaluate --study")
    page.table("roughness", ["model", "depth mm", "largest %", "99 % of ticks below %", "peak N"],
               [[r["model"], 1e3 * r["depth_m"], 100 * r["largest"], 100 * r["p99"], r["peak_N"]] for r in rows])


def operating(page, rows):
    """Draws the first table: errors of every law on operating scenes by rate of force samples and latency, with the cost of the rate."""
    page.section("Operating scenes", "The demo's scenes as they are: pressed, held, lifted, cut and let go. RMS of the vector error over the peak force, against the same scene at the tick rate; encoders and tremor on. "
                 "Up to 50 samples a second carry a patch; above that laws go by the force alone. The price is one processor's share for the simulation.")
    hands = list(dict.fromkeys((r["scene"], r["mode"]) for r in rows))
    of = lambda hand, late: [r for r in rows if (r["scene"], r["mode"], r["latency_samples"]) == (*hand, late)]
    names = [n for n in dict.fromkeys(r["extrapolator"] for r in rows) if n != "paper_position"]
    columns = -(-len(hands) // 2)
    figure, axes = plt.subplots(2, columns, figsize=(4.2 * columns, 7), layout="constrained", squeeze=False, sharex=True)
    for axis in axes.flat[len(hands):]:
        axis.set_visible(False)
    for axis, hand in zip(axes.flat, hands):
        for i, name in enumerate(names):
            points = sorted((r["rate_Hz"], 100 * r["rms"]) for r in of(hand, 1) if r["extrapolator"] == name)
            x, y = [p[0] for p in points], [max(p[1], 1e-2) for p in points]
            axis.plot(x, y, **series(i))
            label_line(axis, x[-1], y[-1], name, series(i))
        axis.set(xscale="log", yscale="log", title=f"{hand[0]}, {hand[1]}", xlabel="force samples a second", ylabel="RMS error, % of peak")
    at = {hand: {r["rate_Hz"]: 100 * r["rms"] for r in of(hand, 1) if r["extrapolator"] == "hold"} for hand in hands}
    first = hands[-1]
    low, high = min(at[first]), max(at[first])
    page.figure("operating", figure, f"A sample late. More samples beat any law: on {first[0]}, {first[1]}, <code>hold</code> goes from {at[first][low]:.1f} % at {low:g} Hz to {at[first][high]:.1f} % at {high:g} Hz.",
                "tm-evaluate --study --part operating")
    page.table("operating", ["scene", "instrument", "Hz", "processor %", "samples late", *names],
               [[*hand, rate, 100 * own[0]["processor_share"], late, *(100 * r["rms"] for n in names for r in own if r["extrapolator"] == n)]
                for hand in hands for rate in sorted({r["rate_Hz"] for r in of(hand, 0)}) for late in (0, 1, 2)
                for own in [[r for r in of(hand, late) if r["rate_Hz"] == rate]]], "RMS error in % of peak.")
    phases = ["free", "touch", "press", "slide", "grasp", "lift", "cut", "let go"]
    page.table("operating_phases", ["scene", "instrument", "Hz", "law", *phases],
               [[*hand, rate, name, *(100 * r["phases"][p]["rms"] if p in r["phases"] else "" for p in phases)]
                for hand in hands for rate in sorted({r["rate_Hz"] for r in of(hand, 1)}) for name in names
                for r in of(hand, 1) if r["rate_Hz"] == rate and r["extrapolator"] == name], "A sample late, RMS in % of the session's peak, in the ticks of each phase.")
    page.record("operating", rows)


def figure5(page, data):
    samples, truth = np.array(data["samples"]), np.array(data["truth"])
    page.section("The paper's figure 5, with numbers", f"A steady hand at 0.01 m/s, 20 Hz, {data['model']} model. Left: samples as impulses, the extrapolated force as a line, over time. "
                 "Right: its error as a vector, polar, in the plane across and along the shaft; one row an extrapolator, one scale for all.")
    names = [n for n in NAMES if n in data["extrapolators"]]
    figure = plt.figure(figsize=(9, 1.7 * len(names)), layout="constrained")
    dt = data["dt_s"]
    time = np.arange(len(truth)) * dt
    errors = {n: np.array(data["extrapolators"][n]) - truth for n in names}
    scale = 1.05 * max(np.linalg.norm(e, axis=1).max() for e in errors.values())
    ring = max(r for k in (1, 2, 5) for e in range(-9, 3) if (r := k * 10.0**e) < 0.75 * scale)
    at = np.linspace(0, time[-1], len(samples))
    for i, name in enumerate(names):
        left = figure.add_subplot(len(names), 2, 2 * i + 1)
        force = np.array(data["extrapolators"][name])
        left.vlines(at, 0, np.linalg.norm(samples, axis=1), color="#bbbbbb", linewidth=0.8)
        left.plot(time, np.linalg.norm(force, axis=1), color="#1b1b1b", linewidth=1)
        left.set_ylabel(f"{name}\nN", fontsize=8)
        left.tick_params(labelsize=7)
        right = figure.add_subplot(len(names), 2, 2 * i + 2, projection="polar")
        e = errors[name]
        across = np.where(e[:, 0] >= 0, 1, -1) * np.hypot(e[:, 0], e[:, 1])
        right.plot(np.arctan2(e[:, 2], across), np.linalg.norm(e, axis=1), color="#c1440e", linewidth=0.7)
        right.set_ylim(0, scale)
        right.tick_params(labelsize=6)
        right.set_xticklabels([])
        right.set_rticks([ring], [f"{ring:g} N"])
        right.set_rlabel_position(20)
        if i == 0:
            left.set_title("force: samples (grey), extrapolated (black)", fontsize=8)
            right.set_title("error, N; to the right across the shaft, up along it", fontsize=8)
    left.set_xlabel("s", fontsize=8)
    page.figure("figure5", figure, "What the paper showed as pictures. The fuller a rosette, the larger the error of that extrapolator; an empty one is what the hand wants.", "tm-evaluate --study")


def rates(page, rows, models):
    page.section("Rate, speed and latency", "RMS of the vector error over the peak force; surgeon-like strokes at 0.01 m/s with a tremor of 40 µm at 9 Hz, encoders on, 20 Hz, unless said otherwise. "
                 "Truth: the same model run at 500 Hz on the same path.")
    for model in models:
        figure, axes = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
        curves(axes[0], pick(rows, model=model, rate_Hz=...), "rate_Hz", "frames a second")
        curves(axes[1], pick(rows, model=model, speed_m_s=...), "speed_m_s", "speed, m/s")
        curves(axes[2], pick(rows, model=model, latency_frames=...), "latency_frames", "latency, frames", log=False)
        at = {r["extrapolator"]: 100 * r["rms"] for r in pick(rows, model=model)}
        best = min(at, key=at.get)
        page.figure(f"rates_{model}", figure, f"<b>{model}</b>: at 20 Hz <code>{best}</code> is best with {at[best]:.2f} % (<code>position</code> {at['position']:.2f} %, <code>hold</code> {at['hold']:.2f} %).",
                    f"tm-evaluate --study --model {model}")
    table = []
    for model in models:
        for late in (0, 1, 2, 3):
            row = [model, late]
            for name in NAMES:
                own = [r for r in pick(rows, model=model, latency_frames=late) if r["extrapolator"] == name]
                row.append(100 * own[0]["rms"] if own else "")
            table.append(row)
    page.table("latency", ["model", "frames late", *NAMES], table, "RMS error in % of peak at 20 Hz, 0.01 m/s, tremor on.")


def hands(page, rows):
    """Draws paths on which tissue is cut or grasped."""
    own = [r for r in rows if "cut_true" in r]
    if not own:
        return
    page.section("Cut and held", "Isotropic tissue at 20 Hz, by the models that can, while the other hand cuts a slit beside the tool, while the tool itself is the cautery, and in a grasper that lifts and pulls. "
                 "Cuts at 20 Hz are the truth's, at the same simulated times; in the paths named <i>own cuts</i> the cautery cuts for itself in both runs.")
    paths = list(dict.fromkeys((r["path"], r["model"]) for r in own))
    at = lambda path, model, late: {r["extrapolator"]: r for r in own if (r["path"], r["model"], r["latency_frames"]) == (path, model, late)}
    page.table("hands", ["path", "model", "frames late", *NAMES, "contact, unbridged"],
               [[path, model, late, *(100 * e[n]["rms"] if n in e else "" for n in [*NAMES, "local_model-unbridged"])] for path, model in paths for late in (0, 1, 2) for e in [at(path, model, late)]],
               "RMS error in % of peak. Unbridged: <code>contact</code> going over to another cut state at once.")
    page.table("hands_details", ["path", "model", "frames late", "cut", "of these by both", "true jump per tick %", "contact's at an arrival %", "position's at an arrival %",
                                 "contact's squared error in ticks with a cut after its sample %", "such ticks %", "off the patch %"],
               [[path, model, late, e["local_model"]["cut_true"], e["local_model"]["cut_shared"], 100 * e["local_model"]["jump_true"], 100 * e["local_model"]["jump_arrival"], 100 * e["position"]["jump_arrival"],
                 100 * e["local_model"]["cut_since_error2"], 100 * e["local_model"]["cut_since_ticks"], 100 * e["local_model"]["off_patch"]] for path, model in paths for late in (0, 1, 2) for e in [at(path, model, late)]],
               "What was cut after the sample in use nobody at the hand can know: where nearly all of the squared error lies there, only more samples a second would help.")


def worse_words(rows, model, key):
    """Describes the effect of the worst condition on the best extrapolator and on `hold`."""
    found = by_name(pick(rows, model=model, **{key: ...}), key)
    best = min(found, key=lambda n: found[n][0][1])
    change = [f"<code>{n}</code> goes from {found[n][0][1]:.2f} to {found[n][-1][1]:.2f} %" for n in dict.fromkeys((best, "hold"))]
    return f"from none to {found[best][-1][0]:g} ({key}) {' and '.join(change)}."


def conditions(page, rows, models):
    page.section("Jitter, loss, encoders, reversals", "The same strokes at 20 Hz under worse circumstances.")
    for key, text in (("jitter", "jitter of the frame time, share of a frame"), ("loss", "share of samples lost")):
        figure, axis = plt.subplots()
        curves(axis, pick(rows, model=models[0], **{key: ...}), key, text, log=False)
        page.figure(key, figure, f"{models[0]} model: {worse_words(rows, models[0], key)}")
    table = []
    for model in models:
        for label, wanted in (("steady hand", dict(tremor_m=0)), ("tremor", {}), ("tremor, no encoders", dict(encoders=False)),
                              ("tremor, truth as the paper's", dict(truth="interpolated")), ("reversals at 0.05 m/s", dict(path="reversals", speed_m_s=0.05, tremor_m=0))):
            own = {r["extrapolator"]: r for r in pick(rows, model=model, **wanted)}
            if own:
                table.append([model, label, *(100 * own[n]["rms"] for n in NAMES)])
    page.table("circumstances", ["model", "path", *NAMES], table, "RMS error in % of peak, no latency.")
    table = []
    for model in models:
        for r in pick(rows, model=model):
            table.append([model, r["extrapolator"], 100 * r["peak"], 100 * r["jump_peak"], 100 * r["jump_p99"], 57.2958 * r["direction_rad"], r["over_limit"], r["off_patch"], 100 * r["worst_error2"], r["ns_per_tick"]])
    page.table("details", ["model", "extrapolator", "peak error %", "largest jump per tick %", "99 % of jumps below %", "direction, deg RMS", "force / limit", "off the patch", "squared error in the worst 2 % of ticks, %", "ns per tick"], table)


def z_width(page, rows):
    """Draws the benefit of streaming: stiffness and damping that `hold` renders stably, by rates of force samples and ticks, and by latency."""
    cell = lambda r: f"> {r['stiffness_N_m']:.0f}" if r["beyond"] else round(r["stiffness_N_m"])
    rates = sorted({(r["rate_Hz"], r["tick_Hz"]) for r in rows})
    of = lambda rate, tick, wall, late, passivity: next((r for r in rows if (r["rate_Hz"], r["tick_Hz"], r["wall_N_s_m"], r["delay_frames"], r["passivity"]) == (rate, tick, wall, late, passivity)), None)
    walls = sorted({r["wall_N_s_m"] for r in rows})
    lates = sorted({r["delay_frames"] for r in rows})
    page.section("Z-width", "The range of stiffness and damping of a wall that stays stable with this device and hand, by <code>hold</code>: after a step of 1 mm in the hand's wish its oscillation dies out within an encoder count. "
                 "Theory: b &gt; K (T/2 + delay) + B, B the wall's damping (Colgate and Schenkel 1997; Diolaiti et al. 2006).")
    figure, axes = plt.subplots(1, 2, figsize=(11, 4.4), layout="constrained")
    for i, (rate, tick) in enumerate(rates):
        own = [(r["stiffness_N_m"], r["wall_N_s_m"]) for w in walls for r in [of(rate, tick, w, 0, False)] if r]
        axes[0].plot([max(k, 1) for k, _ in own], [w for _, w in own], **series(i))
        label_line(axes[0], max(own[0][0], 1), own[0][1], f"{rate:g} Hz", series(i))
    axes[0].set(xscale="log", xlabel="largest stable stiffness, N/m", ylabel="damping of the wall, N·s/m", title="no latency")
    for i, late in enumerate(lates):
        own = [(rate, r["stiffness_N_m"], r["theory_N_m"]) for rate, tick in rates for r in [of(rate, tick, 0, late, False)] if r]
        axes[1].plot([o[0] for o in own], [max(o[1], 1) for o in own], **series(i))
        axes[1].plot([o[0] for o in own], [o[2] for o in own], color="#bbbbbb", linewidth=4, zorder=0)
        label_line(axes[1], own[-1][0], max(own[-1][1], 1), f"{late} late", series(i))
    axes[1].set(xscale="log", yscale="log", xlabel="force samples a second (above 500: as many ticks)", ylabel="largest stable stiffness, N/m", title="no damping in the wall; grey: theory")
    page.figure("z_width", figure, "More samples a second carry a stiffer wall, and a sample of latency takes about half of it.", "tm-evaluate --study --part loop")
    page.table("z_width", ["force samples a second", "ticks a second", *(f"B = {w:g} N·s/m" for w in walls), *(f"{n} late{how}" for n in lates for how in ("", ", passivity control") if n or how)],
               [[rate, tick, *(cell(r) if r else "" for w in walls for r in [of(rate, tick, w, 0, False)]),
                 *(cell(r) if r else "" for n in lates for on in (False, True) if n or on for r in [of(rate, tick, 0, n, on)])] for rate, tick in rates],
               "Largest stable stiffness, N/m.")


def loop(page, data, devices):
    rows = data["rows"]
    z_width(page, data["z_width"])
    page.section("Desk devices", "The same by the virtual twin of each (docs/devices.md), which differ in mass and viscous friction; their limits are lifted.")
    page.table("devices", ["device", "samples and ticks a second", "largest stable stiffness, N/m", "theory, N/m"],
               [[r["device"], r["rate_Hz"], f"> {r['stiffness_N_m']:.0f}" if r["beyond"] else round(r["stiffness_N_m"]), round(r["theory_N_m"])] for r in devices["z_width"]],
               "Largest stable stiffness of a wall by hold.")
    page.table("device_errors", ["device", "samples and ticks a second", "delay of its torques, ms", "error, mN", "largest, mN"],
               [[r["device"], r["rate_Hz"], r["late_ms"], round(r["error_mN"], 1), round(r["error_max_mN"], 1)] for r in devices["errors"]],
               "Error of the force at the hand by hold, root mean square over 0.2 s after a step of 1 mm of the hand, on a surface of compliance 2 mm/N. Some devices allow fewer ticks (docs/controller-loop.md).")
    page.section("Closed loop", f"The stiffest contact whose oscillation dies out within one encoder count after a step of 1 mm in the hand's wish. Mass {data['mass_kg']} kg, hand {data['hand_stiffness_N_m']:.0f} N/m, "
                 f"device and hand damping b = {data['damping_N_s_m']:.1f} N·s/m, no Coulomb friction, no limit active. Theory for <code>hold</code>: b &gt; K (T/2 + delay).")
    delays = sorted({r["delay_frames"] for r in rows})
    figure, axes = plt.subplots(1, len(delays), figsize=(6.4 * len(delays), 4.4), layout="constrained", squeeze=False)
    for axis, delay in zip(axes[0], delays):
        for i, name in enumerate(NAMES):
            for passivity in (False, True):
                own = sorted((r for r in rows if r["extrapolator"] == name and r["delay_frames"] == delay and r["passivity"] == passivity), key=lambda r: r["rate_Hz"])
                style = series(i)
                axis.plot([r["rate_Hz"] for r in own], [max(r["stiffness_N_m"], 1) for r in own], **{**style, **({"linestyle": "", "fillstyle": "none"} if passivity else {})})
                if own and not passivity:
                    label_line(axis, own[-1]["rate_Hz"], max(own[-1]["stiffness_N_m"], 1), name, style)
        theory = sorted({(r["rate_Hz"], r["theory_N_m"]) for r in rows if r["delay_frames"] == delay})
        axis.plot([t[0] for t in theory], [t[1] for t in theory], color="#bbbbbb", linewidth=5, zorder=0)
        if theory:
            axis.annotate("theory for hold", theory[0], xytext=(4, 8), textcoords="offset points", fontsize=8, color="#777777")
        axis.set(xscale="log", yscale="log", xlabel="frames a second", ylabel="largest stable stiffness, N/m", title=f"{delay} frame{'s' if delay != 1 else ''} of delay")
    at = {r["extrapolator"]: r["stiffness_N_m"] for r in rows if r["rate_Hz"] == 30 and r["delay_frames"] == 0 and not r["passivity"]}
    best = max(at, key=at.get)
    page.figure("loop", figure, f"Filled: passivity control off; open: on; grey: theory for hold. At 30 Hz <code>hold</code> carries {at['hold']:.0f} N/m, <code>{best}</code> {at[best]:.0f} N/m, "
                f"{at[best] / at['hold']:.1f} times as much.", "tm-evaluate --study")
    page.table("loop", ["extrapolator", "Hz", "frames late", "passivity", "stable up to N/m", "theory for hold N/m"],
               [[r["extrapolator"], r["rate_Hz"], r["delay_frames"], "on" if r["passivity"] else "off", f"> {r['stiffness_N_m']:.0f}" if r["beyond"] else round(r["stiffness_N_m"]), round(r["theory_N_m"])] for r in rows])
    return {"hold_N_m": at["hold"], "best": best, "best_N_m": at[best], "ratio": at[best] / at["hold"]}


def tissue_loop(page, rows):
    page.table("loop_tissue", ["tissue", "extrapolator", "stable up to N/m"], [[r["model"], r["extrapolator"], f"> {r['stiffness_N_m']:.0f}" if r["beyond"] else round(r["stiffness_N_m"])] for r in rows],
               "The same at 30 Hz on simulated tissue of 1,000 tetrahedra, from above it, each case as many times as stiff and as dense; what is left of the step stays within four counts.")


def ready(page, rows):
    page.section("Ready times", "Exact compliance in a thread beside a simulation of 25 Hz, by the wall clock: figures of this machine under the load that it had, compared with nothing."
                 + ("" if rows else " <b>Not measured: this build has no solver.</b>"))
    if rows:
        page.table("ready", ["tetrahedra", "first whole patch s (aim 1 at 15,000, 3 at 50,000)", "of it the worker computed s", "tetrahedra in a small cut",
                             "frames until exact again (aim 3, 20)", "at most", "in a large cut", "frames until exact again", "frame alone ms", "frame beside the worker ms", "slower % (aim 5)", "load average"],
                   [[r["tets"], r["first_whole_patch_s"], r["first_whole_patch_worker_s"], r["cut_tets"], r["exact_after_cut_frames"], r["exact_after_cut_frames_most"], r["large_cut_tets"],
                     r["exact_after_large_cut_frames"], 1e3 * r["step_alone_s"], 1e3 * r["step_beside_s"], 100 * r["slower"], r["load_average"]] for r in rows])
    page.record("ready", rows)


def cutting(page, rows):
    """Draws the worst session of each extrapolator and latency; evaluate.json has all sessions."""
    hands = pick_equal(rows, latency_frames=0, extrapolator="local_model")
    page.section("Two cauteries at random", "Both hands press, slide, cut and lift off at random on one block, each with its own force; cuts are the truth's. "
                 + (f"{len({r['seed'] for r in hands})} sessions, {sum(r['seconds'] for r in hands) / 60:.1f} minutes felt by a hand, {max(r['cut'] for r in hands)} tetrahedra cut at most in one."
                    if rows else "<b>Not run here: it is of the isotropic model.</b>"))
    if rows:
        table = []
        for late in (0, 1, 2):
            for name in ("position", "local_model"):
                own = pick_equal(rows, latency_frames=late, extrapolator=name)
                worst = max(own, key=lambda r: r["largest"])
                table.append([late, name, worst["largest"], f"seed {worst['seed']}, hand {worst['instrument']}", 100 * max(r["rms"] for r in own), 100 * max(r["jump_arrival"] for r in own)])
        page.table("cutting", ["frames late", "extrapolator", "largest force over the truth's peak (aim 1.1)", "in", "RMS % of peak, worst session", "jump at an arrival % of peak, worst"], table)
    page.record("cutting", rows)


def pick_equal(rows, **wanted):
    return [r for r in rows if all(r[k] == v for k, v in wanted.items())]


def torture(page, path):
    """Draws the rows of `make stability` that a hand notices first."""
    cases = json.loads(path.read_text())["cases"] if path else []
    page.section("Torture tests", "What hands notice first, of <code>make stability</code>; there are the others. " + ("" if cases else "<b>Not run here.</b>"))
    if cases:
        page.table("torture", ["what", "figure", "aim, at most", "measured", "in words", "repeat with", "verdict"],
                   [[c["what"], c["figure_name"], float(c["bound"]), float(c["figure"]), c["text"], c["command"], "met" if c["good"] else "missed"] for c in cases],
                   mark=lambda row: "good" if row[-1] == "met" else "bad")
    page.record("torture", cases)


def claims(rows, models, loop_facts):
    """Returns the claims of issue and paper as numbers and truth values."""
    out = {"closed_loop": {**loop_facts, "ten_times_hold": loop_facts["ratio"] >= 10}}
    for model in models:
        steady = {r["extrapolator"]: r["rms"] for r in pick(rows, model=model, tremor_m=0)}
        if not steady:
            continue
        own = {late: {r["extrapolator"]: r["rms"] for r in pick(rows, model=model, latency_frames=late)} for late in (0, 1, 2)}
        fast = {late: {r["extrapolator"]: r["rms"] for r in pick(rows, model=model, speed_m_s=0.03, latency_frames=late)} for late in (0, 1, 2)}
        back = {r["extrapolator"]: r["rms"] for r in pick(rows, model=model, path="reversals", speed_m_s=0.05, tremor_m=0)}
        out[model] = {
            "position_beats_hold_steady": steady["position"] < steady["hold"], "position_beats_time_steady": steady["position"] < steady["time"],
            "position_beats_hold_tremor": own[0]["position"] < own[0]["hold"], "position_beats_time_tremor": own[0]["position"] < own[0]["time"],
            "tangent_over_position": own[0]["tangent"] / own[0]["position"], "tangent_over_position_late": own[1]["tangent"] / own[1]["position"],
            "contact_over_position": {f"{late} late": own[late]["local_model"] / own[late]["position"] for late in own},
            "contact_over_position_0.03": {f"{late} late": fast[late]["local_model"] / fast[late]["position"] for late in fast if "local_model" in fast[late]},
            "signed_beats_unsigned_on_reversals": back["position"] < back["paper_position"],
            "largest_force_over_limit": max(r["over_limit"] for r in rows if r["model"] == model),
        }
    return out


def claims_table(page, facts, rows, models):
    page.section("What was claimed, and what came out")
    table = []
    for model in models:
        if model not in facts:
            continue
        f = facts[model]
        table += [[model, "position beats hold, steady hand", f["position_beats_hold_steady"]], [model, "position beats time, steady hand", f["position_beats_time_steady"]],
                  [model, "position beats hold, tremor", f["position_beats_hold_tremor"]], [model, "position beats time, tremor", f["position_beats_time_tremor"]],
                  [model, "tangent / position, tremor (aim: a third)", f["tangent_over_position"]], [model, "tangent / position, a frame late (aim: a half)", f["tangent_over_position_late"]],
                  *[[model, f"contact / position, {late} (aim on precomputed: a thirtieth)", v] for late, v in f["contact_over_position"].items()],
                  *[[model, f"contact / position at 0.03 m/s, {late}", v] for late, v in f["contact_over_position_0.03"].items()],
                  [model, "signed beats unsigned on reversals", f["signed_beats_unsigned_on_reversals"]], [model, "largest force over the device's limit", f["largest_force_over_limit"]]]
    c = facts["closed_loop"]
    table.append(["closed loop", f"{c['best']} at 30 Hz over hold (aim: 10)", c["ratio"]])
    page.table("claims", ["model", "claim", "came out"], table)
    if "precomputed" in models:
        mine = {late: {r["extrapolator"]: 100 * r["rms"] for r in pick(rows, model="precomputed", latency_frames=late)} for late in (0, 1)}
        page.table("sketch", ["frames late", "extrapolator", "the sketch, RMS % of peak", "here"],
                   [[late, n, SKETCH[late][n], mine[late][n]] for late in (0, 1) for n in SKETCH[late]],
                   "The sketch: a precomputed block in numpy that the design started from; another path on another block, so of the same kind, not the same experiment.")


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("figures")
    arguments.add_argument("-o", "--out", required=True)
    arguments.add_argument("--torture", type=pathlib.Path, help="verdicts of tm-stability, shown beside")
    options = arguments.parse_args()
    data = json.loads(pathlib.Path(options.figures).read_text())
    rows = data["rates"]["rows"]
    models = list(dict.fromkeys(r["model"] for r in rows))
    page = Page(options.out, "Force extrapolation, measured",
                "Forces come from the simulation 10 to 100 times a second and go to the hand 500 times. What happens between is extrapolated; this page says how well.",
                {"memory bandwidth in this run": f"{data['bandwidth_B_s'] / 1e9:.1f} GB/s", "form": "quick" if data["quick"] else "whole"})
    operating(page, data["operating"])
    roughness(page, data["roughness"])
    figure5(page, data["rates"]["figure5"])
    rates(page, rows, models)
    conditions(page, rows, models)
    loop_facts = loop(page, data["loop"], data["devices"])
    if data["tissue-loop"]:
        tissue_loop(page, data["tissue-loop"])
    facts = claims(rows, models, loop_facts)
    claims_table(page, facts, rows, models)
    hands(page, rows)
    page.record("aims", aims(page, data, pick))
    cutting(page, data["cutting"])
    torture(page, options.torture)
    ready(page, data["ready"])
    for key in ("roughness", "loop", "devices", "tissue-loop"):
        page.record(key, data[key])
    page.record("rows", rows)
    page.record("claims", facts)
    main_rows = pick(rows, model=models[0], rate_Hz=...)
    (pathlib.Path(options.out) / "rates.json").write_text(json.dumps({"model": models[0], "rows": main_rows}, indent=1) + "\n")
    print(page.write("evaluate"))


if __name__ == "__main__":
    main()
