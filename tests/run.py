"""Runs every test: those that share the processors first, two at a time, then those that watch the wall clock (guests, whole rings of programs, windows), which
tests that compute would starve. Those mostly wait, so that three of them share two processors; what they leave goes to the sanitizers' builds, in the scheduler's idle
class. What failed beside others (but for those of the clock, which tests/patience.py judges) is run once more by itself: what passes then is told of, and counts as passed.
The last line counts all: `N passed, N failed, N skipped`."""
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading

JOBS = os.environ.get("TM_JOBS", "2")
WAITING = str(int(JOBS) + 1)
BESIDE = []  # process of the leftover tests
FEW = 8      # failures that may come of what ran beside them; more have another cause


def idle():
    """Of this process and its children: runs where nothing else wants to. Sessions share the processors evenly where the kernel groups by them, whatever their processes ask for."""
    os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
    try:
        with open("/proc/self/autogroup", "w") as group:
            group.write("19")
    except OSError:
        pass  # this kernel does not


def phase(*arguments, leftover=False, failed_json=os.devnull):
    """Counts of one pytest run, shown as it goes, or at its end if it lives on what others leave; names of what failed into a file."""
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments, *sys.argv[1:]]
    run = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=leftover, preexec_fn=idle if leftover else None,
                           env={**os.environ, "TM_FAILED": failed_json})
    counts, said = None, []
    if leftover:
        BESIDE.append(run.pid)
    for line in run.stdout:
        found = re.fullmatch(r"(\d+) passed, (\d+) failed, (\d+) skipped\n", line)
        if found:
            counts = [int(n) for n in found.groups()]
        elif leftover:
            said.append(line)
        else:
            print(line, end="", flush=True)
    code = run.wait()
    print("".join(said), end="", flush=True)
    if counts is None or code not in (0, 1, 5):  # 5: nothing was selected
        counts = counts or [0, 0, 0]
        counts[1] = max(counts[1], 1)
    return counts


def once_more(counts, failed_json):
    """Counts of a phase after its failures, if few, have been run by themselves."""
    try:
        with open(failed_json) as names:
            failed = json.load(names)
    except FileNotFoundError:
        failed = []
    if not 0 < len(failed) <= FEW or len(failed) != counts[1]:
        return counts
    print(f"once more, by themselves: {' '.join(failed)}", flush=True)
    passed, still, _ = phase(*failed, "-n", "0")
    print(f"{passed} of {len(failed)} passed by themselves", flush=True)
    return [counts[0] + passed, still, counts[2]]


def main():
    with tempfile.TemporaryDirectory() as folder:
        names = [f"{folder}/{phase}.json" for phase in ("together", "leftover")]
        together = phase("tests", "-m", "not alone and not leftover", "-n", JOBS, "--dist", "worksteal", failed_json=names[0])
        leftover = []
        beside = threading.Thread(target=lambda: leftover.extend(phase("tests", "-m", "leftover", "-n", JOBS, leftover=True, failed_json=names[1])))
        beside.start()
        try:
            alone = phase("tests", "-m", "alone", "-n", WAITING, "--dist", "loadgroup")
            beside.join()
        except KeyboardInterrupt:
            os.killpg(BESIDE[0], signal.SIGTERM)  # a session of its own hears no Ctrl-C
            raise
        together, leftover = once_more(together, names[0]), once_more(leftover, names[1])
    passed, failed, skipped = (sum(counts) for counts in zip(together, alone, leftover))
    print(f"{passed} passed, {failed} failed, {skipped} skipped", flush=True)
    return 1 if failed or not passed else 0


if __name__ == "__main__":
    sys.exit(main())
