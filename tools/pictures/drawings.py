"""drawings.py [OUT]: the drawings of the pages, as SVG in OUT (docs/images): contact, loop, step, patch, smoothing, objects, states.

Run it after a change: build/venv/bin/python tools/pictures/drawings.py"""
import pathlib
import sys

import matplotlib
matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.patches import Circle, FancyArrowPatch, FancyBboxPatch, Polygon  # noqa: E402
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection  # noqa: E402
import numpy as np  # noqa: E402
from plots import BLUE, GREEN, GREY, INK, RED, ROOT, STYLE, save  # noqa: E402

PALE = {BLUE: "#dbe7f5", RED: "#f8e0d4", GREEN: "#e3ecd6", GREY: "#ececec", INK: "#e4e4e4"}


def sheet(width, height, figsize):
    """Makes axes without frame: x from 0 to width, y from 0 to height, equal scales."""
    figure, axes = plt.subplots(figsize=figsize)
    axes.set(xlim=(0, width), ylim=(0, height), aspect="equal")
    axes.axis("off")
    return figure, axes


def arrow(axes, start, end, colour=INK, style="-|>", bend=0.0, width=1.4, **more):
    axes.add_patch(FancyArrowPatch(start, end, arrowstyle=style, mutation_scale=13, color=colour, lw=width, shrinkA=0, shrinkB=0, connectionstyle=f"arc3,rad={bend}", **more))


def box(axes, x, y, width, height, title, lines="", colour=BLUE):
    axes.add_patch(FancyBboxPatch((x, y), width, height, boxstyle="round,pad=0,rounding_size=0.12", facecolor=PALE[colour], edgecolor=colour, lw=1.4))
    text = f"{title}\n{lines}" if lines else title
    axes.text(x + width / 2, y + height / 2, text, ha="center", va="center", fontsize=10, linespacing=1.35)


def contact(out):
    """Draws tool, station, row, contact compliance and viscous drag in a section through tissue."""
    figure, axes = sheet(13, 6.6, (8.6, 4.4))
    surface = np.array([(0.3, 2.9), (2.2, 2.8), (4.0, 2.25), (5.6, 1.9), (7.3, 2.3), (9.2, 2.85), (11.4, 2.95)])
    axes.add_patch(Polygon([*surface, (11.4, 0.3), (0.3, 0.3)], facecolor=PALE[RED], edgecolor="none"))
    axes.plot(*surface.T, color=RED, lw=2)
    axes.plot(*surface.T, "o", color=RED, ms=6)
    tip, along, radius = np.array([5.7, 2.85]), np.array([0.42, 0.908]), 1.15
    across = np.array([-along[1], along[0]])
    far = tip + 3.3 * along
    for side in (1, -1):
        axes.plot(*np.array([tip + side * radius * across, far + side * radius * across]).T, color=INK)
    for k in range(3):
        centre = tip + k * radius * along
        axes.add_patch(Circle(centre, radius, fill=k == 0, facecolor=PALE[GREY], edgecolor=INK, ls="-" if k == 0 else "--", lw=1.3, alpha=0.9 if k == 0 else 1))
        axes.plot(*centre, "o", color=INK, ms=5)
    axes.plot(*np.array([tip, far]).T, color=INK, lw=0.8, ls="-.")
    foot = np.array([5.6, 1.9])
    for base, share in ((np.array([5.05, 2.0]), 0.6), (np.array([6.5, 2.1]), 0.4)):
        normal = base - tip
        normal = normal / np.linalg.norm(normal)
        arrow(axes, base, base + 1.25 * normal, BLUE, width=2)
    axes.text(4.3, 0.55, "n, share 0.6", color=BLUE, ha="center")
    axes.text(7.0, 0.95, "n, share 0.4", color=BLUE, ha="center")
    arrow(axes, tip, tip + np.array([1.9, 0]), INK, width=2)
    axes.text(*(tip + np.array([1.95, 0.1])), "v", va="bottom")
    arrow(axes, tip, tip - np.array([1.5, 0]), GREEN, width=2)
    lowest = tip + np.array([0, -radius])
    axes.annotate("", (8.6, lowest[1]), (8.6, foot[1]), arrowprops={"arrowstyle": "<->", "color": GREEN, "shrinkA": 0, "shrinkB": 0})
    for y in (lowest[1], foot[1]):
        axes.plot([5.7, 8.75], [y, y], color=GREEN, lw=0.7, ls=":")
    notes = (("tool: capsule, axis to the trocar", (9.0, 6.1), tip + 3.0 * along, INK), ("stations: spheres one radius apart,\nstation 0 is the tip", (9.0, 4.75), tip + radius * along, INK),
             ("contact compliance: depth = c λ;\nrows of a station share it", (8.4, 0.9), (8.6, 1.75), GREEN),
             ("viscous drag: 0.3 s/m · λ v,\nagainst the sliding speed v", (0.4, 3.95), tip - np.array([1.3, 0]), GREEN), ("surface triangle:\nits corners move with\nthe row's weights", (0.4, 1.2), (3.1, 2.52), RED),
             ("row: one station against one face,\nedge or vertex; gap, normal n,\nmultiplier λ ≥ 0 in N", (0.4, 5.6), (4.75, 3.5), BLUE))
    for words, place, target, colour in notes:
        axes.annotate(words, target, place, color=colour, va="center", ha="left", arrowprops={"arrowstyle": "-", "color": colour, "lw": 0.9, "shrinkA": 2, "shrinkB": 2})
    save(figure, out, "contact")


def loop(out):
    """Draws the control loop from the tool to the motor, with its rates."""
    figure, axes = sheet(13, 6.9, (8.6, 4.6))
    box(axes, 0.3, 2.6, 2.3, 1.6, "device", "tool, encoders,\nmotors", GREY)
    box(axes, 4.0, 4.6, 2.9, 1.7, "controller", "tick: 500 Hz, float,\nno allocation, no lock", BLUE)
    box(axes, 9.4, 4.6, 3.2, 1.7, "simulation: contact", "force sample: 500 Hz,\n25 to 50 Hz with patches", RED)
    box(axes, 9.4, 0.5, 3.2, 1.7, "simulation: tissue", "substep: 0.1 to 2 ms;\nframe: 25 to 30 Hz", RED)
    box(axes, 4.0, 0.5, 2.9, 1.7, "viewer, log", "one picture a frame", GREY)
    arrow(axes, (1.2, 4.25), (3.95, 5.75), BLUE, bend=-0.25)
    axes.text(1.75, 5.75, "encoders,\nCAN, 500 Hz", ha="center", color=BLUE)
    arrow(axes, (3.95, 5.0), (2.2, 4.25), BLUE, bend=0.15)
    axes.text(2.75, 3.75, "torques,\nCAN, 500 Hz", ha="left", va="center", color=BLUE)
    arrow(axes, (6.95, 5.85), (9.35, 5.85), INK)
    axes.text(8.15, 6.0, "TOOL_i, 500 Hz", ha="center", va="bottom")
    arrow(axes, (9.35, 5.0), (6.95, 5.0), INK)
    axes.text(8.15, 4.85, "FORCE_i;\nPATCH_i to 50 Hz", ha="center", va="top")
    arrow(axes, (10.6, 4.55), (10.6, 2.25), RED)
    arrow(axes, (11.4, 2.25), (11.4, 4.55), RED)
    axes.text(10.45, 3.4, "reactions", ha="right", va="center", color=RED)
    axes.text(11.55, 3.4, "surface", ha="left", va="center", color=RED)
    arrow(axes, (9.35, 1.35), (6.95, 1.35), INK)
    axes.text(8.15, 1.5, "TISSUE, CUT,\nSIM_STATUS", ha="center", va="bottom")
    axes.text(6.0, 3.2, "between samples: extrapolation;\nalways: passivity, limits, ramps", ha="center", va="center", color=BLUE, fontsize=9.5)
    arrow(axes, (6.0, 3.65), (6.0, 4.55), BLUE, width=1)
    save(figure, out, "loop")


def step(out):
    """Draws the phases of a substep and the stages that run in them."""
    figure, axes = sheet(13.2, 5.6, (8.6, 3.7))
    phases = (("begin", "tool paths,\nmoving supports,\ncuts", ("cut", "contact"), GREY), ("force", "internal force\ninto force_N", ("force", "rotation", "viscosity"), RED),
              ("load", "adds to\nforce_N", ("gravity",), RED), ("integrate", "central\ndifferences:\nwrites u_next_m", ("integrate",), BLUE),
              ("constrain", "corrects\nu_next_m", ("support", "cut search", "grasp", "friction", "contact detect", "contact solve", "contact forces"), GREEN), ("end", "measurements", ("energy",), GREY))
    width = 2.05
    for i, (name, what, stages, colour) in enumerate(phases):
        x = 0.25 + i * (width + 0.05)
        axes.add_patch(Polygon([(x, 5.4), (x + width - 0.3, 5.4), (x + width, 5.0), (x + width - 0.3, 4.6), (x, 4.6)], facecolor=colour, edgecolor="none"))
        axes.text(x + (width - 0.25) / 2, 5.0, name, ha="center", va="center", color="white", weight="bold")
        axes.text(x, 4.35, what, va="top", fontsize=9.5)
        for k, stage in enumerate(stages):
            axes.text(x, 2.6 - 0.4 * k, stage, va="top", family="monospace", fontsize=9, color=colour if colour != GREY else INK)
    axes.plot([0.25, 12.8], [2.8, 2.8], color=GREY, lw=0.8)
    save(figure, out, "step")


def patch(out):
    """Draws the contents of a patch: triangles around the tip, their compliance, and the tip's path between two samples."""
    figure, axes = sheet(13, 6.2, (8.6, 4.1))
    rng = np.random.default_rng(3)
    nx, ny = 9, 6
    grid = np.array([[(0.5 + 0.95 * i + 0.48 * (j % 2), 0.6 + 0.85 * j) for i in range(nx)] for j in range(ny)]) + 0.1 * rng.standard_normal((ny, nx, 2))
    tip, end = np.array([3.7, 2.7]), np.array([5.3, 3.3])
    middle = (tip + end) / 2
    for j in range(ny - 1):
        for i in range(nx - 1):
            a, b, c, d = grid[j, i], grid[j, i + 1], grid[j + 1, i], grid[j + 1, i + 1]
            for corners in ((a, b, d if j % 2 else c), ((a, d, c) if j % 2 else (b, d, c))):
                inside = np.linalg.norm((np.mean(corners, axis=0) - middle) * (0.8, 1)) < 1.5
                axes.add_patch(Polygon(corners, facecolor=PALE[BLUE] if inside else "#fafafa", edgecolor=BLUE if inside else "#c8c8c8", lw=1.3 if inside else 0.7, zorder=2 if inside else 1))
    arrow(axes, tip, end, INK, width=2, zorder=4)
    for p, words in ((tip, "tip at sample n"), (end, "tip at tick k")):
        axes.add_patch(Circle(p, 0.34, facecolor="white", edgecolor=INK, lw=1.5, zorder=3, alpha=0.85))
    axes.plot(*tip, "o", color=INK, ms=5, zorder=5)
    notes = (("patch: triangles near the tip and\nalong its path (up to 24 vertices)", (9.3, 5.4), (5.5, 4.05), BLUE), ("compliance matrix C: displacement of each\nvertex per newton at each other, m/N", (9.3, 3.9), (4.9, 2.3), BLUE),
             ("tip at tick k: rows are found and solved on\nthe patch 500 times a second: u = C f", (9.3, 2.4), end, INK), ("tip at sample n: the force of the\nsimulation's own contact", (9.3, 0.9), tip, INK))
    for words, place, target, colour in notes:
        axes.annotate(words, target, place, color=colour, va="center", ha="left", fontsize=9.5, arrowprops={"arrowstyle": "-", "color": colour, "lw": 0.9, "shrinkB": 3}, zorder=6)
    axes.set(xlim=(0, 14.6))
    save(figure, out, "patch")


def smoothing(out):
    """Draws four domains over which strain is averaged: a tetrahedron, and around a face, an edge, a vertex."""
    points = np.array([(0, 0, 0), (1, 0, 0), (0.5, 0.9, 0), (0.5, 0.3, 0.85), (0.5, 0.3, -0.85), (1.4, 0.9, 0.25), (-0.45, 0.8, 0.2), (0.5, -0.65, 0.1)])
    tets = [(0, 1, 2, 3), (0, 1, 2, 4), (1, 2, 3, 5), (0, 2, 3, 6), (0, 1, 3, 7)]
    centre = {t: points[list(t)].mean(axis=0) for t in tets}

    def part(t, fixed):
        """Returns the corners of a tetrahedron's part around some vertices: the sub-simplices of its barycentric division that touch only those."""
        pieces = []
        others = [v for v in t if v not in fixed]
        if len(fixed) == 3:
            return [[*points[list(fixed)], centre[t]]]
        if len(fixed) == 2:
            return [[*points[list(fixed)], points[[*fixed, o]].mean(axis=0), centre[t]] for o in others]
        (v,) = fixed
        for a in others:
            for b in others:
                if a != b:
                    pieces.append([points[v], points[[v, a]].mean(axis=0), points[[v, a, b]].mean(axis=0), centre[t]])
        return pieces

    figure = plt.figure(figsize=(8.6, 2.7))
    cases = (("tetrahedron\n(linear FEM)", tets[:1], None, RED), ("face\nFS-FEM", tets[:2], (0, 1, 2), GREEN), ("edge\nES-FEM: shear", [t for t in tets if 0 in t and 3 in t], (0, 3), BLUE), ("vertex\nNS-FEM: volume", [t for t in tets if 3 in t], (3,), INK))
    for k, (title, group, fixed, colour) in enumerate(cases):
        axes = figure.add_subplot(1, 4, k + 1, projection="3d")
        edges = {tuple(sorted((a, b))) for t in group for a in t for b in t if a != b}
        axes.add_collection3d(Line3DCollection([points[list(e)] for e in edges], colors="#9a9a9a", linewidths=0.9))
        for t in group:
            for piece in ([points[list(t)]] if fixed is None else part(t, fixed)):
                faces = [[piece[i] for i in range(4) if i != skip] for skip in range(4)]
                axes.add_collection3d(Poly3DCollection(faces, facecolors=colour, alpha=0.22, edgecolors=colour, linewidths=0.25))
        if fixed is not None:
            corners = points[list(fixed)]
            axes.add_collection3d(Line3DCollection([[corners[i], corners[j]] for i in range(len(corners)) for j in range(i)], colors=colour, linewidths=2.4)) if len(fixed) > 1 else None
            axes.scatter(*corners.T, color=colour, s=28, depthshade=False)
        axes.set(xlim=(-0.45, 1.4), ylim=(-0.55, 1.0), zlim=(-0.85, 0.9))
        axes.set_box_aspect((1.6, 1.4, 1.6), zoom=1.4)
        axes.view_init(elev=16, azim=-62)
        axes.axis("off")
        axes.set_title(title, fontsize=11, color=colour)
    save(figure, out, "smoothing")


def objects(out):
    """Draws the objects of a C program, in the order in which it makes them, and what changes when."""
    figure, axes = sheet(13, 4.9, (8.6, 3.3))
    box(axes, 0.3, 2.6, 2.6, 1.9, "tm_mesh", "rest positions,\ntopology\nnever changes", GREY)
    box(axes, 4.0, 2.6, 2.8, 1.9, "tm_tissue", "materials, tensors,\nmasses\nchanged by cuts alone", RED)
    box(axes, 7.9, 2.6, 2.8, 1.9, "tm_world", "displacements,\nlist of stages\nchanges every step", BLUE)
    arrow(axes, (2.95, 3.55), (3.95, 3.55))
    arrow(axes, (6.85, 3.55), (7.85, 3.55))
    for i, name in enumerate(("support", "gravity", "contact", "your own")):
        box(axes, 4.15 + 2.2 * i, 0.4, 1.95, 0.8, name, "", GREEN)
        arrow(axes, (5.1 + 2.2 * i, 1.25), (8.4 + 0.6 * i, 2.55), GREEN, width=1)
    axes.text(3.9, 0.8, "stages, added by tm_stage_*\nand tm_world_add_stage", ha="right", va="center", color=GREEN, fontsize=9.5)
    axes.text(11.0, 3.55, "tm_world_step\ntm_world_settle", va="center", family="monospace", fontsize=9)
    save(figure, out, "objects")


def states(out):
    """Draws the states of the controller; two of them output force."""
    figure, axes = sheet(13, 5.0, (8.6, 3.3))
    places = {"boot": (0.3, 3.4, GREY), "self_test": (3.0, 3.4, GREY), "idle": (5.7, 3.4, BLUE), "engaged": (8.4, 3.4, GREEN), "stale": (11.1, 3.4, GREEN), "fault": (5.7, 0.4, RED)}
    for name, (x, y, colour) in places.items():
        box(axes, x, y, 1.6, 0.8, name, "", colour)
    for start, end, words in ((1.9, 3.0, "encoders"), (4.6, 5.7, "100 ms\nwell"), (7.3, 8.4, "fresh\nsample")):
        arrow(axes, (start + 0.05, 3.8), (end - 0.05, 3.8))
        axes.text((start + end) / 2, 3.95, words, ha="center", va="bottom", fontsize=9)
    arrow(axes, (10.05, 4.0), (11.05, 4.0))
    axes.text(10.55, 4.15, "sample\ntoo old", ha="center", va="bottom", fontsize=9)
    arrow(axes, (11.05, 3.6), (10.05, 3.6))
    axes.text(10.55, 3.45, "fresh", ha="center", va="top", fontsize=9)
    arrow(axes, (11.9, 3.35), (6.9, 3.35), bend=-0.28)
    axes.text(9.5, 2.35, "faded, or a pause", ha="center", va="top", fontsize=9)
    arrow(axes, (6.5, 3.35), (6.5, 1.25), RED)
    axes.text(6.6, 1.7, "any state: first fault is latched", va="center", color=RED, fontsize=9)
    arrow(axes, (5.65, 0.8), (1.1, 3.35), RED, bend=-0.25)
    axes.text(2.6, 1.1, "reset", color=RED, fontsize=9)
    axes.text(10.55, 0.8, "force: ramps in when engaged,\nfades when stale, else zero", ha="center", va="center", color=GREEN, fontsize=9.5)
    save(figure, out, "states")


def main():
    out = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs/images"
    with matplotlib.rc_context({**STYLE, "axes.grid": False}):
        for draw in (contact, loop, step, patch, smoothing, objects, states):
            draw(out)


if __name__ == "__main__":
    main()
