"""haptic-rt with motors on a bus: ODrive over CANSimple, moteus over CAN-FD, CiA 402 over CANopen, against their emulators on the virtual bus (odrive_axes.py,
moteus_axes.py, cia402_axes.py). Units, signs, modes, and motors that fail, hang or lie."""
import os
import re
import subprocess
import time

import pytest
from drivekit import wait_for
from motorkit import HAPTIC, JOINTS, KINDS, NODES, QUANTUM_TURNS, STOP_MS, TORQUES, TROUBLES, TURNS, Axes, compare, in_trouble, play
from paths import LONG


@pytest.fixture
def axes(tmp_path):
    made = []

    def make(*arguments):
        made.append(Axes(tmp_path, *arguments))
        return made[-1]
    yield make
    for each in made:
        each.end()


@pytest.mark.parametrize("kind, more", [("odrive", ("--dbc", "0.5.6")), ("odrive", ()), ("moteus", ()), ("cia402", ())])
def test_torques_and_turns_arrive_with_their_units_and_signs(axes, kind, more):
    bench = axes(kind, *more)
    controller = play(bench)
    wait_for(lambda: all(count > 1200 for count in bench.torques()), 30)  # by then the joints are at rest; by count, as a busy machine starts the mock late
    report, rows, said = controller.end()
    time.sleep(0.1)
    assert bench.child.poll() is None, "the emulator found something that it does not take"
    sent, _ = bench.rows()
    assert report["fault"] == "none", said
    checked, worst = compare(kind, sent, rows)
    print(kind, checked, worst)
    assert checked > 300
    last = rows[-1]
    for node, turns, joint in zip(NODES, TURNS, JOINTS):
        at = min((row for row in sent if row[1] == node), key=lambda row: abs(row[0] - last["t_us"]))[3]
        assert abs(last[joint] - at / turns) < 1e-4 + QUANTUM_TURNS[kind], (joint, last[joint], at)
    assert all(row[2] == 0 for row in sent[-3:]), "the last word is no torque"


# The short form plays what differs most; the long form and stop_times.py all.
SHORT = {"odrive": ("killed", "error"), "moteus": ("frozen", "error", "short"), "cia402": ("error", "nonsense")}


@pytest.mark.parametrize("kind, trouble", [(kind, trouble) for kind in KINDS for trouble in (TROUBLES if LONG else SHORT[kind])])
def test_trouble_ends_the_torque(axes, kind, trouble):
    bench = axes(kind, "--trouble", trouble, "--after", "0.3")
    controller_ms, device_ms, report, rows, said = in_trouble(bench, trouble)
    print(f"{kind} {trouble}: controller {controller_ms:.1f} ms, at the axes {device_ms:.1f} ms, {report['state']} {report['fault']}")
    if trouble == "flood":  # fifty times the frames, each of them true: the newest count, and the force goes on
        assert report["fault"] == "none" and report["state"] == "engaged"
        return
    assert controller_ms <= STOP_MS and device_ms <= STOP_MS
    if trouble in ("error", "nonsense", "short"):
        assert report["fault"] == "device_reported" and not any(rows[-1][t] for t in TORQUES)
    if trouble == "error":
        code = {"odrive": r"ODrive node \d reports error 0x800", "moteus": r"moteus node \d reports error 0x21", "cia402": r"CiA 402 node \d reports error 0x2310"}
        assert re.search(code[kind], said), said  # all axes fail at once: any may be heard first


def refused(tmp_path, device):
    done = subprocess.run([HAPTIC, "--device", device, "--duration", "0.1"], capture_output=True, text=True, timeout=20, env={**os.environ, "TM_BUS_DIR": str(tmp_path)})
    return done.stderr if done.returncode == 2 else done


@pytest.mark.parametrize("device, says", [("odrive:virtual:o/0:8,1:8", "does not name 3 axes"), ("odrive:virtual:o/0:8,0:8,1:8", "does not name 3 axes"),
                                          ("odrive:virtual:o/0:8,1:0,2:8", "does not name 3 axes"), ("odrive:serial:o/0:8,1:8,2:8", "is not a bus address"),
                                          ("moteus:virtual:o/0:8,1:8,2:8", "NODE within 1..126"), ("cia402:virtual:o/1:8,2:8,127:8", "NODE within 1..126")])
def test_bad_addresses_are_refused(tmp_path, device, says):
    assert says in refused(tmp_path, device)
