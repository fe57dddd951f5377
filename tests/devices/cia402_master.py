"""The master of the PyPI package canopen (profiles.p402) drives an emulated drive: the emulator is checked by a client that is not ours.

    cia402_master.py BUS_DIR NAME NODE --log FILE"""
import time

import canopen
from axes_kit import NODES, wires
from canopen.profiles.p402 import BaseNode402
from cia402_dictionary import COUNTS, dictionary

network = canopen.Network(bus=wires())
network.connect()
node = BaseNode402(NODES[0], dictionary(NODES[0]))
network.add_node(node)
node.nmt.state = "PRE-OPERATIONAL"
for record in (node.rpdo, node.tpdo):
    record.read()
for one, names in ((node.rpdo[1], ("Controlword", "Target torque")), (node.tpdo[1], ("Statusword", "Position actual value"))):
    one.clear()
    for name in names:
        one.add_variable(name)
    one.trans_type, one.enabled = 1, True
    one.save()
node.sdo[0x6060].raw = 10
assert node.sdo["Motor rated torque"].raw == 240
node.setup_402_state_machine(read_pdos=False)
node.nmt.state = "OPERATIONAL"
network.sync.start(0.005)
node.rpdo[1].start(0.005)
node.state = "OPERATION ENABLED"
print(node.state)
node.rpdo[1]["Target torque"].raw = 100
node.rpdo[1].update()
time.sleep(0.3)
print(node.tpdo[1]["Position actual value"].raw / COUNTS)
node.rpdo[1].stop()
network.sync.stop()
network.disconnect()
