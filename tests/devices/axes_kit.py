"""What the emulators of motors share (odrive_axes.py, moteus_axes.py, cia402_axes.py): arguments, a log, troubles, a bus, and an axis: a mass with friction
that a hand holds.

    NAME_axes.py BUS_DIR NAME NODE,NODE,... --log FILE [--trouble KIND --after S]

The bus is the virtual one NAME in BUS_DIR, or the interface NAME where BUS_DIR is `socketcan`. A line of the log: time_us,node,torque (N m),turns.
`--after` counts from the first torque."""
import argparse
import math
import pathlib
import sys
import threading
import time

import can
from can.interfaces.socketcan import SocketcanBus

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "loop"))
from virtual_bus import FD, VirtualBus  # noqa: E402

parser = argparse.ArgumentParser()
parser.add_argument("directory")
parser.add_argument("name")
parser.add_argument("nodes")
parser.add_argument("--log", required=True)
parser.add_argument("--dbc", default="0.6.10")
parser.add_argument("--trouble", default="")
parser.add_argument("--after", type=float, default=0.5)
parser.add_argument("--pause", type=float, default=0.001, help="s, between two positions of an ODrive")
parser.add_argument("--start", type=float, default=0.0, help="turns, of the last node's hand")
parser.add_argument("--swing", type=float, default=0.0, help="turns, of that hand onwards, every two seconds")
parser.add_argument("--seconds", type=float, default=1e9, help="end after this time")
args = parser.parse_args()
log = open(args.log, "w", buffering=1)
NODES = [int(node) for node in args.nodes.split(",")]
FINE = 1e-12  # numbers below are zero
first_torque_us = None
noted = False
begin_us = time.monotonic_ns() // 1000


def now_us():
    return time.monotonic_ns() // 1000


def in_trouble(kind):
    global noted
    if args.trouble != kind or first_torque_us is None or now_us() - first_torque_us < 1e6 * args.after:
        return False
    if not noted:
        log.write(f"# trouble {now_us()}\n")
        noted = True
    return True


def over():
    return now_us() - begin_us > 1e6 * args.seconds


class Wires(can.BusABC):
    """python-can's interface to the virtual bus."""

    def __init__(self):
        super().__init__(channel=args.name)
        self.bus, self.waiting, self.own, self.lock = VirtualBus(args.directory, args.name), [], [], threading.Lock()

    def send(self, msg, timeout=None):
        with self.lock:
            self.own.append((msg.arbitration_id, bytes(msg.data)))
            self.bus.send(msg.arbitration_id, bytes(msg.data), (FD if msg.is_fd else 0) | (1 if msg.is_extended_id else 0))

    def _recv_internal(self, timeout):
        with self.lock:
            for identifier, data, flags in self.bus.receive_flagged():
                if (identifier, data) in self.own:
                    self.own.remove((identifier, data))
                else:
                    self.waiting.append((identifier, data, flags))
        if not self.waiting:
            time.sleep(0.0003)
            return None, False
        identifier, data, flags = self.waiting.pop(0)
        return can.Message(arbitration_id=identifier, data=data, is_extended_id=bool(flags & 1), is_fd=bool(flags & FD), bitrate_switch=bool(flags & FD)), False


class Socket(SocketcanBus):
    """The kernel's CAN; what is sent periodically is sent by a thread: the guest has no broadcast manager."""
    _send_periodic_internal = can.BusABC._send_periodic_internal


def wires(fd=False):
    return Socket(channel=args.name, fd=fd) if args.directory == "socketcan" else Wires()


class Plant:
    """A motor's shaft."""

    def __init__(self, node):
        self.start, self.swing = (args.start, args.swing) if node == NODES[-1] else (0.0, 0.0)
        self.node, self.torque, self.turns, self.speed, self.last_us = node, 0.0, self.start, 0.0, now_us()

    def push(self, torque, commanded):
        """Sets the torque that acts, and notes the one that was commanded."""
        global first_torque_us
        self.torque = torque
        if abs(torque) > FINE and first_torque_us is None:
            first_torque_us = now_us()
        log.write(f"{now_us()},{self.node},{commanded:.9g},{self.turns:.9g}\n")

    def move(self):
        now = now_us()
        dt = min(1e-6 * (now - self.last_us), 0.005)
        self.last_us = now
        hand = self.start + self.swing * 0.5 * (1 - math.cos(math.pi * 1e-6 * (now - begin_us)))
        v = (self.speed + dt * (2 * math.pi * self.torque - 0.2 * (self.turns - hand)) / 0.002) / (1 + dt * 0.04 / 0.002)
        if not in_trouble("still"):
            self.speed, self.turns = v, self.turns + dt * v
