"""Constants by tm-fit as a user finds them: one load of the beam is fitted, the others are predicted from the fitted scene; and a blind test of it."""
import json
import subprocess

import numpy as np
from beam import MARKERS, SCENE, mesh

TERMS = "viscosity: {terms: [{time: 10 ms, shear: 0.1}, {time: 40 ms, shear: 0.1}, {time: 160 ms, shear: 0.1}]}\n"
YOUNG = "tissue.materials.beam.young, tissue.materials.hook.young=100 kPa..300 kPa..800 kPa"
SHARE = "viscosity.terms[0].shear, viscosity.terms[1].shear, viscosity.terms[2].shear=0.01..0.1..0.3"
HOOK = "tissue.materials.hook.density={hook_kg_m3}"
HEAD = ["hook_kg_m3", *(f"{m}_m" for m in MARKERS), "period_s", "decrement"]


def tm_fit(bin, scene, data, out, *words):
    """Runs tm-fit. Returns its fit.json."""
    done = subprocess.run([str(w) for w in (bin / "tm-fit", scene, "--data", data, "-o", out, "--quiet", *words)], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(done.stderr)
    return json.loads((out / "fit.json").read_text())


class FittedBeam:
    """The beam's scene with a hook, whose density is the load, and tables for tm-fit."""

    def __init__(self, bin, folder, of, across, law="rotation:\nstrain_smoothing:\n"):
        self.bin, self.folder, self.of = bin, folder, of
        density, gravity = of["authors"]["density_kg_m3"], of["gravity_m_s2"]
        self.volume, self.inside_kg, self.gravity = mesh(folder / f"hung_{across}.msh", of["size_m"], across, True), 0.0, gravity
        self.inside_kg = density * self.volume / 2
        hook = f"    hook: {{young: 200 kPa, poisson: 0.49, density: {self.hook(0):.9g} kg/m3}}\n"
        self.scene = folder / f"hung_{across}.yaml"
        text = SCENE.format(what=f"{across} cells across", mesh=f"hung_{across}.msh", density=density, hook=hook, law=law + TERMS, gravity=gravity)
        self.scene.write_text(text.replace("poisson: 0.499", "poisson: 0.49"))

    def hook(self, load_N):
        """Returns the density, kg/m3, with which the hook weighs as much as the load and the beam's part of it."""
        return (load_N / self.gravity + self.inside_kg) / self.volume

    def table(self, name, rows):
        """Writes rows (load, N; displacements of the markers, m, or none; period, s; decrement) for tm-fit. Returns the path."""
        def text(v):
            return "" if v is None else f"{v:.9g}"
        path = self.folder / name
        path.write_text(",".join(HEAD) + "\n" + "".join(",".join(map(text, [self.hook(load), *(moved or [None] * 3), period, decrement])) + "\n" for load, moved, period, decrement in rows))
        return path

    def fit(self, data, predict, out, extra=(), swing_s=1.5, constants=(YOUNG, SHARE)):
        """Runs tm-fit. Returns its fit.json."""
        columns = HEAD[1:]
        words = [w for m in MARKERS for w in ("--point", f"{m}=" + ",".join(map(str, self.of["points_m"][m])))]
        what = {**{f"{m}_m": f"point {m} z" for m in MARKERS}, "period_s": "period m1 z", "decrement": "decrement m1 z"}
        words += [w for c in columns for w in ("--compare", f"{c}={what[c]}", "--noise", f"{c}={'5%' if c == 'decrement' else '1%'}")]
        words += [w for c in constants for w in ("--fit", c)] + [w for p in predict for w in ("--predict", str(p))]
        return tm_fit(self.bin, self.scene, data, self.folder / out, *words, "--row", HOOK, "--swing", swing_s, "--from-first", *extra)


def measured_rows(of):
    """Returns rows of the two measured loads: displacements from the rest under weight, m."""
    apart = [-1e-3 * (np.mean(of["weight"]["rest_mm"][m]) - np.mean(of["loaded"]["rest_mm"][m])) for m in MARKERS]
    weight, loaded = ([float(np.mean(of[name][key])) for key in ("period_s", "decrement")] for name in ("weight", "loaded"))
    return (0.0, [0.0] * 3, *weight), (of["load_N"], apart, *loaded)


def constants_of(found):
    return ", ".join(f"{c['value']:.4g} {c['unit']} ({c['interval'][0]:.4g} to {c['interval'][1]:.4g})".replace("  ", " ") for c in found["constants"])


def each_load_by_the_other(bin, folder, of, across, predict_N=(), both=True):
    """Fits 0.510 N and predicts weight; with `both` also fits the swing under weight and predicts 0.510 N. Yields (what, measured, simulated, how) and prints the constants."""
    body = FittedBeam(bin, folder, of, across)
    weight, loaded = measured_rows(of)
    still = (0.0, [0.0] * 3, None, None)
    for name, fitted, other in (("0.510 N", [still, loaded], [(0.0, None, *weight[2:])]), ("the swing under weight", [(0.0, None, *weight[2:])], [still, loaded]))[:1 + both]:
        slug = "fit_load" if fitted[0] is still else "fit_weight"
        further = [body.table(f"{slug}_further.csv", [still, *((load, [1e-3] * 3, 1.0, 1.0) for load in predict_N)])] if predict_N else []
        found = body.fit(body.table(f"{slug}.csv", fitted), [body.table(f"{slug}_other.csv", other), *further], slug)
        print(f"beam: tm-fit to {name}, {across} cells across: Young's modulus (with viscosity) and share of each term {constants_of(found)}")
        yield from told(found["predicted"][0], f"tm-fit to {name}", "0 N" if fitted[0] is still else f"{of['load_N']:g} N")
        for row, load in zip(found["predicted"][1]["simulated"][1:] if further else [], predict_N):
            columns = dict(zip(found["predicted"][1]["columns"], row))
            print(f"beam   {load:g} N by tm-fit to {name}: {-1e3 * np.mean([columns[f'{m}_m'] for m in MARKERS]):.3f} mm below the rest under weight; period {columns['period_s']:.4f} s, decrement {columns['decrement']:.3f}")


def told(predicted, how, load):
    """Yields (what, unit, measured, simulated, how): markers by their mean, mm."""
    for measured, simulated in zip(predicted["measured"], predicted["simulated"]):
        m, s = (dict(zip(predicted["columns"], values)) for values in (measured, simulated))
        if m.get("m1_m"):
            yield f"{load}, rest to rest", "mm", *(-1e3 * float(np.mean([v[f"{k}_m"] for k in MARKERS])) for v in (m, s)), how
        for column, what, unit in (("period_s", "period", "s"), ("decrement", "decrement", "")):
            if m.get(column):
                yield f"{what}, {load}", unit, m[column], s[column], how
