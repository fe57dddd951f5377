"""Reads and disturbs a virtual bus: haptic_rt/io/bus_virtual.h in Python."""
import mmap
import os
import struct
import threading
import time

SLOTS, HEADER, SLOT = 4096, 64, 88
FD = 8  # a flag: CAN-FD


class VirtualBus:
    def __init__(self, directory, name):
        self.path = os.path.join(directory, name + ".bus")
        end = time.monotonic() + 60
        while not os.path.exists(self.path) or os.path.getsize(self.path) != HEADER + SLOTS * SLOT:
            assert time.monotonic() < end, f"{self.path} never came"
            time.sleep(0.002)
        self.file = open(self.path, "r+b")
        self.map = mmap.mmap(self.file.fileno(), 0)
        self.next = self.head()

    def head(self):
        return struct.unpack_from("<Q", self.map, 8)[0]

    def set_off(self, off):
        struct.pack_into("<Q", self.map, 16, 1 if off else 0)

    def receive(self):
        """Returns [(id, data)] received since the last call."""
        return [(identifier, data) for identifier, data, _ in self.receive_flagged()]

    def receive_flagged(self):
        """Returns [(id, data, flags)] received since the last call."""
        frames = []
        head = self.head()
        while self.next < head:
            at = HEADER + SLOT * (self.next % SLOTS)
            stamp, _, identifier, length, flags = struct.unpack_from("<QQIBB", self.map, at)
            if stamp != self.next + 1:
                break
            frames.append((identifier, bytes(self.map[at + 22:at + 22 + length]), flags))
            self.next += 1
        return frames

    def send(self, identifier, data, flags=0):
        """Not atomic, unlike the C side; sufficient between its frames."""
        number = self.head()
        struct.pack_into("<Q", self.map, 8, number + 1)
        at = HEADER + SLOT * (number % SLOTS)
        struct.pack_into("<QQIBB64s", self.map, at, 0, 1, identifier, len(data), flags, bytes(data).ljust(64, b"\0"))
        struct.pack_into("<Q", self.map, at, number + 1)


class Watch(threading.Thread):
    """Records when frames pass, to about a millisecond."""

    def __init__(self, bus):
        super().__init__(daemon=True)
        self.bus, self.frames, self.stop = bus, [], False
        self.start()

    def run(self):
        while not self.stop:
            now = time.monotonic()
            self.frames += [(now, identifier, data) for identifier, data in self.bus.receive()]
            time.sleep(0.0005)

    def last(self, identifier):
        return next(((t, d) for t, i, d in reversed(self.frames) if i == identifier), (None, None))


def torque(data):
    return struct.unpack_from("<hhh", data)


def crc8(data):
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = ((crc << 1) ^ 0x1D if crc & 0x80 else crc << 1) & 0xFF
    return crc ^ 0xFF
