"""make compare: one block, one press, in tensormass, MuJoCo's flex and Newton on the processor, each on one core; one table, a picture.

Every program runs in a process of its own (run_*.py) and gets the same vertices, tetrahedra, constants, support and press (case.py). All are compared
with the same reference: the linear law at rest on the finest mesh, with strain smoothing. Times are processor times of the steps while the press is
held.

Exit status: 0 all ran, 1 a program is missing, failed, gave no numbers or took too long (the table says which; the other rows stand), 2 a wrong
option or no reference, 130 stopped with Ctrl-C (finished rows are written)."""
import argparse
import json
import math
import os
import pathlib
import platform
import resource
import signal
import subprocess
import sys
import time

import numpy as np
import table
from scipy.interpolate import RegularGridInterpolator

HERE = pathlib.Path(__file__).resolve().parent
STVK = "Saint Venant-Kirchhoff law"
NEO = "stable neo-Hookean law; single; force computed from positions"
EXPLICIT = "explicit"  # the step: 0.9 of the one that tensormass guarantees for this mesh

# Program, setting, settings of its runner, remarks on work that is not the same.
PLAN = [
    ("tensormass", "dynamic", {"do": "dynamic"}, ""),
    ("tensormass", "dynamic, single", {"do": "dynamic", "precision": "single"}, "single tensors"),
    ("tensormass", "dynamic, volume", {"do": "dynamic", "volume": True}, "element that locks far less"),
    ("tensormass", "precomputed", {"do": "precomputed", "dt_s": 0.002}, "no inertia; surface alone; at 500 Hz"),
    ("tensormass", "precomputed, volume", {"do": "precomputed", "dt_s": 0.002, "volume": True}, "the same element"),
    ("MuJoCo", "Euler", {"integrator": "Euler", "dt_s": EXPLICIT}, STVK),
    ("MuJoCo", "discrete, 2 ms", {"integrator": "discrete", "dt_s": 0.002}, STVK + "; implicit"),
    ("MuJoCo", "discrete, 40 ms", {"integrator": "discrete", "dt_s": 0.04}, STVK + "; implicit"),
    ("Newton", "semi-implicit", {"solver": "semi-implicit", "dt_s": EXPLICIT}, NEO),
    ("Newton", "VBD, 2 ms, 10 iterations", {"solver": "VBD", "dt_s": 0.002, "iterations": 10}, NEO + "; implicit"),
    ("Newton", "VBD, 40 ms, 20 iterations", {"solver": "VBD", "dt_s": 0.04, "iterations": 20, "drag": False}, NEO + "; implicit, no drag"),
]
RUNNER = {"tensormass": "run_ours.py", "MuJoCo": "run_mujoco.py", "Newton": "run_newton.py"}


class Failed(Exception):
    """A run without a result: (kind, sentence)."""


def arguments(words):
    parser = argparse.ArgumentParser(prog="make compare ARGS=\"...\"", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("build/compare"), help="folder of compare.json, .csv, .png (build/compare)")
    parser.add_argument("--ours", default="build/compare/python", help="folder of the Python package tensormass, as a wheel has it")
    parser.add_argument("--peers", default="build/compare/venv/bin/python", help="an interpreter that has MuJoCo and Newton")
    parser.add_argument("--meshes", default="2,3,4", help="meshes k, of 192 k^3 tetrahedra (2,3,4)")
    parser.add_argument("--reference", type=int, default=8, metavar="K", help="the reference's mesh (8)")
    parser.add_argument("--press", type=float, default=0.02, help="deepest displacement over the block's height (0.02)")
    parser.add_argument("--only", default=",".join(RUNNER), help="programs, apart by commas; names are those of the table")
    parser.add_argument("--limit", type=float, default=120, metavar="S", help="the processor's seconds that one run may take, and ten times that by the clock; Newton's first compiles its kernels and has five times as many (120)")
    parser.add_argument("--from", dest="recorded", type=pathlib.Path, metavar="FILE", help="no run: table, CSV and picture of a compare.json")
    parser.add_argument("--runners", type=pathlib.Path, default=HERE, help=argparse.SUPPRESS)
    given = parser.parse_args(words)
    try:
        given.meshes = [int(k) for k in given.meshes.split(",")]
    except ValueError:
        parser.error(f"--meshes {given.meshes}: whole numbers apart by commas, as 2,3,4")
    given.only, given.peers, given.runners = given.only.split(","), os.path.abspath(given.peers), given.runners.resolve()
    unknown = [name for name in given.only if name not in RUNNER]
    if unknown:
        parser.error(f"--only: no program '{unknown[0]}'; there are {', '.join(RUNNER)}")
    if not 0 < given.press <= 0.2:
        parser.error(f"--press {given.press}: between 0 and 0.2; the linear law, which is the reference, means nothing beyond")
    if min(given.meshes) < 1 or max(given.meshes) >= given.reference:
        parser.error("--meshes: 1 and more, and coarser than --reference")
    return given


class Bench:
    """Runs runners, each in a process of its own."""

    def __init__(self, given):
        self.given, self.work = given, given.out / "work"
        self.work.mkdir(parents=True, exist_ok=True)
        self.compiled = set()

    def run(self, program, case, settings):
        """Returns (the runner's output, its arrays); raises Failed if it has no result."""
        out = self.work / "out.npz"
        out.unlink(missing_ok=True)
        interpreter = sys.executable if program == "tensormass" else self.given.peers
        environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1", "WARP_CACHE_PATH": str(self.work.resolve() / "warp")}
        if program == "tensormass":
            environment["PYTHONPATH"] = os.path.abspath(self.given.ours)
        limit = self.given.limit
        if program == "Newton" and settings["solver"] not in self.compiled:
            limit *= 5
            self.compiled.add(settings["solver"])
        seconds = max(1, round(limit))
        try:
            done = subprocess.run([interpreter, str(self.given.runners / RUNNER[program]), str(case.resolve()), json.dumps(settings), str(out.resolve())], capture_output=True,
                                  text=True, timeout=10 * limit, env=environment, cwd=self.work,
                                  preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1)))
        except subprocess.TimeoutExpired:
            raise Failed("too slow", f"took more than {10 * limit:g} s by the clock") from None
        except OSError:
            raise Failed("missing", f"no interpreter {interpreter}: was it installed?") from None
        if done.returncode == -signal.SIGXCPU:
            raise Failed("too slow", f"took more than {seconds} s of processor")
        if done.returncode:
            last = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[-1]
            raise Failed("missing" if "ModuleNotFoundError" in last else "failed", last[-200:])
        return (json.loads(done.stdout.strip().splitlines()[-1]), dict(np.load(out))) if out.exists() else ({}, {})

    def case(self, k):
        path = self.work / f"case-{k}.npz"
        self.run("tensormass", path, {"do": "mesh", "k": k, "press": self.given.press})
        return path

    def rest(self, k, volume):
        """Returns (case, the runner's output, displacements at rest)."""
        path = self.case(k)
        said, arrays = self.run("tensormass", path, {"do": "static", "volume": volume})
        return dict(np.load(path)), said, arrays["u_m"]


def on_grid(case, u):
    """Returns displacements as a function of the place, linearly interpolated."""
    rest = case["rest_m"]
    axes = [np.unique(np.round(rest[:, k], 9)) for k in range(3)]
    place = [np.searchsorted(axes[k], np.round(rest[:, k], 9)) for k in range(3)]
    values = np.zeros([len(a) for a in axes] + [3])
    values[tuple(place)] = u
    return RegularGridInterpolator(axes, values, bounds_error=False, fill_value=None)


def relative(found, wanted):
    return float(np.linalg.norm(found - wanted) / np.linalg.norm(wanted))


def row_of(program, setting, differs, case, said, arrays, reference, own):
    """Returns a row of the table. reference: (function of place, N); own: (displacements, N) of the linear law at rest on this mesh."""
    free = ~case["held"] & arrays["known"]
    u, force = arrays["u_m"][free], said["force_N"]
    row = {"program": program, "setting": setting, "tets": len(case["tets"]), "version": said["version"], "differs": differs + said.get("note", ""), "dt_s": said["dt_s"],
           "step_s": said["step_s"], "per_second": said["step_s"] / said["dt_s"], "prepare_s": said["prepare_s"], "force_N": force, "kind": "ran", "why": ""}
    if not (np.isfinite(arrays["u_m"]).all() and math.isfinite(force)):
        return failure(program, setting, len(case["tets"]), "not finite", "not a number among its displacements or forces")
    row["displacement_error"] = relative(u, reference[0](case["rest_m"][free]))
    row["force_error"] = abs(force - reference[1]) / abs(reference[1])
    row["from_own"], row["force_from_own"] = relative(u, own[0][free]), abs(force - own[1]) / abs(own[1])
    return row


def failure(program, setting, tets, kind, why):
    return {"program": program, "setting": setting, "tets": tets, "kind": kind, "why": why}


def measure(bench, given, found, say):
    """Fills found["rows"] run by run, so that finished rows remain if it is stopped."""
    say(f"reference: the linear law at rest, mesh {given.reference}, {192 * given.reference ** 3} tetrahedra")
    case, said, u = bench.rest(given.reference, True)
    reference = (on_grid(case, u), said["force_N"])
    coarser, told, v = bench.rest(given.reference - 1, True)
    free = ~coarser["held"]
    found["reference"] = {"tets": len(case["tets"]), "force_N": said["force_N"], "press": given.press,
                          "from_the_next": {"displacement": relative(v[free], reference[0](coarser["rest_m"][free])), "force": abs(told["force_N"] / said["force_N"] - 1)}}
    gone = {}
    for k in given.meshes:
        case, said, own = bench.rest(k, False)
        path = bench.work / f"case-{k}.npz"
        for program, setting, settings, differs in PLAN:
            if program not in given.only:
                continue
            asked = {**settings, "dt_s": 0.9 * said["critical_s"]} if settings.get("dt_s") == EXPLICIT else settings
            if program in gone:
                found["rows"].append(failure(program, setting, len(case["tets"]), "missing", gone[program]))
                continue
            try:
                row = row_of(program, setting, differs, case, *bench.run(program, path, asked), reference, (own, said["force_N"]))
            except Failed as failed:
                row = failure(program, setting, len(case["tets"]), *failed.args)
                if failed.args[0] == "missing":
                    gone[program] = failed.args[1]
            found["rows"].append(row)
            say(table.line(row))


def main(words=None, bench=Bench):
    given = arguments(words)
    began = time.time()
    stopped = False

    def say(text):
        print(f"[{time.time() - began:4.0f} s] {text}", flush=True)

    if given.recorded:
        try:
            found = json.loads(given.recorded.read_text())
        except (OSError, ValueError) as error:
            print(f"{given.recorded}: {error}; give a compare.json", file=sys.stderr)
            return 2
    else:
        found = {"machine": {"processor": table.processor(), "system": platform.platform()}, "rows": []}
        try:
            measure(bench(given), given, found, say)
        except Failed as failed:
            print(f"make compare: tensormass itself: {failed.args[0]}: {failed.args[1]}; nothing can be compared", file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            stopped = True
    given.out.mkdir(parents=True, exist_ok=True)
    print(table.write(found, given.out))
    if stopped:
        print(f"make compare: stopped; {len(found['rows'])} runs are in {given.out}/compare.json", file=sys.stderr)
        return 130
    return 1 if any(r["kind"] != "ran" for r in found["rows"]) else 0


if __name__ == "__main__":
    sys.exit(main())
