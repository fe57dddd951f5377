"""One page of what `tm-accuracy --scene` measured: what to change in a scene, what that costs, and which errors are smaller than those of uncertain material constants."""
import argparse
import html
import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "pages"))
import page as pages  # noqa: E402
from page import plt  # noqa: E402

MESHES = ("own", "strain_smoothing", "mesh")
NUMBERS = ("step", "mass", "precision", "model")


def percent(value):
    """Formats a share in per cent; None: a dash."""
    return "–" if value is None else f"{100 * value:.3g} %"


def done(study, *knobs):
    """Returns the runs that varied one of these settings and succeeded."""
    return [r for r in study["runs"] if r["knob"] in knobs and "cannot" not in r]


def read(path):
    """Reads the study, or exits with the error."""
    try:
        study = json.loads(pathlib.Path(path).read_text())
        if study.get("study") != "tensormass accuracy of a scene":
            sys.exit(f"{path}: not a scene's study; make one with tm-accuracy --scene SCENE.yaml --json {path}")
    except (OSError, ValueError, AttributeError) as error:
        sys.exit(f"{path}: cannot be read as a study: {error}; make one with tm-accuracy --scene")
    if not study["whole"]:
        sys.exit(f"{path}: the study was broken off; the same tm-accuracy command finishes it")
    return study


def improvements(study):
    """Returns single changes that reduce the error by at least 5 %, cheapest first."""
    own = study["runs"][0]
    better = [r for r in done(study, *MESHES, *NUMBERS) if r is not own and r.get("force_error", 9e9) < 0.95 * own["force_error"]]
    return sorted(better, key=lambda r: r["cpu_s"])[:3]


def doubt(study):
    """Describes the reference that errors are measured from, and how uncertain it is."""
    truth = study["truth"]
    if truth["extrapolated"]:
        return (f"Errors are distances of the force at the hand, RMS over its path, from Richardson's estimate (order {truth['order']:.2f}, {'observed' if truth['order_observed'] else 'assumed'}) "
                f"of this scene's own meshes, the finest of {truth['finest_tets']:,} tetrahedra. <b>That estimate is itself uncertain by {percent(truth['uncertainty'])}</b>; smaller differences than that between two errors say nothing.")
    if "uncertainty" in truth:
        return (f"Errors are distances of the force at the hand, RMS over its path, from the finest run ({truth['finest_tets']:,} tetrahedra). <b>The meshes are not near a limit yet: it may lie another "
                f"{percent(truth['uncertainty'])} away.</b> That is so where tetrahedra are longer than the instrument's radius; a longer <code>--limit</code> lets finer ones be run.")
    return "No finer mesh of this scene was run: errors are distances from half the step, and <b>what the mesh leaves out is not known</b>."


def frontier_figure(page, study):
    """Draws error against cost of all runs, and the line of those that no other run beats in both."""
    own, choice = study["runs"][0], study.get("recommendation")
    rows = [r for r in done(study, *MESHES, *NUMBERS) if r.get("force_error", 0) > 0]
    figure, axis = plt.subplots()
    for i, (knob, label) in enumerate((("own", "the scene as it is"), ("strain_smoothing", "its mesh, with or without strain_smoothing"), ("mesh", "other meshes"), ("step", "step"), ("mass", "mass scaling"), ("precision", "precision"), ("model", "model"))):
        points = [r for r in rows if r["knob"] == knob]
        style = pages.series(i)
        axis.plot([1e3 * r["cpu_s"] for r in points], [100 * r["force_error"] for r in points], linestyle="none", marker=style["marker"], color=style["color"], markersize=11 if knob == "own" else 6, label=label)
    edge = pages.frontier([(1e3 * r["cpu_s"], 100 * r["force_error"]) for r in rows])
    axis.plot(*zip(*edge), color="#777777", linewidth=1, label="nothing measured is both cheaper and exacter")
    if choice:
        axis.plot(1e3 * choice["cost_s"] * own["frame_s"] / choice["frame_s"], max(100 * choice["error"], 1e-6), marker="*", markersize=16, linestyle="none", color="#2e6b12", label="recommended (predicted)")
        axis.axvline(1e3 * own["frame_s"] * choice["budget"], color="#777777", linestyle=":")
        pages.label_upright(axis, 1e3 * own["frame_s"] * choice["budget"], "budget")
    if study["truth"].get("uncertainty"):
        axis.axhspan(1e-9, 100 * study["truth"]["uncertainty"], color="#eeeeee", zorder=0, label="within the truth's own uncertainty")
        axis.set_ylim(bottom=0.5 * min(p[1] for p in edge))
    axis.set_ylim(top=1.4 * max(100 * r["force_error"] for r in rows))
    axis.set(xscale="log", yscale="log", xlabel="processor time of a frame, ms", ylabel="error of the force, %")
    axis.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncol=2, fontsize=8)
    page.figure("frontier", figure, "Error of the force at the hand against the price of a frame; the large dot is the scene as it is.")


def bars(page, name, rows, caption):
    rows = sorted((r for r in rows if "change" in r), key=lambda r: r["change"])
    if not rows:
        return
    figure, axis = plt.subplots(figsize=(6.4, 0.9 + 0.36 * len(rows)))
    axis.barh([r["label"] for r in rows], [100 * r["change"] for r in rows], color="#1f5fa8", height=0.6)
    for i, r in enumerate(rows):
        axis.text(100 * r["change"], i, f" {100 * r['change']:.3g} %" + (f", peak {100 * r['peak_change']:+.3g} %" if "peak_change" in r else ""), va="center", fontsize=8)
    axis.set_xlim(right=140 * max(max(r["change"] for r in rows), 1e-9))
    axis.set_xlabel("change of the force, RMS over the path, %")
    page.figure(name, figure, caption)


def recommendation(page, study):
    choice = study.get("recommendation")
    if not choice:
        page.section("Recommendation", "None was asked for: <code>--budget 0.5</code> recommends a setting for half a processor and runs it.")
        return
    words = ", ".join(html.escape(s) for s in [*choice["settings"], *([f"extrapolator {choice['extrapolator']}, haptics.rate {choice['sample_rate_Hz']:.4g} Hz"] if "extrapolator" in choice else [])])
    page.section("Recommendation", f"For {choice['budget']:g} processors: <b>{words}</b>, written as <code>{html.escape(choice['file'])}</code>."
                 + ("" if choice["fits"] else " <b>Nothing measured fits the budget; this is the cheapest.</b>"))
    if "kept" in choice:
        page.table("promise", ("", "promised", "held"), [
            ("error of the force", f"{percent(choice['error'])} (predicted: {percent(choice['predicted_error'])})", percent(choice["held_error"])),
            ("of a processor, 95th percentile", percent(choice["share"]), f"{percent(choice['held_share'])}; {percent(choice['held_over'])} of {choice['held_frames']} frames took more than the budget"),
            ("late frames, by the wall clock", "5 % at most", f"{choice['held_late']} of {choice['held_frames']}"),
            ("the machine", "1", f"{choice['held_slower']:.3g} times slower"),
            ("settings that came out worse than predicted", "", str(choice["worse"]))], html.escape(choice["verdict"]))


def samples_figure(page, rows):
    figure, axis = plt.subplots()
    for i, law in enumerate(dict.fromkeys(r["law"] for r in rows)):
        points = sorted((r["sample_rate_Hz"], 100 * r["force_error"]) for r in rows if r["law"] == law and r["force_error"] > 0)
        axis.plot(*zip(*points), label=law, **pages.series(i))
    axis.set(xscale="log", yscale="log", xlabel="force samples a second (haptics.rate)", ylabel="error at the hand, one sample late, %")
    axis.legend(fontsize=8)
    page.figure("samples", figure, "Error of the force at the hand against the rate of force samples, for each extrapolator.")


def samples(page, study):
    """Draws error at the hand and cost for rates of force samples (haptics.rate) and extrapolators."""
    rows = [r for r in done(study, "extrapolator", "rate") if "force_error" in r and "law" in r]
    if not rows:
        return
    choice = study.get("recommendation") or {}
    chosen = (choice.get("extrapolator"), choice.get("sample_rate_Hz"))
    why = f" Recommended, of what the budget has room for: <b>{html.escape(choice['rate_reason'])}</b>." if choice.get("rate_reason") else ""
    page.section("Force samples", "Between two force samples the controller makes up the force, 500 times a second. The scene's samples at each rate (<code>haptics.rate</code>; the frame rate stays) through each of its extrapolators, against the same scene at "
                 f"500 frames a second (RMS over the path; the mesh's error is not in it).{why}")
    samples_figure(page, rows)
    head = ("at once", "1 sample late", "2 samples late", "of a processor")
    words = lambda r: (*(percent(f) for f in r["felt"]), percent(r["share"]))
    best = sorted((r for r in rows if r.get("best_at_rate")), key=lambda r: r["sample_rate_Hz"])
    page.table("rates", ("rate, Hz", "best extrapolator", *head), [(f"{r['sample_rate_Hz']:.4g}", r["law"], *words(r)) for r in best], "The best extrapolator at each rate, one sample late; of errors that no hand tells apart, at the same price, the scene's own. Above 50 Hz samples carry no stiffness and no patch.")
    page.table("extrapolators", ("rate, Hz", "extrapolator", "carries", *head, ""), [(f"{r['sample_rate_Hz']:.4g}", r["law"], r["sends"], *words(r), "recommended" if (r["law"], r["sample_rate_Hz"]) == chosen else "")
                                                                                   for r in sorted(rows, key=lambda r: r["force_error"])],
               "Price: processor time of a frame with its samples and what they carry, 95th percentile, over the frame's length.")


def write(study, folder, command):
    own = study["runs"][0]
    span = f"{study['duration_s']:.4g} s of the path's {study.get('asked_duration_s', study['duration_s']):.4g} s"
    page = pages.Page(folder, f"What accuracy costs in {pathlib.Path(study['scene']).name}", doubt(study), {"scene": study["scene"], "tensormass": study["version"]})
    page.section("Error against time", f"As it is, the scene's force is {percent(own['force_error'])} off, for {1e3 * own['cpu_s']:.3g} ms of a frame of {1e3 * own['frame_s']:.3g} ms. All errors, promised ones too, are over {span}. Prices are processor time, measured on this machine.")
    frontier_figure(page, study)
    recommendation(page, study)
    page.section("The three cheapest improvements")
    cheap = [(f"{r['name']} ({r['knob']})", percent(r["force_error"]), f"{1e3 * r['cpu_s']:.3g}", f"× {r['cpu_s'] / own['cpu_s']:.2g}", " ".join(r["set"])) for r in improvements(study)]
    if cheap:
        page.table("improvements", ("change", "error then", "ms a frame", "price", "--set"), cheap, f"One change at a time; as it is: {percent(own['force_error'])}.")
    else:
        page.text("No single change that was measured lowers the error by a twentieth.")
    page.section("What each effect contributes", "The effect is left out, or one that the scene does not name is added, and the force compared with that of the scene as it is. An effect is physics, not a setting: leaving it out is never recommended, but shows what its price buys. So is the law of large strains: a deep press that a nonlinear law changes by more than the mesh's error should have one.")
    label = {"drop": "without ", "add": "with ", "law": "with the law "}
    effects = [dict(r, label=label[r["knob"]] + r["name"]) for r in done(study, *label)]
    bars(page, "effects", effects, "Change of the force at the hand; the sign is the peak's.")
    page.section("What the constants hide", "Constants of living tissue are seldom known to a fifth. Where these bars are longer than the error above, a finer mesh does not make the force truer: measure the tissue instead.")
    constants = [dict(r, label=r["name"]) for r in done(study, "constant")]
    mesh = [dict(change=own["force_error"], label="this scene's own error")]
    bars(page, "constants", constants + mesh, "Stiffness, Poisson's ratio by 20 % (below 0.495), fibres turned by 18 degrees (a fifth of the most they can be off).")
    page.section("Frame rate", "Of pictures, with one force sample a frame, against the fastest rate, at frames that both have. What the hand feels is told by the rate of force samples below.")
    page.table("frame", ("rate", "error", "ms a frame", "of a processor"), [(r["name"], percent(r.get("force_error")), 1e3 * r["cpu_s"], percent(r["share"])) for r in done(study, "frame")])
    samples(page, study)
    page.section("All that was run")
    page.table("runs", ("knob", "setting", "tetrahedra", "error of force", "of shape", "change", "ms a frame", "of a processor", "set-up, s"),
               [(r["knob"], r["name"], r["tets"], percent(r.get("force_error")), percent(r.get("shape_error")), percent(r.get("change")), 1e3 * r["cpu_s"], percent(r["share"]), r["setup_s"]) for r in study["runs"] if "cannot" not in r],
               "Of a processor: 95th percentile of the frames. Another tissue (an effect more or less, other constants) has a change and no error: its truth is another.")
    left_out = [(r["knob"], r["name"], r["why"]) for r in study.get("left_out", [])]
    if left_out:
        page.table("left_out", ("knob", "setting", "left out within the limit"), left_out)
    refused = [(r["knob"], r["name"], r["cannot"]) for r in study["runs"] if "cannot" in r]
    if refused:
        page.table("refused", ("knob", "setting", "why it cannot be"), refused)
    page.text(f"Repeat: <code>{html.escape(command)}</code>")
    page.record("truth", {k: v for k, v in study["truth"].items() if k != "force_N"})
    page.record("improvements", [r["name"] for r in improvements(study)])
    page.record("recommendation", study.get("recommendation"))
    page.record("runs", [{k: v for k, v in r.items() if k not in ("force_N", "u_m")} for r in study["runs"]])
    return page.write("scene")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("study", help="JSON of tm-accuracy --scene")
    parser.add_argument("-o", "--output", required=True, help="folder of the page")
    options = parser.parse_args()
    study = read(options.study)
    print(write(study, options.output, f"tm-accuracy --scene {study['scene']} --json {options.study}"))


if __name__ == "__main__":
    main()
