"""Tests that watch the wall clock, on a machine that let them wait: a test that failed while a process that only sleeps was late by more than LATE_S is played again
once the machine is calm, all that it stands on anew, at most twice, and a warning says so. One that failed on a machine in time has failed."""
import subprocess
import sys
import time

import pytest
from _pytest.runner import runtestprotocol

LATE_S = 0.05
AGAIN = 2
CALM_S = 2          # in time for so long
CALM_WITHIN_S = 60  # or never mind
SLEEPER = """
import select, sys, time
late = 0.0
while True:
    before = time.monotonic()
    asked = select.select([sys.stdin], [], [], 0.01)[0]
    if not asked:
        late = max(late, time.monotonic() - before - 0.01)
    elif sys.stdin.readline():
        print(late, flush=True)
        late = 0.0
    else:
        break
"""


class Sleeper:
    """A process that notes how late it was woken; it ends with this one."""

    most_s = 0.0  # of the whole run

    def __init__(self):
        self.process = subprocess.Popen([sys.executable, "-S", "-c", SLEEPER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)

    def late_s(self):
        """The longest since this was asked last."""
        self.process.stdin.write("\n")
        self.process.stdin.flush()
        late_s = float(self.process.stdout.readline())
        self.most_s = max(self.most_s, late_s)
        return late_s

    def wait_for_calm(self):
        end = time.monotonic() + CALM_WITHIN_S
        while time.monotonic() < end:
            self.late_s()
            time.sleep(CALM_S)
            if self.late_s() < LATE_S:
                return


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item, nextitem):
    if not item.get_closest_marker("alone"):
        return None
    config = item.config
    if not hasattr(config, "sleeper"):
        config.sleeper, config.played_again = Sleeper(), 0
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for attempt in range(AGAIN + 1):
        config.sleeper.late_s()
        reports = runtestprotocol(item, nextitem=nextitem, log=False)
        late_s = config.sleeper.late_s()
        if "once" in getattr(item, "fixturenames", ()):  # it may stand on what was made long before
            late_s = config.sleeper.most_s
        if attempt == AGAIN or late_s < LATE_S or not any(report.failed for report in reports):
            break
        item.warn(pytest.PytestWarning(f"failed while the machine let processes wait {late_s:.2f} s: played again\n{next(r for r in reports if r.failed).longreprtext[-1000:]}"))
        config.sleeper.wait_for_calm()
        config.played_again += 1
        item.session._setupstate.teardown_exact(None)
        item._initrequest()
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True
