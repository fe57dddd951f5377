"""Repeats tests that depend on the wall clock (marker `clock`) if the machine delayed them or is too slow. A failed test runs again once the machine is
calm, with new fixtures, at most twice, with a warning. If the machine was late each time, the test counts as skipped, with the reason. A failure on a
machine in time is a failure. Under tests/run.py failed tests run again alone, after all others.

A concurrent process measures the machine. It is in time if a sleeping process is never woken LATE_S late and a fixed piece of work takes a median below
SLOWER times PIECE_S. PIECE_S is its time on the 3 GHz processors for which the tests' bounds were set."""
import json
import os
import subprocess
import sys
import time

import pytest
from _pytest.runner import runtestprotocol

LATE_S = 0.05
PIECE_S = 0.0034
SLOWER = 2
AGAIN = int(os.environ.get("TM_AGAIN", "2"))  # 0: a failure is final, until tests/run.py runs it alone
CALM_S = 2          # in time for this long
CALM_WITHIN_S = 60  # maximum wait
WATCHER = """
import json, select, sys, time
late, pieces, next_piece = 0.0, [], 0.0
while True:
    before = time.monotonic()
    asked = select.select([sys.stdin], [], [], 0.01)[0]
    if not asked:
        late = max(late, time.monotonic() - before - 0.01)
    if asked and not sys.stdin.readline():
        break
    if time.monotonic() > next_piece or asked:
        begin = time.monotonic()
        sum(i * i for i in range(100000))
        pieces.append(time.monotonic() - begin)
        next_piece = begin + 0.5
    if asked:
        print(json.dumps((late, sorted(pieces)[len(pieces) // 2])), flush=True)
        late, pieces = 0.0, []
"""


class Watcher:
    """A process that records how late it wakes and how long a piece of work takes; it ends with this one."""

    def __init__(self):
        self.process = subprocess.Popen([sys.executable, "-S", "-c", WATCHER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
        self.most_late_s = 0.0  # over the complete run

    def since(self):
        """Returns the maximum lateness and the median time of the piece of work since the last call, s."""
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        late_s, piece_s = json.loads(self.process.stdout.readline())
        self.most_late_s = max(self.most_late_s, late_s)
        return late_s, piece_s

    def why_not_in_time(self, whole_run):
        """Returns the reason why a test could not be judged since the last call, or None."""
        late_s, piece_s = self.since()
        late_s = self.most_late_s if whole_run else late_s
        if late_s >= LATE_S:
            return f"the machine let processes wait {late_s:.2f} s"
        if piece_s >= SLOWER * PIECE_S:
            return f"the machine was {piece_s / PIECE_S:.1f} times slower than the bounds are made for"
        return None

    def wait_for_calm(self):
        end = time.monotonic() + CALM_WITHIN_S
        while time.monotonic() < end:
            self.since()
            time.sleep(CALM_S)
            if self.why_not_in_time(False) is None:
                return


def not_judged(reports, why):
    """Changes the failed reports of a test to skips."""
    for report in (r for r in reports if r.failed):
        report.outcome, report.longrepr = "skipped", (str(report.fspath), report.location[1], f"Skipped: not judged: each time it failed, {why}")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item, nextitem):
    if not item.get_closest_marker("clock"):
        return None
    config = item.config
    if not hasattr(config, "watcher"):
        config.watcher, config.played_again = Watcher(), 0
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    whole_run = "once" in getattr(item, "fixturenames", ())  # its fixture may be much older
    for attempt in range(AGAIN + 1):
        config.watcher.since()
        reports = runtestprotocol(item, nextitem=nextitem, log=False)
        why = config.watcher.why_not_in_time(whole_run)
        for report in reports:
            report.retried = attempt > 0
        failed = [report for report in reports if report.failed]
        if why is None or not failed:
            break
        if not AGAIN:
            failed[0].sections.append(("The machine", why))
            break
        last = attempt == AGAIN
        item.warn(pytest.PytestWarning(f"failed while {why}: {'not judged' if last else 'played again'}\n{failed[0].longreprtext[-1000:]}"))
        if last:
            not_judged(reports, why)
            break
        config.watcher.wait_for_calm()
        config.played_again += 1
        item.session._setupstate.teardown_exact(None)
        item._initrequest()
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True
