"""Draws the first plots of the result pages into OUT (docs/images), from the tables of those pages and the list of hard cases: plots.py [OUT].

Each figure is stored once, in the page's table. Run it after a table changed: build/venv/bin/python tools/pictures/plots.py"""
import collections
import pathlib
import re
import sys

import matplotlib
matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parents[2]
INK, BLUE, RED, GREEN, GREY = "#1a1a1a", "#1f5fa8", "#c2410c", "#4d7c0f", "#8a8a8a"
STYLE = {"font.size": 11, "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.color": "#e5e5e5", "axes.axisbelow": True,
         "figure.facecolor": "white", "svg.hashsalt": "tensormass", "svg.fonttype": "path"}


def table(page, head):
    """Returns the rows, as lists of cells, of the first table of docs/PAGE whose head line begins with HEAD."""
    text = (ROOT / "docs" / page).read_text()
    start = text.index(f"\n| {head}") + 1
    lines = text[start:].split("\n\n")[0].strip().split("\n")
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def number(cell):
    return float(cell.replace(",", "").replace("%", ""))


def save(figure, out, name):
    figure.tight_layout()
    figure.savefig(out / f"{name}.svg", metadata={"Date": None, "Creator": None})
    plt.close(figure)


def performance(out):
    rows = table("performance.md", "tetrahedra | double")
    tets = [number(r[0]) for r in rows]
    figure, (left, right) = plt.subplots(1, 2, figsize=(8.6, 3.4))
    for column, name, colour, mark in ((1, "double", BLUE, "o"), (2, "single", RED, "s")):
        values = [number(r[column]) for r in rows]
        left.plot(tets, values, color=colour, marker=mark, label=name)
    left.axhline(1, color=GREY)
    left.text(tets[0], 0.97, "plain C loop in double", va="top", color=GREY)
    left.set(xscale="log", ylim=(0, 1.1), xlabel="tetrahedra", ylabel="time of a force pass, relative")
    left.legend(frameon=False, loc="lower left", ncol=2)
    two = [(t, number(r[4])) for t, r in zip(tets, rows) if r[4] != "one thread"]
    right.plot(*zip(*two), color=GREEN, marker="o")
    right.axhline(2, color=GREY)
    right.text(two[0][0], 1.97, "twice as fast", va="top", color=GREY)
    right.set(xscale="log", ylim=(1, 2.1), xlim=left.get_xlim(), xlabel="tetrahedra", ylabel="speed-up of a step, 2 threads")
    save(figure, out, "performance-step")


def outcomes():
    """Counts the cases of each group by expected verdict, from the rows of their tables."""
    groups = collections.defaultdict(collections.Counter)
    for source in sorted((ROOT / "apps/studies/stability").glob("cases_*.c")):
        for group, verdict in re.findall(r'^    \{([A-Z]+), "[^"]*", "[^"]*",\s*(ACCURATE|STABLE|REFUSED)', source.read_text(), re.M):
            groups[group.lower()][verdict] += 1
    return groups


def stability(out):
    groups = outcomes()
    names = sorted(groups, key=lambda g: sum(groups[g].values()))
    figure, axes = plt.subplots(figsize=(8.6, 4.2))
    left = [0] * len(names)
    for verdict, colour, label in (("ACCURATE", BLUE, "stays accurate"), ("STABLE", GREEN, "stays stable, loss stated"), ("REFUSED", GREY, "is refused, remedy named")):
        values = [groups[n][verdict] for n in names]
        axes.barh(names, values, left=left, color=colour, label=f"{label}: {sum(values)}")
        left = [a + b for a, b in zip(left, values)]
    axes.grid(axis="y", visible=False)
    axes.set(xlabel="cases")
    axes.legend(frameon=False, loc="lower right")
    save(figure, out, "stability-outcomes")


def reality(out):
    rows = [r for r in table("reality.md", "body and figure") if not r[5].startswith("fitted")]
    figure, axes = plt.subplots(figsize=(8.6, 0.9 + 0.36 * len(rows)))
    at = list(range(len(rows)))[::-1]
    axes.axvspan(-5, 5, color="#eeeeee")
    axes.errorbar([0] * len(rows), at, xerr=[100 * number(r[2]) / number(r[1]) for r in rows], fmt="none", color=INK, capsize=4)
    shown = [max(-60, min(60, number(r[4]))) for r in rows]
    axes.plot(shown, at, "s", color=RED)
    for row, y, x in zip(rows, at, shown):
        if x != number(row[4]):
            axes.text(x - 2, y, f"{row[4]} %", ha="right", va="center", fontsize=9)
    axes.set_yticks(at, [r[0].replace("`", "") + (f" ({r[5]})" if r[5] != "predicted" else "") for r in rows], fontsize=9)
    axes.set(xlabel="simulated less measured, %", xlim=(-65, 65))
    save(figure, out, "reality-differences")


def which_law(out):
    depths = (10, 20, 40)
    figure, (left, right) = plt.subplots(1, 2, figsize=(10.4, 4.2))
    for axes, rows, styles in ((left, table("which-law.md", "law | linear"), [(INK, "o"), (BLUE, "s"), (RED, "^"), (GREEN, "D"), ("#8a4fa3", "v"), ("#b58900", "P")]),
                               (right, table("which-law.md", "computed as"), [(GREY, "o"), (RED, "s"), ("#b58900", "^"), (BLUE, "D"), (INK, "v")])):
        for row, (colour, mark) in zip(rows, styles):
            axes.plot(depths, [number(cell) for cell in row[1:4]], color=colour, marker=mark, label=row[0].replace("`", ""))
        axes.set(xlim=(8, 42), ylim=(0, None), xlabel="indented, % of the block's size", xticks=depths)
        axes.legend(frameon=False, loc="upper left", fontsize=9)
    left.set(ylabel="% of the force", title="linear tissue in place of the law", ylim=(0, 70))
    right.set(ylabel="% of the largest displacement", title="shape of a neo-Hookean block", ylim=(0, 100))
    save(figure, out, "which-law")


def extrapolation(out):
    rows = table("extrapolation.md", "scene, instrument")
    columns = ((1, "25 Hz, `hold`", GREY), (2, "25 Hz, `position`", RED), (4, "25 Hz, `adaptive`", BLUE), (5, "100 Hz, `adaptive`", GREEN), (6, "500 Hz, `adaptive`", INK))
    figure, axes = plt.subplots(figsize=(8.6, 4.6))
    for i, (column, label, colour) in enumerate(columns):
        axes.barh([-y + 0.32 - 0.16 * i for y in range(len(rows))], [number(r[column]) for r in rows], height=0.15, color=colour, label=label.replace("`", ""))
    axes.set_yticks([-y for y in range(len(rows))], [r[0].split(" (")[0] for r in rows])
    axes.grid(axis="y", visible=False)
    axes.set(xlabel="force error one sample late, RMS, % of peak")
    axes.legend(frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncol=5, columnspacing=1, handlelength=1, fontsize=9)
    save(figure, out, "extrapolation-operating")


def main():
    out = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs/images"
    with matplotlib.rc_context(STYLE):
        for draw in (performance, stability, extrapolation, reality, which_law):
            draw(out)


if __name__ == "__main__":
    main()
