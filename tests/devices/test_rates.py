"""haptic-rt at the largest rate of each device, with its emulator, and what a higher rate is told."""
import os
import re
import subprocess

import motorkit
import pytest
import scenekit
import test_libraries
from drivekit import Controller, FORCE, commands, emulator, samples
from kit import NETWORK, report
from paths import BUILD, LONG, ROOT
from test_haply import built_in

HAPTIC = BUILD / "bin/haptic-rt"
ADDRESSES = {"virtual": "virtual:o", "socketcan": "socketcan:can0", **scenekit.ADDRESSES}


def largest():
    """{kind: largest rate, Hz} of `haptic-rt --list`."""
    said = subprocess.run([HAPTIC, "--list"], capture_output=True, text=True, timeout=30, check=True).stdout
    return {kind: int(rate) for kind, rate in re.findall(r"(\w+):[^\n(]*? \((?:[^\n()]*, )?up to (\d+) Hz\)", said)}


@pytest.fixture(scope="module")
def stubs(once):
    return once("stub-libraries", test_libraries.build_stubs)


def check(told, rows, force, names, rate):
    """The force is that of the samples, at a tick of this rate; a busy machine misses some ticks."""
    assert told["rate_Hz"] == rate and told["state"] == "engaged" and told["fault"] == "none"
    assert told["ticks"] + told["missed_ticks"] > 0.95 * rate * (rows[-1]["time_s"] - rows[0]["time_s"])
    settled = sorted(sum((row[name] - f) ** 2 for name, f in zip(names, force)) for row in rows[-rate // 4:])
    assert settled[len(settled) // 2] < 1e-3 * sum(f ** 2 for f in force), settled[len(settled) // 2]
    times = [b["time_s"] - a["time_s"] for a, b in zip(rows, rows[1:])]
    assert abs(sorted(times)[len(times) // 2] * rate - 1) < 0.1


FORCES = ("force_x_N", "force_y_N", "force_z_N")


def test_virtual_device_at_4000_Hz(tmp_path):
    environment = {"TM_BUS_DIR": str(tmp_path)}
    device = subprocess.Popen([BUILD / "bin/tm-device", "--bus", "virtual:o", "--device-type", "omega", "--rate", "4000", "--priority", "0", "--duration", "30", "--quiet"],
                              env={**os.environ, **environment}, stderr=subprocess.DEVNULL)
    try:
        force = (0.1, -0.1, -0.5)
        controller = Controller(tmp_path, "virtual:o", "--device-type", "omega", "--rate", 4000, "--samples", samples(tmp_path, force), "--duration", 2, env=environment)
        controller.child.wait(timeout=30)
        told, rows, said = controller.end()
    finally:
        device.kill()
        device.wait()
    check(told, rows, force, FORCES, 4000)
    assert told["can"]["rx"] > 2 * 0.5 * told["ticks"], said


@pytest.mark.parametrize("device", ("haply", "omega") if not LONG else ("haply", "touch", "omega", "falcon"))
def test_cursor_at_its_largest_rate(tmp_path, stubs, device):
    if device == "haply" and not built_in():
        pytest.skip("haptic-rt was built without libwebsockets (libwebsockets-dev)")
    rate, words = largest()[device], ("--samples", samples(tmp_path), "--duration", 2)
    if device == "haply":
        with emulator(tmp_path) as (_, port, log):
            controller = Controller(tmp_path, f"haply:0@127.0.0.1:{port}", "--rate", rate, *words)
            controller.child.wait(timeout=30)
            told, rows, _ = controller.end()
        sent = [(row[0], row[1]) for row in commands(log)[0]]
    else:
        log = tmp_path / "stub.csv"
        controller = Controller(tmp_path, device + ":0", "--rate", rate, *words, env=test_libraries.environment(stubs, device + ":0", log), under=NETWORK)
        controller.child.wait(timeout=30)
        told, rows, _ = controller.end()
        sent = scenekit.read_stub(log)
    check(told, rows, FORCE, FORCES, rate)
    compared, worst = scenekit.compare_cursor(sent, rows, scenekit.quantum_N(device))
    print(f"{device} {rate} Hz: {told['drive']}, {told['missed_ticks']} of {told['ticks']} ticks missed, {compared} forces, {1e3 * worst:.2g} mN")
    assert compared > 500


@pytest.mark.parametrize("kind", motorkit.KINDS if LONG else ("moteus",))
def test_motors_at_their_largest_rate(tmp_path, kind):
    bench = motorkit.Axes(tmp_path, kind)
    rate = largest()[kind]
    try:
        controller = bench.controller("--rate", rate, "--duration", 3 if kind != "odrive" else 6)
        controller.child.wait(timeout=30)
        told, rows, said = controller.end()
        sent, _ = bench.rows()
    finally:
        bench.end()
    check(told, rows, motorkit.FORCE, FORCES, rate)
    compared, worst = motorkit.compare(kind, sent, rows)
    print(f"{kind} {rate} Hz: {told['drive']}, {told['missed_ticks']} of {told['ticks']} ticks missed, {compared} torques, {1e3 * worst:.2g} mN")
    assert compared > 300, said


@pytest.mark.parametrize("kind", ADDRESSES)
def test_a_higher_rate_is_refused(kind):
    most = largest()[kind]
    done = subprocess.run([HAPTIC, "--device", ADDRESSES[kind], "--rate", str(most + 1), "--duration", "0.1"], capture_output=True, text=True, timeout=20)
    assert done.returncode == 2
    assert f"takes at most {most} ticks a second; give 100 to {most}" in done.stderr or (most == 4000 and "100 to 4000" in done.stderr), done.stderr


def test_the_page_states_each_rate():
    text = (ROOT / "docs/controller-loop.md").read_text()
    rows = dict(re.findall(r"^\| (\w+) \| ([\d,]+) \|", text[text.index("| device | largest rate, Hz |"):], re.M))
    assert {kind: int(rate.replace(",", "")) for kind, rate in rows.items()} == largest()


@pytest.mark.parametrize("rate", [500, 4000])
def test_twin_in_lockstep_feels_the_same_force(tmp_path, rate):
    seen = report(BUILD / "bin/tm-sim", scenekit.SCENE, "--lockstep", "--quiet", "--set", "instruments[0].device=touch", "--set", "time.duration=2.4 s", "--set", f"haptics.tick_rate={rate} Hz", tmp=tmp_path)
    assert seen["controllers"][0]["state"] == "engaged" and not seen["controllers"][0]["fault"]
    assert abs(seen["force_N"]["peak"] - 0.61) < 0.02, "docs/devices.md has the peak at 500 Hz"
