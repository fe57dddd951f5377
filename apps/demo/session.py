"""Starts and ends the programs of a session: simulation, one controller and one virtual device an instrument, the logger.

Used by demo.py, play.py and tm-session, inside the session's network namespace (netns.sh).
"""
import ctypes
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile
import time


def stop_all(processes, patience_s=5.0):
    """SIGINT to each that still runs, then SIGKILL to those that do not listen."""
    for p in processes:
        if p.poll() is None:
            p.send_signal(signal.SIGINT)
    end = time.monotonic() + patience_s
    for p in processes:
        try:
            p.wait(max(0.01, end - time.monotonic()))
        except subprocess.TimeoutExpired:
            p.kill()
            p.wait()


def of_their_own(libc=ctypes.CDLL(None), set_parent_death_signal=1):
    """In a program about to start: a terminal's Ctrl-C goes to the session alone, which ends its programs one after the other, and none outlives it."""
    os.setsid()
    libc.prctl(set_parent_death_signal, signal.SIGTERM)


class Session:
    """A scene's programs. `out` receives their figures and logs; `hand` is "script" or "lcm" (HAND_i moves the instruments)."""

    def __init__(self, bin_dir, scene, out, hand="script", sets=()):
        self.bin, self.scene, self.out, self.hand = pathlib.Path(bin_dir), str(scene), pathlib.Path(out), hand
        self.sets = [a for s in sets for a in ("--set", s)]
        self.out.mkdir(parents=True, exist_ok=True)
        subprocess.run([self.bin / "tm-sim", self.scene, *self.sets, "--hands", self.out / "hand"], check=True)
        self.facts = json.loads((self.out / "hand.json").read_text())
        self.bus = f"virtual:session{os.getpid()}"
        # A folder of its own: inside a user namespace everybody is user 0, and root's own folder may be there already.
        self.bus_dir = tempfile.mkdtemp(prefix="tensormass-", dir="/dev/shm" if os.access("/dev/shm", os.W_OK) else None)
        self.environment = {**os.environ, "TM_BUS_DIR": self.bus_dir}
        self.running = []

    def begin(self, name, *command):
        log = open(self.out / f"{name}.txt", "w")
        process = subprocess.Popen([str(c) for c in command], stdout=log, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL, env=self.environment, preexec_fn=of_their_own)
        process.name = name
        self.running.append(process)
        return process

    def start_logger(self, path):
        path.unlink(missing_ok=True)
        return self.begin("lcm-logger", "lcm-logger", "-q", "-f", path)

    def start_ring(self, duration_s=None):
        """Simulation first, then devices and controllers; any order would do. Without a duration they run until stopped."""
        until = ["--duration", f"{duration_s:g} s"] if duration_s else []
        self.begin("tm-sim", self.bin / "tm-sim", self.scene, *self.sets, "--realtime", *until, "--json", self.out / "sim.json")
        time.sleep(0.5)
        until = ["--duration", f"{duration_s:g}"] if duration_s else []
        for i, instrument in enumerate(self.facts["instruments"]):
            hand = self.out / f"hand{i}.csv" if self.hand == "script" else "lcm"
            style = ["--straight"] * instrument["straight"] + ["--repeat"] * instrument["repeat"] + ["--tremor", f"{instrument['tremor_m']:g}"]
            device = ["--device-type", instrument["device"]]
            self.begin(f"tm-device{i}", self.bin / "tm-device", "--bus", self.bus, "--instrument", i, *device, "--hand", hand,
                       *(style if self.hand == "script" else ["--start", ",".join(f"{j:.9g}" for j in instrument["start_joint"])]), *until, "--json", self.out / f"device{i}.json")
            record = ["--record", self.out / f"ticks{i}.csv"] if duration_s else []
            self.begin(f"haptic-rt{i}", self.bin / "haptic-rt", "--bus", self.bus, "--instrument", i, *device, "--mode", instrument["mode"],
                       "--extrapolator", self.facts["extrapolator"], "--passivity" if self.facts["passivity"] else "--no-passivity", *record, *until,
                       "--json", self.out / f"controller{i}.json")

    def well(self):
        """Whether none has ended with an error; the first that has is told of."""
        for p in self.running:
            if p.poll() not in (None, 0):
                print(f"{p.name} ended with exit code {p.returncode}; its last words ({self.out}/{p.name}.txt):", file=sys.stderr)
                sys.stderr.write("".join((self.out / f"{p.name}.txt").read_text().splitlines(True)[-5:]))
                return False
        return True

    def wait(self, names, tell=None):
        """Until the named programs have ended; the first to fail ends the session. Returns whether all ended well."""
        while True:
            if not self.well():
                return False
            if all(p.poll() is not None for p in self.running if p.name.startswith(names)):
                return True
            if tell:
                tell()
            time.sleep(0.1)

    def end(self):
        stop_all([p for p in self.running if p.name != "lcm-logger"])
        time.sleep(0.2)  # the logger hears the last messages
        stop_all([p for p in self.running if p.name == "lcm-logger"])
        shutil.rmtree(self.bus_dir, ignore_errors=True)
