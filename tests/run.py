"""Runs every test: those that share the processors first, two at a time, then one by one those that watch the wall clock (guests, whole rings of programs,
windows), which other tests beside them would starve. The last line counts both: `N passed, N failed, N skipped`."""
import os
import re
import subprocess
import sys

JOBS = os.environ.get("TM_JOBS", "2")


def phase(*arguments):
    """Counts of one pytest run, shown as it goes."""
    command = [sys.executable, "-m", "pytest", "tests", "-q", "-p", "no:cacheprovider", *arguments, *sys.argv[1:]]
    run = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    counts = None
    for line in run.stdout:
        found = re.fullmatch(r"(\d+) passed, (\d+) failed, (\d+) skipped\n", line)
        if found:
            counts = [int(n) for n in found.groups()]
        else:
            print(line, end="", flush=True)
    code = run.wait()
    if counts is None or code not in (0, 1, 5):  # 5: nothing was selected
        counts = counts or [0, 0, 0]
        counts[1] = max(counts[1], 1)
    return counts


def main():
    together = phase("-m", "not alone", "-n", JOBS, "--dist", "worksteal")
    alone = phase("-m", "alone")
    passed, failed, skipped = (a + b for a, b in zip(together, alone))
    print(f"{passed} passed, {failed} failed, {skipped} skipped", flush=True)
    return 1 if failed or not passed else 0


if __name__ == "__main__":
    sys.exit(main())
