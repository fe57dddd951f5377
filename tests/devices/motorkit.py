"""haptic-rt with motors on the virtual bus, and one of their emulators (odrive_axes.py, moteus_axes.py, cia402_axes.py)."""
import math
import os
import signal
import subprocess
import sys
import time

from drivekit import Controller, HERE, samples, wait_for
from paths import BUILD

HAPTIC = BUILD / "bin/haptic-rt"
KINDS = ("odrive", "moteus", "cia402")
NODES, TURNS = (1, 2, 3), (20.0, -20.0, 40.0)  # motor turns per m
ADDRESS = "{kind}:{bus}/" + ",".join(f"{n}:{t}" for n, t in zip(NODES, TURNS))
TORQUES, JOINTS = ("force_x_N", "force_y_N", "force_z_N"), ("x_m", "y_m", "z_m")  # of `desk`: three slides
RATED_mNm = 240  # cia402_axes.py
# Half the last step of a motor's torque, N m, and of its position, turns.
QUANTUM_Nm = {"odrive": 0.5e-9, "moteus": 0.5e-9, "cia402": 0.5e-6 * RATED_mNm}
QUANTUM_TURNS = {"odrive": 0, "moteus": 0, "cia402": 0.5 / 65536}
FLOAT = 2.0 ** -22  # forces and torques are floats: their rounding, twice
STOP_MS = 50  # stated: docs/device-failures.md
TROUBLES = ("killed", "frozen", "error", "nonsense", "short", "late", "flood")
FORCE = (0.3, 0.2, -1.5)


class Axes:
    def __init__(self, tmp, kind, *arguments):
        self.tmp, self.kind, self.log = tmp, kind, tmp / "axes.csv"
        self.env = {**os.environ, "TM_BUS_DIR": str(tmp)}
        self.arguments = [sys.executable, str(HERE / f"{kind}_axes.py"), str(tmp), "o", ",".join(map(str, NODES)), "--log", str(self.log), *map(str, arguments)]
        self.child = None

    def start(self):
        self.child = subprocess.Popen(self.arguments, stdout=subprocess.PIPE, text=True)

    def controller(self, *arguments):
        controller = Controller(self.tmp, ADDRESS.format(kind=self.kind, bus="virtual:o"), "--device-type", "desk", "--samples", samples(self.tmp, FORCE), *arguments, env=self.env)
        self.start()
        return controller

    def rows(self):
        """[(time in us, node, torque, turns)] of the log, and the time of trouble, or None."""
        rows, trouble = [], None
        for line in self.log.read_text().splitlines():
            if line.startswith("# trouble"):
                trouble = int(line.split()[2])
            elif line.count(",") == 3:
                t, node, torque, turns = line.split(",")
                rows.append((int(t), int(node), float(torque), float(turns)))
        return rows, trouble

    def end(self):
        if not self.child:
            return
        self.child.send_signal(signal.SIGCONT)
        self.child.kill()
        self.child.wait()

    def torques(self):
        """How many torques that are not zero each node has received."""
        rows = self.rows()[0]
        return [sum(1 for row in rows if row[1] == node and row[2]) for node in NODES]

    def pushed(self):
        return self.log.exists() and any(abs(row[2]) > 0 for row in self.rows()[0][-60:])


def compare(kind, sent, rows):
    """Holds each torque at the motors to that of a tick, one after the other and of none to come. Returns (number compared, largest difference in N)."""
    checked, worst = 0, 0.0
    for node, turns, name in zip(NODES, TURNS, TORQUES):
        at, quantum_N = 0, QUANTUM_Nm[kind] * 2 * math.pi * abs(turns)
        for time_us, _, torque, _ in [row for row in sent if row[1] == node and row[2]]:
            joint = torque * 2 * math.pi * turns
            while abs(rows[at][name] - joint) > quantum_N + FLOAT * abs(joint):
                at += 1
                assert at < len(rows) and rows[at]["t_us"] <= time_us, (node, joint)
            worst, checked = max(worst, abs(rows[at][name] - joint)), checked + 1
    return checked, worst


def play(bench):
    """Starts controller and axes until force acts; a busy machine may start the axes too late for one start of the controller."""
    for _ in range(4):
        controller = bench.controller()
        try:
            wait_for(bench.pushed, 8)
            return controller
        except AssertionError:
            said = controller.end()[2]
            bench.end()
    raise AssertionError(f"the axes were never pushed: {said}")


def in_trouble(bench, trouble):
    """Returns (ms until the controller's force is zero, ms until the last torque at the motors, report, rows, said)."""
    own = trouble in ("killed", "frozen")
    controller = play(bench)
    if own:
        time.sleep(0.2)
        bench.child.send_signal(signal.SIGKILL if trouble == "killed" else signal.SIGSTOP)
        since = time.monotonic_ns() // 1000
        time.sleep(0.4)
        bench.child.send_signal(signal.SIGCONT)
    else:
        wait_for(lambda: bench.rows()[1], 15)
        since = bench.rows()[1]
    time.sleep(0.4)
    report, rows, said = controller.end()
    controller_ms = next((1e-3 * (row["t_us"] - since) for row in rows if row["t_us"] >= since and not any(row[t] for t in TORQUES)), 1e9)
    late = [row[0] for row in bench.rows()[0] if row[0] > since]
    zero = next((row[0] for row in bench.rows()[0] if row[0] > since and row[2] == 0), since)
    return controller_ms, 1e-3 * (zero - since) if late and not own else 0.0, report, rows, said
