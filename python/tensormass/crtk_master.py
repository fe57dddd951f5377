"""Makes a CRTK master (as of the dVRK) a device of haptic-rt: `python -m tensormass.crtk_master /MTMR` beside `haptic-rt --device crtk:0`.

Sends the master's poses to the driver as datagrams, and publishes the forces that come back (haptic_rt/io/drive_crtk.c). Limits, watchdog and the loop are
the controller's, which waits for nothing here. When haptic-rt is silent, zero force is published."""
from __future__ import annotations

import argparse
import functools
import math
import signal
import socket
import struct
import sys
import threading
import time
from typing import Any, Dict, List, Optional, Tuple

import numpy as np

from .crtk_ros import Transport, transport

STATE, FORCE = struct.Struct("<4sIq3d4dd"), struct.Struct("<4sBB2xq6f")
PERMISSION = 1 << 8
SILENT_S = 0.03  #: silence of haptic-rt after which zero force is published
_FAULT, _IN_USE = 5, (3, 4)
_WRENCH, _STATE = "geometry_msgs/msg/WrenchStamped", "crtk_msgs/msg/OperatingState"
COMMANDS = ("enable", "disable", "pause", "resume", "home", "unhome")


def read_axes(text: str) -> Any:
    """Returns the rotation from the master's axes to the cursor's (right, away, up), from names such as "x,-z,y". ValueError: it is no rotation."""
    words = text.split(",")
    m = np.zeros((3, 3))
    for row, word in enumerate(words):
        name = word.lstrip("+-")
        if len(words) != 3 or name not in ("x", "y", "z") or word not in (name, "+" + name, "-" + name):
            raise ValueError(f"'{text}' is not three axes; write x,-z,y for instance")
        m[row, "xyz".index(name)] = -1.0 if word[0] == "-" else 1.0
    if abs(np.linalg.det(m) - 1.0) > 1e-9:
        raise ValueError(f"'{text}' is not right-handed; change the sign of one axis")
    return m


class State:
    """The operating state of CRTK: DISABLED, ENABLED, PAUSED or FAULT, changed by the strings of state_command. Force is permitted if enabled and homed."""

    def __init__(self, enabled: bool) -> None:
        self.wanted = "ENABLED" if enabled else "DISABLED"
        self.is_homed = enabled
        self.fault = False

    @property
    def name(self) -> str:
        """The state to publish."""
        return "FAULT" if self.fault else self.wanted

    @property
    def permitted(self) -> bool:
        """Whether force may be rendered."""
        return self.wanted == "ENABLED" and self.is_homed

    def command(self, text: str) -> bool:
        """Takes a command. Returns False for one that is unknown or does not apply to the state; nothing changes then."""
        allowed = {"enable": ("DISABLED", "ENABLED"), "disable": ("DISABLED", "ENABLED", "PAUSED"), "pause": ("ENABLED", "PAUSED"), "resume": ("PAUSED", "ENABLED"),
                   "home": ("ENABLED", "PAUSED"), "unhome": ("DISABLED", "ENABLED", "PAUSED")}
        if self.wanted not in allowed.get(text, ()):
            return False
        if text in ("home", "unhome"):
            self.is_homed = text == "home"
        else:
            self.wanted = {"enable": "ENABLED", "disable": "DISABLED", "pause": "PAUSED", "resume": "ENABLED"}[text]
        return True


class Master:
    """Joins a master's topics with a driver of haptic-rt at `port` of this machine.

    master: namespace of the master's topics; here: namespace of operating_state and state_command of the instrument. gripper: its angle closed and open, rad."""

    def __init__(self, ros: Transport, master: str, here: str, port: int, axes: Any, gripper: Tuple[float, float], buttons: Dict[int, str], state: State, frame: str) -> None:
        self.ros, self.master, self.here, self.port, self.axes, self.state, self.frame = ros, master, here, port, axes, state, frame
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.01)
        self.counts = {"poses": 0, "forces": 0, "commands": 0, "refused": 0}
        self._gripper, self._trigger, self._buttons = gripper, -1.0, 0
        self._master_ready = True
        self._heard_s, self._zero, self._stop = 0.0, True, False
        self._in_use = False
        ros.subscribe(f"{master}/measured_cp", "geometry_msgs/msg/PoseStamped", self._pose)
        ros.subscribe(f"{master}/gripper/measured_js", "sensor_msgs/msg/JointState", self._joint)
        ros.subscribe(f"{master}/operating_state", _STATE, self._master_state, reliable=True)
        ros.subscribe(f"{here}/state_command", "crtk_msgs/msg/StringStamped", self._command, reliable=True)
        for button, topic in buttons.items():
            ros.subscribe(topic, "sensor_msgs/msg/Joy", functools.partial(self._button, button), reliable=True)
        self._thread = threading.Thread(target=self._forces, daemon=True)
        self._thread.start()

    # ---- from ROS ----

    def _pose(self, message: Any) -> None:
        p, q = message.pose.position, message.pose.orientation
        time_us = time.monotonic_ns() // 1000
        cursor, axis = self.axes @ (p.x, p.y, p.z), self.axes @ (q.x, q.y, q.z)
        size = math.sqrt(float(axis @ axis) + q.w ** 2)
        turn = (*(float(v) / size for v in axis), q.w / size) if 1e-6 < size < 1e6 else (0.0, 0.0, 0.0, 0.0)
        permission = PERMISSION if self.state.permitted and self._master_ready else 0
        self.socket.sendto(STATE.pack(b"TMS1", self._buttons | permission, time_us, *map(float, cursor), *turn, self._trigger), ("127.0.0.1", self.port))
        self.counts["poses"] += 1

    def _joint(self, message: Any) -> None:
        closed, wide = self._gripper
        if len(message.position):
            self._trigger = min(max((wide - float(message.position[0])) / (wide - closed), 0.0), 1.0)

    def _button(self, button: int, message: Any) -> None:
        pressed = len(message.buttons) > 0 and int(message.buttons[0]) == 1
        self._buttons = self._buttons | 1 << button if pressed else self._buttons & ~(1 << button)

    def _master_state(self, message: Any) -> None:
        self._master_ready = message.state == "ENABLED" and bool(message.is_homed)

    def _command(self, message: Any) -> None:
        good = self.state.command(message.string)
        self.counts["commands" if good else "refused"] += 1
        self.tell()

    # ---- to ROS ----

    def _header(self) -> Dict[str, Any]:
        now = time.time_ns()
        return {"stamp": {"sec": now // 1000000000, "nanosec": now % 1000000000}, "frame_id": self.frame}

    def _publish(self, force: Any, torque: Any = (0.0, 0.0, 0.0)) -> None:
        self._zero = not any(force) and not any(torque)
        self.ros.publish(f"{self.master}/servo_cf", _WRENCH, {"header": self._header(), "wrench": {
            "force": dict(zip("xyz", map(float, force))), "torque": dict(zip("xyz", map(float, torque)))}})
        self.counts["forces"] += 1

    def tell(self) -> None:
        """Publishes the operating state."""
        self.ros.publish(f"{self.here}/operating_state", _STATE, {"header": self._header(), "state": self.state.name, "is_homed": self.state.is_homed, "is_busy": self._in_use})

    def _newest(self) -> Optional[bytes]:
        data, more = None, True
        while more:
            try:
                data = self.socket.recv(64)
                self.socket.setblocking(False)
            except OSError:  # nothing more, or haptic-rt is not there
                more = False
        self.socket.settimeout(0.01)
        return data

    def _forces(self) -> None:
        while not self._stop:
            data, now_s = self._newest(), time.monotonic()
            if data and len(data) == FORCE.size and data[:4] == b"TMF1":
                _, state, fault, time_us, *wrench = FORCE.unpack(data)
                self.state.fault = state == _FAULT or fault != 0
                self._in_use = state in _IN_USE
                if now_s - 1e-6 * time_us < SILENT_S and all(map(math.isfinite, wrench)):
                    self._heard_s = now_s
                    self._publish(self.axes.T @ wrench[:3], self.axes.T @ wrench[3:])
            if now_s - self._heard_s > SILENT_S and not self._zero:
                self._in_use = False
                self._publish((0.0, 0.0, 0.0))

    def run(self, seconds: float) -> None:
        """Serves until `seconds` have passed or an exception ends it; zero force is the last that it publishes."""
        end, next_s = time.monotonic() + seconds, 0.0
        try:
            while time.monotonic() < end:
                self.ros.spin(0.02)
                if time.monotonic() >= next_s:
                    self.tell()
                    next_s = time.monotonic() + 0.1
        finally:
            self._stop = True
            self._thread.join()
            self._publish((0.0, 0.0, 0.0))
            self.socket.close()

    def report(self) -> List[str]:
        """Returns lines for the end of the run."""
        return [f"{self.counts['poses']} poses, {self.counts['forces']} forces, {self.counts['commands']} commands, {self.counts['refused']} refused"]


def _pair(text: str) -> Tuple[float, float]:
    closed, wide = map(float, text.split(","))
    if not 0.05 < abs(wide - closed) < 10.0:
        raise ValueError("two angles that differ")
    return closed, wide


def _stop(*_: Any) -> None:
    raise KeyboardInterrupt


def _arguments(given: Optional[List[str]]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tensormass.crtk_master", description="Makes a CRTK master of ROS 2 a device: haptic-rt --device crtk:0.")
    parser.add_argument("master", metavar="NAMESPACE", help="of the master's topics, for example /MTMR")
    parser.add_argument("--seconds", type=float, default=math.inf, help="end after this time")
    parser.add_argument("--namespace", default="/haptic0", help="of operating_state and state_command [%(default)s]")
    parser.add_argument("--frame", default="world", help="frame_id of the headers [world]")
    parser.add_argument("--port", type=int, default=10700, help="of haptic-rt --device crtk:PORT [10700]")
    parser.add_argument("--axes", type=read_axes, default=read_axes("x,y,z"), metavar="X,Y,Z", help="the master's axes that point right, away from the user, and up [x,y,z]")
    parser.add_argument("--gripper", type=_pair, default=(0.0, 1.05), metavar="CLOSED,OPEN", help="angles of the gripper, rad [0,1.05]")
    parser.add_argument("--clutch", default="/footpedals/clutch", metavar="TOPIC", help="sensor_msgs/msg/Joy: button 0 of the device [%(default)s]")
    parser.add_argument("--pedal", default="/footpedals/coag", metavar="TOPIC", help="sensor_msgs/msg/Joy: button 1 of the device [%(default)s]")
    parser.add_argument("--enabled", action="store_true", help="begin enabled and homed, instead of by state_command")
    return parser.parse_args(given)


def main(given: Optional[List[str]] = None) -> int:
    """Returns 0, or 2 after bad input, as the programs do."""
    options = _arguments(given)
    try:
        ros = transport()
    except ImportError as error:
        print(f"crtk_master: {error.name} is missing; install ROS 2 with crtk_msgs, or type pip install cyclonedds", file=sys.stderr)
        return 2
    signal.signal(signal.SIGTERM, _stop)
    master = Master(ros, options.master, options.namespace, options.port, options.axes, options.gripper, {0: options.clutch, 1: options.pedal}, State(options.enabled), options.frame)
    try:
        master.run(options.seconds)
    except KeyboardInterrupt:
        pass
    finally:
        ros.close()
    print(f"crtk_master: {', '.join(master.report())}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
