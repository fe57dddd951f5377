"""docs/images/architecture.svg: the source tree in one picture.   python tools/pictures/architecture.py [OUT]"""
import pathlib
import sys

WIDTH, HEIGHT = 1020, 410
#: name, folder, x, y, width, height, fill
BOXES = [
    ("scene and mesh", "apps/scenes, meshes", 20, 40, 170, 64, "#f3efe6"),
    ("simulation", "apps/sim", 230, 40, 220, 64, "#dce8f2"),
    ("controller", "haptic_rt/io, haptic_rt/can", 540, 40, 220, 64, "#f6dfd3"),
    ("device and hand", "real, or haptic_rt/device", 830, 40, 170, 64, "#f3efe6"),
    ("viewer and window", "apps/view, apps/play", 405, 150, 180, 54, "#dce8f2"),
    ("tissue", "libtensormass: core, io, scene, solve", 230, 246, 220, 64, "#cfe3c3"),
    ("tick at 500 Hz", "haptic_rt/core: float, no system", 540, 246, 220, 64, "#efc9b5"),
    ("contact law", "law: one source, double for the tissue, float for the tick", 230, 346, 530, 50, "#e9e2f0"),
]
#: from x, y to x, y; both directions; label, its x and y
ARROWS = [
    (190, 72, 230, 72, False, "", 0, 0),
    (450, 72, 540, 72, True, "LCM", 495, 62),
    (760, 72, 830, 72, True, "CAN", 795, 62),
    (495, 76, 495, 150, True, "", 0, 0),
    (300, 246, 300, 104, False, "", 0, 0),
    (690, 246, 690, 104, False, "", 0, 0),
    (340, 346, 340, 310, False, "", 0, 0),
    (650, 346, 650, 310, False, "", 0, 0),
]


def words(x, y, said, size, weight="normal"):
    return f'<text x="{x:g}" y="{y:g}" font-size="{size}" font-weight="{weight}" text-anchor="middle">{said}</text>'


def draw():
    """Returns the picture as SVG text."""
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" font-family="sans-serif" fill="#222">',
           "<title>Simulation, controller and device in a row, and the libraries that they are built on</title>",
           '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto-start-reverse">'
           '<path d="M0 0 8 4 0 8z" fill="#555"/></marker></defs>',
           f'<rect width="{WIDTH}" height="{HEIGHT}" fill="white"/>']
    for ax, ay, bx, by, both, label, x, y in ARROWS:
        start = ' marker-start="url(#tip)"' if both else ""
        out.append(f'<line x1="{ax}" y1="{ay}" x2="{bx}" y2="{by}" stroke="#555" stroke-width="1.5" marker-end="url(#tip)"{start}/>')
        if label:
            out.append(words(x, y, label, 12, "bold"))
    for name, place, x, y, width, height, fill in BOXES:
        out.append(f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="5" fill="{fill}" stroke="#777"/>')
        out += [words(x + width / 2, y + height / 2 - 4, name, 14, "bold"), words(x + width / 2, y + height / 2 + 15, place, 12)]
    return "\n".join([*out, "</svg>\n"])


if __name__ == "__main__":
    pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/architecture.svg").write_text(draw())
