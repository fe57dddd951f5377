"""moteus controllers for a CAN-FD bus, written from the published protocol (mjbots, "moteus reference"); commands are decoded by moteus' own PyPI package.

Stricter than the board: only the registers that a torque needs, and a torque above register 0x025 or a frame of a length that CAN-FD has not is an error.
From fault (1) and time-out (11) only a stop (0) leads on; the watchdog is register 0x027."""
import math
import struct
import time

import can
from axes_kit import NODES, Plant, args, in_trouble, now_us, over, wires
from moteus import multiplex
from moteus.moteus import Mode, Register

LENGTHS = (0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64)
COMMAND = (Register.COMMAND_POSITION, Register.COMMAND_VELOCITY, Register.COMMAND_FEEDFORWARD_TORQUE, Register.COMMAND_KP_SCALE, Register.COMMAND_KD_SCALE,
           Register.COMMAND_POSITION_MAX_TORQUE, Register.COMMAND_TIMEOUT)
bus = wires(fd=True)


class Board:
    def __init__(self, node):
        self.plant, self.mode, self.fault, self.told, self.heard_us = Plant(node), Mode.STOPPED, 0, {}, now_us()

    def write(self, register, value):
        if register == Register.MODE:
            held = self.mode in (Mode.FAULT, Mode.TIMEOUT) and value != Mode.STOPPED
            self.mode, self.fault = (self.mode, self.fault) if held else (Mode(value), 0)
            return
        assert register in COMMAND, register
        self.told[register] = value

    def act(self):
        """Lets the newest command act."""
        if self.mode != Mode.POSITION:
            self.plant.push(0.0, 0.0)
            return
        torque = self.told[Register.COMMAND_FEEDFORWARD_TORQUE]
        assert math.isnan(self.told[Register.COMMAND_POSITION]) and self.told[Register.COMMAND_KP_SCALE] == self.told[Register.COMMAND_KD_SCALE] == 0
        assert abs(torque) <= self.told[Register.COMMAND_POSITION_MAX_TORQUE] * (1 + 1e-6), self.told
        self.plant.push(torque, torque)

    def check(self):
        """The board's own watchdog, and trouble."""
        if self.mode == Mode.POSITION and now_us() - self.heard_us > 1e6 * self.told[Register.COMMAND_TIMEOUT]:
            self.mode = Mode.TIMEOUT
            self.plant.torque = 0.0
        if in_trouble("error") and self.mode == Mode.POSITION:
            self.mode, self.fault = Mode.FAULT, 33
        self.plant.move()

    def answer(self, asked):
        turns = math.nan if in_trouble("nonsense") else self.plant.turns
        value = {Register.MODE: self.mode, Register.POSITION: turns, Register.VELOCITY: self.plant.speed, Register.TORQUE: self.plant.torque, Register.FAULT: self.fault}
        data = b""
        for register, resolution in asked:
            data += bytes([0x20 | resolution << 2 | 1, register]) + struct.pack("<b" if resolution == multiplex.INT8 else "<f", value[Register(register)])
        data = data[:-5] if in_trouble("short") else data
        length = next(n for n in LENGTHS if n >= len(data))
        message = can.Message(arbitration_id=self.plant.node << 8, data=data.ljust(length, bytes([multiplex.NOP])), is_extended_id=True, is_fd=True, bitrate_switch=True)
        for _ in range(50 if in_trouble("flood") else 1):
            bus.send(message)

    def take(self, data):
        asked = []
        for part in multiplex.parse_frame(data):
            assert isinstance(part, multiplex.RegisterSubframe)
            if part.type == multiplex.SubframeType.WRITE:
                self.write(part.register, part.value)
            else:
                asked.append((part.register, part.resolution))
        self.heard_us = now_us()
        self.act()
        self.check()
        if in_trouble("late"):
            waiting.append((now_us() + 50000, self, asked))
        else:
            self.answer(asked)


boards, waiting = {node: Board(node) for node in NODES}, []
print("ready", flush=True)
while not over():
    message = bus.recv(0)
    while waiting and waiting[0][0] < now_us():
        _, board, asked = waiting.pop(0)
        board.answer(asked)
    if message is None:
        for board in boards.values():
            board.check()
        time.sleep(0.0002 if args.directory != "socketcan" else 0.0005)
        continue
    assert message.is_fd and len(message.data) in LENGTHS and message.arbitration_id & 0x8000, message
    board = boards.get(message.arbitration_id & 0x7f)
    if board:
        board.take(bytes(message.data))
