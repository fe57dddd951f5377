"""Chooses the cases of the C tests that the short form under AddressSanitizer leaves out: `choose.py --build build/coverage [--check]`.

Every case runs by itself in a build that counts how often each region of the code runs (a region: straight code without a branch, of a function of the
libraries or the programs). Kept are cases that together reach SHARE of the regions that all reach, chosen one after the other by regions gained per second. The
others, and programs without a kept case, go into left_out.txt: `PROGRAM CASE` or `PROGRAM`. A case that fails by itself is kept. --check: requires that what the list keeps reaches LEAST of the regions, and changes nothing."""
import argparse
import concurrent.futures
import heapq
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parent.parent
LIST = HERE / "left_out.txt"
SHARE = 0.99  # the last hundredth takes as long as all others
LEAST = 0.98  # of code that has changed since the list was made


def regions(profile):
    """Returns the regions that ran, as hashes of function and number; without the templates of other people's libraries."""
    with tempfile.NamedTemporaryFile(suffix=".profdata") as merged:
        subprocess.run(["llvm-profdata", "merge", profile, "-o", merged.name], check=True, capture_output=True)
        text = subprocess.run(["llvm-profdata", "show", "--counts", "--all-functions", merged.name], check=True, capture_output=True, text=True).stdout
    found, function = set(), None
    for line in text.splitlines():
        name = re.fullmatch(r"  (\S.*):", line)
        if name:
            function = None if re.search("Eigen|^_ZNK?S[a-z]|^_ZNK?9__gnu_cxx|^_ZNK?3std", name[1]) else name[1]
        count = re.fullmatch(r"    (Function count|Block counts): (.*)", line)
        if count and function:
            found.update(hash((function, count[1], i)) for i, n in enumerate(count[2].strip("[]").split(", ")) if n not in ("", "0"))
    return frozenset(found)


def name_of(program):
    return "/".join(program.parts[-2:])


def run_cases(program):
    """Returns {(program, case): (seconds, regions)}; regions None: the case fails by itself and is always kept."""
    with tempfile.TemporaryDirectory() as folder:
        env = dict(os.environ, TM_ROOT=str(ROOT), TM_OUT=str(program.parents[2]), TM_SANITIZER="asan", TM_LONG="0", OMP_THREAD_LIMIT="1", OPENBLAS_NUM_THREADS="1",
                   LLVM_PROFILE_FILE=f"{folder}/whole.profraw", TM_COVERAGE=folder)
        subprocess.run([program], cwd=ROOT, env=env, capture_output=True, timeout=3600)
        try:
            rows = [line.split(maxsplit=3) for line in pathlib.Path(folder, "cases").read_text().splitlines()]
        except FileNotFoundError:
            rows = []  # of another language, or its own set-up fails: kept
        return {(name_of(program), case): (float(seconds), regions(f"{folder}/{number}.profraw") if status == "0" else None) for number, status, seconds, case in rows}


def choose(cases, share=SHARE):
    """Returns the kept cases, which reach this share of all regions. `cases`: {name: (seconds, regions)}."""
    always = {name for name, (_, reached) in cases.items() if reached is None}
    cases = {name: row for name, row in cases.items() if name not in always}
    missing, kept = frozenset().union(*(reached for _, reached in cases.values())), []
    gain = lambda name: len(cases[name][1] & missing) / (cases[name][0] + 0.01)
    waiting = [(-gain(name), name) for name in cases]
    heapq.heapify(waiting)
    may_miss = int((1 - share) * len(missing))
    while len(missing) > may_miss:
        best = waiting[0][1]
        if -gain(best) > waiting[0][0]:  # gains only fall: the first whose gain is still the same is the best
            heapq.heapreplace(waiting, (-gain(best), best))
            continue
        heapq.heappop(waiting)
        kept.append(best)
        missing -= cases[best][1]
    for name in sorted(kept, key=lambda name: -cases[name][0]):  # earlier ones may have become superfluous
        others = frozenset().union(*(cases[other][1] for other in kept if other != name))
        if len(cases[name][1] - others) <= may_miss - len(missing):
            missing |= cases[name][1] - others
            kept.remove(name)
    return always | set(kept)


def rows_of(cases, kept):
    """Returns the lines of the list."""
    for program in sorted({program for program, _ in cases}):
        own = [case for name, case in cases if name == program]
        out = [case for case in own if (program, case) not in kept]
        yield from [program] if out == own else [f"{program} {case}" for case in out]


def left_out(listed=LIST):
    """Returns the list: {program: names of cases; empty: all}."""
    found = {}
    for line in listed.read_text().splitlines():
        if line and not line.startswith("#"):
            program, *case = line.split()
            found.setdefault(program, []).extend(case)
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path, required=True)
    parser.add_argument("--check", action="store_true")
    a = parser.parse_args()
    if not shutil.which("llvm-profdata"):
        sys.exit("choose.py: llvm-profdata is not installed; apt-get install llvm")
    programs = [ROOT / line for line in (a.build / "tests/manifest.txt").read_text().split()]
    with concurrent.futures.ThreadPoolExecutor(int(os.environ.get("TM_JOBS", "2"))) as pool:
        cases = {name: row for found in pool.map(run_cases, programs) for name, row in found.items()}
    listed = left_out()
    kept = {name for name in cases if name[0] not in listed or (listed[name[0]] and name[1] not in listed[name[0]])} if a.check else choose(cases)
    reached = [len(frozenset().union(*(cases[name][1] or () for name in some))) for some in (kept, cases)]
    seconds = [sum(cases[name][0] for name in some) for some in (kept, cases)]
    said = f"{len(kept)} of {len(cases)} cases reach {reached[0]} of {reached[1]} regions in {seconds[0]:.0f} of {seconds[1]:.0f} s"
    print(said)
    if a.check:
        return 0 if reached[0] >= LEAST * reached[1] else 1
    LIST.write_text("\n".join([f"# Made by `make sanitize-choice`: {said}.", *rows_of(cases, kept)]) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
