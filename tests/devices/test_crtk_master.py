"""A CRTK master moves an instrument and feels its force: haptic-rt, the bridge and a master in one network namespace, over DDS on its loopback.

The master is a process with types of its own (tests/devices/crtk_master.py) by PyPI's cyclonedds; with TM_ROS_PYTHON it is also a node of ROS 2, by rclpy and
Fast DDS: `pip install ros-rclpy ros-rmw-fastrtps-cpp ros-geometry-msgs ros-sensor-msgs`, all of PyPI, and TM_ROS_PYTHON is that environment's interpreter.
The types of crtk_ros.py are compared with those of ROS 2 Humble in the package rosbags."""
import contextlib
import csv
import json
import os
import socket
import struct
import subprocess
import sys
import time

import pytest
from kit import NETWORK
from paths import LONG
import scenekit
from drivekit import Controller, FORCE, HERE, expected, samples

pytest.importorskip("cyclonedds.core")
typesys = pytest.importorskip("rosbags.typesys")
ROS_PYTHON = os.environ.get("TM_ROS_PYTHON")
STOP_MS = 50  # stated: docs/device-failures.md
STATES = ("boot", "self_test", "idle", "engaged", "stale", "fault")
LOOPBACK = ["sh", "-c", 'ip link set lo up multicast on; ip route add 224.0.0.0/4 dev lo; exec "$@"', "sh"]


def now_us():
    return time.monotonic_ns() // 1000


def crtk_bridge():
    """Returns the module of the bridge, from the sources."""
    import crtk_bridge  # noqa: F401 (makes the package)
    return sys.modules["tensormass.crtk_master"]


def play(tmp, trouble, *words, master=sys.executable):
    """Returns (what crtk_run.py told, [(us, force, position)] at the master, its remarks, rows of the controller, its report)."""
    done = subprocess.run([NETWORK[0], NETWORK[1], *LOOPBACK, sys.executable, HERE / "crtk_run.py", tmp, master, trouble, *map(str, words)],
                          capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:] + (tmp / "bridge.txt").read_text()[-2000:]
    lines = (tmp / "m.csv").read_text().splitlines()
    sent = [(row[0], row[1:4], row[4:]) for row in ([float(w) for w in line.split(",")] for line in lines if line.count(",") == 6)]
    remarks = [line.split()[1:] for line in lines if line.startswith("#")]
    if trouble == "controller":
        return json.loads(done.stdout), sent, remarks, [], {}
    report = json.loads((tmp / "r.json").read_text())
    rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader((tmp / "r.csv").open())]
    for row in rows:
        row["t_us"] = report["start_us"] + 1e6 * row["time_s"]
    return json.loads(done.stdout), sent, remarks, rows, report


@pytest.mark.parametrize("peer", ["dds", pytest.param("rclpy", marks=pytest.mark.skipif(not ROS_PYTHON, reason="TM_ROS_PYTHON names no interpreter with rclpy"))])
def test_force_and_motion_arrive_with_their_units_and_signs(tmp_path, peer):
    words = ("--move", "0.02,-0.01,-0.03", "--gripper", 0.525, *(["--ros"] if peer == "rclpy" else []))
    told, sent, _, rows, report = play(tmp_path, "none", *words, master=ROS_PYTHON if peer == "rclpy" else sys.executable)
    assert report["fault"] == "none" and report["drive"]["refused"] == 0, told["said"]
    compared, worst = scenekit.compare_cursor([(us, force) for us, force, _ in sent], rows, 1e-9)
    print(f"{peer}: {compared} forces compared, largest difference {1e3 * worst:.2g} mN; {report['drive']}")
    assert compared > 100 and not any(sent[-1][1]), "the last word is no force"
    assert any(abs(f[0] + FORCE[0]) + abs(f[1] - FORCE[1]) + abs(f[2] + FORCE[2]) < 0.05 for _, f, _ in sent), "left is not right, into the body is down"
    moving = [row for row in rows if row["state"] == 3]
    a, b = moving[0], moving[-1]
    at = [min(sent, key=lambda row: abs(row[0] - tick["t_us"]))[2] for tick in (a, b)]
    for axis, sign, of in (("x_m", -1, 0), ("y_m", 1, 1), ("z_m", -1, 2)):
        assert abs(b[axis] - a[axis] - sign * (at[1][of] - at[0][of])) < 0.003, axis
    assert abs(b["grip"] - 0.5) < 0.01, "half open"


def test_torque_of_a_free_handle_arrives_with_its_unit_and_signs(tmp_path):
    """Upright handle, tip 0.1 m below: arm x force, N m."""
    told, sent, remarks, _, report = play(tmp_path, "none", "--handle")
    assert report["fault"] == "none", told["said"]
    torques = [tuple(map(float, word[1:])) for word in remarks if word[0] == "torque"]
    checked = 0
    for (_, (x, y, z), _), torque in zip(sent, torques):
        assert max(abs(a - b) for a, b in zip(torque, (0.1 * y, -0.1 * x, 0.0))) < 1e-6
        checked += abs(torque[1]) > 0.04
    assert checked > 100 and not any(torques[-1]) and len(torques) == len(sent)
    assert any(abs(x + FORCE[0]) + abs(y - FORCE[1]) + abs(z + FORCE[2]) < 0.05 for _, (x, y, z), _ in sent)


def test_state_command_permits_and_withdraws_the_force(tmp_path):
    orders = "resume:0.1,home:0.2,enable:0.3,home:0.6,pause:1.4,nonsense:1.5,resume:1.9,disable:2.7"
    _, sent, remarks, rows, _ = play(tmp_path, "none", "--commands", orders)
    at = {word[2]: int(word[1]) for word in remarks if word[0] == "command"}  # the last of each
    states = [(int(word[1]), word[2], word[3] == "1") for word in remarks if word[0] == "state"]

    def force(begin, end):
        return max((max(map(abs, f)) for us, f, _ in sent if begin < us < end), default=0.0)

    assert force(0, at["home"]) == 0.0, "no force before enable and home"
    assert force(at["home"], at["pause"]) > 1.0
    assert force(at["pause"] + 200000, at["resume"]) == 0.0, "a pause fades the force within 50 ms, and its message may wait"
    assert force(at["resume"], at["disable"]) > 1.0 and force(at["disable"] + 200000, 1e18) == 0.0
    names = [state for _, state, _ in states]
    order = [name for k, name in enumerate(names) if k == 0 or names[k - 1] != name]
    assert order == ["DISABLED", "ENABLED", "PAUSED", "ENABLED", "DISABLED"] and rows
    assert not any(homed for us, _, homed in states if us < at["home"])


TROUBLES = ("killed", "frozen", "controller", "master", "silent", "nonsense", "unready")


def in_trouble(tmp, trouble):
    """Plays one failure; returns (ms until the controller's force is zero, ms until the last force at the master, report, rows, output)."""
    told, sent, _, rows, report = play(tmp, trouble)
    since = told["since"]
    after = [row for row in sent if row[0] > since]
    if trouble == "frozen":  # forces that waited in the bridge's socket are old, and not published
        after = [row for row in sent if row[0] >= told["thawed"]][:10]
        assert sum(1 for row in after if any(row[1])) <= 1
    zero = next((row[0] for row in after if not any(row[1])), None)
    silent = trouble in ("killed", "master")  # a killed bridge publishes nothing, and a killed master hears nothing
    controller_ms = next((1e-3 * (row["t_us"] - since) for row in rows if row["t_us"] >= since and not any(expected(row))), 0.0)
    if rows:  # the state before the bridge ended
        report["state"] = STATES[int([row for row in rows if row["t_us"] < told["ended"]][-1]["state"])]
    return controller_ms, 0.0 if silent else 1e-3 * (zero - (told.get("thawed") or since)), report, rows, told.get("said", "")


@pytest.mark.parametrize("trouble", TROUBLES if LONG else ("frozen", "controller", "nonsense"))
def test_trouble_ends_the_force(tmp_path, trouble):
    controller_ms, device_ms, report, rows, _ = in_trouble(tmp_path, trouble)
    print(f"{trouble}: controller {controller_ms:.1f} ms, at the master {device_ms:.1f} ms, {report.get('state')} {report.get('fault')}")
    assert controller_ms <= STOP_MS and device_ms <= STOP_MS
    assert trouble == "controller" or controller_ms > 0.0
    assert trouble != "frozen" or report["state"] == "engaged", "it engages anew once the bridge is back, by the ramp"
    if trouble == "nonsense":
        assert report["fault"] == "device_reported"


@pytest.mark.parametrize("trouble, fault", [("flood", "device_reported"), ("short", "device_reported"), ("old", "none"), ("future", "none")])
def test_invalid_datagrams_end_the_force(tmp_path, trouble, fault):
    """Sends the bridge's datagrams without a bridge: 500 valid ones a second, then others."""
    pack = crtk_bridge().STATE.pack
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.settimeout(0)
    controller = Controller(tmp_path, "crtk:10701", "--priority", 0, "--samples", samples(tmp_path))
    force, since, zero_us, end = 0.0, None, None, time.monotonic() + 15
    later_us = {"old": -30000, "future": 1000000}.get(trouble, 0)
    while time.monotonic() < end and not (since and now_us() - since > 200000):
        if since is None and force < -1.4:
            since = now_us()
        valid = pack(b"TMS1", 1 << 8, now_us() + (later_us if since else 0), 0, 0, 0, 0, 0, 0, 1, -1)
        for _ in range(200 if since and trouble == "flood" else 1):
            link.sendto(valid[:60] if since and trouble == "short" else valid, ("127.0.0.1", 10701))
        with contextlib.suppress(OSError):
            while True:
                force = -struct.unpack("<4sBB2xq6f", link.recv(64))[6]
                zero_us = zero_us or (now_us() if since and force == 0.0 else None)
        time.sleep(0.002)
    report, rows, said = controller.end()
    assert since and zero_us and zero_us - since < 1000 * STOP_MS, said
    assert next(row["t_us"] - since for row in rows if row["t_us"] >= since and not any(expected(row))) < 1000 * STOP_MS
    assert report["fault"] == fault, said


def test_operating_states_and_axes():
    bridge = crtk_bridge()
    State, read_axes = bridge.State, bridge.read_axes
    s = State(False)
    assert s.name == "DISABLED" and not s.permitted and not s.command("resume") and not s.command("home") and not s.command("fly")
    assert s.command("enable") and s.name == "ENABLED" and not s.permitted
    assert s.command("home") and s.permitted and s.command("pause") and s.name == "PAUSED" and not s.permitted
    assert s.command("resume") and s.permitted and s.command("unhome") and not s.permitted and s.command("home")
    s.fault = True
    assert s.name == "FAULT"
    s.fault = False
    assert s.command("disable") and s.name == "DISABLED" and not s.command("pause")
    assert State(True).permitted
    assert (read_axes("x,-z,y") @ (1, 2, 3) == (1, -3, 2)).all() and (read_axes("x,y,z") @ (1, 2, 3) == (1, 2, 3)).all()
    for bad in ("x,y", "x,y,y", "x,y,-z", "x,y,w", "--x,y,z"):
        with pytest.raises(ValueError):
            read_axes(bad)


@pytest.mark.parametrize("words", [["/M", "--axes", "x,z,y"], ["/M", "--gripper", "1,1"], []])
def test_bad_words_are_refused(words):
    done = subprocess.run([sys.executable, HERE / "crtk_bridge.py", *words], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and ("invalid" in done.stderr or "required" in done.stderr), done.stderr


def test_types_are_those_of_ros():
    """Compares names, order and types of all fields; crtk_msgs is in no package of types, so its two are here, as published."""
    crtk_bridge()
    types = sys.modules["tensormass.crtk_ros"].TYPES
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    for name, text in (("OperatingState", "std_msgs/Header header\nstring state\nbool is_homed\nbool is_busy\n"), ("StringStamped", "std_msgs/Header header\nstring string\n")):
        store.register(typesys.get_types_from_msg(text, "crtk_msgs/msg/" + name))

    def named(node):
        kind, of = node[0].name, node[1]
        return of if kind == "NAME" else of[0] if kind == "BASE" else named(of[0]) + "[]"

    for kind, fields in types.items():
        assert [(field, named(node)) for field, node in store.get_msgdef(kind).fields] == list(fields), kind
