"""A master in ROS 2 for tests: publishes measured_cp, gripper/measured_js and operating_state, and logs each servo_cf that it receives as
`time_us,fx,fy,fz,x,y,z`.

It does not use the bridge's types or transport: it is rclpy with the maker's types (--ros), or the package cyclonedds with types written from their definitions.
Its clock is CLOCK_MONOTONIC, as haptic-rt's."""
import argparse
import math
import os
import sys
import time

parser = argparse.ArgumentParser()
parser.add_argument("--name", default="/MTMR")
parser.add_argument("--here", default="/haptic0")
parser.add_argument("--log", required=True)
parser.add_argument("--rate", type=float, default=500)
parser.add_argument("--swing", type=float, default=0.0, help="m down and up again in 2 s")
parser.add_argument("--move", default="0,0,0", help="velocity, m/s")
parser.add_argument("--turn", type=float, default=0.0, help="rad/s about the vertical")
parser.add_argument("--gripper", type=float, default=1.05, help="rad")
parser.add_argument("--commands", default="enable:0.3,home:0.4", help="WORD:SECOND, comma separated, on state_command; seconds since the bridge was heard")
parser.add_argument("--trouble", default="", help="silent, nonsense or unready, --after s after the force reached 1.4 N")
parser.add_argument("--after", type=float, default=0.4)
parser.add_argument("--ros", action="store_true", help="by rclpy")
o = parser.parse_args()

log = open(o.log, "w", buffering=1)
position = [0.0, 0.0, 0.0]
first_push = first_heard = None


def received(message):
    global first_push
    f = message.wrench.force
    now = time.monotonic_ns() // 1000
    if first_push is None and f.x ** 2 + f.y ** 2 + f.z ** 2 > 2.0:
        first_push = now
    t = message.wrench.torque
    log.write(f"# torque {t.x!r} {t.y!r} {t.z!r}\n")
    log.write(f"{now},{f.x!r},{f.y!r},{f.z!r},{position[0]!r},{position[1]!r},{position[2]!r}\n")


def states(message):
    global first_heard
    first_heard = first_heard or time.monotonic()
    log.write(f"# state {time.monotonic_ns() // 1000} {message.state} {int(message.is_homed)} {int(message.is_busy)}\n")


def by_dds():
    """Returns (pose, joint, ready, command: functions that publish; spin)."""
    from dataclasses import dataclass, field

    from cyclonedds.core import Listener
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.idl import IdlStruct
    from cyclonedds.idl.types import float64, int32, sequence, uint32
    from cyclonedds.pub import DataWriter
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic

    @dataclass
    class Time(IdlStruct, typename="builtin_interfaces.msg.dds_.Time_"):
        sec: int32 = 0
        nanosec: uint32 = 0

    @dataclass
    class Header(IdlStruct, typename="std_msgs.msg.dds_.Header_"):
        stamp: Time = field(default_factory=Time)
        frame_id: str = ""

    @dataclass
    class Vector3(IdlStruct, typename="geometry_msgs.msg.dds_.Vector3_"):
        x: float64 = 0.0
        y: float64 = 0.0
        z: float64 = 0.0

    @dataclass
    class Point(IdlStruct, typename="geometry_msgs.msg.dds_.Point_"):
        x: float64 = 0.0
        y: float64 = 0.0
        z: float64 = 0.0

    @dataclass
    class Quaternion(IdlStruct, typename="geometry_msgs.msg.dds_.Quaternion_"):
        x: float64 = 0.0
        y: float64 = 0.0
        z: float64 = 0.0
        w: float64 = 1.0

    @dataclass
    class Pose(IdlStruct, typename="geometry_msgs.msg.dds_.Pose_"):
        position: Point = field(default_factory=Point)
        orientation: Quaternion = field(default_factory=Quaternion)

    @dataclass
    class PoseStamped(IdlStruct, typename="geometry_msgs.msg.dds_.PoseStamped_"):
        header: Header = field(default_factory=Header)
        pose: Pose = field(default_factory=Pose)

    @dataclass
    class Wrench(IdlStruct, typename="geometry_msgs.msg.dds_.Wrench_"):
        force: Vector3 = field(default_factory=Vector3)
        torque: Vector3 = field(default_factory=Vector3)

    @dataclass
    class WrenchStamped(IdlStruct, typename="geometry_msgs.msg.dds_.WrenchStamped_"):
        header: Header = field(default_factory=Header)
        wrench: Wrench = field(default_factory=Wrench)

    @dataclass
    class JointState(IdlStruct, typename="sensor_msgs.msg.dds_.JointState_"):
        header: Header = field(default_factory=Header)
        name: sequence[str] = field(default_factory=list)
        position: sequence[float64] = field(default_factory=list)
        velocity: sequence[float64] = field(default_factory=list)
        effort: sequence[float64] = field(default_factory=list)

    @dataclass
    class OperatingState(IdlStruct, typename="crtk_msgs.msg.dds_.OperatingState_"):
        header: Header = field(default_factory=Header)
        state: str = ""
        is_homed: bool = False
        is_busy: bool = False

    @dataclass
    class StringStamped(IdlStruct, typename="crtk_msgs.msg.dds_.StringStamped_"):
        header: Header = field(default_factory=Header)
        string: str = ""

    class Take(Listener):
        def __init__(self, call):
            super().__init__()
            self.call = call

        def on_data_available(self, reader):
            for message in reader.take(N=100):
                if message.sample_info.valid_data:
                    self.call(message)

    from cyclonedds.qos import Policy, Qos
    reliable = Qos(Policy.Reliability.Reliable(100000000), Policy.History.KeepLast(10))
    participant = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID") or 0))
    listeners = [Take(received), Take(states)]
    readers = [DataReader(participant, Topic(participant, f"rt{o.name}/servo_cf", WrenchStamped), qos=reliable, listener=listeners[0]),
               DataReader(participant, Topic(participant, f"rt{o.here}/operating_state", OperatingState), qos=reliable, listener=listeners[1])]

    def writer(name, kind):
        return DataWriter(participant, Topic(participant, "rt" + name, kind), qos=reliable)

    poses, joints, ready = writer(o.name + "/measured_cp", PoseStamped), writer(o.name + "/gripper/measured_js", JointState), writer(o.name + "/operating_state", OperatingState)
    commands = writer(o.here + "/state_command", StringStamped)

    def spin(seconds):
        assert readers
        time.sleep(max(0.0, seconds))

    return (lambda p, q: poses.write(PoseStamped(pose=Pose(Point(*p), Quaternion(*q)))), lambda angle: joints.write(JointState(name=["gripper"], position=[angle])),
            lambda state, homed: ready.write(OperatingState(state=state, is_homed=homed)), lambda word: commands.write(StringStamped(string=word)), spin)


def by_ros():
    """As by_dds, by rclpy. crtk_msgs is in no package index, so it publishes no state and no command: the bridge begins enabled."""
    import rclpy
    from geometry_msgs.msg import PoseStamped, WrenchStamped
    from sensor_msgs.msg import JointState
    rclpy.init()
    node = rclpy.create_node("master")
    node.create_subscription(WrenchStamped, o.name + "/servo_cf", received, 10)
    poses, joints = node.create_publisher(PoseStamped, o.name + "/measured_cp", 10), node.create_publisher(JointState, o.name + "/gripper/measured_js", 10)

    def pose(p, q):
        message = PoseStamped()
        message.pose.position.x, message.pose.position.y, message.pose.position.z = p
        message.pose.orientation.x, message.pose.orientation.y, message.pose.orientation.z, message.pose.orientation.w = q
        poses.publish(message)

    def joint(angle):
        joints.publish(JointState(name=["gripper"], position=[angle]))

    def spin(seconds):
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            rclpy.spin_once(node, timeout_sec=max(0.0, end - time.monotonic()))

    return pose, joint, lambda state, homed: None, lambda word: None, spin


pose, joint, ready, command, spin = by_ros() if o.ros else by_dds()
velocity = [float(w) for w in o.move.split(",")]
orders = [(w.split(":")[0], float(w.split(":")[1])) for w in o.commands.split(",") if w and not o.ros]
print("ready", flush=True)
start, tick, said, trouble = time.monotonic(), 0, 0.0, False
while True:
    t = time.monotonic() - start
    away = -0.5 * o.swing * (1 - math.cos(math.pi * t))
    position[:] = [velocity[0] * t, velocity[1] * t, velocity[2] * t + away]
    half = 0.5 * o.turn * t
    now = time.monotonic_ns() // 1000
    if o.trouble and not trouble and first_push and now - first_push > 1e6 * o.after:
        trouble, said = True, 0.0
        log.write(f"# trouble {now}\n")
    orientation = (0.0, 0.0, math.sin(half), math.cos(half))
    if trouble and o.trouble == "nonsense":
        pose((math.nan, 1e9, 0.0), orientation)
    elif not (trouble and o.trouble == "silent"):
        pose(tuple(position), orientation)
    if t > said:
        joint(o.gripper)
        ready("FAULT" if trouble and o.trouble == "unready" else "ENABLED", True)
        said = t + 0.05
    while orders and first_heard and orders[0][1] < time.monotonic() - first_heard:
        log.write(f"# command {now} {orders[0][0]}\n")
        command(orders.pop(0)[0])
    tick += 1
    spin(start + tick / o.rate - time.monotonic())
    if os.getppid() == 1:
        sys.exit()
