#!/usr/bin/python3
"""Runs tm-sim many times and collects the results in one table: scenes, a folder of them, or a sweep over their keys, by Slurm if it is installed, else on this machine's cores."""
import argparse
import concurrent.futures
import csv
import hashlib
import itertools
import json
import os
import pathlib
import re
import shlex
import shutil
import signal
import subprocess
import sys

BIN = pathlib.Path(__file__).resolve().parent
SIM = str(BIN / "tm-sim")
MOST_RUNS = 100000
RANGE = re.compile(r"\s*([-+]?[\d.]*\d(?:[eE][-+]?\d+)?)\s*\.\.\s*([-+]?[\d.]*\d(?:[eE][-+]?\d+)?)\s*([^:\d\s][^:]*)?(?::\s*(\d+))?\s*")


class Stop(Exception):
    """An error message with the exit code."""
    def __init__(self, message, code=2):
        super().__init__(message)
        self.code = code


def arguments():
    p = argparse.ArgumentParser(prog="tm-study", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter,
                                epilog="FOLDER gets results.csv (and results.parquet, where Python has pyarrow), one row a run: the scene, a hash of it with its files\n"
                                       "and settings, what was varied, and the figures of tm-sim --json, errors too; jobs.sh, which does one run by its number, alike\n"
                                       "for Slurm (an array job) and for cores; and runs/, what each said. Run again, it does what is not done, or what its inputs changed.")
    p.add_argument("scene", nargs="*", type=pathlib.Path, metavar="SCENE", help="a scene, or a folder of scenes (.yaml)")
    p.add_argument("-o", "--out", type=pathlib.Path, metavar="FOLDER", help="folder for all results")
    p.add_argument("--vary", action="append", default=[], metavar="PATH=VALUES", help="key as in tm-sim --set, with a list (20,25,30) or a number of values in a range (3..9kPa:4); repeated: every combination")
    p.add_argument("--set", action="append", default=[], metavar="PATH=VALUE", help="of every run")
    p.add_argument("--unset", action="append", default=[], metavar="PATH", help="of every run")
    p.add_argument("--duration", metavar="TIME", help="duration of every run [the scene's]")
    p.add_argument("--frames", metavar="N", type=int, help="number of frames of every run, instead")
    p.add_argument("--jobs", metavar="N", type=int, default=os.cpu_count() or 1, help="number of concurrent runs [as many as cores; Slurm: its own]")
    p.add_argument("--local", action="store_true", help="run on this machine even if Slurm is installed")
    p.add_argument("--sbatch", action="append", default=[], metavar="WORD", help="option for sbatch, such as --sbatch=--partition=long")
    p.add_argument("--run", nargs=2, metavar=("FOLDER", "NUMBER"), help="do one run of an existing study, for jobs.sh")
    p.add_argument("--quiet", action="store_true", help="print errors only")
    p.add_argument("--version", action="version", version="tm-study @VERSION@")
    return p.parse_args()


# --- the runs ---


def scenes(paths):
    found = []
    for path in paths:
        if path.is_dir():
            inside = sorted(path.glob("*.yaml"))
            if not inside:
                raise Stop(f"{path}: contains no .yaml; give a folder of scenes, or scenes")
            found += inside
        elif path.is_file():
            found.append(path)
        else:
            raise Stop(f"{path}: does not exist; give a scene or a folder of scenes")
    return found


def values(text, option):
    """Parses a list, or a range with its number of values; commas inside brackets belong to the value."""
    span = RANGE.fullmatch(text)
    if span:
        low, high, unit, count = span.groups()
        if not count or int(count) < 2:
            raise Stop(f"{option}: a range needs its number of values, two or more; write {low}..{high}{unit or ''}:4")
        low, high, count = float(low), float(high), int(count)
        return [f"{low + (high - low) * i / (count - 1):.12g}{' ' + unit.strip() if unit else ''}" for i in range(count)]
    parts, depth = [""], 0
    for c in text:
        depth += (c in "[{") - (c in "]}")
        if c == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += c
    parts = [part.strip() for part in parts]
    if depth or not all(parts):
        raise Stop(f"{option}: a value is empty, or a bracket is not closed; write PATH=20,25,30 or PATH=3..9kPa:4")
    return parts


def variations(options):
    """Returns [(path, [value, ...]), ...]."""
    out = []
    for text in options:
        path, equals, rest = text.partition("=")
        if not equals or not path.strip():
            raise Stop(f"--vary {text}: no values; write PATH=20,25,30 or PATH=3..9kPa:4")
        if path in (p for p, _ in out):
            raise Stop(f"--vary {text}: {path} is varied twice; put its values into one list")
        out.append((path, values(rest, f"--vary {text}")))
    return out


def digest(scene, words, version):
    """Returns a digest of the scene, the files that it names, the settings and the program."""
    sha = hashlib.sha256(json.dumps([version, words]).encode())
    text = scene.read_bytes()
    sha.update(text)
    named = set(re.findall(r"[\w./~+-]+\.\w+", text.decode("utf-8", "replace") + "\n" + "\n".join(words)))
    for name in sorted(named):
        for path in (scene.parent / name, pathlib.Path(name)):
            if path.is_file():
                sha.update(name.encode() + path.read_bytes())
                break
    return sha.hexdigest()[:16]


def plan(a):
    varied = variations(a.vary)
    version = subprocess.run([SIM, "--version"], capture_output=True, text=True, check=True).stdout.strip()
    common = [w for s in a.set for w in ("--set", s)] + [w for u in a.unset for w in ("--unset", u)]
    length = (["--duration", a.duration] if a.duration else []) + (["--frames", str(a.frames)] if a.frames is not None else [])
    found, runs, count = scenes(a.scene), [], 1
    for _, list_of in varied:
        count *= len(list_of)
    if count * len(found) > MOST_RUNS:
        raise Stop(f"{count * len(found)} runs, more than {MOST_RUNS}; vary less at once")
    for scene, point in itertools.product(found, itertools.product(*(v for _, v in varied))):
        settings = common + [w for (path, _), value in zip(varied, point) for w in ("--set", f"{path}={value}")]
        runs.append({"scene": str(scene), "hash": digest(scene, settings + length, version), "varied": dict(zip((p for p, _ in varied), point)),
                     "words": [str(scene.resolve()), *settings], "length": length})
    return runs


# --- one run ---


def place(folder, run, ending):
    return folder / "runs" / f"{run['hash']}.{ending}"


def do_one(folder, number):
    """Runs one tm-sim; returns its exit code. Its output files are complete or absent."""
    try:
        run = json.loads((folder / "jobs.json").read_text())["runs"][int(number)]
    except (OSError, ValueError, LookupError) as error:
        raise Stop(f"--run {folder} {number}: this run does not exist ({error}); tm-study SCENE -o {folder} makes a study") from None
    part, failed = place(folder, run, "part"), place(folder, run, "failed")
    done = subprocess.run([SIM, *run["words"], "--lockstep", *run["length"], "--quiet", "--json", str(part)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if done.returncode == 0 and not json.loads(part.read_text()).get("interrupted"):
        failed.unlink(missing_ok=True)
        os.replace(part, place(folder, run, "json"))
        return 0
    part.unlink(missing_ok=True)
    if done.returncode not in (0, 130, 143) and done.returncode > 0:
        failed.write_text(done.stderr.strip() or f"tm-sim: exit {done.returncode}")
    return done.returncode or 130


# --- all runs ---


def check(runs, jobs):
    """Checks every run's scene and settings before the first run."""
    def one(run):
        done = subprocess.run([SIM, *run["words"], "--check", "--quiet"], capture_output=True, text=True)
        return done.returncode, done.stderr.strip()
    with concurrent.futures.ThreadPoolExecutor(jobs) as pool:
        wrong = dict.fromkeys(words for code, words in pool.map(one, runs) if code)
    if wrong:
        raise Stop("\n".join(wrong))


def write_jobs(folder, runs):
    (folder / "runs").mkdir(parents=True, exist_ok=True)
    (folder / "jobs.json").write_text(json.dumps({"runs": runs}, indent=1))
    program = shlex.quote(str(pathlib.Path(__file__).resolve()))
    (folder / "jobs.sh").write_text(f"#!/bin/sh\n#SBATCH --job-name=tm-study\n# One run of this study by its number: the first word, or Slurm's.\n"
                                    f"exec {shlex.quote(sys.executable)} {program} --run {shlex.quote(str(folder.resolve()))} \"${{1:-$SLURM_ARRAY_TASK_ID}}\"\n")


def spans(numbers):
    """Writes 0,1,2,5 as 0-2,5."""
    out = []
    for n in numbers:
        if out and out[-1][1] == n - 1:
            out[-1][1] = n
        else:
            out.append([n, n])
    return ",".join(str(a) if a == b else f"{a}-{b}" for a, b in out)


def by_slurm(a, left):
    log = a.out.resolve() / "runs" / "slurm-%a.log"
    done = subprocess.run(["sbatch", "--wait", f"--array={spans(left)}", f"--output={log}", *a.sbatch, str(a.out / "jobs.sh")], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if done.returncode < 0:
        raise KeyboardInterrupt
    if done.stderr.strip() and done.returncode:
        print(done.stderr.strip(), file=sys.stderr)


def on_cores(a, left):
    with concurrent.futures.ThreadPoolExecutor(a.jobs) as pool:
        work = {pool.submit(subprocess.run, ["/bin/sh", str(a.out / "jobs.sh"), str(n)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL): n for n in left}
        try:
            for k, _ in enumerate(concurrent.futures.as_completed(work), 1):
                if not a.quiet:
                    print(f"\r{k} of {len(left)}", end="" if k < len(left) else "\n", flush=True)
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)
            raise


# --- the table ---


def flat(value, name=""):
    """Returns figures with dotted names; lists of up to four by index."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from flat(inner, f"{name}.{key}" if name else key)
    elif isinstance(value, list):
        if len(value) <= 4 and not any(isinstance(v, (dict, list)) for v in value):
            for i, inner in enumerate(value):
                yield f"{name}.{i}", inner
    else:
        yield name, value


def table(folder, runs):
    rows = []
    for run in runs:
        row = {"scene": run["scene"], "hash": run["hash"], **run["varied"], "error": ""}
        result, failed = place(folder, run, "json"), place(folder, run, "failed")
        if result.is_file():
            for name, value in flat(json.loads(result.read_text())):
                row.setdefault(name, value)
        else:
            row["error"] = failed.read_text() if failed.is_file() else "not done"
        rows.append(row)
    names = list(dict.fromkeys(name for row in rows for name in row))
    part = folder / "results.part"
    with open(part, "w", newline="") as file:
        writer = csv.DictWriter(file, names, restval="")
        writer.writeheader()
        writer.writerows(rows)
    os.replace(part, folder / "results.csv")
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        return rows
    pyarrow.parquet.write_table(pyarrow.Table.from_pylist([{n: row.get(n) for n in names} for row in rows]), folder / "results.parquet")
    return rows


def study(a):
    if not a.scene or not a.out:
        raise Stop("tm-study: the scene or the folder for results is missing; give tm-study SCENE... -o FOLDER")
    if a.jobs < 1:
        raise Stop(f"--jobs {a.jobs}: at least one run is needed; give 1 or more")
    if a.out.exists() and not a.out.is_dir():
        raise Stop(f"{a.out}: is a file; name a folder")
    runs = plan(a)
    left = [n for n, run in enumerate(runs) if not place(a.out, run, "json").is_file()]
    check([runs[n] for n in left], a.jobs)
    write_jobs(a.out, runs)
    slurm = bool(shutil.which("sbatch")) and not a.local
    if not a.quiet:
        print(f"{len(runs)} runs, {len(runs) - len(left)} done before; {'Slurm' if slurm else f'{min(a.jobs, max(len(left), 1))} at once'}", flush=True)
    try:
        if left:
            (by_slurm if slurm else on_cores)(a, left)
    finally:
        rows = table(a.out, runs)
    wrong = [row for row in rows if row["error"]]
    for row in wrong[:5]:
        print(f"{row['scene']} ({', '.join(f'{k}={row[k]}' for k in runs[0]['varied'])}): {row['error']}", file=sys.stderr)
    if not a.quiet:
        print(a.out / "results.csv")
    return 1 if wrong else 0


def main():
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    a = arguments()
    try:
        return do_one(pathlib.Path(a.run[0]), a.run[1]) if a.run else study(a)
    except Stop as stop:
        print(stop, file=sys.stderr)
        return stop.code
    except OSError as error:
        print(f"tm-study: {error}; check the path and the disk", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("tm-study: interrupted; the same command continues from here", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
