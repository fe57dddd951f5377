"""haptic-rt and tm-device, unchanged, over a real kernel's CAN in a guest: vcan, and two emulated SJA1000 controllers. Its time is counted in
instructions. Events are read from stock candump's log and from the programs' JSON. A lost command is a gap in its counter; lateness is not judged."""
import json

import cantools
import guest_run
import pytest
from guest_scenes import FORCE_N, PLAYED, STEADY_S, part, scene
from paths import ROOT

DATABASE = cantools.database.load_file(ROOT / "haptic_rt" / "can" / "impulse_engine.dbc")
MESSAGE = {message.frame_id: message for message in DATABASE.messages}
ZERO_WITHIN_US = 150000
WATCHDOG_US = 20000
SLACK_US = 6000  # a step of the device, a tick, the frame's transmission
HOLE_US = 8000   # 24 frames that every participant must send


def buses(scene):
    return [bus for bus, scenes in PLAYED.items() if scene in scenes]


class Log:
    """Decodes candump's log by the DBC file; returns messages by name, as (time in us, signals)."""

    def __init__(self, path):
        self.frames = guest_run.candump(path)
        self.named = {}
        self.errors = [f for f in self.frames if f[2] & 0x20000000]
        times = [t for t, _, _, _ in self.frames]
        self.holes = [(a, b) for a, b in zip(times, times[1:]) if b - a > HOLE_US]
        for time_us, _, identifier, data in self.frames:
            if identifier in MESSAGE:
                message = MESSAGE[identifier]
                self.named.setdefault(message.name, []).append((time_us, message.decode(data, decode_choices=False)))

    def all(self, name):
        return self.named.get(name, [])

    def awake_us(self, begin_us, end_us):
        """Returns the time between two instants, without the time in which the complete guest was stopped."""
        times = [begin_us] + [t for t, _, _, _ in self.frames if begin_us < t < end_us] + [end_us]
        return sum(min(b - a, 2000) for a, b in zip(times, times[1:]))


def gaps(messages):
    counters = [signals["Counter"] for _, signals in messages]
    return sum((b - a - 1) % 128 for a, b in zip(counters, counters[1:]))


def push(signals):
    return max(abs(signals[k]) for k in ("TorquePitch", "TorqueYaw", "ForceInsertion"))


def told(out, which):
    return json.loads((out / f"{which}.json").read_text())


@pytest.mark.parametrize("bus", buses("steady"))
def test_two_devices_without_a_lost_command(bus):
    out = scene(bus, "steady")
    log = Log(out / "a.log")
    assert not log.holes
    assert not log.errors
    for i in (0, 1):
        commands, encoders_a, encoders_b = log.all(f"MotorCommand{i}"), log.all(f"EncoderA{i}"), log.all(f"EncoderB{i}")
        controller, device = told(out, f"c{i}"), told(out, f"d{i}")
        assert len(commands) == controller["ticks"] + 1, "one a tick, and \"motors off\" at the end"
        assert controller["ticks"] == 500 * STEADY_S
        assert gaps(commands) == 0 and gaps(encoders_a) == 0 and gaps(encoders_b) == 0
        assert len(encoders_a) > 0.98 * 500 * (STEADY_S + 0.5) and len(encoders_a) == len(encoders_b)
        assert controller["fault"] == "none"
        assert controller["can"]["lost"] == 0 and device["can"]["lost"] == 0 and device["can"]["corrupt"] == 0
        assert not [t for t, _ in log.all(f"DeviceFault{i}")]
        beats = log.all(f"DeviceHeartbeat{i}") + log.all(f"ControllerHeartbeat{i}")
        assert beats and all(s["Fault"] == 0 for t, s in beats)
        # The motors get the requested force: along the shaft, after ramping up.
        settled = [s for t, s in commands if commands[0][0] + 2000000 < t < commands[-1][0]]
        assert settled and all(s["MotorsOn"] for s in settled)
        assert all(FORCE_N[0] - 0.02 < -s["ForceInsertion"] < FORCE_N[1] + 0.02 for s in settled)
        assert {round(-s["ForceInsertion"], 1) for s in settled} >= set(FORCE_N)
    span_us = log.frames[-1][0] - log.frames[0][0]
    bits = sum(47 + 8 * len(data) + (34 + 8 * len(data) - 1) // 4 for _, _, _, data in log.frames)
    assert bits / span_us < 0.60, f"bus load {100 * bits / span_us:.1f} % of 1 Mbit/s with the worst stuffing"


@pytest.mark.parametrize("bus", buses("silent"))
def test_force_fades_when_the_simulation_is_killed(bus):
    """The samples stop. The last one is visible as the last step of the force."""
    out = scene(bus, "silent")
    log = Log(out / "a.log")
    assert not log.holes
    for i in (0, 1):
        commands = log.all(f"MotorCommand{i}")
        force = [(t, -s["ForceInsertion"]) for t, s in commands]
        steps = [t for (_, a), (t, b) in zip(force, force[1:]) if abs(b - a) > 0.08 and FORCE_N[0] - 0.02 < b < FORCE_N[1] + 0.02]
        pushing_us = max(t for t, s in commands if push(s) > 0)
        assert len(steps) > 10, "the samples never reached the motors"
        assert log.awake_us(steps[-1], pushing_us) < ZERO_WITHIN_US, f"force for {pushing_us - steps[-1]} us after the last sample"
        assert commands[-1][0] > pushing_us + 500000, "nothing is commanded any more"
        assert told(out, f"c{i}")["fault"] == "none", "a simulation's end is no fault"


@pytest.mark.parametrize("bus", buses("unplugged"))
def test_unplugged_device_is_a_fault(bus):
    out = scene(bus, "unplugged")
    log = Log(out / "a.log")
    assert not log.holes
    commands, last_us = log.all("MotorCommand0"), log.all("EncoderA0")[-1][0]
    assert last_us < log.frames[-1][0] - 500000
    assert any(push(s) > 1 for t, s in commands if t < last_us)
    late_us = log.awake_us(last_us, max(t for t, s in commands if push(s) > 0 or s["MotorsOn"]))
    assert late_us < ZERO_WITHIN_US, f"force for {late_us} us after the device's last word"
    assert told(out, "c0")["state"] != "engaged"
    assert told(out, "c1")["fault"] == "none" and gaps(log.all("MotorCommand1")) == 0
    other = [push(s) for t, s in log.all("MotorCommand1")[:-1] if t > last_us]
    assert all(p > 1 for p in other), "the other device must not feel it"


@pytest.mark.parametrize("bus", buses("orphaned"))
def test_killed_controllers_torque_is_dropped_by_the_device(bus):
    """The device's watchdog drops the torque within 20 ms and reports it."""
    out = scene(bus, "orphaned")
    log = Log(out / "a.log")
    assert not log.holes
    last_us, last = log.all("MotorCommand0")[-1]
    assert push(last) > 1 and last["MotorsOn"]
    faults = [(t, s) for t, s in log.all("DeviceFault0") if t > last_us]
    assert len(faults) == 1 and faults[0][1]["Code"] == 1, "the watchdog says it once"
    assert 0 < log.awake_us(last_us, faults[0][0]) < WATCHDOG_US + SLACK_US, f"{faults[0][0] - last_us} us"
    beats = [s for t, s in log.all("DeviceHeartbeat0") if t > faults[0][0]]
    assert beats and all(s["Fault"] == 1 for s in beats)
    assert not [t for t, _ in log.all("DeviceFault1")] and gaps(log.all("MotorCommand1")) == 0


def test_bus_off_is_a_fault_until_reset():
    """Bus-off is announced by an error frame, the only possible way on vcan. Both controllers drop the force and return only after a reset."""
    out = scene("vcan", "bus_off")
    log = Log(out / "a.log")
    assert not log.holes
    assert len(log.errors) == 1
    off_us = log.errors[0][0]
    for i in (0, 1):
        commands = log.all(f"MotorCommand{i}")
        assert any(push(s) > 1 for t, s in commands if t < off_us)
        late_us = log.awake_us(off_us, max(t for t, s in commands if push(s) > 0))
        assert late_us < SLACK_US, f"force for {late_us} us after bus-off"
        assert told(out, f"c{i}")["fault"] == "bus_off" and told(out, f"c{i}")["can"]["bus_off"] == 1
        assert commands[-1][0] > off_us + 500000 and not commands[-1][1]["MotorsOn"], "recovered: commands again, without torque"


def test_interface_down_drops_the_torque():
    """The controller's own interface goes down and up again: the device receives nothing and its watchdog acts."""
    out = scene("controllers", "down")
    log = Log(out / "b.log")
    for i in (0, 1):
        commands, faults = log.all(f"MotorCommand{i}"), log.all(f"DeviceFault{i}")
        silence = [(a, b) for (a, _), (b, _) in zip(commands, commands[1:]) if b - a > 300000]
        assert len(silence) == 1, "the commands stop once and come again"
        last_us = silence[0][0]
        assert push(next(s for t, s in commands if t == last_us)) > 1
        assert faults and 0 < faults[0][0] - last_us < WATCHDOG_US + SLACK_US
        assert told(out, f"c{i}")["fault"] == "bus_off"
        assert all(push(s) == 0 for t, s in commands if t > silence[0][1]), "no torque before a reset"


def test_loop_sleeps_receives_and_sends_only():
    """docs/dedicated-machine.md: the loop's thread sleeps, receives and sends."""
    out = part("calls")
    calls = {}
    for line in (out / "trace").read_text(errors="replace").splitlines():
        thread, _, rest = line.partition(" ")
        calls.setdefault(thread, []).append(rest.strip().split("(")[0])
    loop = max(calls.values(), key=lambda names: names.count("clock_nanosleep"))
    first, last = loop.index("clock_nanosleep"), len(loop) - 1 - loop[::-1].index("clock_nanosleep")
    under_way = [name for name in loop[first:last] if name.isidentifier()]
    assert under_way.count("clock_nanosleep") > 1000 and under_way.count("recvfrom") > 2000 and under_way.count("sendto") > 1000
    assert set(under_way) <= {"clock_nanosleep", "recvfrom", "sendto", "getrusage", "clock_gettime"}, set(under_way)
