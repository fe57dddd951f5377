"""Runs the suite in sanitizers' builds and writes the results: `run.py --build build [--short PART] [--pytest ARGUMENT]... asan tsan`.

A report of a sanitizer is a finding, even if its test passed: each goes into a file of its own (build/NAME/reports/), and only an empty folder
passes. Exit 1: a finding, or a test that failed. Figures: build/sanitize.json, a row each on the page of `make stability`."""
import argparse
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
ABOUT = {"asan": "AddressSanitizer, LeakSanitizer and UndefinedBehaviorSanitizer", "tsan": "ThreadSanitizer"}
# Parts of the short form, all built by `make tests-short`: the C programs and the parsers of user files; the ring of programs over LCM, which depends on the clock.
SHORT = {"programs": {"asan": ["tests/test_programs.py", "tests/sim/test_input.py"],
                      "tsan": ["tests/test_programs.py"]},
         "ring": {name: ["tests/loop/test_messages.py"] for name in ABOUT}}


def options(reports):
    """Returns the environment: folder of reports and options. Suppressions name other people's libraries only."""
    common = f"log_path={reports}/report:print_suppressions=0"
    return {"ASAN_OPTIONS": f"detect_leaks=1:detect_stack_use_after_return=1:strict_string_checks=1:allocator_may_return_null=1:{common}",
            "LSAN_OPTIONS": f"suppressions={HERE}/lsan.supp:print_suppressions=0",
            "UBSAN_OPTIONS": f"print_stacktrace=1:{common}",
            # The locks of their threads are not instrumented: without those threads every report concerns this project.
            "OMP_THREAD_LIMIT": "1", "OPENBLAS_NUM_THREADS": "1",
            "TSAN_OPTIONS": f"suppressions={HERE}/tsan.supp:second_deadlock_stack=1:history_size=4:{common}"}


def wrapper(name):
    """Returns a prefix for programs: ThreadSanitizer cannot place its shadow memory if a kernel spreads addresses over more than 28 bits."""
    still = ["setarch", "-R"]
    return still if name == "tsan" and subprocess.run([*still, "true"], capture_output=True).returncode == 0 else []


def run_suite(name, build, short, arguments):
    """Returns the figures of one sanitizer's build."""
    reports = build / name / (f"reports-{short}" if short else "reports")
    shutil.rmtree(reports, ignore_errors=True)
    reports.mkdir(parents=True)
    where = SHORT[short][name] if short else ["tests"]
    # C programs share nothing and do not depend on the clock: two at a time, as one processor would otherwise be idle at the end.
    beside = ["-n", os.environ.get("TM_JOBS", "2"), "--dist", "worksteal"] if short == "programs" else []
    command = [*wrapper(name), sys.executable, "-m", "pytest", *where, "-q", "-p", "no:cacheprovider", "-m", "not plain", *beside, *arguments]
    fewer = {"TM_LONG": "0", "TM_LEFT_OUT": str(HERE / ("left_out.txt" if name == "asan" else "left_out_tsan.txt"))} if short else {}
    done = subprocess.run(command, cwd=ROOT, env=dict(os.environ, TM_OUT=str(build / name), TM_SANITIZER=name, **fewer, **options(reports)), capture_output=True, text=True)
    text = done.stdout + done.stderr
    count = re.findall(r"^(\d+) passed, (\d+) failed, (\d+) skipped, \d+ retried$", text, re.M)
    passed, failed, skipped = (int(n) for n in count[-1]) if count else (0, 1, 0)
    found = sorted(p for p in reports.iterdir() if p.stat().st_size)
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True).stdout.strip()
    return {"about": ABOUT[name], "commit": commit, "form": f"short, {short}" if short else "whole", "passed": passed, "failed": failed, "skipped": skipped,
            "reports": [f"{p.parent.name}/{p.name}: {summary(p)}" for p in found], "exit": done.returncode, "said": text[-20000:] if done.returncode else ""}


def summary(report):
    """Returns the line that names kind and place."""
    text = report.read_text(errors="replace")
    line = re.search(r"^SUMMARY: .*$|^.*runtime error: .*$", text, re.M)
    return line[0] if line else text[:200]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, required=True)
    parser.add_argument("--short", choices=sorted(SHORT))
    parser.add_argument("--pytest", action="append", default=[])
    parser.add_argument("names", nargs="+", choices=sorted(ABOUT))
    a = parser.parse_args()
    build = a.build.absolute()
    figures = build / "sanitize.json"
    results, ran = json.loads(figures.read_text()) if figures.exists() else {}, []
    for name in a.names:
        result = results[name] = run_suite(name, build, a.short, a.pytest)
        ran.append(result)
        print(f"{name}: {result['passed']} passed, {result['failed']} failed, {result['skipped']} skipped, {len(result['reports'])} reports", flush=True)
        for line in result["reports"]:
            print(f"  {build / name / line}", file=sys.stderr)
        if result["exit"]:
            print(result["said"], file=sys.stderr)
    figures.write_text(json.dumps(results, indent=1) + "\n")
    return 1 if any(r["failed"] or r["reports"] or not r["passed"] for r in ran) else 0


if __name__ == "__main__":
    sys.exit(main())
