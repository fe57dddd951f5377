"""Makes a self-contained HTML page of figures and tables, for `make evaluate`, `make accuracy` and `make stability`.

Every page begins with its conditions (machine, commit, compiler, flags). Figures are embedded; their data are in JSON and CSV files in the same folder.
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
from matplotlib.ticker import FixedFormatter, FixedLocator, FuncFormatter, LogLocator, NullFormatter  # noqa: E402

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent

# Readable in greyscale: series differ in dash and marker, not only in colour.
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
    """Returns the style of the index-th series, as keyword arguments of plot()."""
    return dict(SERIES[index % len(SERIES)])


def label_line(axis, x, y, text, style, dx=4, dy=0):
    """Writes a series' name at its last point, which avoids a legend."""
    label = axis.annotate(text, (x, y), xytext=(dx, dy), textcoords="offset points", color=style.get("color", "k"),
                          va="center", fontsize=9, annotation_clip=False)
    label.set_gid(LINE_LABEL)


def label_upright(axis, x, text, color="#777777"):
    """Labels a vertical line, along it and inside the frame."""
    axis.annotate(text, (x, 0.03), xycoords=("data", "axes fraction"), xytext=(3, 0), textcoords="offset points", rotation=90, fontsize=8, color=color)


def spread_labels(figure):
    """Moves overlapping line labels apart vertically."""
    labels = [text for axis in figure.axes for text in axis.texts if text.get_gid() == LINE_LABEL]
    if len(labels) < 2:
        return
    figure.draw_without_rendering()
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


def _tick_labels(axis):
    """Returns (position, text, box) of every visible label of an axis."""
    ticks = [*axis.get_major_ticks(), *axis.get_minor_ticks()]
    low, high = sorted(axis.get_view_interval())
    slack = 1e-9 * (high - low)
    seen = [(t.get_loc(), t.label1) for t in ticks if t.label1.get_visible() and t.label1.get_text() and low - slack <= t.get_loc() <= high + slack]
    return sorted(((at, label.get_text(), label.get_window_extent()) for at, label in seen), key=lambda x: x[0])


def overlapping_ticks(figure):
    """Returns pairs (text, text) of tick labels of one axis that overlap or are closer than a space."""
    figure.draw_without_rendering()
    found = []
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            labels = _tick_labels(axis)
            found += [(a, b) for (_, a, box), (_, b, other) in zip(labels, labels[1:]) if box.expanded(1.05, 1.0).overlaps(other)]
    return found


def thin_ticks(figure):
    """Thins tick labels until none overlaps its neighbour: 1, 2, 5 if a logarithmic axis spans few decades."""
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            if axis.get_scale() == "log" and high < 300 * low:
                axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
                axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
                axis.set_minor_formatter(NullFormatter())
    for keep_minor in (True, *[False] * 8):
        if not overlapping_ticks(figure):
            return
        for axes in figure.axes:
            for axis in (axes.xaxis, axes.yaxis):
                labels = _tick_labels(axis)
                if not any(box.expanded(1.05, 1.0).overlaps(other) for (_, _, box), (_, _, other) in zip(labels, labels[1:])):
                    continue
                major = {t.get_loc() for t in axis.get_major_ticks()}
                fewer = [x for x in labels if x[0] in major] if keep_minor else labels[::2]
                fewer = fewer if len(fewer) > 1 else labels[::max(1, len(labels) - 1)]
                offset = axis.get_offset_text().get_text()
                axis.set_major_locator(FixedLocator([x[0] for x in fewer]))
                axis.set_major_formatter(FixedFormatter([x[1] for x in fewer]))
                axis.get_major_formatter().set_offset_string(offset)
                axis.set_minor_formatter(NullFormatter())


def frontier(points):
    """Returns the Pareto front of (time, error, ...) points, by ascending time."""
    best, kept = float("inf"), []
    for point in sorted(points, key=lambda p: (p[0], p[1])):
        if point[1] < best:
            best = point[1]
            kept.append(point)
    return kept


def draw_frontier(axis, points):
    """Connects the Pareto front; the other points stay unconnected."""
    best = frontier(points)
    axis.plot([p[0] for p in best], [p[1] for p in best], color="#bbbbbb", linewidth=5, alpha=0.6, zorder=0, solid_capstyle="round")
    return best


def loglog(axis, xlabel, ylabel):
    axis.set(xscale="log", yscale="log", xlabel=xlabel, ylabel=ylabel)


def times(ratio):
    """Returns "2.0 times"; an integer from ten on."""
    return f"{ratio:,.0f} times" if ratio >= 9.95 else f"{ratio:.1f} times"


def _line(*command):
    try:
        return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=20).stdout.strip().splitlines()[0]
    except (OSError, IndexError, subprocess.TimeoutExpired):
        return "unknown"


def circumstances(extra=None):
    """Returns machine, commit, compiler and flags, for the page's head and its JSON file."""
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


# Pictures are drawn once, on white; dark mode inverts them and rotates their hues back.
STYLE = """
:root{--paper:#fff;--ink:#1b1b1b;--soft:#555;--line:#ddd;--code:#f4f4f4;--good:#2e6b12;--fair:#8a5a00;--bad:#a51b0b;--link:#1f5fa8}
@media (prefers-color-scheme:dark){:root{--paper:#141414;--ink:#e4e4e4;--soft:#a8a8a8;--line:#3a3a3a;--code:#242424;--good:#8fd16a;--fair:#e8b04a;--bad:#ff8370;--link:#8fbcf5}
img{filter:invert(.9215) hue-rotate(180deg)}}
body{font:16px/1.5 Georgia,serif;max-width:62rem;margin:2rem auto;padding:0 1rem;color:var(--ink);background:var(--paper)}
h1,h2,th,dt,nav,label,figcaption,.caption{font-family:system-ui,sans-serif} h2{margin-top:2.5rem;border-top:1px solid var(--line);padding-top:1rem}
a{color:var(--link)} nav{margin:1.5rem 0;font-size:14px;display:flex;flex-wrap:wrap;gap:.2rem 1.2rem}
label{font-size:14px;display:block;position:sticky;top:0;background:var(--paper);padding:.5rem 0} input{font:inherit;color:inherit;background:var(--code);border:1px solid var(--line);padding:.2rem .5rem;margin:0 .5rem}
dl{display:grid;grid-template-columns:max-content 1fr;gap:0 1rem;font-size:13px;color:var(--soft)} dd{margin:0;overflow-wrap:anywhere}
figure{margin:1.5rem 0} img{max-width:100%} figcaption,.caption{font-size:14px;color:var(--soft)}
.wide{overflow-x:auto} table{border-collapse:collapse;font-size:13px;font-family:system-ui,sans-serif} td,th{padding:.25rem .6rem;border-bottom:1px solid var(--line);text-align:left;vertical-align:top}
td:not(:first-child){font-variant-numeric:tabular-nums} .good td:last-child{color:var(--good)} .fair td:last-child{color:var(--fair)} .bad td:last-child{color:var(--bad)}
code{font-size:13px;background:var(--code);padding:.1rem .3rem;overflow-wrap:anywhere} [hidden]{display:none!important}
@media (max-width:48rem){body{margin:1rem auto} dl{display:block} figure{overflow-x:auto} img{max-width:none;width:max(100%,30rem)}
.verdicts thead{display:none} .verdicts,.verdicts tbody{display:block} .verdicts tr{display:flex;flex-direction:column;padding:.6rem 0;border-bottom:1px solid var(--line)}
.verdicts td{border:0;padding:.05rem 0;overflow-wrap:anywhere} .verdicts td:empty{display:none} .verdicts td::before{content:attr(data-name) ": ";color:var(--soft)}
.verdicts td:first-child{order:-2;font-weight:bold} .verdicts td:last-child{order:-1;font-weight:bold} .verdicts td:first-child::before,.verdicts td:last-child::before{content:none}}
@media print{body{max-width:none;margin:0} h2{break-after:avoid} figure,tr{break-inside:avoid} .wide,figure{overflow:visible} img{max-width:100%;width:auto} table{font-size:10px} td,th{padding:.15rem .3rem}}
"""

# A filter above the first table of verdicts: rows with all its words stay visible, in every such table.
FILTER = """
const rows=[...document.querySelectorAll('.verdicts tbody tr')],label=document.createElement('label'),field=document.createElement('input'),told=document.createElement('span');
field.type='search';field.placeholder='broken, cut, step \u2026';label.append('Show rows with',field,told);
document.querySelector('.wide:has(.verdicts)').before(label);
const show=()=>{const words=field.value.toLowerCase().split(/\\s+/).filter(Boolean);let n=0;
for(const r of rows){const text=r.textContent.toLowerCase();r.hidden=!words.every(w=>text.includes(w));n+=!r.hidden}
told.textContent=n+' of '+rows.length+' rows';};
field.addEventListener('input',show);show();
"""


class Page:
    """Collects sections, then writes index.html, NAME.json and one CSV a table into `folder`, all or nothing."""

    def __init__(self, folder, title, lead, facts=None):
        self.folder = pathlib.Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        self.title, self.lead = title, lead
        self.facts = circumstances(facts)
        self.body, self.contents, self.data = [], [], {"title": title, "circumstances": self.facts}

    def section(self, heading, text=""):
        anchor = "".join(c if c.isalnum() else "-" for c in heading.lower())
        self.contents.append(f'<a href="#{anchor}">{html.escape(heading)}</a>')
        self.body.append(f'<h2 id="{anchor}">{html.escape(heading)}</h2>')
        if text:
            self.text(text)

    def text(self, text):
        """Adds a paragraph; HTML passes unescaped, for code and emphasis."""
        self.body.append(f"<p>{text}</p>")

    def figure(self, name, figure, caption, command=None):
        """Embeds a matplotlib figure and writes NAME.png and NAME.svg."""
        thin_ticks(figure)
        # Has been laid out (thin_ticks) and is measured once: each save would repeat both, at the cost of two drawings.
        figure.set_layout_engine(None)
        spread_labels(figure)
        box = figure.get_tightbbox().padded(plt.rcParams["savefig.pad_inches"])
        png = io.BytesIO()
        figure.savefig(png, format="png", bbox_inches=box)
        (self.folder / f"{name}.png").write_bytes(png.getvalue())
        figure.savefig(self.folder / f"{name}.svg", bbox_inches=box, metadata={"Date": None})
        plt.close(figure)
        data = base64.b64encode(png.getvalue()).decode()
        repeat = f'<br><code>{html.escape(command)}</code>' if command else ""
        self.body.append(f'<figure><img alt="{html.escape(name)}" src="data:image/png;base64,{data}">'
                         f"<figcaption>{caption}{repeat}</figcaption></figure>")

    def table(self, name, header, rows, caption="", mark=None):
        """Adds a table, also as NAME.csv. `mark(row)` may return a CSS class (good, fair or bad): the last column is then a verdict, which heads the row
        on a narrow screen, and rows can be filtered."""
        with open(self.folder / f"{name}.csv", "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(header)
            writer.writerows(rows)
        out = [f"<div class=wide><table{' class=verdicts' if mark else ''}><thead><tr>", *(f"<th>{html.escape(str(h))}</th>" for h in header), "</tr></thead><tbody>"]
        for row in rows:
            out.append(f'<tr class="{mark(row) or ""}">' if mark else "<tr>")
            out.extend(f'<td data-name="{html.escape(str(h))}">{html.escape(_number(c))}</td>' if mark else f"<td>{html.escape(_number(c))}</td>" for h, c in zip(header, row))
            out.append("</tr>")
        out.append(f"</tbody></table></div><p class=caption>{caption}</p>")
        self.body.append("".join(out))

    def record(self, key, value):
        """Adds a value to the page's JSON file."""
        self.data[key] = value

    def write(self, name):
        facts = "".join(f"<dt>{html.escape(k)}</dt><dd>{html.escape(str(v))}</dd>" for k, v in self.facts.items())
        contents = f"<nav>{' '.join(self.contents)}</nav>" if len(self.contents) > 1 else ""
        body = "".join(self.body)
        script = f"<script>{FILTER}</script>" if "class=verdicts" in body else ""
        page = f"""<!doctype html><html lang=en><meta charset=utf-8><meta name=viewport content="width=device-width,initial-scale=1"><meta name=color-scheme content="light dark">
<title>{html.escape(self.title)}</title><style>{STYLE}</style>
<h1>{html.escape(self.title)}</h1><p>{self.lead}</p><dl>{facts}</dl>{contents}{body}{script}</html>"""
        for path, text in ((f"{name}.json", json.dumps(self.data, indent=1, allow_nan=False) + "\n"), ("index.html", page)):
            temporary = self.folder / (path + "~")
            temporary.write_text(text)
            temporary.replace(self.folder / path)
        return self.folder / "index.html"


def _number(value):
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 1e4 else f"{value:.3e}"
    return str(value)
