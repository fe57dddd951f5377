"""`haptic-rt --setup`: the push test proves right units and signs and finds wrong ones; identification then finds the emulated hand and cursor."""
import os
import re
import subprocess

import pytest
import test_libraries
from drivekit import commands, emulator, in_setup
from paths import BUILD
from test_haply import built_in

with_haply = pytest.mark.skipif(not built_in(), reason="haptic-rt was built without libwebsockets (libwebsockets-dev)")
FOUND = re.compile(r"with the hand, (\w)  mass ([\d.]+) kg, damping ([\d.]+) N s/m, friction ([-\d.]+) N, stiffness (\d+) N/m, delay ([-\d.]+) ms; (\d+) % unexplained")


@with_haply
def test_correct_device_is_confirmed_and_identified(tmp_path):
    with emulator(tmp_path) as (_, port, log):
        code, said = in_setup(tmp_path, port)
    assert code == 0 and "units and signs are right" in said and said.count("as commanded") == 6, said
    stiffness = [int(n) for n in re.findall(r"\((\d+) N/m\)", said)]
    assert all(250 <= s <= 1000 for s in stiffness), "a hand of 300 N/m with 0.15 N of friction, pushed by a ramp"
    sizes = [max(map(abs, row[1])) for row in commands(log)[0]]
    assert max(sizes) <= 1.3
    found = FOUND.findall(said)
    assert [row[0] for row in found] == ["x", "y", "z"], said
    for _, mass, damping, friction, hand, delay, unexplained in found:  # haply_service.py: 0.12 kg, 11.3 N s/m, 0.15 N, 300 N/m
        assert 0.09 < float(mass) < 0.16 and 9 < float(damping) < 14 and 0.05 < float(friction) < 0.3 and 240 < float(hand) < 360, said
        assert -1 < float(delay) < 8 and float(unexplained) < 10, said


@with_haply
def test_a_fault_ends_the_test(tmp_path):
    with emulator(tmp_path, "--trouble", "nonsense", "--after", "0.3") as (_, port, _log):
        code, said = in_setup(tmp_path, port)
    assert code == 1 and "a fault ended the test" in said and "NOT confirmed" in said and not FOUND.findall(said), said


@with_haply
def test_wrong_signs_and_units_are_found(tmp_path):
    with emulator(tmp_path, "--wrong=-1,0.001,1") as (_, port, log):
        code, said = in_setup(tmp_path, port)
    sizes = [max(map(abs, row[1])) for row in commands(log)[0]]
    assert max(sizes) <= 1.0 and max(b - a for a, b in zip(sizes, sizes[1:])) < 0.1, "millinewtons at a time"
    lines = {line.split()[1]: line for line in said.splitlines() if line.startswith("push")}
    assert code == 1 and "NOT confirmed" in said and not FOUND.findall(said), said
    assert all("AGAINST" in lines[k] for k in ("+x", "-x")) and all("did not move: hold it loosely" in lines[k] for k in ("+y", "-y"))
    assert all("as commanded" in lines[k] for k in ("+z", "-z"))


SIGMA = ("--device-type", "sigma", "--free", "--setup", "--duration", "40")


def test_torque_that_turns_the_handle_is_confirmed(tmp_path):
    """The virtual device, with 2 to 5 mrad of dry friction of its handle."""
    env = {**os.environ, "TM_BUS_DIR": str(tmp_path)}
    twin = subprocess.Popen([BUILD / "bin/tm-device", "--bus", "virtual:o", "--device-type", "sigma", "--duration", "60", "--quiet"], env=env, stderr=subprocess.DEVNULL)
    try:
        done = subprocess.run([BUILD / "bin/haptic-rt", "--bus", "virtual:o", *SIGMA], capture_output=True, text=True, timeout=60, env=env)
    finally:
        twin.kill()
        twin.wait()
    assert done.returncode == 0 and done.stdout.count("as commanded") == 6, done.stdout
    assert all(float(turned) > 1 for turned in re.findall(r"turned by ([-+.\d]+) mrad", done.stdout)) and done.stdout.count("mrad") == 4


def test_torque_that_does_not_turn_the_handle_is_found(tmp_path, once):
    """The stub of libdhd, whose wrist stands still."""
    stubs = once("stub-libraries", test_libraries.build_stubs)
    env = test_libraries.environment(stubs, "sigma", tmp_path / "log", STUB_LEAN="1.5708", STUB_SWING="1e-9")
    done = subprocess.run([*test_libraries.HAPTIC, "--device", "omega:0", *SIGMA], capture_output=True, text=True, timeout=60, env=env)
    assert done.returncode == 1 and done.stdout.count("did not turn the handle towards it") == 4 and done.stdout.count("as commanded") == 2, done.stdout
