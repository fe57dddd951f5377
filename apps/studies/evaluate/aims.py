"""Compares the aims with the results: one row per aim, met or missed."""


def _contact(rows, pick, model, limits):
    """Yields the RMS error of `local_model` in % of peak, by frames late."""
    for late, most in enumerate(limits):
        for r in pick(rows, model=model, latency_frames=late, extrapolator="local_model"):
            yield f"contact on {model} tissue, {late} late", "RMS % of peak, at most", most, 100 * r["rms"]


def _over_position(rows, pick, path, most):
    for late in (0, 1, 2):
        at = {r["extrapolator"]: r for r in pick(rows, model="isotropic", path=path, latency_frames=late)}
        if at:
            yield f"contact on {path}, {late} late", "RMS over position's, at most", most, at["local_model"]["rms"] / at["position"]["rms"]


def _hands(rows, pick):
    yield from _over_position(rows, pick, "other-hand-cuts", 1 / 3)
    yield from _over_position(rows, pick, "same-hand-cuts", 1 / 2)
    for late in (0, 1, 2):
        for r in pick(rows, model="isotropic", path="same-hand-cuts", latency_frames=late, extrapolator="local_model"):
            yield f"jump at a sample's arrival, same-hand-cuts, {late} late", "% of peak, at most", 3, 100 * r["jump_arrival"]
    yield from _over_position(rows, pick, "grasped-and-pulled", 1 / 10)


def _tangent(rows, pick):
    for model in dict.fromkeys(r["model"] for r in rows):
        for late in (0, 1, 2):
            at = {r["extrapolator"]: r["rms"] for r in pick(rows, model=model, latency_frames=late)}
            if at:
                yield f"tangent on {model} tissue, {late} late", "RMS over position's, below", 1, at["tangent"] / at["position"]


def _all(data, pick):
    """(what, which way, aim, figure)"""
    rows = data["rates"]["rows"]
    for model in ("isotropic", "fibred"):
        yield from _contact(rows, pick, model, (0.15, 0.15, 0.5))
    yield from _contact(rows, pick, "cut", (0.25, 0.25, 0.8))
    yield from _hands(rows, pick)
    fast = {r["extrapolator"]: r["rms"] for r in pick(rows, model="precomputed", speed_m_s=0.03, latency_frames=2)}
    if fast:
        yield "contact on precomputed tissue at 0.03 m/s, 2 late", "times less than position's, at least", 30, fast["position"] / fast["local_model"]
    yield from _tangent(rows, pick)
    for r in data["roughness"]:
        if r["depth_m"] > 0.0015:
            yield f"the force itself, {r['model']}, {1e3 * r['depth_m']:.0f} mm", "second difference per tick, % of peak, at most", 0.5, 100 * r["largest"]
    for late in (0, 1, 2):
        largest = [r["largest"] for r in data["cutting"] if r["extrapolator"] == "local_model" and r["latency_frames"] == late]
        if largest:
            yield f"two cauteries at random, {late} late", "largest force over the truth's peak, at most", 1.1, max(largest)
    loop = {r["extrapolator"]: r["stiffness_N_m"] for r in data["loop"]["rows"] if r["rate_Hz"] == 30 and r["delay_frames"] == 0 and not r["passivity"]}
    if loop:
        yield "closed loop at 30 Hz, contact, on an exponential surface", "times hold's stiffness, at least", 10, loop["local_model"] / loop["hold"]
    for model in ("isotropic", "cut"):
        loop = {r["extrapolator"]: r["stiffness_N_m"] for r in data["tissue-loop"] if r["model"] == model}
        if loop:
            yield f"closed loop at 30 Hz, contact, on {model} tissue", "times hold's stiffness, at least", 10, loop["local_model"] / loop["hold"]


def aims(page, data, pick):
    page.section("Aims", "What was aimed at, and what this run measured; 20 Hz, 0.01 m/s and a tremor of 40 µm unless said otherwise.")
    out = []
    for what, way, aim, figure in _all(data, pick):
        met = figure >= aim if way.endswith("at least") else figure <= aim
        out.append({"what": what, "figure_name": way, "aim": aim, "figure": figure, "met": met})
    page.table("aims", ["what", "figure", "aim", "measured", "verdict"], [[a["what"], a["figure_name"], float(a["aim"]), float(a["figure"]), "met" if a["met"] else "missed"] for a in out],
               f"{sum(a['met'] for a in out)} of {len(out)} met.", mark=lambda row: "good" if row[-1] == "met" else "bad")
    return out
