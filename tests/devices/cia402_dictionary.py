"""The object dictionary of a CiA 402 drive, for its emulator and for another master."""
import canopen
from canopen import objectdictionary as od

RATED_mNm, COUNTS, PER_TURNS, SWITCH_ON_DISABLED = 240, 65536, 1, 0x0240
RECORDS = {0x1400: (od.UNSIGNED32, od.UNSIGNED8), 0x1600: (od.UNSIGNED32,) * 2, 0x1800: (od.UNSIGNED32, od.UNSIGNED8), 0x1A00: (od.UNSIGNED32,) * 2}
VARIABLES = {0x1000: ("Device type", od.UNSIGNED32, 0x20192), 0x1001: ("Error register", od.UNSIGNED8, 0), 0x1017: ("Producer heartbeat time", od.UNSIGNED16, 0),
             0x6040: ("Controlword", od.UNSIGNED16, 0), 0x6041: ("Statusword", od.UNSIGNED16, SWITCH_ON_DISABLED), 0x6060: ("Modes of operation", od.INTEGER8, 0),
             0x6064: ("Position actual value", od.INTEGER32, 0), 0x6071: ("Target torque", od.INTEGER16, 0), 0x6076: ("Motor rated torque", od.UNSIGNED32, RATED_mNm)}


def variable(name, index, subindex, kind, value, access="rw"):
    v = od.ODVariable(name, index, subindex)
    v.data_type, v.access_type, v.default, v.pdo_mappable = kind, access, value, True
    return v


def dictionary(node):
    o = canopen.ObjectDictionary()
    for index, (name, kind, value) in VARIABLES.items():
        o.add_object(variable(name, index, 0, kind, value, "ro" if index == 0x6076 else "rw"))
    for index, kinds in RECORDS.items():
        record = od.ODRecord(f"Record {index:04X}", index)
        record.add_member(variable("Number", index, 0, od.UNSIGNED8, 2))
        for k, kind in enumerate(kinds, 1):
            value = {(0x1400, 1): 0x200 + node, (0x1800, 1): 0x180 + node}.get((index, k), 255 if index in (0x1400, 0x1800) else 0)
            record.add_member(variable(f"Entry {k}", index, k, kind, value))
        o.add_object(record)
    for index, values in ((0x1016, (0,)), (0x608F, (COUNTS, PER_TURNS))):
        array = od.ODArray(f"Array {index:04X}", index)
        array.add_member(variable("Number", index, 0, od.UNSIGNED8, len(values)))
        for k, value in enumerate(values, 1):
            array.add_member(variable(f"Value {k}", index, k, od.UNSIGNED32, value))
        o.add_object(array)
    return o
