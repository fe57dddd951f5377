"""One self-contained HTML page of figures and tables: used by `make evaluate`, `make accuracy` and `make stability`.

Every page opens with what it was made on (machine, commit, compiler, flags), every figure is embedded, and the
numbers behind it stand beside the page as JSON and CSV.
"""
import base64
import csv
import datetime
import html
import io
import json
import os
import pathlib
import platform
import subprocess

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent

# Readable in grey: every series differs in dash and marker, not in colour alone.
SERIES = [
    dict(color="#1b1b1b", linestyle="-", marker="o"),
    dict(color="#c1440e", linestyle="--", marker="s"),
    dict(color="#1f5fa8", linestyle="-.", marker="^"),
    dict(color="#6a8f2f", linestyle=":", marker="D"),
    dict(color="#8a4fa3", linestyle=(0, (5, 1, 1, 1, 1, 1)), marker="v"),
    dict(color="#b58900", linestyle=(0, (8, 2)), marker="P"),
    dict(color="#777777", linestyle=(0, (1, 1)), marker="x"),
]

plt.rcParams.update({
    "figure.figsize": (6.4, 4.2), "figure.dpi": 120, "savefig.bbox": "tight", "font.size": 10,
    "axes.spines.top": False, "axes.spines.right": False, "axes.grid": True, "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6, "axes.axisbelow": True, "lines.linewidth": 1.5, "lines.markersize": 5, "legend.frameon": False,
})


LINE_LABEL = "line label"


def series(index):
    """Style of the index-th series, as keyword arguments of plot()."""
    return dict(SERIES[index % len(SERIES)])


def label_line(axis, x, y, text, style, dx=4, dy=0):
    """Writes a series' name at its last point, so that no legend has to be looked up."""
    label = axis.annotate(text, (x, y), xytext=(dx, dy), textcoords="offset points", color=style.get("color", "k"),
                          va="center", fontsize=9, annotation_clip=False)
    label.set_gid(LINE_LABEL)


def spread_labels(figure):
    """Moves labels of lines apart, up and down, as far as they lie over one another."""
    labels = [text for axis in figure.axes for text in axis.texts if text.get_gid() == LINE_LABEL]
    if len(labels) < 2:
        return
    figure.canvas.draw()
    points = 72 / figure.dpi
    for _ in range(60):
        boxes = sorted(((text.get_window_extent(), text) for text in labels), key=lambda b: b[0].y0)
        moved = False
        for i, (low, below) in enumerate(boxes):
            for high, above in boxes[i + 1:]:
                if low.y1 <= high.y0 or low.x1 <= high.x0 or high.x1 <= low.x0:
                    continue
                for text, way in ((below, -1), (above, 1)):
                    dx, dy = text.xyann
                    text.xyann = (dx, dy + way * max(0.5, 0.5 * points * (low.y1 - high.y0)))
                moved = True
        if not moved:
            return


def frontier(points):
    """Those (time, error, ...) points that no other beats in both, by ascending time."""
    best, kept = float("inf"), []
    for point in sorted(points, key=lambda p: (p[0], p[1])):
        if point[1] < best:
            best = point[1]
            kept.append(point)
    return kept


def _line(*command):
    try:
        return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=20).stdout.strip().splitlines()[0]
    except (OSError, IndexError, subprocess.TimeoutExpired):
        return "unknown"


def circumstances(extra=None):
    """Machine, commit, compiler and flags, for the head of a page and the JSON beside it."""
    model = next((l.split(":", 1)[1].strip() for l in open("/proc/cpuinfo") if l.startswith("model name")), platform.machine())
    facts = {
        "date": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
        "machine": f"{model}, {os.cpu_count()} cores, {platform.system()} {platform.release()}",
        "commit": _line("git", "describe", "--always", "--dirty", "--abbrev=10"),
        "compiler": _line(os.environ.get("TM_CC", "gcc"), "--version"),
        "flags": os.environ.get("TM_FLAGS", "see Makefile, config=release"),
    }
    facts.update(extra or {})
    return facts


class Page:
    """Collects sections, then writes index.html, NAME.json and one CSV a table into `folder`, the whole page or nothing."""

    def __init__(self, folder, title, lead, facts=None):
        self.folder = pathlib.Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        self.title, self.lead = title, lead
        self.facts = circumstances(facts)
        self.body, self.data = [], {"title": title, "circumstances": self.facts}

    def section(self, heading, text=""):
        self.body.append(f"<h2>{html.escape(heading)}</h2>")
        if text:
            self.text(text)

    def text(self, text):
        """A paragraph; HTML is let through, so that a page can set code and emphasis."""
        self.body.append(f"<p>{text}</p>")

    def figure(self, name, figure, caption, command=None):
        """Embeds a matplotlib figure and leaves NAME.png and NAME.svg beside the page."""
        spread_labels(figure)
        png = io.BytesIO()
        figure.savefig(png, format="png")
        (self.folder / f"{name}.png").write_bytes(png.getvalue())
        figure.savefig(self.folder / f"{name}.svg", metadata={"Date": None})
        plt.close(figure)
        data = base64.b64encode(png.getvalue()).decode()
        repeat = f'<br><code>{html.escape(command)}</code>' if command else ""
        self.body.append(f'<figure><img alt="{html.escape(name)}" src="data:image/png;base64,{data}">'
                         f"<figcaption>{caption}{repeat}</figcaption></figure>")

    def table(self, name, header, rows, caption="", mark=None):
        """A table, also as NAME.csv. `mark(row)` may return a CSS class: good, fair or bad."""
        with open(self.folder / f"{name}.csv", "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(header)
            writer.writerows(rows)
        out = ["<table><thead><tr>", *(f"<th>{html.escape(str(h))}</th>" for h in header), "</tr></thead><tbody>"]
        for row in rows:
            out.append(f'<tr class="{(mark(row) or "") if mark else ""}">')
            out.extend(f"<td>{html.escape(_number(c))}</td>" for c in row)
            out.append("</tr>")
        out.append(f"</tbody></table><p class=caption>{caption}</p>")
        self.body.append("".join(out))

    def record(self, key, value):
        """Puts a value into the JSON beside the page."""
        self.data[key] = value

    def write(self, name):
        facts = "".join(f"<dt>{html.escape(k)}</dt><dd>{html.escape(str(v))}</dd>" for k, v in self.facts.items())
        page = f"""<!doctype html><html lang=en><meta charset=utf-8><meta name=viewport content="width=device-width">
<title>{html.escape(self.title)}</title><style>
body{{font:16px/1.5 Georgia,serif;max-width:62rem;margin:2rem auto;padding:0 1rem;color:#1b1b1b}}
h1,h2,th,dt,figcaption,.caption{{font-family:system-ui,sans-serif}} h2{{margin-top:2.5rem;border-top:1px solid #ddd;padding-top:1rem}}
dl{{display:grid;grid-template-columns:max-content 1fr;gap:0 1rem;font-size:13px;color:#555}} dd{{margin:0}}
figure{{margin:1.5rem 0}} img{{max-width:100%}} figcaption,.caption{{font-size:14px;color:#444}}
table{{border-collapse:collapse;font-size:13px;font-family:system-ui,sans-serif}} td,th{{padding:.25rem .6rem;border-bottom:1px solid #e4e4e4;text-align:left}}
td:not(:first-child){{font-variant-numeric:tabular-nums}} .good td:last-child{{color:#2e6b12}} .fair td:last-child{{color:#8a5a00}} .bad td:last-child{{color:#a51b0b}}
code{{font-size:13px;background:#f4f4f4;padding:.1rem .3rem}}</style>
<h1>{html.escape(self.title)}</h1><p>{self.lead}</p><dl>{facts}</dl>{''.join(self.body)}</html>"""
        for path, text in ((f"{name}.json", json.dumps(self.data, indent=1, allow_nan=False) + "\n"), ("index.html", page)):
            temporary = self.folder / (path + "~")
            temporary.write_text(text)
            temporary.replace(self.folder / path)
        return self.folder / "index.html"


def _number(value):
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 1e4 else f"{value:.3e}"
    return str(value)
