"""haptic-rt with the makers' libraries libHD and libdhd, as stubs (stub_hd.c, stub_dhd.c) that implement the documented calls and log each call out
of order or in the wrong thread. Units, signs, closing, and calls that fail, hang or return wrong values."""
import math
import os
import subprocess

import pytest
from drivekit import Controller, FORCE, expected, samples, wait_for
from kit import NETWORK
from paths import BUILD, LONG, ROOT

HAPTIC = [*NETWORK, BUILD / "bin/haptic-rt"]  # in a network namespace: devices are claimed there, and tests run concurrently
STOP_MS = 50  # stated: docs/device-failures.md
KINDS = {"touch:0": ("hd", "TM_LIBHD", {}), "omega:0": ("dhd", "TM_LIBDHD", {}), "sigma": ("dhd", "TM_LIBDHD", {"STUB_WRIST": "motors", "STUB_LEAN": "1.2"}), "falcon:0": ("dhd", "TM_LIBDHD", {"STUB_FALCON": "1"})}
WORDS = {"sigma": ("omega:0", "--device-type", "sigma", "--free")}  # address and type, where they are not the kind's
LEAN_RAD, ARM_M = 1.2, 0.1


def build_stubs(out):
    for name in ("hd", "dhd"):
        subprocess.run(["gcc", "-O1", "-w", "-shared", "-fPIC", "-o", out / f"lib{name}.so", ROOT / f"tests/devices/stub_{name}.c", "-lm", "-lpthread"], check=True)


@pytest.fixture(scope="module")
def stubs(once):
    return once("stub-libraries", build_stubs)


def environment(stubs, device, log, **more):
    name, variable, own = KINDS[device]
    return {**os.environ, variable: str(stubs / f"lib{name}.so"), "STUB_LOG": str(log), **own, **more}


def read(log):
    rows, notes = [], {}
    for line in log.read_text().splitlines():
        if line.startswith("# "):
            notes.setdefault(line.split()[1], []).append(line)
        else:
            value = [float(w) for w in line.split(",")]
            rows.append((value[0], value[1:4], value[4:]))
    return rows, notes


def torque_of(force):
    """Torque of a force at the tip, ARM_M beyond the handle's point along a shaft that points LEAN_RAD down from straight away; user axes."""
    x, y, z = force
    away, up = math.cos(LEAN_RAD), -math.sin(LEAN_RAD)
    return [ARM_M * (away * z - up * y), ARM_M * up * x, -ARM_M * away * x]


def play(tmp_path, stubs, device, seconds=2.0, **more):
    log = tmp_path / "stub.csv"
    controller = Controller(tmp_path, *WORDS.get(device, (device,)), "--samples", samples(tmp_path), "--duration", seconds, env=environment(stubs, device, log, **more), under=NETWORK)
    controller.child.wait(timeout=30)
    return *read(log), *controller.end()


@pytest.mark.parametrize("device", KINDS)
def test_force_and_motion_arrive_with_their_units_and_signs(tmp_path, stubs, device):
    sent, notes, report, rows, _ = play(tmp_path, stubs, device, 3.0)
    assert "broken" not in notes, notes["broken"][:3]
    ticks = iter(rows)
    tick, checked = next(ticks), 0
    for time_us, force, _ in sent:  # each is the force of a tick, of increasing time
        if not any(force):
            continue
        while max(abs(a - b) for a, b in zip(force, expected(tick))) > 1e-6:
            tick = next(ticks, None)
            assert tick and tick["t_us"] <= time_us
        checked += 1
    assert checked > 500
    settled = [force for _, force, _ in sent if abs(force[2]) > 1.4]
    assert settled and all(f[0] < 0 and f[1] < 0 and f[2] > 0 for f in settled)
    last = rows[-1]
    close = min(sent, key=lambda row: abs(row[0] - last["t_us"]))
    moved = [b - a for a, b in zip(sent[0][2][:3], close[2])]
    assert moved[0] > 0.01 and moved[2] < -0.01
    tilt, arm = math.pi / 2 - LEAN_RAD, ARM_M if device == "sigma" else 0.0  # the tip is an arm beyond the handle's point
    for axis, sign, of, start in (("x_m", -1, 0, 0.0), ("y_m", 1, 1, arm * math.sin(tilt)), ("z_m", -1, 2, 0.1 + arm * (math.cos(tilt) - 1.0))):
        assert abs(last[axis] - start - sign * moved[of]) < 0.001
    assert not any(sent[-1][1]) and "closed" in notes, "its last word is no force, and it is closed"
    for _, force, felt in sent:  # the tilt is a count of 0.1 mrad
        assert max(abs(a - b) for a, b in zip(felt[3:], torque_of(force) if device == "sigma" else (0, 0, 0))) < 2e-5
    if device == "sigma":
        assert max(abs(felt[3]) for _, _, felt in sent) > 0.05 and abs(last["tilt_y_rad"] - (math.pi / 2 - LEAN_RAD)) < 1e-3
    assert report["drive"]["refused"] == 0 and FORCE


TROUBLES = ("position", "force", "frozen", "late", "nonsense")


def in_trouble(tmp_path, stubs, device, trouble):
    """Plays one trouble; returns (ms until the controller's force is zero, ms until the last force at the device, report, rows, output)."""
    sent, notes, report, rows, said = play(tmp_path, stubs, device, 2.4, STUB_TROUBLE=trouble, STUB_AFTER="0.8")
    assert "broken" not in notes, notes["broken"][:3]
    since = float(notes["trouble"][0].split()[2])
    controller_ms = next(1e-3 * (row["t_us"] - since) for row in rows if row["t_us"] >= since and not any(expected(row)))
    if trouble == "frozen":
        thawed = float(notes["thawed"][0].split()[2])
        first = next(row for row in sent if row[0] >= thawed)
        return controller_ms, 0.0 if not any(first[1]) else 1e3, report, rows, said
    after = [row for row in sent if row[0] >= since]
    zero = next(row[0] for row in after if not any(row[1]))
    return controller_ms, 1e-3 * (zero - since), report, rows, said


# The short form plays what differs most; the long form and device_table.py all.
SHORT = {"touch:0": ("position", "late"), "omega:0": ("force", "frozen", "nonsense"), "sigma": ("force",)}


@pytest.mark.parametrize("device, trouble", [(device, trouble) for device in SHORT for trouble in ((*TROUBLES, "orientation")[: 6 if device == "sigma" else 5] if LONG else SHORT[device])])
def test_trouble_ends_the_force(tmp_path, stubs, device, trouble):
    controller_ms, device_ms, report, rows, said = in_trouble(tmp_path, stubs, device, trouble)
    print(f"{device} {trouble}: controller {controller_ms:.1f} ms, at the device {device_ms:.1f} ms, {report['state']} {report['fault']}")
    assert controller_ms <= STOP_MS and device_ms <= (60 if trouble == "late" else STOP_MS)  # the library itself waits 50 ms
    if trouble in ("position", "orientation", "force", "nonsense"):
        assert report["fault"] == "device_reported" and not any(expected(rows[-1]))
    call = {"position": "GetPosition", "orientation": "GetOrientationFrame", "force": "SetForceAndTorqueAndGripperForce" if device == "sigma" else "SetForce"}
    if trouble in call:
        assert ("libHD: a frame failed" if device == "touch:0" else f"libdhd: dhd{call[trouble]}: communication error") in said


@pytest.mark.long
def test_saturated_motors_of_the_wrist_are_no_failure(tmp_path, stubs):
    _, notes, report, _, _ = play(tmp_path, stubs, "sigma", 2.0, STUB_TROUBLE="saturated")
    assert "trouble" in notes and report["fault"] == "none" and report["state"] == "engaged"


@pytest.mark.parametrize("device, kind, wrist, says", [("omega:0", "sigma", "", "device 0 (omega.3) has no motors at its wrist; choose --device-type omega\n"),
                                                      ("omega:0", "sigma", "passive", "device 0 (omega.6) has no motors at its wrist; choose --device-type omega_wrist\n"),
                                                      ("omega:0", "omega_wrist", "", "device 0 (omega.3) has no wrist; choose --device-type omega\n"),
                                                      ("touch:0", "sigma", "", "touch: renders no torque at a handle, as 'sigma' does; choose --device-type touch\n")])
def test_a_type_that_the_device_is_not_is_refused(tmp_path, stubs, device, kind, wrist, says):
    env = environment(stubs, device, tmp_path / "log", **({"STUB_WRIST": wrist} if wrist else {}))
    done = subprocess.run([*HAPTIC, "--device", device, "--device-type", kind, "--free", "--duration", "0.2"], capture_output=True, text=True, timeout=20, env=env)
    assert done.returncode == 2 and says in done.stderr, done.stderr


def test_a_version_without_the_wrists_calls_is_refused(tmp_path):
    subprocess.run(["gcc", "-O1", "-w", "-shared", "-fPIC", "-DSTUB_OLD", "-o", tmp_path / "old.so", ROOT / "tests/devices/stub_dhd.c", "-lm", "-lpthread"], check=True)
    run = lambda kind: subprocess.run([*HAPTIC, "--device", "omega:0", "--device-type", kind, "--duration", "0.2"], capture_output=True, text=True, timeout=20, env={**os.environ, "TM_LIBDHD": str(tmp_path / "old.so")})
    assert "libdhd has no dhdHasWrist, which 'sigma' requires; install a later version" in run("sigma").stderr and run("omega").returncode == 0


@pytest.mark.parametrize("device", ["touch:0", "omega:0"])
@pytest.mark.parametrize("trouble, says", [("open", "cannot open device"), ("start", "error")])
def test_failure_to_open_is_explained(tmp_path, stubs, device, trouble, says):
    done = subprocess.run([*HAPTIC, "--device", device, "--duration", "0.2"], capture_output=True, text=True, timeout=20,
                          env=environment(stubs, device, tmp_path / "log", STUB_TROUBLE=trouble))
    assert done.returncode == 2 and says in done.stderr, done.stderr


def test_wrong_kind_of_device_is_named(tmp_path, stubs):
    done = subprocess.run([*HAPTIC, "--device", "omega:0", "--duration", "0.2"], capture_output=True, text=True, timeout=20,
                          env=environment(stubs, "falcon:0", tmp_path / "log"))
    assert done.returncode == 2 and "device 0 is a Novint Falcon" in done.stderr and "choose falcon:0" in done.stderr


@pytest.mark.parametrize("device, library, says", [("touch:0", "libHD.so", "OpenHaptics (libHD)"), ("omega:0", "libdhd.so.3", "Force Dimension's SDK (libdhd)"),
                                                  ("falcon:0", "libdhd.so.3", "Force Dimension's SDK (libdhd)")])
def test_a_missing_library_is_named(device, library, says):
    done = subprocess.run([*HAPTIC, "--device", device, "--duration", "0.2"], capture_output=True, text=True, timeout=20)
    if done.returncode != 2:
        pytest.skip(f"{library} is installed here")
    assert f"{library} is not installed; install {says}" in done.stderr


def test_a_library_without_a_call_is_refused(tmp_path):
    (tmp_path / "empty.c").write_text("int nothing;\n")
    subprocess.run(["gcc", "-shared", "-fPIC", "-o", tmp_path / "empty.so", tmp_path / "empty.c"], check=True)
    done = subprocess.run([*HAPTIC, "--device", "touch:0", "--duration", "0.2"], capture_output=True, text=True, timeout=20, env={**os.environ, "TM_LIBHD": str(tmp_path / "empty.so")})
    assert done.returncode == 2 and "has no hdInitDevice" in done.stderr


def test_devices_are_listed(tmp_path, stubs):
    env = {**environment(stubs, "touch:0", tmp_path / "a"), **environment(stubs, "falcon:0", tmp_path / "a")}
    said = subprocess.run([*HAPTIC, "--list"], capture_output=True, text=True, timeout=30, env=env).stdout
    assert "touch:0          PHANTOM Omni" in said and "falcon:0         Novint Falcon" in said and "omega            libdhd finds none" in said and wait_for
