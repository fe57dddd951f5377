"""Starts and ends the programs of a session: simulation, logger, and a controller and a virtual device for each instrument.

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
    """Sends SIGINT to each running process, then SIGKILL to those that do not end."""
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
    """Detaches a program that is about to start from the terminal's Ctrl-C: only the session receives it and ends its programs in order. They also end if
    the session dies."""
    os.setsid()
    libc.prctl(set_parent_death_signal, signal.SIGTERM)


class Session:
    """The programs of a scene. `out` receives their figures and logs; `hand` is "script" or "lcm" (HAND_i moves the instruments)."""

    def __init__(self, bin_dir, scene, out, hand="script", sets=()):
        self.bin, self.scene, self.out, self.hand = pathlib.Path(bin_dir), str(scene), pathlib.Path(out), hand
        self.sets = [a for s in sets for a in ("--set", s)]
        self.out.mkdir(parents=True, exist_ok=True)
        subprocess.run([self.bin / "tm-sim", self.scene, *self.sets, "--hands", self.out / "hand"], check=True)
        self.facts = json.loads((self.out / "hand.json").read_text())
        self.bus = f"virtual:session{os.getpid()}"
        # A separate folder: inside a user namespace every user is 0, and root's folder may exist already.
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
        """Starts the simulation first, then devices and controllers; the order does not matter. Without a duration they run until stopped."""
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
        """Returns False, with a message, if a program has ended with an error."""
        for p in self.running:
            if p.poll() not in (None, 0):
                print(f"{p.name} ended with exit code {p.returncode}; its last messages ({self.out}/{p.name}.txt):", file=sys.stderr)
                sys.stderr.write("".join((self.out / f"{p.name}.txt").read_text().splitlines(True)[-5:]))
                return False
        return True

    def wait(self, names, tell=None):
        """Waits until the named programs have ended; the first failure ends the session. Returns whether all succeeded."""
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
        time.sleep(0.2)  # the logger receives the last messages
        stop_all([p for p in self.running if p.name == "lcm-logger"])
        shutil.rmtree(self.bus_dir, ignore_errors=True)
