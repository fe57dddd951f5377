"""Runs every test, or those of one component (`--room unit`).

Tests that compute run first, two at a time, then those that depend on the wall clock (marker `clock`: guests, complete control loops, windows), which
tests that compute would starve. The latter mostly wait, so three of them share two processors. The sanitizers' builds run throughout in the scheduler's
idle class. A failed clock test runs again alone after all others, at most twice (tests/patience.py); a test that computes never does. The last line counts
all: `N passed, N failed, N skipped, N retried`; those before name the slowest tests, and the processor time of all and of the costliest folders. Seconds of
every test, on the wall clock and of processor: build/tests/PHASE.xml."""
import collections
import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import threading
import xml.etree.ElementTree

import rooms

JOBS = os.environ.get("TM_JOBS", "2")
WAITING = str(int(JOBS) + 1)
TOGETHER = ("-m", "not clock and not leftover", "-n", JOBS, "--dist", "worksteal")
BESIDE = []  # process of the leftover tests
RECORDS = []  # files with the seconds of each test
FEW = 40     # more clock failures than this have another cause


def idle():
    """Sets this process and its children to idle priority, and their session's group too. Otherwise a kernel that groups by session shares
    the processors evenly between sessions."""
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    try:
        with open("/proc/self/autogroup", "w") as group:
            group.write("19")
    except OSError:
        pass  # not supported by this kernel


def record(name):
    """Returns the option by which pytest records this phase's seconds in the build folder; none without a build."""
    if not os.environ.get("TM_OUT"):
        return []
    RECORDS.append(os.path.join(os.environ["TM_OUT"], "tests", f"{name}.xml"))
    return ["--junitxml", RECORDS[-1], "-o", "junit_duration_report=total"]


def costliest(count=10):
    """Returns the slowest tests: setup, call and teardown on the wall clock."""
    seconds = []
    for path in filter(os.path.exists, RECORDS):
        for case in xml.etree.ElementTree.parse(path).iter("testcase"):
            seconds.append((float(case.get("time")), f"{case.get('classname').removeprefix('tests.').replace('.', '/')}::{case.get('name')}"))
    return [f"{time:.0f} s {name}" for time, name in sorted(seconds, reverse=True)[:count] if time >= 1]


def processor_seconds(count=8):
    """Returns the processor time of all tests, then of the costliest folders (C programs by theirs); setup shared by several tests counts to the first."""
    folders = collections.Counter()
    for path in filter(os.path.exists, RECORDS):
        for case in xml.etree.ElementTree.parse(path).iter("testcase"):
            program = re.search(r"test_program\[(\w+)/", case.get("name"))
            used = case.find("properties/property[@name='processor_s']")
            folders[program[1] if program else case.get("classname").split(".")[1]] += float(used.get("value")) if used is not None else 0
    return [f"{folders.total():.0f} s"] + [f"{seconds:.0f} s {name}" for name, seconds in folders.most_common(count) if seconds >= 1]


def files_of(marker, names):
    """Returns the files with tests of this marker, given there or by name: reading all tests takes each process six seconds."""
    def has(path):
        name = path.relative_to("tests").as_posix()
        return any(name.startswith(n) or n.startswith(name) for n in names) or f"mark.{marker}" in path.read_text()

    programs = "tests/test_programs.py"  # named by their folders
    return [str(path) for path in sorted(pathlib.Path("tests").rglob("test_*.py")) if str(path) == programs or has(path)] or ["tests"]


def phase(*arguments, leftover=False, **environment):
    """Runs pytest once; returns counts (passed, failed, skipped, retried). Shows its output at once, or at its end for leftover tests."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments, *sys.argv[1:]]
    run = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=leftover, preexec_fn=idle if leftover else None,
                           env={**os.environ, **environment})
    counts, said = None, []
    if leftover:
        BESIDE.append(run.pid)
    for line in run.stdout:
        found = re.fullmatch(r"(\d+) passed, (\d+) failed, (\d+) skipped, (\d+) retried\n", line)
        if found:
            counts = [int(n) for n in found.groups()]
        elif leftover:
            said.append(line)
        else:
            print(line, end="", flush=True)
    code = run.wait()
    print("".join(said), end="", flush=True)
    if counts is None or code not in (0, 1, 5):  # 5: nothing was selected
        counts = counts or [0, 0, 0, 0]
        counts[1] = max(counts[1], 1)
    return counts


def by_themselves(counts, failed_json):
    """Runs failed clock tests again, alone, unless too many failed; returns the new counts."""
    try:
        with open(failed_json) as names:
            failed = [re.sub(r"@[^\]@]*$", "", name) for name in json.load(names)]  # without the group, which xdist appends to a name
    except FileNotFoundError:
        failed = []
    if not 0 < len(failed) <= FEW or len(failed) != counts[1]:
        return counts
    print(f"retried, by themselves: {' '.join(failed)}", flush=True)
    passed, still, skipped, _ = phase(*failed, "-n", "0", "-rs", TM_AGAIN="1")
    print(f"of {len(failed)} retried, by themselves {passed} passed, {still} failed, {skipped} could not be judged", flush=True)
    return [counts[0] + passed, still, counts[2] + skipped, len(failed)]


def whole():
    """Runs the phases of all components; returns the counts."""
    leftover = []
    beside = threading.Thread(target=lambda: leftover.extend(phase(*files_of("leftover", rooms.LEFTOVER), "-m", "leftover", "-n", JOBS, *record("leftover"), leftover=True)))
    beside.start()
    with tempfile.TemporaryDirectory() as folder:
        try:
            together = phase("tests", *TOGETHER, *record("together"))
            clock = phase(*files_of("clock", rooms.CLOCK), "-m", "clock", *record("clock"), "-n", WAITING, "--dist", "loadgroup", TM_AGAIN="0", TM_FAILED=f"{folder}/failed.json")
            beside.join()
        except KeyboardInterrupt:
            os.killpg(BESIDE[0], signal.SIGTERM)  # a separate session does not receive Ctrl-C
            raise
        return together, by_themselves(clock, f"{folder}/failed.json"), leftover


def main():
    by_no_clock = {"unit", "physics"} & set(sys.argv[1:])  # components without clock tests and leftover tests (tests/conftest.py)
    counts = [phase("tests", *TOGETHER, *record("together"))] if by_no_clock else whole()
    passed, failed, skipped, retried = (sum(each) for each in zip(*counts))
    if costliest():
        print(f"costliest: {', '.join(costliest())}\nprocessor: {', '.join(processor_seconds())}", flush=True)
    print(f"{passed} passed, {failed} failed, {skipped} skipped, {retried} retried", flush=True)
    return 1 if failed or not passed else 0


if __name__ == "__main__":
    sys.exit(main())
