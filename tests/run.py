"""Runs every test, or those of one room (`--room unit`): those that compute first, two at a time, then those that watch the wall clock (marker `clock`: guests, whole rings of
programs, windows), which tests that compute would starve. Those mostly wait, so that three of them share two processors. What either leaves goes to the sanitizers' builds,
in the scheduler's idle class, from first to last. Of those that watch the clock, what failed is run again by itself when all else has ended, at most twice
(tests/patience.py); what computes, never. The last line counts all: `N passed, N failed, N skipped, N retried`; the one before names the costliest.
Seconds of every test: build/tests/PHASE.xml."""
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import xml.etree.ElementTree

JOBS = os.environ.get("TM_JOBS", "2")
WAITING = str(int(JOBS) + 1)
TOGETHER = ("-m", "not clock and not leftover", "-n", JOBS, "--dist", "worksteal")
BESIDE = []  # process of the leftover tests
RECORDS = []  # of the seconds of each test
FEW = 40     # more that failed by the clock have another cause


def idle():
    """Of this process and its children: runs where nothing else wants to. Sessions share the processors evenly where the kernel groups by them, whatever their processes ask for."""
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    try:
        with open("/proc/self/autogroup", "w") as group:
            group.write("19")
    except OSError:
        pass  # this kernel does not


def record(name):
    """Option by which pytest records this phase's seconds beside what is built; none without a build."""
    if not os.environ.get("TM_OUT"):
        return []
    RECORDS.append(os.path.join(os.environ["TM_OUT"], "tests", f"{name}.xml"))
    return ["--junitxml", RECORDS[-1], "-o", "junit_duration_report=total"]


def costliest(count=10):
    """The tests that took longest: setup, call and teardown on the wall clock."""
    seconds = []
    for path in filter(os.path.exists, RECORDS):
        for case in xml.etree.ElementTree.parse(path).iter("testcase"):
            seconds.append((float(case.get("time")), f"{case.get('classname').removeprefix('tests.').replace('.', '/')}::{case.get('name')}"))
    return [f"{time:.0f} s {name}" for time, name in sorted(seconds, reverse=True)[:count] if time >= 1]


def phase(*arguments, leftover=False, **environment):
    """Counts (passed, failed, skipped, retried) of one pytest run, shown as it goes, or at its end if it lives on what others leave."""
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
    """Counts of the tests that watch the clock, after those that failed, if they are not all too many, have been run again by themselves."""
    try:
        with open(failed_json) as names:
            failed = json.load(names)
    except FileNotFoundError:
        failed = []
    if not 0 < len(failed) <= FEW or len(failed) != counts[1]:
        return counts
    print(f"retried, by themselves: {' '.join(failed)}", flush=True)
    passed, still, skipped, _ = phase(*failed, "-n", "0", "-rs", TM_AGAIN="1")
    print(f"of {len(failed)} retried, by themselves {passed} passed, {still} failed, {skipped} could not be judged", flush=True)
    return [counts[0] + passed, still, counts[2] + skipped, len(failed)]


def whole():
    """Counts of the phases of all rooms."""
    leftover = []
    beside = threading.Thread(target=lambda: leftover.extend(phase("tests", "-m", "leftover", "-n", JOBS, *record("leftover"), leftover=True)))
    beside.start()
    with tempfile.TemporaryDirectory() as folder:
        try:
            together = phase("tests", *TOGETHER, *record("together"))
            clock = phase("tests", "-m", "clock", *record("clock"), "-n", WAITING, "--dist", "loadgroup", TM_AGAIN="0", TM_FAILED=f"{folder}/failed.json")
            beside.join()
        except KeyboardInterrupt:
            os.killpg(BESIDE[0], signal.SIGTERM)  # a session of its own hears no Ctrl-C
            raise
        return together, by_themselves(clock, f"{folder}/failed.json"), leftover


def main():
    by_no_clock = {"unit", "physics"} & set(sys.argv[1:])  # rooms where nothing watches it, nor is left over (tests/conftest.py)
    counts = [phase("tests", *TOGETHER, *record("together"))] if by_no_clock else whole()
    passed, failed, skipped, retried = (sum(each) for each in zip(*counts))
    if costliest():
        print(f"costliest: {', '.join(costliest())}", flush=True)
    print(f"{passed} passed, {failed} failed, {skipped} skipped, {retried} retried", flush=True)
    return 1 if failed or not passed else 0


if __name__ == "__main__":
    sys.exit(main())
