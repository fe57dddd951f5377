"""`python -m tensormass.crtk`: names, types and values of CRTK, read back from a bag by the PyPI package rosbags with its types of ROS 2 Humble, and given to
a stand-in for rclpy, which Debian 12 does not package; and a bridge that stands still delays no tick."""
import csv
import json
import os
import subprocess
import sys

import lcm
import numpy as np
import pytest
from kit import NETWORK
from paths import BUILD, ROOT
from test_package import log, python, run, wheel  # noqa: F401

rosbag2, typesys = pytest.importorskip("rosbags.rosbag2"), pytest.importorskip("rosbags.typesys")
TYPES = {"measured_cp": "geometry_msgs/msg/PoseStamped", "measured_cv": "geometry_msgs/msg/TwistStamped", "measured_cf": "geometry_msgs/msg/WrenchStamped",
         "servo_cf": "geometry_msgs/msg/WrenchStamped", "operating_state": "crtk_msgs/msg/OperatingState"}
# crtk_msgs/msg/OperatingState.msg of collaborative-robotics/crtk_msgs
OPERATING_STATE = "std_msgs/Header header\nstring state\nbool is_homed\nbool is_busy\n"
STAND_IN = """
import json, sys
class Message:
    def __init__(self): self.__dict__["values"] = {}
    def __getattr__(self, name): return self.values.setdefault(name, Message())
    def __setattr__(self, name, value): self.values[name] = value
    def plain(self): return {k: v.plain() if isinstance(v, Message) else v for k, v in self.values.items()}
class Publisher:
    def __init__(self, kind, topic): self.kind, self.topic = kind, topic
    def publish(self, message): print("SAID " + json.dumps([self.topic, type(message).__name__, message.plain()]))
class Node:
    def create_publisher(self, kind, topic, depth): return Publisher(kind, topic)
    def destroy_node(self): pass
def init(): pass
def shutdown(): pass
def create_node(name): return Node()
"""


def array(vector):
    return np.array([vector.x, vector.y, vector.z])


def read_bag(path):
    """{topic: [(ns, type, message)]}, by rosbags alone."""
    store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
    store.register(typesys.get_types_from_msg(OPERATING_STATE, TYPES["operating_state"]))
    found = {}
    with rosbag2.Reader(path) as reader:
        for connection, time_ns, data in reader.messages():
            found.setdefault(connection.topic, []).append((time_ns, connection.msgtype, store.deserialize_cdr(data, connection.msgtype)))
    return found


def read_lcm(path):
    sys.path.insert(0, str(BUILD / "python"))
    from tensormass_lcm import controller_status_t, force_sample_t, tool_state_t
    kinds = {"TOOL_0": tool_state_t, "FORCE_0": force_sample_t, "CONTROLLER_0": controller_status_t}
    found = {name: [] for name in kinds}
    for event in lcm.EventLog(str(path), "r"):
        if event.channel in kinds:
            found[event.channel].append((event.timestamp, kinds[event.channel].decode(event.data)))
    return found


def test_a_log_becomes_a_bag_with_crtk_names_types_and_values(python, log, tmp_path):  # noqa: F811
    run(python, "-m", "tensormass.crtk", "--log", log, "--bag", tmp_path / "bag", "--namespace", "/MTMR")
    bag, sent = read_bag(tmp_path / "bag"), read_lcm(log)
    assert {topic: rows[0][1] for topic, rows in bag.items()} == {"/MTMR/" + name: kind for name, kind in TYPES.items()}
    poses, tools = bag["/MTMR/measured_cp"], sent["TOOL_0"]
    assert len(poses) == len(tools) > 100 and len(bag["/MTMR/measured_cv"]) == len(tools) - 1
    trocar = np.array([-0.02, -0.08, 0.16])
    for (time_ns, _, pose), (time_us, tool) in zip(poses, tools):
        assert time_ns == 1000 * time_us == 1000000000 * pose.header.stamp.sec + pose.header.stamp.nanosec and pose.header.frame_id == "world"
        assert np.array_equal(array(pose.pose.position), tool.tip_m)
    q = poses[-1][2].pose.orientation
    shaft = np.array([2 * (q.x * q.z + q.w * q.y), 2 * (q.y * q.z - q.w * q.x), 1 - 2 * (q.x ** 2 + q.y ** 2)])
    along = np.array(tools[-1][1].tip_m) - trocar
    assert np.allclose(shaft, along / np.linalg.norm(along), atol=1e-9), "the shaft is the z axis"
    moved = sum(array(twist.twist.linear) * 1e-6 * (b.utime - a.utime) for (_, _, twist), (_, a), (_, b) in zip(bag["/MTMR/measured_cv"], tools, tools[1:]))
    assert np.allclose(moved, np.array(tools[-1][1].tip_m) - tools[0][1].tip_m, atol=1e-9), "velocities add up to the way"
    for topic, channel in (("measured_cf", "FORCE_0"), ("servo_cf", "CONTROLLER_0")):
        assert [list(array(m.wrench.force)) for _, _, m in bag["/MTMR/" + topic]] == [list(m.force_N) for _, m in sent[channel]]
    assert max(np.linalg.norm(m.force_N) for _, m in sent["FORCE_0"]) > 0.1
    states = [(m.state, m.is_homed, m.is_busy) for _, _, m in bag["/MTMR/operating_state"]]
    assert ("ENABLED", True, False) in states and len(states) == len(sent["CONTROLLER_0"])


def test_rclpy_gets_the_same_by_its_own_calls(python, log, tmp_path):  # noqa: F811
    (tmp_path / "rclpy.py").write_text(STAND_IN)
    for package, names in (("geometry_msgs", ("PoseStamped", "TwistStamped", "WrenchStamped")), ("crtk_msgs", ("OperatingState",))):
        (tmp_path / package).mkdir()
        (tmp_path / package / "__init__.py").write_text("")
        (tmp_path / package / "msg.py").write_text("from rclpy import Message\n" + "".join(f"class {name}(Message): pass\n" for name in names))
    said = run(python, "-m", "tensormass.crtk", "--log", log, env={"PYTHONPATH": str(tmp_path)})
    rows = [json.loads(line[5:]) for line in said.splitlines() if line.startswith("SAID ")]
    assert {row[0]: row[1] for row in rows} == {"/tensormass0/" + name: kind.rpartition("/")[2] for name, kind in TYPES.items()}
    first = next(row[2] for row in rows if row[0].endswith("measured_cp"))
    assert first["pose"]["position"]["x"] == read_lcm(log)["TOOL_0"][0][1].tip_m[0] and first["header"]["frame_id"] == "world"


def test_what_is_missing_is_named(python, log, tmp_path):  # noqa: F811
    (tmp_path / "cyclonedds.py").write_text("raise ImportError(name='cyclonedds')")
    for words, says in ((["--log", log], "rclpy is missing; install ROS 2 with crtk_msgs, or type pip install cyclonedds, or write a bag"), (["--log", tmp_path / "none", "--bag", tmp_path / "b"], "cannot be read")):
        done = subprocess.run([python, "-m", "tensormass.crtk", *words], capture_output=True, text=True, timeout=60, env={**os.environ, "PYTHONPATH": str(tmp_path)})
        assert done.returncode == 2 and says in done.stderr, done.stderr


RUN = """
{bin}/tm-device --bus virtual:c --priority 0 --duration 8 2> {tmp}/device.txt & device=$!
{bin}/tm-sim {scene} --realtime --quiet --set 'time.duration=20 s' 2> {tmp}/sim.txt & sim=$!
{python} -m tensormass.crtk --bag {tmp}/bag --seconds 4 > {tmp}/bridge.txt 2>&1 & bridge=$!
(sleep 1.5; kill -STOP $bridge; sleep 1.5; kill -CONT $bridge) &
{bin}/haptic-rt --bus virtual:c --duration 3.5 --json {tmp}/r.json --record {tmp}/r.csv 2> {tmp}/said.txt
kill -INT $sim; kill $device; wait $bridge; echo $? > {tmp}/code
"""


@pytest.mark.clock
def test_a_bridge_that_stands_still_delays_no_tick(python, tmp_path):  # noqa: F811
    text = RUN.format(bin=BUILD / "bin", scene=ROOT / "apps/scenes/liver-press.yaml", tmp=tmp_path, python=python)
    subprocess.run([*NETWORK, "sh", "-c", text], timeout=80, check=False, capture_output=True, env={"TM_BUS_DIR": str(tmp_path), "PATH": "/usr/bin:/bin:/usr/sbin:/sbin"})
    told = json.loads((tmp_path / "r.json").read_text())
    assert (tmp_path / "code").read_text() == "0\n", (tmp_path / "bridge.txt").read_text()
    assert told["fault"] == "none" and told["state"] == "engaged", told
    # A wait for the bridge would skip the 750 messages of its stop; a busy machine wakes the sending thread late for some.
    assert told["sent"]["skipped"] < 100 < told["ticks"] - 1400, told
    with open(tmp_path / "r.csv") as file:
        times = [float(row["time_s"]) for row in csv.DictReader(file)]
    assert max(b - a for a, b in zip(times, times[1:])) < 0.25, "no tick waited while it stood still"
    stamps = sorted(time_ns for rows in read_bag(tmp_path / "bag").values() for time_ns, _, _ in rows)
    assert len(stamps) > 500 and max(b - a for a, b in zip(stamps, stamps[1:])) > 1e9, "it did stand still"
    assert sys.executable
