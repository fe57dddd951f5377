"""Runs haptic-rt with a device's emulator, and reads the logs of both."""
import contextlib
import csv
import json
import os
import signal
import subprocess
import sys
import time

from paths import BUILD, ROOT

HERE = ROOT / "tests/devices"
FORCE = (0.5, -0.3, -1.5)  # N, along the joints' axes: left, away, into the body


def samples(tmp, force=FORCE, seconds=20, rate=50):
    path = tmp / "samples.csv"
    path.write_text("time_s,fx_N,fy_N,fz_N\n" + "".join(f"{k / rate},{force[0]},{force[1]},{force[2]}\n" for k in range(int(seconds * rate))))
    return path


@contextlib.contextmanager
def emulator(tmp, *arguments, name="service"):
    """The Haply emulator: yields (process, port, path of its log)."""
    log = tmp / f"{name}.csv"
    child = subprocess.Popen([sys.executable, str(HERE / "haply_service.py"), "--log", str(log), *map(str, arguments)], stdout=subprocess.PIPE, text=True)
    try:
        yield child, int(child.stdout.readline()), log
    finally:
        with contextlib.suppress(ProcessLookupError):
            child.send_signal(signal.SIGCONT)
        child.kill()
        child.wait()


def commands(path):
    """Returns the rows of the emulator's log as (time in us, requested force, applied force, cursor), and the time of trouble, or None."""
    rows, trouble = [], None
    for line in path.read_text().splitlines():
        if line.startswith("# trouble"):
            trouble = int(line.split()[2])
            continue
        words = line.split(",")
        if len(words) == 10:
            value = [float(w) for w in words[1:]]
            rows.append((int(words[0]), value[:3], value[3:6], value[6:]))
    return rows, trouble


class Controller:
    """Starts haptic-rt, recording."""
    started = []  # by the running test; conftest.py ends those that a failed test leaves

    def __init__(self, tmp, device, *arguments, env=None, under=()):
        self.tmp = tmp
        self.child = subprocess.Popen([*under, str(BUILD / "bin/haptic-rt"), "--device", device, "--trocar", "0,0,0", "--record", str(tmp / "r.csv"), "--json", str(tmp / "r.json"),
                                       *map(str, arguments)], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env={**os.environ, **(env or {})})
        self.started.append(self)

    def kill(self):
        """Ends it, whatever it does."""
        if self.child.poll() is None:
            self.child.kill()
        self.child.communicate()

    def end(self, code=0):
        """Ends it; returns (its report, rows as dictionaries with `t_us`, its output)."""
        if self.child.poll() is None:
            self.child.send_signal(signal.SIGTERM)
        _, said = self.child.communicate(timeout=20)
        assert self.child.returncode == code, said
        report = json.loads((self.tmp / "r.json").read_text())
        rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader((self.tmp / "r.csv").open())]
        for row in rows:
            row["t_us"] = report["start_us"] + 1e6 * row["time_s"]
        return report, rows, said


def wait_for(what, seconds=8.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if what():
            return
        time.sleep(0.02)
    raise AssertionError("waited in vain")


def pushed(log):
    """Returns whether the emulator has received nearly the full force."""
    return log.exists() and any(abs(row[1][2]) > 0.9 * abs(FORCE[2]) for row in commands(log)[0][-20:])


def expected(row):
    """Returns the force at the cursor in a recorded tick: right, away, up."""
    return [-row["force_x_N"], row["force_y_N"], -row["force_z_N"]]


def in_setup(tmp, port):
    """Runs --setup; returns (exit code, its output)."""
    done = subprocess.run([str(BUILD / "bin/haptic-rt"), "--device", f"haply:0@127.0.0.1:{port}", "--setup", "--duration", "40"], capture_output=True, text=True, timeout=60)
    return done.returncode, done.stdout
