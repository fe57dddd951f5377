"""Draws the verdicts of tm-stability: `python page.py VERDICTS.json -o FOLDER`."""
import argparse
import json
import math
import pathlib
import sys
import textwrap

import matplotlib.pyplot as plt

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent.parent / "pages"))
from page import Page, series  # noqa: E402

HEADINGS = {
    "tissue": ("Tissue", "Materials, meshes and supports at the edge of what can be computed."),
    "tool": ("Tool", "Instruments where they should not be, and faster than they should be."),
    "cut": ("Cutting", "Tetrahedra removed by the thousand while a tool presses."),
    "rotation": ("Rotation", "Tissue that turns and bends far, with the effect `rotation`."),
    "viscosity": ("Viscosity", "Tissue that relaxes in next to no time, hardly ever, and to almost nothing."),
    "energy": ("Energy", "What hands put in, and what tissue and springs make of it."),
    "torture": ("At the hand", "What others' simulators are known to get wrong; `make evaluate` shows these figures beside its own."),
    "link": ("Link and force", "What may arrive at the controller, or fail to."),
}
CLASS = {"stays accurate": "good", "stays stable": "fair", "refused": "good", "broken": "bad"}


def draw(page, cases, group):
    """Draws all curves of one group as small multiples."""
    drawn = [c for c in cases if "x" in c]
    if not drawn:
        return
    columns = 4
    rows = (len(drawn) + columns - 1) // columns
    figure, axes = plt.subplots(rows, columns, figsize=(12, 2.3 * rows), squeeze=False, layout="constrained")
    for axis, case in zip(axes.flat, drawn):
        axis.plot(case["x"], [math.nan if v is None else v for v in case["y"]], **{**series(0), "marker": ""})
        axis.locator_params(nbins=4)
        axis.set_title(case["name"], fontsize=9, loc="left")
        axis.set_xlabel(case["x_name"], fontsize=8)
        axis.set_ylabel(textwrap.fill(case["y_name"], 24), fontsize=8)
        axis.tick_params(labelsize=7)
        axis.ticklabel_format(useOffset=False)
        if None in case["y"]:
            continue
        if "energy / energy" in case["y_name"]:
            axis.set_ylim(min(0, *case["y"]), max(1.2, *case["y"]))
        elif 0 < max(case["y"]) - min(case["y"]) < 1e-6 * max(case["y"]):  # a line, and no tick labels of twenty digits
            axis.set_ylim(0, 1.2 * max(case["y"]))
    for axis in list(axes.flat)[len(drawn):]:
        axis.axis("off")
    values = [v for case in drawn for v in case["y"]]
    wild = sorted({case["name"] for case in drawn for v in case["y"] if v is None or not math.isfinite(v)})
    page.figure(f"curves_{group}", figure, f"Each case's curve on a scale of its own, {len(values):,} values, " +
                (f"<b>not finite in {', '.join(wild)}</b>." if wild else "all of them finite."))


def fuzzing(page, path):
    """Draws the last results of `make fuzz`, one row per target; reports if it never ran."""
    targets = json.loads(path.read_text())["targets"] if path and path.exists() else {}
    page.section("Fuzzing", "Inputs tried on every parser and decoder, under AddressSanitizer and UndefinedBehaviorSanitizer; what each target "
                 "promises is in docs/fuzzing.md. " + ("" if targets else "<b>Not run in this build: make fuzz FUZZ_SECONDS=600.</b>"))
    if targets:
        page.table("fuzz", ["target", "processor seconds", "inputs", "edges covered", "seeds", "repeat with", "found"],
                   [[name, t["cpu_seconds"], t["inputs"], t["edges_covered"], t["seeds"], f"make fuzz FUZZ_ARGS={name}",
                     ", ".join(t["findings"]) if t["exit"] else "nothing"] for name, t in sorted(targets.items())],
                   mark=lambda row: "good" if row[-1] == "nothing" else "bad")
    page.record("fuzz", targets)


def sanitizers(page, path):
    """Draws the last results of `make sanitize`, one row per build; reports if it never ran."""
    builds = json.loads(path.read_text()) if path and path.exists() else {}
    page.section("Sanitizers", "The suite in builds of clang's sanitizers; any report fails it, also one of a program whose test did not mind. "
                 + ("" if builds else "<b>Not run in this build: make sanitize.</b>"))
    if builds:
        page.table("sanitize", ["build", "what it sees", "commit", "tests passed", "failed", "skipped", "repeat with", "reports"],
                   [[name, b["about"], b["commit"], b["passed"], b["failed"], b["skipped"], f"make sanitize SANITIZERS={name}", "; ".join(b["reports"]) or "none"]
                    for name, b in sorted(builds.items())], mark=lambda row: "good" if row[-1] == "none" and not row[4] else "bad")
    page.record("sanitize", builds)


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("verdicts")
    arguments.add_argument("-o", "--out", required=True)
    arguments.add_argument("--fuzz", type=pathlib.Path, help="fuzz.json of make fuzz")
    arguments.add_argument("--sanitize", type=pathlib.Path, help="sanitize.json of make sanitize")
    options = arguments.parse_args()
    data = json.loads(pathlib.Path(options.verdicts).read_text())
    cases = data["cases"]
    counts = {v: sum(c["verdict"] == v for c in cases) for v in CLASS}
    wrong = [c["name"] for c in cases if not c["good"]]
    page = Page(options.out, "Hard cases",
                f"{len(cases)} cases: {counts['stays accurate']} stay accurate, {counts['stays stable']} stay stable with a stated loss, "
                f"{counts['refused']} are refused with a message, {counts['broken']} broken. "
                + (f"<b>Not as they should be: {', '.join(wrong)}.</b>" if wrong else "Each came out as it should."),
                {"form": "quick" if data["quick"] else "whole"})
    for group in dict.fromkeys(c["group"] for c in cases):
        own = [c for c in cases if c["group"] == group]
        heading, text = HEADINGS[group]
        page.section(heading, text)
        page.table(group, ["case", "what", "figure", "value", "bound", "in words", "repeat with", "verdict"],
                   [[c["name"], c["what"], c["figure_name"], c.get("figure", ""), c.get("bound", ""), c["text"], c["command"],
                     c["verdict"] if c["good"] else f"{c['verdict']} (should be: {c['expected']})"] for c in own],
                   mark=lambda row: CLASS.get(row[-1], "bad"))
        draw(page, own, group)
    fuzzing(page, options.fuzz)
    sanitizers(page, options.sanitize)
    page.record("cases", cases)
    page.record("counts", counts)
    print(page.write("stability"))


if __name__ == "__main__":
    main()
