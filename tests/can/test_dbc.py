"""The codec and the DBC file (read by Python's cantools) agree bit by bit in both directions; the bus load is that of docs/can.md."""
import ctypes
import random

import cantools
import pytest

KINDS = {"MotorCommand": 7, "EncoderA": 3, "EncoderB": 4, "DeviceHeartbeat": 5, "DeviceFault": 6, "ControllerHeartbeat": 8, "Reset": 9, "EncoderC": 10, "HandleCommand": 11}
FIRST = {"MotorCommand": 0x100, "EncoderA": 0x110, "EncoderB": 0x118, "DeviceFault": 0x080, "Reset": 0x090, "DeviceHeartbeat": 0x700,
         "ControllerHeartbeat": 0x710, "EncoderC": 0x114, "HandleCommand": 0x108}


class Frame(ctypes.Structure):
    _fields_ = [("id", ctypes.c_uint32), ("length", ctypes.c_uint8), ("flags", ctypes.c_uint8), ("data", ctypes.c_uint8 * 64)]  # HRT_CAN_DATA


class Message(ctypes.Structure):
    _fields_ = [("kind", ctypes.c_int), ("instrument", ctypes.c_int32), ("counter", ctypes.c_uint8), ("count", ctypes.c_int32 * 5),
                ("pedal", ctypes.c_bool), ("motors_on", ctypes.c_bool), ("torque", ctypes.c_float * 3), ("state", ctypes.c_uint8),
                ("fault", ctypes.c_uint8), ("session", ctypes.c_uint16), ("gaps", ctypes.c_uint16), ("detail", ctypes.c_uint16),
                ("tilt", ctypes.c_int32 * 2), ("handle_Nm", ctypes.c_float * 3)]


@pytest.fixture(scope="module")
def codec(build):
    lib = ctypes.CDLL(str(build / "tests/can/codec.so"))
    lib.hrt_can_pack.restype = ctypes.c_bool
    return lib


@pytest.fixture(scope="module")
def dbc(root):
    return cantools.database.load_file(root / "haptic_rt/can/impulse_engine.dbc")


def crc8(data):
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = ((crc << 1) ^ 0x1D if crc & 0x80 else crc << 1) & 0xFF
    return crc ^ 0xFF


def random_message(rng, name, instrument):
    m = Message(kind=KINDS[name], instrument=instrument, counter=rng.randrange(128), pedal=rng.random() < 0.5, motors_on=rng.random() < 0.5,
                state=rng.randrange(3), fault=rng.randrange(1, 256), session=rng.randrange(1, 65536), gaps=rng.randrange(65536),
                detail=rng.randrange(65536))
    for j in range(5):
        m.count[j] = rng.randrange(-32768, 32768)
    for j in range(2):
        m.tilt[j] = rng.randrange(-32768, 32768)
    for j in range(3):
        m.handle_Nm[j] = rng.randrange(-32768, 32768) * 2e-4
        m.torque[j] = rng.randrange(-32768, 32768) * (1e-3 if j == 2 else 1e-4)
    return m


def signals(name, m):
    """Returns the signals that cantools should read from this message's frame, without the checksum."""
    if name == "MotorCommand":
        return {"TorquePitch": m.torque[0], "TorqueYaw": m.torque[1], "ForceInsertion": m.torque[2], "Counter": m.counter, "MotorsOn": int(m.motors_on)}
    if name == "HandleCommand":
        return {**{f"Torque{axis}": m.handle_Nm[j] for j, axis in enumerate("XYZ")}, "Counter": m.counter}
    if name == "EncoderA":
        return {"Pitch": m.count[0], "Yaw": m.count[1], "Insertion": m.count[2], "Counter": m.counter}
    if name == "EncoderC":
        return {"TiltX": m.tilt[0], "TiltY": m.tilt[1], "Counter": m.counter}
    if name == "EncoderB":
        return {"Roll": m.count[3], "Grip": m.count[4], "Counter": m.counter, "Pedal": int(m.pedal)}
    if name == "DeviceHeartbeat":
        return {"State": m.state, "Fault": m.fault, "Session": m.session, "CommandGaps": m.gaps, "Counter": m.counter}
    if name == "ControllerHeartbeat":
        return {"State": m.state, "Fault": m.fault, "EncoderGaps": m.gaps, "Counter": m.counter}
    if name == "DeviceFault":
        return {"Code": m.fault, "Detail": m.detail}
    return {"Key": 0xA5, "Counter": m.counter}


@pytest.mark.parametrize("instrument", [0, 1])
@pytest.mark.parametrize("name", KINDS)
def test_c_packs_what_cantools_reads(codec, dbc, name, instrument):
    rng = random.Random(name + str(instrument))
    definition = dbc.get_message_by_name(f"{name}{instrument}")
    assert definition.frame_id == FIRST[name] + instrument
    for _ in range(200):
        m, frame = random_message(rng, name, instrument), Frame()
        assert codec.hrt_can_pack(ctypes.byref(m), ctypes.byref(frame))
        assert (frame.id, frame.length, frame.flags) == (definition.frame_id, definition.length, 0)
        data = bytes(frame.data[:frame.length])
        assert data[-1] == crc8(bytes([frame.id & 0xFF]) + data[:-1])
        decoded = definition.decode(data, decode_choices=False)
        for signal, value in signals(name, m).items():
            assert decoded[signal] == pytest.approx(value, abs=1e-5), signal
        assert data[:-1] == definition.encode(dict(signals(name, m), Checksum=0), strict=False)[:-1]


@pytest.mark.parametrize("instrument", [0, 1])
@pytest.mark.parametrize("name", KINDS)
def test_c_unpacks_what_cantools_writes(codec, dbc, name, instrument):
    rng = random.Random(name + "back" + str(instrument))
    definition = dbc.get_message_by_name(f"{name}{instrument}")
    for _ in range(200):
        m, out = random_message(rng, name, instrument), Message()
        values = dict(signals(name, m), Checksum=0)
        data = bytearray(definition.encode(values, strict=False))
        data[-1] = crc8(bytes([definition.frame_id & 0xFF]) + data[:-1])
        frame = Frame(definition.frame_id, len(data), 0, (ctypes.c_uint8 * 64)(*data))
        codec.hrt_can_unpack(ctypes.byref(frame), ctypes.byref(out))
        assert (out.kind, out.instrument) == (KINDS[name], instrument)
        for signal, value in signals(name, m).items():
            assert signals(name, out)[signal] == pytest.approx(value, abs=1e-5), signal


def test_values_beyond_the_wire_are_clamped(codec, dbc):
    m, frame = Message(kind=KINDS["MotorCommand"]), Frame()
    for value, expected in ((1e9, 32.767), (-1e9, -32.768), (float("nan"), 0.0), (float("inf"), 32.767)):
        m.torque[2] = value
        assert codec.hrt_can_pack(ctypes.byref(m), ctypes.byref(frame))
        decoded = dbc.get_message_by_name("MotorCommand0").decode(bytes(frame.data[:8]), decode_choices=False)
        assert decoded["ForceInsertion"] == pytest.approx(expected)


def test_any_truncation_and_any_noise_is_refused_or_ours(codec):
    rng = random.Random(8)
    taken = 0
    for _ in range(20000):
        length = rng.randrange(9)
        frame = Frame(rng.choice(list(FIRST.values())) + rng.randrange(2), length, 0, (ctypes.c_uint8 * 64)(*rng.randbytes(8)))
        out = Message()
        codec.hrt_can_unpack(ctypes.byref(frame), ctypes.byref(out))
        taken += out.kind > 1
    assert taken < 20000 / 8 / 256 * 3  # one in 256 passes the checksum by chance, if the length is right


def test_every_message_of_the_dbc_is_packed_and_compared(dbc):
    assert sorted(m.name for m in dbc.messages) == sorted(name + device for name in KINDS for device in "01")
    for name in KINDS:
        compared = {*signals(name, Message()), "Checksum"}
        assert {s.name for s in dbc.get_message_by_name(name + "0").signals} == compared, name


def test_both_devices_have_one_layout(dbc):
    for name in KINDS:
        a, b = dbc.get_message_by_name(name + "0"), dbc.get_message_by_name(name + "1")
        assert b.frame_id == a.frame_id + 1 and a.length == b.length
        assert [(s.name, s.start, s.length, s.is_signed, s.scale) for s in a.signals] == [(s.name, s.start, s.length, s.is_signed, s.scale) for s in b.signals]


def test_bus_load_of_two_devices_is_below_60_percent(dbc):
    bits_per_s = 0.0
    for message in dbc.messages:
        data = 8 * message.length
        bits = 47 + data + (34 + data - 1) // 4  # worst-case stuffing, interframe space
        if message.cycle_time:
            bits_per_s += bits * 1000.0 / message.cycle_time
    print(f"computed load {bits_per_s / 1e4:.1f} % of 1 Mbit/s")
    assert 0.3e6 < bits_per_s < 0.6e6
