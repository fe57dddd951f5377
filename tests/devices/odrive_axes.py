"""ODrive axes for a bus: `ODriveCANMock` of the PyPI package odrive-can, which decodes and encodes by the published DBC files, on our virtual bus. The mock
takes no torques; here an axis is a mass with friction that a hand holds, and the encoders come every 2 ms.

    odrive_axes.py BUS_DIR NAME NODE,NODE,... --log FILE [--dbc 0.5.6] [--trouble error|nonsense|short|still|late|flood --after S]

A line of the log: time_us,node,torque (N m),turns. `--after` counts from the first torque."""
import argparse
import asyncio
import logging
import math
import pathlib
import sys
import time

import can
import cantools
import odrive_can
from odrive_can.mock import ODriveCANMock

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "loop"))
from virtual_bus import VirtualBus  # noqa: E402

parser = argparse.ArgumentParser()
parser.add_argument("directory")
parser.add_argument("name")
parser.add_argument("nodes")
parser.add_argument("--log", required=True)
parser.add_argument("--dbc", default="0.6.10")
parser.add_argument("--trouble", default="")
parser.add_argument("--after", type=float, default=0.5)
args = parser.parse_args()
DBC = cantools.database.load_file(pathlib.Path(odrive_can.__file__).parent / "dbc" / f"odrive-cansimple-{args.dbc}.dbc")
logging.disable(logging.CRITICAL)
log = open(args.log, "w", buffering=1)
first_torque_us = None
noted = False


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


class Wires(can.BusABC):
    """python-can's interface to the virtual bus."""

    def __init__(self):
        super().__init__(channel=args.name)
        self.bus, self.waiting, self.own = VirtualBus(args.directory, args.name), [], []

    def send(self, msg, timeout=None):
        self.own.append((msg.arbitration_id, bytes(msg.data)))
        self.bus.send(msg.arbitration_id, bytes(msg.data))

    def _recv_internal(self, timeout):
        for frame in self.bus.receive():
            if frame in self.own:
                self.own.remove(frame)
            else:
                self.waiting.append(frame)
        if not self.waiting:
            time.sleep(0.0005)
            return None, False
        identifier, data = self.waiting.pop(0)
        return can.Message(arbitration_id=identifier, data=data, is_extended_id=False), False


class Axis(ODriveCANMock):
    def __init__(self, node, bus):
        self.torque, self.turns, self.speed, self.last_us, self.error = 0.0, 0.0, 0.0, now_us(), 0
        super().__init__(node, bus)
        self.notifier.stop()  # main() hands out the frames: one bus has one notifier
        self.dbc = DBC

    async def execute_cmd(self, cmd, data):
        global first_torque_us
        if cmd == "Set_Input_Torque":
            assert self.odrive.control_mode == "TORQUE_CONTROL" or data["Input_Torque"] == 0
            self.torque = data["Input_Torque"] if self.odrive.axis_state == "CLOSED_LOOP_CONTROL" else 0.0
            if self.torque and first_torque_us is None:
                first_torque_us = now_us()
            log.write(f"{now_us()},{self.axis_id},{data['Input_Torque']:.9g},{self.turns:.9g}\n")
        elif cmd == "Clear_Errors":
            self.error = 0
        elif cmd == "Set_Axis_State":
            self.odrive.axis_state = str(data["Axis_Requested_State"])
        else:
            await super().execute_cmd(cmd, data)

    def move(self):
        now = now_us()
        dt = min(1e-6 * (now - self.last_us), 0.005)
        self.last_us = now
        v = (self.speed + dt * (2 * math.pi * self.torque - 0.2 * self.turns) / 0.002) / (1 + dt * 0.04 / 0.002)
        if not in_trouble("still"):
            self.speed, self.turns = v, self.turns + dt * v

    async def encoders(self):
        frame = self.dbc.get_message_by_name(f"Axis{self.axis_id}_Get_Encoder_Estimates")
        while True:
            self.move()
            if in_trouble("error") and self.error == 0:
                self.error = 0x800
            turns = math.nan if in_trouble("nonsense") else self.turns
            data = frame.encode({"Pos_Estimate": turns, "Vel_Estimate": self.speed})
            for _ in range(50 if in_trouble("flood") else 1):
                self.bus.send(can.Message(arbitration_id=frame.frame_id, data=data[:5] if in_trouble("short") else data, is_extended_id=False))
            await asyncio.sleep(0.05 if in_trouble("late") else 0.001)

    async def beats(self):
        frame = self.dbc.get_message_by_name(f"Axis{self.axis_id}_Heartbeat")
        while True:
            signals = {signal.name: 0 for signal in frame.signals} | {"Axis_Error": self.error, "Axis_State": self.odrive.axis_state if not self.error else "IDLE"}
            self.bus.send(can.Message(arbitration_id=frame.frame_id, data=frame.encode(signals, strict=False), is_extended_id=False))
            await asyncio.sleep(0.02)


async def main():
    wires = Wires()
    axes = {int(node): Axis(int(node), wires) for node in args.nodes.split(",")}

    async def dispatch():
        while True:
            message = wires.recv(0)
            if message is None:
                await asyncio.sleep(0)
                continue
            axis = axes.get(message.arbitration_id >> 5)
            if axis is None:
                continue
            decoded = axis.dbc.get_message_by_frame_id(message.arbitration_id)
            await axis.execute_cmd(decoded.name.split("_", 1)[1], decoded.decode(message.data))
    print("ready", flush=True)
    await asyncio.gather(dispatch(), *(axis.encoders() for axis in axes.values()), *(axis.beats() for axis in axes.values()))

asyncio.run(main())
