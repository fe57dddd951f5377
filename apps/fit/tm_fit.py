#!/usr/bin/python3
"""Fits constants of a scene's materials to measurements: least squares with 95 % intervals, correlations, and a verdict on each constant that the data do not determine."""
import argparse
import hashlib
import json
import os
import pathlib
import signal
import sys
import time

BIN = pathlib.Path(__file__).resolve().parent
for folder in (BIN.parent / "lib/tensormass/fit", BIN):
    sys.path.insert(0, str(folder))
try:
    import numpy as np
    import scipy  # noqa: F401
except ImportError:  # --help works without
    np = None

SIM = BIN / "tm-sim"
EPILOG = """Data are CSV files with a header line, in SI units. A curve: --row sets the scene for each row, and the equilibrium is compared.
  tm-fit press.yaml --data press.csv --row 'supports[1].displace=[0, 0, -{depth_m}]' --compare 'force_N=-support top z' \\
         --fit 'tissue.materials.*.young=1 kPa..50 kPa' -o fit
A series over time: --time names its column; each trial runs the scene once.
  tm-fit beam.yaml --data swing.csv --time t_s --compare 'tip_m=point tip z' --point tip=0.1,0.015,0.03 \\
         --fit 'viscosity.terms[0].shear=0.02..0.5' -o fit
Period and decrement after a release, one row a load: --swing; an empty cell was not measured.
  tm-fit beam.yaml --data loads.csv --row 'loads[0].force=[0, 0, -{load_N}]' --compare 'T_s=period tip z' --swing 1.5 ...
WHAT of --compare: support NAME AXIS (force on the tissue, N), point NAME AXIS (displacement, m), instrument N AXIS (N), period NAME AXIS (of a point, s),
decrement NAME AXIS; '-' before it changes the sign.
Results are FOLDER/index.html, fit.json and state.json. After an interruption the same command continues (docs/fitting.md)."""


def arguments(words=None):
    p = argparse.ArgumentParser(prog="tm-fit", description=__doc__, epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("scene", type=pathlib.Path, metavar="SCENE", help="scene with the law to fit")
    p.add_argument("-o", "--out", type=pathlib.Path, metavar="FOLDER", required=True, help="folder for the results")
    p.add_argument("--fit", action="append", default=[], metavar="PATH=LOW..HIGH", help="constant, by its path in the scene, and its range; LOW..START..HIGH also sets the start value; 'PATH, 4*PATH=...' sets several keys; one to eight")
    p.add_argument("--data", type=pathlib.Path, metavar="FILE", required=True, help="measured values, CSV with a header line")
    p.add_argument("--row", action="append", default=[], metavar="PATH=TEXT", help="setting of the scene for each row of a curve; {column} is replaced by the row's value")
    p.add_argument("--time", metavar="COLUMN", help="the data are a series over time, in this column, s")
    p.add_argument("--compare", action="append", default=[], metavar="COLUMN=WHAT", help="simulated quantity to compare with a column: see WHAT below")
    p.add_argument("--point", action="append", default=[], metavar="NAME=X,Y,Z", help="marker at this undeformed position, m; it may be outside the tissue")
    p.add_argument("--swing", type=float, default=0.0, metavar="SECONDS", help="time to run the scene of each row for period and decrement")
    p.add_argument("--any-start", action="store_true", help="of a series, leave offset, size and phase free: the start of the motion is not known")
    p.add_argument("--release", type=float, default=0.0, metavar="SECONDS", help="time of a series at which the simulation begins; earlier rows are left out [0]")
    p.add_argument("--predict", action="append", default=[], metavar="FILE[@PATH=VALUE]", help="other measurements with the same columns, not used in the fit: print them beside what the fitted scene does, with these settings")
    p.add_argument("--from-first", action="store_true", help="compare differences from the first row")
    p.add_argument("--noise", action="append", default=[], metavar="COLUMN=SD", help="standard deviation of a column, 0.02 or 1%% of each value; sets its weight [equal within a column, columns by their size]")
    p.add_argument("--set", action="append", default=[], metavar="PATH=VALUE", help="set a value of the scene in all trials, as in tm-sim")
    p.add_argument("--robust", action="store_true", help="give outliers less weight (soft L1)")
    p.add_argument("--mesh-check", action="store_true", help="run the fitted scene on a refined mesh too: print the mesh's own error, and constants and predictions without it")
    p.add_argument("--profile", action="store_true", help="compute the likelihood profile at the ends of all intervals [of badly determined ones only]")
    p.add_argument("--differences", action="store_true", help="compute derivatives by differences of equilibria [by the adjoint of each, where it exists]")
    p.add_argument("--tolerance", type=float, default=1e-7, metavar="TOL", help="relative residual of each equilibrium [1e-7]")
    p.add_argument("--again", action="store_true", help="ignore the saved trials of an earlier call")
    p.add_argument("--quiet", action="store_true", help="do not print progress")
    p.add_argument("--version", action="version", version="tm-fit @VERSION@")
    return p.parse_args(words)


class State:
    """Evaluations by their constants, in FOLDER/state.json: the same command finds them again."""

    def __init__(self, path, key, again):
        self.path, self.key, self.known = path, key, {}
        if path.exists() and not again:
            try:
                found = json.loads(path.read_text())
                self.known = found["known"] if found["key"] == key else {}
            except (OSError, ValueError, KeyError, TypeError):
                self.known = {}

    def evaluate(self, name, compute):
        if name not in self.known:
            values, slopes = compute()
            self.known[name] = [values.tolist(), slopes.tolist()]
            part = self.path.with_suffix(".part")
            part.write_text(json.dumps({"key": self.key, "known": self.known}))
            part.replace(self.path)
        return tuple(np.array(v) for v in self.known[name])


class Fit:
    """One fit: the problem, its state, progress."""

    def __init__(self, a, problem, trials):
        self.a, self.problem, self.trials, self.begun, self.calls = a, problem, trials, time.monotonic(), 0
        text = json.dumps([str(a.scene.resolve()), a.scene.read_text(), a.data.read_text(), a.fit, a.row, a.time, a.compare, a.point, a.from_first, a.noise, a.set, a.tolerance, a.differences, a.swing, a.any_start, a.release])
        self.state = State(a.out / "state.json", hashlib.sha256(text.encode()).hexdigest()[:16], a.again)
        self.low = np.array([c.inner(c.low) for c in problem.constants])
        self.high = np.array([c.inner(c.high) for c in problem.constants])

    def told(self, x):
        values = ", ".join(f"{c.outer(v):.5g}{' ' + c.unit if c.unit else ''}" for c, v in zip(self.problem.constants, x))

        def tell(share):
            if not self.a.quiet and sys.stderr.isatty():
                print(f"\r{self.calls} {values}  {100 * share:3.0f} %  {time.monotonic() - self.begun:.0f} s ", end="", file=sys.stderr, flush=True)
        return tell

    def evaluate(self, x):
        """Returns the scaled residuals and their Jacobian at inner constants x."""
        x = np.clip(x, self.low, self.high)
        self.calls += 1
        name = " ".join(f"{v:.12g}" for v in x)
        values, slopes = self.state.evaluate(name, lambda: self.problem.at(self.trials, x, self.told(x)))
        known = self.problem.known
        residual = ((values - self.problem.measured) / self.problem.scale)[known]
        if not self.a.quiet:
            print(f"{chr(13) if sys.stderr.isatty() else ''}{self.calls:3d}  {', '.join(w for c, v in zip(self.problem.constants, x) for w in c.words(v))}  off by {np.sqrt(np.mean(residual**2)):.3g}", file=sys.stderr)
        return residual, (slopes / self.problem.scale[..., None])[known]


def interval(constant, inner):
    low, high = inner
    if not constant.log:
        return [constant.outer(low), constant.outer(high)]
    return [constant.outer(low) if low > -50 else 0.0, constant.outer(high) if high < 50 else float("inf")]


def finite(found):
    """Returns the same for JSON, which has no infinity: null."""
    if isinstance(found, dict):
        return {k: finite(v) for k, v in found.items()}
    if isinstance(found, (list, tuple)):
        return [finite(v) for v in found]
    return None if isinstance(found, float) and not np.isfinite(found) else found


def more_to_measure(fit, x, found, jacobian):
    """Ranks further measurements: each row once more, and a curve's last row half as far again. Returns a list of dicts, best first."""
    from statistics_of_fit import gain
    problem, choices = fit.problem, []
    if problem.time is None:
        blocks = np.split(jacobian, np.cumsum(problem.known.sum(1))[:-1])
        choices = [(f"row {i + 1} once more ({', '.join(f'{n} {c[i]:.4g}' for n, c in problem.data.items() if any('{' + n + '}' in s for s in problem.row_sets))})", blocks[i]) for i in range(problem.count)]
        choices += [choice for choice in [farther(fit, x)] if choice]
    else:
        choices = [("the whole series once more", jacobian)]
    ranked = []
    for name, rows in choices:
        deviation = gain(jacobian, found["variance"], rows)
        ranked.append({"what": name, "shrinks_to": (deviation / np.maximum(found["deviation"], 1e-150)).tolist()})
    return sorted(ranked, key=lambda r: np.prod(r["shrinks_to"]))[:5]


def farther(fit, x):
    """Returns (name, derivatives) of a row whose varied columns go half as far again as the farthest row; None if the scene does not bear it."""
    from trials import Refused
    problem = fit.problem
    varied = [n for n in problem.data if any("{" + n + "}" in s for s in problem.row_sets)]
    if not varied or problem.from_first or any(c.swings for c in problem.compared) or not problem.known.all():
        return None
    last = int(np.argmax(np.abs(problem.data[varied[0]])))
    kept = {n: np.array(c) for n, c in problem.data.items()}
    try:
        for n in problem.data:
            problem.data[n] = np.append(kept[n], (1.5 if n in varied else 1.0) * kept[n][last])
        name = ", ".join(f"{n} {problem.data[n][-1]:.4g}" for n in varied)
        _, slopes = fit.state.evaluate("farther " + " ".join(f"{v:.12g}" for v in x), lambda: problem.at(fit.trials, x, data_rows=[len(kept[varied[0]])]))
        return f"a new row with {name}", slopes[0] / problem.scale[last][:, None]
    except Refused:
        return None
    finally:
        problem.data.update(kept)


def run(a, problem, trials):
    from statistics_of_fit import fit as least_squares, outliers, profile, summary, verdict
    fit = Fit(a, problem, trials)
    start = [c.inner(c.start) for c in problem.constants]
    x, residual, jacobian = least_squares(fit.evaluate, start, fit.low, fit.high, a.robust)
    doubts = [(row + 1, doubt) for row, doubt in sorted(problem.doubts.items()) if doubt]
    found = summary(x, residual, jacobian, fit.low, fit.high)
    square, limit, constants = float(residual @ residual), found["t"]**2 * found["variance"], []
    for k, c in enumerate(problem.constants):
        why = verdict(k, x, found, fit.low, fit.high, c.log)
        profiled = []
        if a.profile or why.startswith("badly"):
            for end in np.clip(found["interval"][k], fit.low[k], fit.high[k]):
                profiled.append((profile(fit.evaluate, x, k, end, fit.low, fit.high) - square) / limit if limit > 0 else float("inf"))
            if min(profiled) < 0.25:
                why = "not identifiable from this: at an end of its interval the other constants compensate it"
        constants.append({"path": c.path, "settings": c.words(x[k]), "unit": c.unit, "value": c.outer(x[k]), "interval": interval(c, found["interval"][k]), "verdict": why, "profile": profiled})
    mesh = check_mesh(a, problem, trials, x) if a.mesh_check else None
    odd = outliers(residual)
    values, at = problem.measured.copy(), np.argwhere(problem.known)
    values[problem.known] += residual * problem.scale[problem.known]
    answer = {"scene": str(a.scene), "data": str(a.data), "constants": constants, "correlation": found["correlation"].tolist(), "condition": found["condition"],
            "rms": [float(v) for v in np.sqrt(np.nanmean((values - problem.measured)**2, 0))], "columns": [c.column for c in problem.compared],
            "measured": blank(problem.measured), "fitted": blank(values), "along": along(a, problem),
            "outliers": [{"row": int(at[i][0]) + 1, "column": problem.compared[at[i][1]].column} for i in odd], "predicted": [predict(a, text, x, trials, mesh) for text in a.predict],
            "mesh_check": mesh and mesh.found(problem),
            "doubts": doubts,
            "more": more_to_measure(fit, x, found, jacobian), "trials": problem.evaluations, "solutions": problem.solutions,
            "differences": problem.differences, "seconds": time.monotonic() - fit.begun}
    if mesh:
        mesh.trials.close()
    return answer


def blank(values):
    """Returns nested lists, None where nothing was measured."""
    return [[v if np.isfinite(v) else None for v in row] for row in values.tolist()]


def check_mesh(a, problem, trials, x):
    """Returns the MeshCheck at the fitted constants."""
    from mesh_check import MeshCheck
    from trials import Trials
    mesh = MeshCheck(BIN / "tm-mesh", a, lambda sets: Trials(SIM, a.scene, sets))
    mesh.correct(problem, trials, x)
    return mesh


def predict(a, text, x, trials, mesh=None):
    """Returns measured and simulated values of measurements that the fit has not seen, and of a series with one more figure each: period and decrement."""
    from swing import swing
    problem = problem_of(a, *predicted_of(text))
    values, _ = problem.at(trials, x, derivatives=False)
    limit = mesh.predicted(problem, trials) if mesh else np.full_like(values, np.nan)
    problem.known[0] &= ~problem.moved  # the row that --from-first compares with
    problem.measured[~problem.known] = np.nan
    found = {"data": text, "columns": [c.column for c in problem.compared], "measured": blank(problem.measured), "simulated": blank(np.where(problem.known, values, np.nan)),
             "without_mesh": blank(np.where(problem.known, limit, np.nan)), "swings": []}
    for run in problem.runs if a.time else []:
        for j, column in enumerate(found["columns"]):
            known = problem.known[run, j]
            two = [swing(problem.data[a.time][run][known], v[run, j][known]) for v in (problem.measured, values)]
            found["swings"].append({"row": run[0] + 1, "column": column, "period_s": [two[0][0], two[1][0]], "decrement": [two[0][1], two[1][1]]})
    return found


def off(measured, simulated):
    return f"{measured:.5g} measured, {simulated:.5g} simulated, {100 * (simulated / measured - 1):+.1f} %" if measured else f"{measured:.5g} measured, {simulated:.5g} simulated"


def report_predicted(found):
    for p in found["predicted"]:
        print(f"not fitted: {p['data']}")
        for row, values in enumerate(zip(p["measured"], p["simulated"], p["without_mesh"]), 1):
            for column, m, s, limit in zip(p["columns"], *values):
                if m is not None and not p["swings"]:
                    print(f"  row {row}, {column}: {off(m, s)}" + (f"; without the mesh's error {limit:.5g}, {100 * (limit / m - 1):+.1f} %" if limit is not None and m else ""))
        for s in p["swings"]:
            print(f"  {s['column']} from row {s['row']} on: period {off(*s['period_s'])}; decrement {off(*s['decrement'])}")


def along(a, problem):
    """Returns the name and values that the page draws the columns over."""
    for name in problem.data:
        if name == a.time or any("{" + name + "}" in s for s in a.row):
            return [name, problem.data[name].tolist()]
    return ["row", list(range(1, problem.count + 1))]


def report_doubts(found):
    """Prints columns whose sign is wrong, and rows whose equilibrium is no valid shape."""
    for j, name in enumerate(found["columns"]):
        products = [m[j] * f[j] for m, f in zip(found["measured"], found["fitted"]) if m[j] is not None and f[j] is not None]
        if products and max(products) < 0:
            print(f"  {name}: measured and simulated values have opposite signs; put a '-' before the quantity in --compare, or remove it")
    if found["doubts"]:
        row, doubt = found["doubts"][0]
        more = f" (and {len(found['doubts']) - 1} more rows)" if len(found["doubts"]) > 1 else ""
        print(f"  row {row}{more}: {doubt}")


def report(found):
    from fit_page import derivatives_of
    print(f"{len(found['measured'])} rows, {found['trials']} trials, derivatives by {derivatives_of(found)}, {found['seconds']:.0f} s; root mean square error: "
          + ", ".join(f"{n} {v:.3g}" for n, v in zip(found["columns"], found["rms"])))
    for c in found["constants"]:
        unit = f" {c['unit']}" if c["unit"] else ""
        print(f"  {c['path']} = {c['value']:.5g}{unit}   95 %: {c['interval'][0]:.5g} to {c['interval'][1]:.5g}{unit}" + (f"   {c['verdict']}" if c["verdict"] else ""))
    for i, c in enumerate(found["constants"]):
        for j in range(i):
            if abs(found["correlation"][i][j]) > 0.95:
                print(f"  {c['path']} and {found['constants'][j]['path']} are correlated ({found['correlation'][i][j]:.3f}): the data determine their combination better than each alone")
    report_doubts(found)
    for o in found["outliers"]:
        print(f"  row {o['row']}, {o['column']}: far from the others; check it, or use --robust")
    if found["more"] and min(found["more"][0]["shrinks_to"]) > 0.98:
        print("  to measure next: another quantity, or a load in another direction; more rows of this kind shrink no interval")
    elif found["more"]:
        best = found["more"][0]
        print(f"  to measure next: {best['what']} shrinks the intervals to " + ", ".join(f"{100 * s:.0f} %" for s in best["shrinks_to"]))
    if found["mesh_check"]:
        from mesh_check import report as report_mesh
        report_mesh(found)
    report_predicted(found)


def prepare(a):
    """Checks the options and returns the Problem."""
    from model import Bad, Constant
    if not a.scene.is_file():
        raise Bad(f"{a.scene}: does not exist; name a scene")
    if not 1 <= len(a.fit) <= 8:
        raise Bad(f"{len(a.fit)} --fit options; name one to eight constants, as in --fit 'tissue.materials.*.young=1 kPa..50 kPa'")
    for text in a.fit:
        Constant(text)
    if not a.compare:
        raise Bad("--compare is missing; name a column and the simulated quantity, as in --compare 'force_N=-support top z'")
    if a.time and not a.any_start and any("{" + a.time + "}" in s for s in a.row):
        raise Bad(f"--time and --row: {a.time} changes within a run; a row sets what is the same during a run")
    if a.any_start and not a.time:
        raise Bad("--any-start needs a series; name its column of time, --time t_s")
    if a.any_start and a.from_first:
        raise Bad("--any-start and --from-first: a free offset contains the first; leave --from-first out")
    if a.out.exists() and not a.out.is_dir():
        raise Bad(f"{a.out}: is a file; name a folder")
    for text in a.predict:
        problem_of(a, *predicted_of(text))
    if a.mesh_check:
        from mesh_check import check_loads, mesh_of
        mesh_of(a.scene, a.set)
        check_loads(a.scene, [*a.row, *a.set])
    return problem_of(a, a.data)


def predicted_of(text):
    """Returns (file, settings) of FILE@PATH=VALUE@..."""
    name, *settings = text.split("@")
    return pathlib.Path(name), settings


def points_of(a):
    from model import Bad
    points = {}
    for text in a.point:
        name, _, place = text.partition("=")
        try:
            points[name] = [float(v) for v in place.split(",")]
        except ValueError:
            points[name] = []
        if len(points[name]) != 3 or not name:
            raise Bad(f"--point {text}: not NAME=X,Y,Z; write --point tip=0.1,0,0.03, in m")
    return points


def noise_of(a):
    from model import Bad
    noise = {}
    for text in a.noise:
        name, _, value = text.partition("=")
        try:
            size = float(value.rstrip("% "))
        except ValueError:
            size = 0.0
        if not 0 < size < float("inf"):
            raise Bad(f"--noise {text}: no number above 0; write --noise force_N=0.02, or force_N=1% of each value")
        noise[name] = ("%", size / 100) if value.strip().endswith("%") else size
    return noise


def problem_of(a, file, settings=()):
    """Returns the Problem of a file of measurements, in the scene with these further settings."""
    from model import Bad, Compared, Constant, Problem, read_csv
    points, data = points_of(a), read_csv(file)
    if a.time in data and a.release:
        after = data[a.time] >= a.release
        if not after.any():
            raise Bad(f"--release {a.release:g}: {file} ends before; give a time within the series, s")
        data = {name: column[after] - (a.release if name == a.time else 0) for name, column in data.items()}
    compared = [Compared(t, points) for t in a.compare]
    measured = [c for c in compared if np.isfinite(data.get(c.column, np.nan if file != a.data or c.column in data else 0.0)).any()]
    compared = measured or compared  # predictions may have other columns; the fit leaves out those that are empty
    return Problem([Constant(t) for t in a.fit], data, [*a.row, *settings], compared, points, a.time, a.tolerance, a.from_first, noise_of(a), not a.differences, a.swing, a.any_start)


def without_scipy():
    """Goes on in the environment of a build (`make venv`), or says what to install."""
    own = BIN.parent / "venv/bin/python"
    if own.exists() and pathlib.Path(sys.prefix) != own.parents[1]:
        os.execv(own, [str(own), str(pathlib.Path(__file__).resolve()), *sys.argv[1:]])
    print("tm-fit: this Python has no numpy or no scipy; install python3-scipy (Debian) or scipy (pip), or run it with a Python that has them", file=sys.stderr)
    return 2


def main():
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    a = arguments()
    if np is None:
        return without_scipy()
    from fit_page import write_page
    from model import Bad
    from trials import Refused, Trials
    try:
        problem = prepare(a)
        a.out.mkdir(parents=True, exist_ok=True)
        with Trials(SIM, a.scene, a.set) as trials:
            found = run(a, problem, trials)
        (a.out / "fit.json").write_text(json.dumps(finite(found), indent=1) + "\n")
        write_page(a.out / "index.html", found)
        report(found)
        if not a.quiet:
            print(a.out / "index.html")
        return 0
    except (Bad, Refused) as error:
        print(error if isinstance(error, Refused) else f"tm-fit: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"tm-fit: {error}; check the path and the disk", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\ntm-fit: interrupted; the same command goes on from here", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
