"""ODrive axes for a bus: `ODriveCANMock` of the PyPI package odrive-can, which decodes and encodes by the published DBC files (`--dbc 0.5.6` or `0.6.10`).
The mock takes no torques; here an axis is that of axes_kit.py, and the encoders come every 2 ms."""
import asyncio
import logging
import math
import pathlib

import can
import cantools
import odrive_can
from axes_kit import NODES, Plant, args, in_trouble, over, wires
from odrive_can.mock import ODriveCANMock

DBC = cantools.database.load_file(pathlib.Path(odrive_can.__file__).parent / "dbc" / f"odrive-cansimple-{args.dbc}.dbc")
logging.disable(logging.CRITICAL)


class Axis(ODriveCANMock):
    def __init__(self, node, bus):
        self.plant, self.error = Plant(node), 0
        super().__init__(node, bus)
        self.notifier.stop()  # main() hands out the frames: one bus has one notifier
        self.dbc = DBC

    async def execute_cmd(self, cmd, data):
        if cmd == "Set_Input_Torque":
            torque = data["Input_Torque"]
            assert self.odrive.control_mode == "TORQUE_CONTROL" or torque == 0
            self.plant.push(torque if self.odrive.axis_state == "CLOSED_LOOP_CONTROL" else 0.0, torque)
        elif cmd == "Clear_Errors":
            self.error = 0
        elif cmd == "Set_Axis_State":
            self.odrive.axis_state = str(data["Axis_Requested_State"])
        else:
            await super().execute_cmd(cmd, data)

    async def encoders(self):
        frame = self.dbc.get_message_by_name(f"Axis{self.axis_id}_Get_Encoder_Estimates")
        while not over():
            self.plant.move()
            if in_trouble("error") and self.error == 0:
                self.error = 0x800
            turns = math.nan if in_trouble("nonsense") else self.plant.turns
            data = frame.encode({"Pos_Estimate": turns, "Vel_Estimate": self.plant.speed})
            for _ in range(50 if in_trouble("flood") else 1):
                self.bus.send(can.Message(arbitration_id=frame.frame_id, data=data[:5] if in_trouble("short") else data, is_extended_id=False))
            await asyncio.sleep(0.05 if in_trouble("late") else args.pause)

    async def beats(self):
        frame = self.dbc.get_message_by_name(f"Axis{self.axis_id}_Heartbeat")
        while not over():
            signals = {signal.name: 0 for signal in frame.signals} | {"Axis_Error": self.error, "Axis_State": self.odrive.axis_state if not self.error else "IDLE"}
            self.bus.send(can.Message(arbitration_id=frame.frame_id, data=frame.encode(signals, strict=False), is_extended_id=False))
            await asyncio.sleep(0.02)


async def main():
    bus = wires()
    axes = {node: Axis(node, bus) for node in NODES}

    async def dispatch():
        while not over():
            message = bus.recv(0)
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
