"""The page of a fit: constants with intervals, curves, residuals, correlation, what more to measure. One HTML file; needs nothing but Python."""
import html

WIDTH, HEIGHT, EDGE = 440, 260, 64
STYLE = """body{font:16px/1.5 Georgia,serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#1b1b1b;background:#fff}
h1,h2,th,td{font-family:system-ui,sans-serif}table{border-collapse:collapse;font-size:14px}td,th{padding:.25rem .6rem;border-bottom:1px solid #ddd;text-align:left}
.wide{overflow-x:auto}.bad{color:#a51b0b}.good{color:#2e6b12}svg{max-width:100%;font:11px system-ui,sans-serif}"""


def ticks(low, high):
    """Returns about five round numbers between low and high."""
    if not high > low:
        return [low]
    raw = (high - low) / 6
    size = 1.0
    while size > raw:
        size /= 10
    while size * 10 <= raw:
        size *= 10
    step = next(size * m for m in (1, 2, 2.5, 5, 10) if size * m >= raw)
    first = -(-low // step)
    return [step * (first + i) for i in range(12) if step * (first + i) <= high * (1 + 1e-9)]


def plot(x, series, x_name, y_name):
    """Returns an SVG of series [(y, drawn as line)] over x."""
    every = [v for y, _ in series for v in y if v is not None]
    (x0, x1), (y0, y1) = (min(x), max(x)), (min(every), max(every))
    x1, y1 = x1 + (x1 == x0), y1 + (y1 == y0) * (abs(y1) or 1)

    def at(px, py):
        return EDGE + (px - x0) / (x1 - x0) * (WIDTH - EDGE - 10), HEIGHT - EDGE - (py - y0) / (y1 - y0) * (HEIGHT - EDGE - 10)
    out = [f'<svg style="margin:0 12px 12px 0" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" role="img" aria-label="{html.escape(y_name)} over {html.escape(x_name)}">']
    for t in ticks(y0, y1):
        out.append(f'<line x1="{EDGE}" x2="{WIDTH - 10}" y1="{at(x0, t)[1]:.1f}" y2="{at(x0, t)[1]:.1f}" stroke="#e4e4e4"/><text x="{EDGE - 4}" y="{at(x0, t)[1] + 4:.1f}" text-anchor="end">{t:.3g}</text>')
    for t in ticks(x0, x1):
        out.append(f'<text x="{at(t, y0)[0]:.1f}" y="{HEIGHT - EDGE + 16}" text-anchor="middle">{t:.3g}</text>')
    for y, line in series:
        points = sorted(at(*p) for p in zip(x, y) if p[1] is not None)
        if line:
            out.append(f'<polyline fill="none" stroke="#c1440e" points="{" ".join(f"{a:.1f},{b:.1f}" for a, b in points)}"/>')
        else:
            out += [f'<circle cx="{a:.1f}" cy="{b:.1f}" r="2" fill="#1f5fa8"/>' for a, b in points]
    out.append(f'<text x="{WIDTH / 2}" y="{HEIGHT - 8}" text-anchor="middle">{html.escape(x_name)}</text><text x="12" y="{HEIGHT / 2}" transform="rotate(-90 12 {HEIGHT / 2})" text-anchor="middle">{html.escape(y_name)}</text></svg>')
    return "".join(out)


def table(head, rows):
    cells = "".join("<tr>" + "".join(f"<td{' class=bad' if str(c).startswith(('not ', 'badly', 'one-sided')) else ''}>{html.escape(str(c))}</td>" for c in row) + "</tr>" for row in rows)
    return f"<div class=wide><table><tr>{''.join(f'<th>{html.escape(h)}</th>' for h in head)}</tr>{cells}</table></div>"


def derivatives_of(found):
    """Returns how derivatives were computed, and what they took."""
    return f"differences ({found['differences']})" if found["differences"] else f"the adjoint, {found['solutions']} solutions"


def predicted_rows(p):
    """Returns the rows of the table of measurements that were not fitted."""
    def cells(row, column, m, s):
        return [row, column, f"{m:.5g}", f"{s:.5g}", f"{100 * (s / m - 1):+.1f} %" if m else ""]
    if p["swings"]:
        return [cells(s["row"], f"{s['column']}, {name}", *s[key]) for s in p["swings"] for name, key in (("period, s", "period_s"), ("decrement", "decrement"))]
    return [cells(i, c, m, s) for i, (measured, simulated) in enumerate(zip(p["measured"], p["simulated"]), 1) for c, m, s in zip(p["columns"], measured, simulated) if m is not None]


def write_page(path, found):
    name, x = found["along"]
    body = [f"<h1>Constants of {html.escape(found['scene'])}</h1><p>From {html.escape(found['data'])}: {len(found['measured'])} rows, {found['trials']} trials, derivatives by {html.escape(derivatives_of(found))}, {found['seconds']:.0f} s.</p>",
            table(["constant", "value", "95 % interval", "verdict"],
                  [[c["path"], f"{c['value']:.5g} {c['unit']}", f"{c['interval'][0]:.5g} to {c['interval'][1]:.5g} {c['unit']}", c["verdict"] or "determined"] for c in found["constants"]]),
            "<h2>Fit and residuals</h2><p>Points: measured; line: simulated with these constants. Beside it the residuals, root mean square " + ", ".join(f"{html.escape(c)} {v:.3g}" for c, v in zip(found["columns"], found["rms"])) + ".</p>"]
    for j, column in enumerate(found["columns"]):
        measured, fitted = ([row[j] for row in found[key]] for key in ("measured", "fitted"))
        body.append(plot(x, [(measured, False), (fitted, True)], name, column))
        body.append(plot(x, [([None if m is None else f - m for f, m in zip(fitted, measured)], False)], name, "simulated less measured"))
    if found["outliers"]:
        body.append("<p class=bad>Far from the others: " + ", ".join(f"row {o['row']} ({html.escape(o['column'])})" for o in found["outliers"]) + ". Check them, or use --robust.</p>")
    names = [c["path"] for c in found["constants"]]
    body.append("<h2>Correlation</h2><p>Near 1 or -1: the data determine a combination better than each constant alone. Condition of the Fisher matrix: "
                f"{found['condition']:.3g}.</p>" + table(["", *names], [[n, *(f"{v:.3f}" for v in row)] for n, row in zip(names, found["correlation"])]))
    body.append("<h2>What more to measure</h2><p>To what share each interval shrinks, at the same noise; best first.</p>"
                + table(["measurement", *names], [[m["what"], *(f"{100 * s:.0f} %" for s in m["shrinks_to"])] for m in found["more"]]))
    for p in found["predicted"]:
        body.append(f"<h2>Not fitted: {html.escape(p['data'])}</h2>" + table(["row", "column", "measured", "simulated", "difference"], predicted_rows(p)))
    words = " ".join(f"--set '{w}'" for c in found["constants"] for w in c["settings"])
    body.append(f"<h2>Use</h2><pre style='white-space:pre-wrap'>tm-sim {html.escape(found['scene'])} {html.escape(words)}</pre>")
    part = path.with_suffix(".part")
    part.write_text(f"<!doctype html><html lang=en><meta charset=utf-8><meta name=viewport content='width=device-width'><title>tm-fit</title><style>{STYLE}</style>{''.join(body)}</html>\n")
    part.replace(path)
