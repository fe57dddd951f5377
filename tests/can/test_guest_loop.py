"""haptic-rt and tm-device, unchanged, over a real kernel's CAN in a guest: user-mode Linux with vcan, QEMU with two emulated SJA1000 controllers.
What happened is read from stock candump's log and from the programs' JSON. A lost command is a gap in its counter; lateness is not looked at."""
import json

import cantools
import guest_run
import pytest
from conftest import BUILD, LONG, ROOT

BUSES = ["vcan", "controllers"]
STEADY_S = 60 if LONG else 8
DATABASE = cantools.database.load_file(ROOT / "haptic_rt" / "can" / "impulse_engine.dbc")
MESSAGE = {message.frame_id: message for message in DATABASE.messages}
ZERO_WITHIN_US = 150000
WATCHDOG_US = 20000

# Steps of a tenth of a newton every 40 ms, so that each sample shows in the torques: along the shaft, out of the body.
FORCE_N = (1.5, 1.6)


def samples(seconds):
    rows = [f"{0.04 * i:.3f},0,0,{-FORCE_N[i % 2]}" for i in range(int(seconds / 0.04))]
    return "time_s,fx_N,fy_N,fz_N\n" + "\n".join(rows) + "\n"


def job(seconds, body, sample_seconds=None):
    """Both devices and both controllers for `seconds`; `body` runs meanwhile with PIDs in d0 d1 c0 c1. All must end in time."""
    return f"""
cd {ROOT}
cat > /tmp/samples.csv <<END
{samples(sample_seconds or seconds + 1)}END
candump -L $CAN_A,0:0,#FFFFFFFF > $OUT/a.log & candump=$!
if [ $CAN_A != $CAN_B ]; then candump -L $CAN_B,0:0,#FFFFFFFF > $OUT/b.log & candump="$candump $!"; fi
for i in 0 1; do
    {BUILD}/bin/tm-device --bus socketcan:$CAN_B --instrument $i --duration {seconds + 1} --json $OUT/d$i.json 2> $OUT/d$i.txt & eval d$i=$!
done
sleep 0.2
for i in 0 1; do
    {BUILD}/bin/haptic-rt --bus socketcan:$CAN_A --instrument $i --samples /tmp/samples.csv --extrapolator hold --trocar 0,0,0 --duration {seconds} \\
        --json $OUT/c$i.json --record $OUT/c$i.csv --stats 2> $OUT/c$i.txt > $OUT/c$i.stats & eval c$i=$!
done
{body}
wait $d0 $d1 $c0 $c1
sleep 0.2
kill $candump
cat $OUT/*.txt
true
"""


class Log:
    """candump's log, decoded by the DBC file; messages by name, as (time in us, signals)."""

    def __init__(self, path):
        self.frames = guest_run.candump(path)
        self.named = {}
        self.errors = [f for f in self.frames if f[2] & 0x20000000 and f[2] > 0x7FF]
        for time_us, _, identifier, data in self.frames:
            if identifier in MESSAGE:
                message = MESSAGE[identifier]
                self.named.setdefault(message.name, []).append((time_us, message.decode(data, decode_choices=False)))

    def awake_us(self, begin_us, end_us):
        """Time between, less that in which the whole guest stood still because its host did: with a device and its controller alive, three frames come
        every 2 ms; a hole of more than 4 ms in all of them is the host's."""
        times = [begin_us] + [t for t, _, _, _ in self.frames if begin_us < t < end_us] + [end_us]
        return sum(min(b - a, 4000) for a, b in zip(times, times[1:]))

    def all(self, name):
        return self.named.get(name, [])


def gaps(messages):
    counters = [signals["Counter"] for _, signals in messages]
    return sum((b - a - 1) % 128 for a, b in zip(counters, counters[1:]))


def push(signals):
    return max(abs(signals[k]) for k in ("TorquePitch", "TorqueYaw", "ForceInsertion"))


def run(bus, name, seconds, body, limit_s, sample_seconds=None):
    done, out = guest_run.run(guest_run.on(bus), bus, f"{name}_{bus}", job(seconds, body, sample_seconds), limit_s)
    assert done.returncode == 0, done.stderr
    return out


def told(out, which):
    return json.loads((out / f"{which}.json").read_text())


@pytest.mark.parametrize("bus", BUSES)
def test_two_devices_without_a_lost_command(bus):
    out = run(bus, "steady", STEADY_S, "", 90 + 20 * STEADY_S)
    log = Log(out / "a.log")
    assert not log.errors
    for i in (0, 1):
        commands, encoders_a, encoders_b = log.all(f"MotorCommand{i}"), log.all(f"EncoderA{i}"), log.all(f"EncoderB{i}")
        controller, device = told(out, f"c{i}"), told(out, f"d{i}")
        assert len(commands) == controller["ticks"] + 1, "one a tick, and \"motors off\" at the end"
        assert controller["ticks"] == 500 * STEADY_S
        assert gaps(commands) == 0 and gaps(encoders_a) == 0 and gaps(encoders_b) == 0
        assert len(commands) > 0.98 * 500 * STEADY_S, f"{len(commands)} commands in {STEADY_S} s"
        assert len(encoders_a) > 0.98 * 500 * (STEADY_S + 0.5) and len(encoders_a) == len(encoders_b)
        assert controller["fault"] == "none" and not log.all(f"DeviceFault{i}")
        assert all(s["Fault"] == 0 for _, s in log.all(f"DeviceHeartbeat{i}") + log.all(f"ControllerHeartbeat{i}"))
        assert controller["can"]["lost"] == 0 and device["can"]["lost"] == 0 and device["can"]["corrupt"] == 0
        # What was asked for is what the motors get: the force along the shaft, once it is ramped in.
        settled = [s for t, s in commands if commands[0][0] + 2000000 < t < commands[-1][0]]
        assert settled and all(s["MotorsOn"] for s in settled)
        assert all(FORCE_N[0] - 0.02 < -s["ForceInsertion"] < FORCE_N[1] + 0.02 for s in settled)
        assert {round(-s["ForceInsertion"], 1) for s in settled} >= set(FORCE_N)
    span_us = log.frames[-1][0] - log.frames[0][0]
    bits = sum(47 + 8 * len(data) + (34 + 8 * len(data) - 1) // 4 for _, _, _, data in log.frames)
    assert bits / span_us < 0.60, f"bus load {100 * bits / span_us:.1f} % of 1 Mbit/s with the worst stuffing"


@pytest.mark.parametrize("bus", BUSES)
def test_simulation_killed(bus):
    """Samples stop at 2 s of their time. The last one shows as the last step of the force."""
    out = run(bus, "silent", 4, "", 120, sample_seconds=2)
    log = Log(out / "a.log")
    for i in (0, 1):
        commands = log.all(f"MotorCommand{i}")
        force = [(t, -s["ForceInsertion"]) for t, s in commands]
        steps = [t for (_, a), (t, b) in zip(force, force[1:]) if abs(b - a) > 0.08 and FORCE_N[0] - 0.02 < b < FORCE_N[1] + 0.02]
        pushing = [t for t, s in commands if push(s) > 0]
        assert len(steps) > 20, "the samples never reached the motors"
        assert log.awake_us(steps[-1], pushing[-1]) < ZERO_WITHIN_US, f"force for {pushing[-1] - steps[-1]} us after the last sample"
        assert commands[-1][0] > pushing[-1] + 1000000, "nothing is commanded any more"
        assert told(out, f"c{i}")["fault"] == "none", "a simulation's end is no fault"


@pytest.mark.parametrize("bus", BUSES)
def test_device_unplugged(bus):
    out = run(bus, "unplugged", 4, "sleep 2; kill -9 $d0", 120)
    log = Log(out / "a.log")
    commands = log.all("MotorCommand0")
    last_us = log.all("EncoderA0")[-1][0]
    assert last_us < log.frames[-1][0] - 1000000
    assert any(push(s) > 1 for t, s in commands if t < last_us)
    late_us = log.awake_us(last_us, max(t for t, s in commands if push(s) > 0 or s["MotorsOn"]))
    assert late_us < ZERO_WITHIN_US, f"force for {late_us} us after the device's last word"
    assert told(out, "c0")["state"] != "engaged"
    assert told(out, "c1")["fault"] == "none" and push(log.all("MotorCommand1")[-2][1]) > 1, "the other device must not feel it"
    assert gaps(log.all("MotorCommand1")) == 0


@pytest.mark.parametrize("bus", BUSES)
def test_controller_killed(bus):
    """The device's watchdog drops the torque within 20 ms and says so."""
    out = run(bus, "orphaned", 4, "sleep 2; kill -9 $c0", 120)
    log = Log(out / "a.log")
    last_us, last = log.all("MotorCommand0")[-1]
    assert push(last) > 1 and last["MotorsOn"]
    faults = log.all("DeviceFault0")
    assert faults, "the watchdog said nothing"
    assert 0 < log.awake_us(last_us, faults[0][0]) < WATCHDOG_US + 4000, f"{faults[0][0] - last_us} us; the watchdog's time and a step of the device"
    assert faults[0][1]["Code"] == 1
    beats = [s for t, s in log.all("DeviceHeartbeat0") if t > faults[0][0]]
    assert beats and all(s["Fault"] == 1 for s in beats)
    assert not log.all("DeviceFault1") and gaps(log.all("MotorCommand1")) == 0


def test_bus_off():
    """An error frame says bus-off; nothing else can on vcan. Both controllers let go, and come back only by a reset."""
    out = run("vcan", "bus_off", 4, "sleep 2; cansend $CAN_A 20000040#0000000000000000", 120)
    log = Log(out / "a.log")
    assert len(log.errors) == 1
    off_us = log.errors[0][0]
    for i in (0, 1):
        commands = log.all(f"MotorCommand{i}")
        assert any(push(s) > 1 for t, s in commands if t < off_us)
        pushing_us = log.awake_us(off_us, max(t for t, s in commands if push(s) > 0))
        assert pushing_us < 10000, f"force for {pushing_us} us after bus-off"
        assert told(out, f"c{i}")["fault"] == "bus_off" and told(out, f"c{i}")["can"]["bus_off"] == 1
        assert commands[-1][0] > off_us + 1000000 and not commands[-1][1]["MotorsOn"], "recovered: commands again, without torque"


def test_interface_down():
    """The controller's own interface goes down and up again: the device hears nothing and its watchdog acts."""
    body = "sleep 2; /bin/ip link set $CAN_A down; sleep 0.5; /bin/ip link set $CAN_A up; sleep 0.1; candump -L $CAN_A,0:0,#FFFFFFFF > $OUT/c.log & candump=\"$candump $!\""
    out = run("controllers", "down", 5, body, 150)
    log = Log(out / "b.log")
    for i in (0, 1):
        commands, faults = log.all(f"MotorCommand{i}"), log.all(f"DeviceFault{i}")
        silence = [(a, b) for (a, _), (b, _) in zip(commands, commands[1:]) if b - a > 300000]
        assert len(silence) == 1, "the commands stop once and come again"
        last_us = silence[0][0]
        assert push(next(s for t, s in commands if t == last_us)) > 1
        assert faults and 0 < log.awake_us(last_us, faults[0][0]) < WATCHDOG_US + 4000
        assert told(out, f"c{i}")["fault"] == "bus_off"
        assert all(push(s) == 0 for t, s in commands if t > silence[0][1]), "no torque before a reset"
