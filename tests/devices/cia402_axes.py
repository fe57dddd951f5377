"""CANopen drives with the profile CiA 402 for a bus: network state, SDO server, PDO maps, heartbeat and EMCY are `LocalNode` of the PyPI package canopen; the
states of the drive, its torque and its watch over the master's heartbeat are written from the profile.

The drive obeys what its object dictionary says: it takes torques only in mode 10, by the PDO maps that were written to it, at SYNC."""
import time

import canopen
from axes_kit import NODES, Plant, args, in_trouble, now_us, over, wires
from cia402_dictionary import COUNTS, PER_TURNS, RATED_mNm, SWITCH_ON_DISABLED, dictionary

READY, SWITCHED_ON, ENABLED, FAULT = 0x0221, 0x0223, 0x0227, 0x0208


class Drive:
    def __init__(self, node, network):
        self.plant, self.status, self.word, self.pending, self.beat_us, self.late_us = Plant(node), SWITCH_ON_DISABLED, 0, None, None, 0
        self.node = canopen.LocalNode(node, dictionary(node))
        self.network, self.mapped = network, False
        network.add_node(self.node)
        network.subscribe(0, self.on_network)
        network.subscribe(0x80, self.on_sync)

    def entry(self, index, subindex=0):
        return self.node.sdo[index][subindex].raw if subindex else self.node.sdo[index].raw

    def on_network(self, can_id, data, timestamp):
        if data[1] not in (0, self.node.id):
            return
        if self.mapped:
            self.network.unsubscribe(self.node.rpdo[1].cob_id, self.on_torque)
            self.mapped = False
        if data[0] == 1:
            self.node.rpdo.read()
            self.node.tpdo.read()
            assert self.node.rpdo[1].trans_type == 1 and self.node.tpdo[1].trans_type == 1
            self.network.subscribe(self.node.rpdo[1].cob_id, self.on_torque)
            self.mapped = True
            master = self.entry(0x1016, 1) >> 16
            self.network.subscribe(0x700 + master, self.on_beat)
        self.beat_us = None  # the watch begins with the first beat (CiA 301)

    def on_beat(self, can_id, data, timestamp):
        self.beat_us = now_us()

    def on_torque(self, can_id, data, timestamp):
        assert len(data) == 4, data
        self.node.rpdo[1].data = bytearray(data)
        self.pending = (self.node.rpdo[1]["Controlword"].raw, self.node.rpdo[1]["Target torque"].raw)

    def obey(self, word):
        rises = word & 0x80 and not self.word & 0x80
        self.word = word
        if self.status == FAULT:
            self.status = SWITCH_ON_DISABLED if rises else FAULT
        elif word & 0x82 == 0 or word & 0x02 == 0:
            self.status = SWITCH_ON_DISABLED
        elif word & 0x0f == 0x06:
            self.status = READY
        elif word & 0x0f == 0x07 and self.status in (READY, ENABLED, SWITCHED_ON):
            self.status = SWITCHED_ON
        elif word & 0x0f == 0x0f and self.status in (SWITCHED_ON, ENABLED):
            self.status = ENABLED

    def fail(self, code):
        self.status, self.plant.torque = FAULT, 0.0
        self.node.emcy.send(code, 1)

    def on_sync(self, can_id, data, timestamp):
        if not self.mapped or in_trouble("silent"):
            return
        if self.pending:
            self.obey(self.pending[0])
            torque = 1e-6 * RATED_mNm * self.pending[1]
            self.plant.push(torque if self.status == ENABLED and self.entry(0x6060) == 10 else 0.0, torque)
            self.pending = None
        self.plant.move()
        self.late_us = now_us() + (50000 if in_trouble("late") else 0)
        if in_trouble("late"):
            late.append((self.late_us, self))
        else:
            self.report()

    def report(self):
        turns = 30000 if in_trouble("nonsense") else self.plant.turns
        self.node.tpdo[1]["Statusword"].raw = self.status
        self.node.tpdo[1]["Position actual value"].raw = round(turns * COUNTS / PER_TURNS)
        if in_trouble("short"):
            self.network.send_message(self.node.tpdo[1].cob_id, bytes(self.node.tpdo[1].data)[:3])
        for _ in range(0 if in_trouble("short") else 50 if in_trouble("flood") else 1):
            self.node.tpdo[1].transmit()

    def check(self):
        gone_ms = self.entry(0x1016, 1) & 0xffff
        if gone_ms and self.beat_us is not None and self.status != FAULT and now_us() - self.beat_us > 1000 * gone_ms:
            self.fail(0x8130)
        if in_trouble("error") and self.status == ENABLED:
            self.fail(0x2310)


late = []
bus = wires()
network = canopen.Network(bus=bus)
drives = [Drive(node, network) for node in NODES]
print("ready", flush=True)
while not over():
    message = bus.recv(0)
    while late and late[0][0] < now_us():
        late.pop(0)[1].report()
    if message is None:
        for drive in drives:
            drive.check()
        time.sleep(0.0002 if args.directory != "socketcan" else 0.0005)
        continue
    network.notify(message.arbitration_id, message.data, 0.0)
