"""Runs the fuzz targets of a config=fuzz build and writes their results as JSON.

    run.py --build build/fuzz --seconds 60 [--runs N] [--jobs 2] [--more] [NAME...]

Seconds are processor time. --more adds to the results of the last run. Seeds: tests/fuzz/corpus/NAME/ (committed, with repaired findings) and inputs
that earlier runs found (BUILD/corpus/NAME/). A finding is stored in BUILD/findings/NAME/; the exit status is then 1. Findings belong into
tests/fuzz/corpus/NAME/ once they are repaired."""
import argparse
import concurrent.futures
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import threading

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent


def run_once(program, build, seconds, runs, seed):
    """Starts a target once: libFuzzer's `seconds` are wall-clock time. Returns its figures."""
    name = program.name
    corpus, findings = build / "corpus" / name, build / "findings" / name
    corpus.mkdir(parents=True, exist_ok=True)
    findings.mkdir(parents=True, exist_ok=True)
    seeds = HERE / "corpus" / name
    command = [program, "-print_final_stats=1", "-close_fd_mask=3", "-rss_limit_mb=1500", "-timeout=300", f"-artifact_prefix={findings}/", f"-seed={seed}"]
    command += [f"-runs={runs}"] if runs else [f"-max_total_time={seconds}"]
    command += [corpus]  # first: libFuzzer stores new inputs in it
    command += [seeds] if seeds.is_dir() else []
    dictionary = HERE / f"{name}.dict"
    command += [f"-dict={dictionary}"] if dictionary.exists() else []
    # One BLAS thread: waiting for work must not count as work.
    env = dict(os.environ, TM_ROOT=str(ROOT), OPENBLAS_NUM_THREADS="1", UBSAN_OPTIONS="print_stacktrace=1",
               ASAN_OPTIONS="detect_leaks=1:allocator_may_return_null=1:handle_abort=1")
    with tempfile.TemporaryDirectory(prefix="tm-fuzz-", dir="/dev/shm") as folder, tempfile.TemporaryFile("w+", errors="replace") as said:
        env["TM_FUZZ_DIR"] = folder
        run = subprocess.Popen([str(c) for c in command], cwd=ROOT, env=env, stdout=said, stderr=subprocess.STDOUT)
        timer = threading.Timer((seconds or 0) + 600, run.kill)
        timer.start()
        _, status, used = os.wait4(run.pid, 0)
        timer.cancel()
        run.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        text = said.read()

    def stat(key):
        found = re.findall(rf"stat::{key}:\s*(\d+)", text)
        return int(found[-1]) if found else 0
    coverage = re.findall(r"cov: (\d+)", text)
    return {"exit": run.returncode, "inputs": stat("number_of_executed_units"), "new_units": stat("new_units_added"),
            "edges_covered": int(coverage[-1]) if coverage else None, "cpu_seconds": used.ru_utime + used.ru_stime,
            "seeds": len(list(seeds.iterdir())) if seeds.is_dir() else 0, "findings": sorted(p.name for p in findings.iterdir()),
            "said": text[-6000:] if run.returncode else ""}


def run_one(program, build, seconds, runs, seed, commit, before):
    """Restarts the target from its grown corpus until its processor time is used: other programs may share the processor. `before`: figures to
    continue from."""
    total = dict(before or {"inputs": 0, "new_units": 0, "cpu_seconds": 0.0})
    while True:
        figures = run_once(program, build, max(5, round(seconds - total["cpu_seconds"])), runs, seed)
        for key in ("inputs", "new_units", "cpu_seconds"):
            figures[key] += total[key]
        total, seed = figures, seed + 1
        if figures["exit"] or runs or total["cpu_seconds"] >= seconds:
            return program.name, dict(total, cpu_seconds=round(total["cpu_seconds"]), commit=commit)


def main():
    p = argparse.ArgumentParser()
    p.add_argument("--build", type=pathlib.Path, required=True)
    p.add_argument("--seconds", type=int, default=60)
    p.add_argument("--runs", type=int, default=0)
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    p.add_argument("--more", action="store_true")
    p.add_argument("names", nargs="*")
    a = p.parse_args()
    build = a.build.resolve()
    programs = sorted(f for f in (build / "tests" / "fuzz").iterdir() if f.name.startswith("fuzz_") and os.access(f, os.X_OK) and f.is_file())
    programs = [f for f in programs if not a.names or f.name in a.names]
    if not programs:
        sys.exit(f"run.py: no fuzz targets in {build}; make fuzz-programs config=fuzz")
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True).stdout.strip()
    figures = build / "fuzz.json"
    results = json.loads(figures.read_text())["targets"] if (a.names or a.more) and figures.exists() else {}  # only some were run: the others keep their figures
    ran = {}
    with concurrent.futures.ThreadPoolExecutor(a.jobs) as pool:
        for future in concurrent.futures.as_completed([pool.submit(run_one, f, build, a.seconds, a.runs, a.seed, commit, results.get(f.name) if a.more else None)
                                                       for f in programs]):
            name, result = future.result()
            results[name] = ran[name] = result
            figures.write_text(json.dumps({"targets": {k: results[k] for k in sorted(results)}}, indent=1) + "\n")
            print(f"{name:18} {'ok' if result['exit'] == 0 else 'FOUND ' + ' '.join(result['findings'])}: {result['inputs']} inputs, "
                  f"{result['edges_covered']} edges", flush=True)
            if result["exit"]:
                print(result["said"], file=sys.stderr)
    return 1 if any(r["exit"] for r in ran.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
