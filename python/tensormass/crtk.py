"""Publishes what instruments do by the names and types of CRTK (Collaborative Robotics Toolkit) for ROS 2: live from LCM, or from a log. crtk_master.py makes a
CRTK master a device of haptic-rt.

`python -m tensormass.crtk` is a process of its own; controller and simulation never wait for it. It needs rclpy with crtk_msgs, or the package cyclonedds, to
publish in ROS 2, the package rosbags to write a bag, and the package lcm to listen live."""
from __future__ import annotations

import argparse
import importlib
import math
import sys
import time
from typing import Any, Dict, Iterator, List, Optional, Protocol, Tuple

import numpy as np

from ._core import FileError
from .crtk_ros import transport
from .log import message_types, read_events

#: topic: (ROS 2 type, meaning)
TOPICS = {"measured_cp": ("geometry_msgs/msg/PoseStamped", "tip, m, and the shaft's direction as the z axis, in world axes"),
          "measured_cv": ("geometry_msgs/msg/TwistStamped", "velocity of the tip, m/s, by the difference of two poses"),
          "measured_cf": ("geometry_msgs/msg/WrenchStamped", "force of the tissue on the tip, N, of each sample"),
          "servo_cf": ("geometry_msgs/msg/WrenchStamped", "force that the controller commands to the hand, N, ten times a second"),
          "operating_state": ("crtk_msgs/msg/OperatingState", "DISABLED, PAUSED (idle), ENABLED (engaged, stale) or FAULT")}
#: fields of crtk_msgs/msg/OperatingState
OPERATING_STATE = "std_msgs/Header header\nstring state\nbool is_homed\nbool is_busy\n"
_STATES = ("DISABLED", "DISABLED", "PAUSED", "ENABLED", "ENABLED", "FAULT")
_IDLE, _FAULT, _SELF_TEST = 2, 5, 1
_ROLL = 3  # joint of all devices with at least five

Message = Tuple[str, Dict[str, Any]]


def _vector(v: Any) -> Dict[str, float]:
    return {"x": float(v[0]), "y": float(v[1]), "z": float(v[2])}


def _quaternion(shaft: Any, up: Any, roll: float) -> Dict[str, float]:
    """Returns the rotation whose z axis is the shaft, turned about it by the roll."""
    z = shaft / np.linalg.norm(shaft)
    x = np.cross(up, z)
    x = x / np.linalg.norm(x) if np.linalg.norm(x) > 1e-9 else np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    y = np.cross(z, x / np.linalg.norm(x))
    x = np.cross(y, z)
    c, s = math.cos(roll), math.sin(roll)
    m = np.column_stack((c * x + s * y, c * y - s * x, z))
    # Shepperd's method: the largest of the four is found first.
    k = int(np.argmax([m[0, 0], m[1, 1], m[2, 2], m.trace()]))
    if k == 3:
        q = [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], 1 + m.trace()]
    else:
        i, j, n = k, (k + 1) % 3, (k + 2) % 3
        q = [0.0] * 4
        q[i], q[j], q[n], q[3] = 1 + m[i, i] - m[j, j] - m[n, n], m[j, i] + m[i, j], m[n, i] + m[i, n], m[n, j] - m[j, n]
    size = math.sqrt(sum(float(v) ** 2 for v in q))
    return dict(zip("xyzw", (float(v) / size for v in q)))


class Bridge:
    """Turns messages of one instrument into those of CRTK. `frame`: name of the scene's world axes."""

    def __init__(self, instrument: int = 0, frame: str = "world") -> None:
        self.instrument, self.frame = instrument, frame
        self._trocar: Any = None
        self._up: Any = np.array([0.0, 1.0, 0.0])
        self._tip: Any = None
        self._tool_us = 0

    def channels(self) -> List[str]:
        """Returns the LCM channels that it reads."""
        return ["SIM_STATUS", *(f"{name}_{self.instrument}" for name in ("TOOL", "FORCE", "CONTROLLER"))]

    def take(self, channel: str, message: Dict[str, Any], stamp_us: int) -> List[Message]:
        """Returns [(topic, message as nested dictionaries)] for a decoded message of LCM; stamp_us: time of the headers, us."""
        header = {"stamp": {"sec": stamp_us // 1000000, "nanosec": stamp_us % 1000000 * 1000}, "frame_id": self.frame}
        name = channel.rpartition("_")[0]
        if channel == "SIM_STATUS" and self.instrument < int(message["instrument_count"]):
            self._trocar, self._up = np.array(message["trocar_m"][self.instrument]), np.array(message["up"][self.instrument])
        elif name == "TOOL":
            return self._tool(message, header)
        elif name == "FORCE":
            return [("measured_cf", _wrench(header, message["force_N"]))]
        elif name == "CONTROLLER":
            state = int(message["state"])
            return [("servo_cf", _wrench(header, message["force_N"])),
                    ("operating_state", {"header": header, "state": _STATES[state], "is_homed": _IDLE <= state < _FAULT, "is_busy": state == _SELF_TEST})]
        return []

    def _tool(self, message: Dict[str, Any], header: Dict[str, Any]) -> List[Message]:
        tip, utime = np.array(message["tip_m"], float), int(message["utime"])
        along = tip - self._trocar if self._trocar is not None else np.array([0.0, 0.0, -1.0])
        roll = float(message["joint"][_ROLL]) if int(message["joints"]) >= 5 else 0.0
        out: List[Message] = [("measured_cp", {"header": header, "pose": {"position": _vector(tip), "orientation": _quaternion(along, self._up, roll)}})]
        if self._tip is not None and utime > self._tool_us:
            v = (tip - self._tip) / (1e-6 * (utime - self._tool_us))
            out.append(("measured_cv", {"header": header, "twist": {"linear": _vector(v), "angular": _vector((0, 0, 0))}}))
        self._tip, self._tool_us = tip, utime
        return out


def _wrench(header: Dict[str, Any], force: Any) -> Dict[str, Any]:
    return {"header": header, "wrench": {"force": _vector(force), "torque": _vector((0, 0, 0))}}


class Sink(Protocol):
    """Takes the messages of a bridge."""

    def put(self, topic: str, message: Dict[str, Any], stamp_us: int) -> None:
        """Publishes a message."""

    def close(self) -> None:
        """Ends it."""


class Bag:
    """A ROS 2 bag, by the package rosbags: messages as CDR."""

    def __init__(self, path: str, namespace: str) -> None:
        typesys, rosbag2 = importlib.import_module("rosbags.typesys"), importlib.import_module("rosbags.rosbag2")
        self._store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        self._store.register(typesys.get_types_from_msg(OPERATING_STATE, TOPICS["operating_state"][0]))
        self._writer = rosbag2.Writer(path, version=9)
        self._writer.open()
        self._connection = {t: self._writer.add_connection(f"{namespace}/{t}", kind, typestore=self._store) for t, (kind, _) in TOPICS.items()}

    def _made(self, kind: str, value: Any) -> Any:
        fields = self._store.get_msgdef(kind).fields
        return self._store.types[kind](**{name: self._made(node[1], value[name]) if node[0].name == "NAME" else value[name] for name, node in fields})

    def put(self, topic: str, message: Dict[str, Any], stamp_us: int) -> None:
        """Writes a message."""
        kind = TOPICS[topic][0]
        self._writer.write(self._connection[topic], stamp_us * 1000, self._store.serialize_cdr(self._made(kind, message), kind))

    def close(self) -> None:
        """Completes the bag."""
        self._writer.close()


class Topics:
    """Topics of ROS 2, live."""

    def __init__(self, namespace: str) -> None:
        self._ros = transport()
        self._namespace = namespace

    def put(self, topic: str, message: Dict[str, Any], stamp_us: int) -> None:
        """Publishes a message."""
        self._ros.publish(f"{self._namespace}/{topic}", TOPICS[topic][0], message)

    def close(self) -> None:
        """Ends the node."""
        self._ros.close()


def _from_log(path: str, channels: List[str]) -> Iterator[Tuple[int, str, bytes]]:
    return ((us, name, data) for us, name, data in read_events(path) if name in channels)


def _live(url: str, channels: List[str], seconds: float) -> Iterator[Tuple[int, str, bytes]]:
    lcm = importlib.import_module("lcm")
    link = lcm.LCM(url)
    waiting: List[Tuple[int, str, bytes]] = []
    for channel in channels:
        link.subscribe(channel, lambda name, data: waiting.append((time.time_ns() // 1000, name, data)))
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        link.handle_timeout(100)
        yield from waiting
        waiting.clear()


def _arguments(given: Optional[List[str]]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tensormass.crtk", description="Publishes an instrument by CRTK's names and types: in ROS 2, or into a bag.")
    parser.add_argument("--log", metavar="FILE", help="read this LCM log instead of listening")
    parser.add_argument("--lcm-url", default="udpm://239.255.76.67:7667?ttl=0", help="where to listen [%(default)s]")
    parser.add_argument("--seconds", type=float, default=math.inf, help="end after this time")
    parser.add_argument("--instrument", type=int, default=0, choices=(0, 1), help="0 or 1 [0]")
    parser.add_argument("--namespace", default="/tensormass0", help="before each topic [%(default)s]")
    parser.add_argument("--frame", default="world", help="frame_id of the headers [world]")
    parser.add_argument("--bag", metavar="FOLDER", help="write a ROS 2 bag (pip install rosbags) instead of publishing")
    return parser.parse_args(given)


def main(given: Optional[List[str]] = None) -> int:
    """Returns 0, or 2 after bad input, as the programs do."""
    options = _arguments(given)
    bridge, types, count = Bridge(options.instrument, options.frame), message_types(), 0
    try:
        sink: Sink = Bag(options.bag, options.namespace) if options.bag else Topics(options.namespace)
    except ImportError as error:
        print(f"crtk: {error.name} is missing; install {'it by pip install rosbags' if options.bag else 'ROS 2 with crtk_msgs, or type pip install cyclonedds, or write a bag: --bag FOLDER'}", file=sys.stderr)
        return 2
    except Exception as error:  # rosbags' own, of a folder that is there
        print(f"crtk: {options.bag}: {error}; give a new folder", file=sys.stderr)
        return 2
    try:
        for stamp_us, channel, data in _from_log(options.log, bridge.channels()) if options.log else _live(options.lcm_url, bridge.channels(), options.seconds):
            type_ = types.get(int.from_bytes(data[:8], "big"))
            if type_ is None:
                continue
            try:
                message = type_.decode(data[8:])
            except ValueError:
                continue
            for topic, out in bridge.take(channel, message, stamp_us):
                sink.put(topic, out, stamp_us)
                count += 1
    except FileError as error:
        print(f"crtk: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        pass
    finally:
        sink.close()
    print(f"crtk: {count} messages")
    return 0


if __name__ == "__main__":
    sys.exit(main())
