"""haptic-rt with ODrive axes over CANSimple: the mock of the PyPI package odrive-can (odrive_axes.py), by the published DBC files of 0.5 and 0.6, on
the virtual bus. Units, signs, modes, and axes that fail, hang or send wrong values."""
import math
import os
import signal
import subprocess
import sys
import time

import pytest
from drivekit import Controller, HERE, samples, wait_for
from paths import BUILD

HAPTIC = BUILD / "bin/haptic-rt"
NODES, TURNS = (0, 1, 2), (20.0, -20.0, 40.0)  # motor turns per m
TORQUES = ("force_x_N", "force_y_N", "force_z_N")  # of `desk`: three slides
STOP_MS = 50  # stated: docs/devices.md


class Axes:
    def __init__(self, tmp, *arguments, nodes=NODES):
        self.tmp, self.log = tmp, tmp / "axes.csv"
        self.env = {**os.environ, "TM_BUS_DIR": str(tmp)}
        self.arguments = [sys.executable, str(HERE / "odrive_axes.py"), str(tmp), "o", ",".join(map(str, nodes)), "--log", str(self.log), *arguments]
        self.child = None

    def controller(self, *arguments, device="odrive:virtual:o/" + ",".join(f"{n}:{t}" for n, t in zip(NODES, TURNS))):
        controller = Controller(self.tmp, device, "--device-type", "desk", "--samples", samples(self.tmp, (0.3, 0.2, -1.5)), *arguments, env=self.env)
        self.child = subprocess.Popen(self.arguments, stdout=subprocess.PIPE, text=True)
        return controller

    def rows(self):
        rows, trouble = [], None
        for line in self.log.read_text().splitlines():
            if line.startswith("# trouble"):
                trouble = int(line.split()[2])
            elif line.count(",") == 3:
                t, node, torque, turns = line.split(",")
                rows.append((int(t), int(node), float(torque), float(turns)))
        return rows, trouble

    def end(self):
        self.child.send_signal(signal.SIGCONT)
        self.child.kill()
        self.child.wait()

    def pushed(self):
        return self.log.exists() and any(abs(row[2]) > 0 for row in self.rows()[0][-60:])


@pytest.fixture
def axes(tmp_path):
    made = []

    def make(*arguments):
        made.append(Axes(tmp_path, *arguments))
        return made[-1]
    yield make
    for each in made:
        if each.child:
            each.end()


@pytest.mark.parametrize("dbc", ["0.5.6", "0.6.10"])
def test_torques_and_turns_arrive_with_their_units_and_signs(axes, dbc):
    bench = axes("--dbc", dbc)
    controller = bench.controller("--duration", 4)
    controller.child.wait(timeout=30)
    report, rows, said = controller.end()
    time.sleep(0.1)
    sent, _ = bench.rows()
    assert report["fault"] == "none" and report["state"] == "engaged", said
    # A slide's force is the motor's torque times its turns per metre times 2 pi; the frame's float keeps seven digits.
    ticks, checked = list(rows), 0
    for node in NODES:
        at = 0
        for time_us, _, torque, _ in [row for row in sent if row[1] == node and row[2]]:
            joint = torque * 2 * math.pi * TURNS[node]
            while abs(ticks[at][TORQUES[node]] - joint) > 1e-6 + 1e-6 * abs(joint):
                at += 1
                assert at < len(ticks) and ticks[at]["t_us"] <= time_us, (node, joint)
            checked += 1
    assert checked > 1000
    last = rows[-1]
    for node, joint in zip(NODES, ("x_m", "y_m", "z_m")):
        turns = min((row for row in sent if row[1] == node), key=lambda row: abs(row[0] - last["t_us"]))[3]
        assert abs(last[joint] - turns / TURNS[node]) < 1e-4, (joint, last[joint], turns)
    assert all(row[2] == 0 for row in sent[-3:]), "the last word is no torque"


TROUBLES = ("killed", "frozen", "error", "nonsense", "short", "late", "flood")


def in_trouble(bench, trouble):
    own = trouble in ("killed", "frozen")
    for begun in range(4):  # on a busy machine the mock may start after the controller
        controller = bench.controller()
        try:
            wait_for(bench.pushed, 8)
            break
        except AssertionError:
            controller.end()
            bench.end()
    else:
        raise AssertionError("the axes were never pushed")
    if own:
        time.sleep(0.3)
        bench.child.send_signal(signal.SIGKILL if trouble == "killed" else signal.SIGSTOP)
        since = time.monotonic_ns() // 1000
        time.sleep(0.5)
        bench.child.send_signal(signal.SIGCONT)
    else:
        wait_for(lambda: bench.rows()[1], 15)
        since = bench.rows()[1]
    time.sleep(0.5)
    report, rows, said = controller.end()
    controller_ms = next((1e-3 * (row["t_us"] - since) for row in rows if row["t_us"] >= since and not any(row[t] for t in TORQUES)), 1e9)
    late = [row[0] for row in bench.rows()[0] if row[0] > since]
    zero = next((row[0] for row in bench.rows()[0] if row[0] > since and row[2] == 0), since)
    return controller_ms, 1e-3 * (zero - since) if late and not own else 0.0, report, rows, said


@pytest.mark.parametrize("trouble", TROUBLES)
def test_trouble_ends_the_torque(axes, trouble):
    bench = axes("--trouble", trouble, "--after", "0.5")
    controller_ms, device_ms, report, rows, said = in_trouble(bench, trouble)
    print(f"odrive {trouble}: controller {controller_ms:.1f} ms, at the axes {device_ms:.1f} ms, {report['state']} {report['fault']}")
    if trouble == "flood":  # fifty times the frames, each of them valid: the newest counts, and the force continues
        assert report["fault"] == "none" and report["state"] == "engaged"
        return
    assert controller_ms <= STOP_MS and device_ms <= STOP_MS
    if trouble in ("error", "nonsense", "short"):
        assert report["fault"] == "device_reported" and not any(rows[-1][t] for t in TORQUES)
    if trouble == "error":
        assert "ODrive node 0 reports error 0x800" in said


@pytest.mark.parametrize("device, says", [("odrive:virtual:o/0:8,1:8", "names no 3 axes"), ("odrive:virtual:o/0:8,0:8,1:8", "names no 3 axes"),
                                          ("odrive:virtual:o/0:8,1:0,2:8", "names no 3 axes"), ("odrive:serial:o/0:8,1:8,2:8", "is not a bus address")])
def test_bad_addresses_are_refused(tmp_path, device, says):
    done = subprocess.run([HAPTIC, "--device", device, "--duration", "0.1"], capture_output=True, text=True, timeout=20, env={**os.environ, "TM_BUS_DIR": str(tmp_path)})
    assert done.returncode == 2 and says in done.stderr, done.stderr
