"""haptic-rt with Haply's service, emulated (haply_service.py; test_haply_client.py checks the emulator by other clients)."""
import signal
import subprocess
import time

import pytest
from drivekit import Controller, FORCE, commands, emulator, expected, pushed, samples, wait_for
from paths import BUILD, LONG

HAPTIC = BUILD / "bin/haptic-rt"
ENGAGED, FAULT = 3, 5
QUANTUM_N = 0.5e-5 + 2e-6  # half the last digit of a command, and of a float
STOP_MS = 50               # stated: docs/device-failures.md


def built_in():
    return "not built in" not in subprocess.run([HAPTIC, "--list"], capture_output=True, text=True, timeout=30).stdout


pytestmark = pytest.mark.skipif(not built_in(), reason="haptic-rt was built without libwebsockets (libwebsockets-dev)")


def turned(log):
    """Returns whether the emulated hand has come to rest, after 3 s, and 600 forces were large."""
    sent = commands(log)[0] if log.exists() else []
    return len(sent) > 1000 and sent[-1][0] - sent[0][0] > 3.2e6 and sum(abs(row[1][2]) > 1.4 for row in sent) > 600


@pytest.mark.parametrize("version", ["3.5", "3.4"])
def test_force_and_motion_arrive_with_their_units_and_signs(tmp_path, version):
    with emulator(tmp_path, "--version", version, "--move", "0.02,-0.01,-0.03") as (_, port, log):
        controller = Controller(tmp_path, f"haply:0@127.0.0.1:{port}", "--samples", samples(tmp_path, seconds=60))
        wait_for(lambda: turned(log), 40)  # by the emulator's time and count: a busy machine starts either late
        report, rows, said = controller.end()
    sent, _ = commands(log)
    ticks = iter(rows)
    tick, checked = next(ticks), 0
    for time_us, wanted, _, _ in sent[:-1]:  # each is the force of a tick, of increasing time, none from a later tick
        if not any(wanted):
            continue
        while max(abs(a - b) for a, b in zip(wanted, expected(tick))) > QUANTUM_N:
            tick = next(ticks, None)
            assert tick and tick["t_us"] <= time_us, (time_us, wanted)
        checked += 1
    assert checked > 500
    settled = [row for row in sent if abs(row[1][2]) > 1.4]
    assert settled and all(row[1][0] < 0 and row[1][1] < 0 and row[1][2] > 0 for row in settled), "left is not right, into the body is down"
    assert all(max(abs(a - b) for a, b in zip(row[1], row[2])) < 1e-9 for row in settled), "the service's filters are off"
    first, last = rows[200], rows[-1]
    close = min(sent, key=lambda row: abs(row[0] - last["t_us"]))
    moved = [b - a for a, b in zip(sent[0][3], close[3])]
    assert moved[0] > 0.01 and moved[2] < -0.01
    for axis, sign, of in (("x_m", -1, 0), ("y_m", 1, 1), ("z_m", -1, 2)):
        assert abs(last[axis] - (0.1 if axis == "z_m" else 0) - sign * moved[of]) < 0.001, (axis, first, last)
    assert abs(last["roll_rad"] - 1.5) < 0.2, "the handle turned by 0.5 rad/s"
    assert report["drive"]["refused"] == 0 and report["drive"]["connections"] == 1 and report["drive"]["states"] > 1000
    assert sent[-1][1] == [0, 0, 0] or not any(sent[-1][1]), "its last word is no force"
    assert "filters" not in said


def test_filters_that_stay_on_are_reported(tmp_path):
    with emulator(tmp_path, "--stuck-filters") as (_, port, log):
        said = Controller(tmp_path, f"haply:0@127.0.0.1:{port}", "--samples", samples(tmp_path), "--duration", 1)
        said.child.wait(timeout=20)
        assert "the service's filters change the force" in said.end()[2]


def stop_times(rows, since_us):
    """Milliseconds until the controller's force is zero."""
    after = [row for row in rows if row["t_us"] >= since_us]
    return next(1e-3 * (row["t_us"] - since_us) for row in after if not any(expected(row)))


TROUBLES = ("killed", "frozen", "flood", "late:50", "nonsense", "silent", "close", "unpowered")


def in_trouble(tmp_path, trouble):
    """Plays one trouble; returns (ms until the controller's force is zero, ms until the last force at the emulator, report, rows, output)."""
    own = trouble in ("killed", "frozen")
    with emulator(tmp_path, *([] if own else ["--trouble", trouble, "--after", 0.8])) as (service, port, log):
        controller = Controller(tmp_path, f"haply:0@127.0.0.1:{port}", "--samples", samples(tmp_path))
        wait_for(lambda: pushed(log))
        if own:
            time.sleep(0.3)
            service.send_signal(signal.SIGKILL if trouble == "killed" else signal.SIGSTOP)
        since = time.monotonic_ns() // 1000
        if own:
            time.sleep(0.4)
        else:
            wait_for(lambda: commands(log)[1])
        if trouble == "frozen":
            thawed = time.monotonic_ns() // 1000
            service.send_signal(signal.SIGCONT)
        time.sleep(0.6)
        report, rows, said = controller.end()
    sent, told = commands(log)
    since = since if own else told
    late = [row[0] for row in sent if row[0] > since and any(row[1])]
    if trouble == "frozen":  # one force may wait in its socket; then all are zero until it engages again
        after = [row for row in sent if row[0] > since]
        assert sum(1 for row in after[:20] if any(row[1])) <= 1
        late = [row[0] for row in after[:20] if any(row[1])]
        return stop_times(rows, since), 1e-3 * (late[-1] - thawed) if late else 0.0, report, rows, said
    first_zero = next((row[0] for row in sent if row[0] > since and not any(row[1])), None)
    late = [t for t in late if first_zero is None or t < first_zero]
    return stop_times(rows, since), 1e-3 * (late[-1] - since) if late else 0.0, report, rows, said


# The short form plays what differs most; the long form and device_table.py all.
@pytest.mark.parametrize("trouble", TROUBLES if LONG else ("killed", "flood", "late:50", "nonsense"))
def test_trouble_ends_the_force(tmp_path, trouble):
    controller_ms, device_ms, report, rows, said = in_trouble(tmp_path, trouble)
    print(f"{trouble}: controller {controller_ms:.1f} ms, at the emulator {device_ms:.1f} ms, {report['state']} {report['fault']}")
    assert controller_ms <= STOP_MS and device_ms <= STOP_MS
    if trouble in ("nonsense", "flood"):
        assert report["fault"] == "device_reported" and rows[-1]["state"] == FAULT
        assert not any(expected(rows[-1]))
    if trouble in ("late:50", "silent", "close", "killed", "unpowered"):
        assert rows[-1]["state"] != ENGAGED
    if trouble == "frozen":
        assert rows[-1]["state"] == ENGAGED, "it engages anew once the service is back, by the ramp"
    if trouble == "unpowered":
        assert "no power supply" in said


def test_the_service_comes_back(tmp_path):
    with emulator(tmp_path) as (service, port, log):
        controller = Controller(tmp_path, f"haply:0@127.0.0.1:{port}", "--samples", samples(tmp_path))
        wait_for(lambda: pushed(log))
        service.kill()
        service.wait()
        with emulator(tmp_path, "--port", port, name="again") as (_, _, again):
            wait_for(lambda: pushed(again))
            report, rows, said = controller.end()
    since = commands(again)[0][0][0]
    sizes = [max(map(abs, expected(row))) for row in rows if row["t_us"] > since]
    assert next(size for size in sizes if size) < 0.1 and max(b - a for a, b in zip(sizes, sizes[1:])) < 0.2, "it came by the ramp"
    assert report["drive"]["connections"] == 2 and report["fault"] == "none" and "closed the connection" in said


def test_the_clutch_moves_the_hand_and_not_the_tip(tmp_path):
    with emulator(tmp_path, "--move", "0.05,0,0", "--buttons", "a:0.9-2.2,b:2.6-9") as (_, port, log):
        controller = Controller(tmp_path, f"haply:0@127.0.0.1:{port}", "--samples", samples(tmp_path), "--duration", 3.4)
        controller.child.wait(timeout=20)
        _, rows, _ = controller.end()
    sent, _ = commands(log)
    assert sent[-1][3][0] - sent[0][3][0] > 0.04
    steps = [abs(b["x_m"] - a["x_m"]) for a, b in zip(rows, rows[1:])]
    assert max(steps) < 0.001 and abs(rows[-1]["x_m"]) < 0.01, "no jump, and the tip stayed"
    held = [row for row in rows if 1.2e6 < row["t_us"] - sent[0][0] < 2.0e6]
    assert held and not any(any(expected(row)) for row in held)
    assert rows[-1]["state"] == ENGAGED and rows[-1]["grip"] > 0.99


def test_two_devices_at_once(tmp_path):
    with emulator(tmp_path, "--devices", 2) as (_, port, log):
        pair = []
        for i in (0, 1):
            (tmp_path / str(i)).mkdir()
            pair.append(Controller(tmp_path / str(i), f"haply:{i}@127.0.0.1:{port}", "--instrument", i, "--samples", samples(tmp_path / str(i), (0, 0, -1.0 - i), seconds=60)))
        wait_for(lambda: min(sum(abs(row[1][2] - 1.0 - i) < 1e-3 for row in commands(log)[0]) for i in (0, 1)) > 500, 40)
        for i, controller in enumerate(pair):
            _, rows, _ = controller.end()
            force = [-row["force_z_N"] for row in rows]
            assert sum(abs(f - 1.0 - i) < 1e-3 for f in force) > 200 and max(force) < 1.2 + i  # two messages a tick; late ticks may overshoot
    sizes = {round(row[1][2], 2) for row in commands(log)[0]}
    assert {1.0, 2.0} <= sizes


def test_devices_are_listed(tmp_path):
    with emulator(tmp_path, "--devices", 2) as (_, port, _):
        said = subprocess.run([HAPTIC, "--list"], capture_output=True, text=True, timeout=30, env={"TM_HAPLY": f"127.0.0.1:{port}"}).stdout
    assert "haply:0          inverse3 049D, service 3.5 or later" in said and "haply:1          inverse3 04BA" in said


def test_tick_makes_no_system_call(tmp_path):
    with emulator(tmp_path) as (_, port, _):
        subprocess.run(["strace", "-f", "-o", tmp_path / "trace", HAPTIC, "--device", f"haply:0@127.0.0.1:{port}", "--trocar", "0,0,0", "--samples", samples(tmp_path), "--duration", "2"],
                       check=True, timeout=60, capture_output=True)
    calls = {}
    for line in (tmp_path / "trace").read_text(errors="replace").splitlines():
        thread, _, call = line.partition(" ")
        calls.setdefault(thread, []).append(call.strip().partition("(")[0])
    loop = max(calls.values(), key=lambda made: made.count("clock_nanosleep"))
    first, last = loop.index("clock_nanosleep"), len(loop) - 1 - loop[::-1].index("clock_nanosleep")
    assert loop.count("clock_nanosleep") > 700 and {call for call in loop[first:last] if call.isidentifier()} <= {"clock_nanosleep", "getrusage"}


def test_it_builds_without_the_library(root, tmp_path):
    """Builds the file without libwebsockets: it compiles, calls nothing of that library, and reports what is missing."""
    includes = [f"-I{root / folder}" for folder in ("", "haptic_rt", "haptic_rt/core", "haptic_rt/io", "libtensormass", "libtensormass/platform")]
    subprocess.run(["gcc", "-std=c11", "-D_GNU_SOURCE", "-Wall", "-Wextra", "-Werror", *includes, "-c", root / "haptic_rt/io/drive_haply.c", "-o", tmp_path / "haply.o"], check=True)
    assert "lws_" not in subprocess.run(["nm", tmp_path / "haply.o"], capture_output=True, text=True, check=True).stdout
    assert b"built without libwebsockets; install libwebsockets-dev" in (tmp_path / "haply.o").read_bytes()


@pytest.mark.parametrize("words, says", [
    (["--device", "foo:0"], "--device: 'foo:0' is not an address; use virtual:NAME or socketcan:INTERFACE, or begin it with one of haply:, touch:, omega:, falcon:, odrive:"),
    (["--bus", "foo:0"], "--bus: 'foo:0' is not an address"),
    (["--device", "haply:x"], "'haply:x' is not a device address; write haply:0"),
    (["--device", "haply:0", "--device-type", "impulse_engine"], "impulse_engine has joints, which this device does not move"),
    (["--device", "haply:0", "--workspace", "scale=9"], "keep scale within 0.05..2"),
    (["--device", "haply:0", "--workspace", "size=1"], "'size=1' is not a setting")])
def test_invalid_addresses_are_rejected(tmp_path, words, says):
    done = subprocess.run([HAPTIC, *words, "--duration", "0.1"], capture_output=True, text=True, timeout=20)
    assert done.returncode == 2 and says in done.stderr, done.stderr


def test_a_device_is_driven_once(tmp_path):
    with emulator(tmp_path) as (_, port, log):
        controller = Controller(tmp_path, f"haply:0@127.0.0.1:{port}", "--samples", samples(tmp_path))
        wait_for(lambda: pushed(log))
        done = subprocess.run([HAPTIC, "--device", f"haply:0@127.0.0.1:{port}", "--duration", "0.1"], capture_output=True, text=True, timeout=20)
        assert done.returncode == 2 and "another haptic-rt uses haply:0" in done.stderr
        controller.end()


def test_without_a_service_it_waits_without_force(tmp_path):
    controller = Controller(tmp_path, "haply:0@127.0.0.1:9", "--samples", samples(tmp_path), "--duration", 0.6)
    controller.child.wait(timeout=20)
    report, rows, _ = controller.end()
    assert report["state"] == "boot" and not any(any(expected(row)) for row in rows) and FORCE
