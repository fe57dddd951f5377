"""haptic-rt and tm-device over LCM; message_ring.py plays the simulation in a network namespace."""
import csv
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile

import pytest
from kit import NETWORK


@pytest.fixture(scope="module")
def seen(bin, build, root):
    directory = tempfile.mkdtemp(prefix="tm-test-", dir="/dev/shm")
    try:
        run = subprocess.run([*NETWORK, sys.executable, root / "tests/loop/message_ring.py", bin, build / "python", directory],
                             capture_output=True, text=True, timeout=800, stdin=subprocess.DEVNULL, env=dict(os.environ, PATH=os.environ["PATH"] + ":/usr/sbin:/sbin"))
        logs = {name: open(os.path.join(directory, name)).read() for name in sorted(os.listdir(directory)) if name.endswith(".log")}
        assert run.returncode == 0, run.stderr + str(logs)
        result = json.loads(run.stdout)
        result["logs"] = "".join(logs.values())
        with open(os.path.join(directory, "record.csv")) as file:
            result["record"] = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
        return result
    finally:
        shutil.rmtree(directory)


PAUSE, STALE, TICK_LATE = 1024, 4, 10  # Limit flag of a tick after a delay of controller or device, state, fault: docs/controller.md


def in_time(seen, name, since, late=None):
    """Checks that the awaited state came at once, or that the record shows a delay of a program or of this test; in a sanitizer's slow build it may
    be late."""
    if not (seen[name]["late"] if late is None else late) or "TM_SANITIZER" in os.environ:
        return True
    rows = seen["record"][seen[since]["ticks"] if since else 0:seen[name]["ticks"]]
    return any(int(row["limits"]) & PAUSE or row["state"] == STALE or row["fault"] == TICK_LATE for row in rows)


def test_nothing_is_sent_before_the_pose_is_known(seen):
    assert seen["published_before_the_pose"] == 0
    assert "waiting for the trocar's pose" in seen["logs"]


def test_control_loop_over_lcm_reaches_equilibrium(seen):
    assert seen["pressed"] and in_time(seen, "first", None), seen["logs"]
    first = seen["first"]
    assert first["state"] == 3 and first["fault"] == 0 and first["text"] == ""
    # The tip is where the scene's trocar and the joints put it: straight down from the trocar.
    pitch, yaw, insertion = first["joint"][:3]
    assert first["tip"][2] == pytest.approx(0.2 - insertion * math.cos(pitch) * math.cos(yaw), abs=1e-5)
    assert first["tip"][:2] == pytest.approx([0.01, 0.02], abs=2e-3)
    # A hand of 300 N/m and a wall of 300 N/m meet half way: target 0.07 m, wall 0.08 m.
    assert first["force"][2] == pytest.approx(1.5, abs=0.2)
    assert first["active"] == 1 and first["joint"][4] == pytest.approx(0.5, abs=0.01)
    assert first["tool_extrapolator"] == 0 and first["extrapolator"] == "hold" and first["passivity"] == 1
    assert seen["tools"] > 500 and seen["statuses"] > 15


def test_law_and_passivity_are_switched_by_command(seen):
    assert (seen["switched"]["extrapolator"], seen["switched"]["passivity"], seen["switched"]["tool_extrapolator"]) == ("tangent", 0, 4)
    assert seen["switched"]["state"] == 3 and in_time(seen, "switched", "first")


def test_bad_messages_are_counted_and_change_nothing(seen):
    after, before = seen["after_bad"], seen["switched"]
    assert after["state"] == 3 and after["extrapolator"] == "tangent"
    assert after["rejected"] - before["rejected"] >= 3  # not finite, for another controller, bad patch; messages that cannot be decoded never arrive
    assert after["force"][2] == pytest.approx(1.5, abs=0.2) and in_time(seen, "after_bad", "switched")


def test_a_second_simulation_is_refused_with_the_reason_once_a_second(seen):
    after = seen["two_simulations"]
    assert after["state"] == 3 and after["force"][2] == pytest.approx(1.5, abs=0.2)
    assert after["rejected"] - seen["after_bad"]["rejected"] > 30 and in_time(seen, "two_simulations", "after_bad")
    lines = [line for line in seen["logs"].splitlines() if "refused" in line and "another session is in use" in line]
    times = [float(re.match(r"haptic-rt (\d+\.\d{3}) s: ", line)[1]) for line in lines]
    assert 2 <= len(lines) <= (3 if after["seconds"] < 2.3 else 2 + after["seconds"]) and all(b - a > 0.999 for a, b in zip(times, times[1:])), lines


def test_every_line_of_the_controller_has_its_time(seen):
    lines = [line for line in seen["logs"].splitlines() if line.startswith("haptic-rt")]
    begun = next(i for i, line in enumerate(lines) if not line.startswith("haptic-rt: "))
    assert any("refused since the last such message" in line for line in lines[begun:])
    assert all(re.fullmatch(r"haptic-rt \d+\.\d{3} s: .+", line) for line in lines[begun:]), lines


def test_device_restart_is_handled(seen):
    assert in_time(seen, "device_gone", "two_simulations")
    assert seen["device_gone"]["state"] in (0, 5) and seen["device_gone"]["force"] == [0, 0, 0]
    assert seen["pressed_again"], seen["logs"]


def test_simulation_gone_leaves_no_force(seen):
    gone = seen["simulation_gone"]
    assert gone["state"] == 2 and gone["force"] == [0, 0, 0] and gone["fault"] == 0
    pushing = [row for row in seen["record"] if row["fz_N"] > 0.5]
    assert len(pushing) > 500
    # In every recorded tick later than 150 ms after t_n of the last valid sample, the force is zero.
    old = [row for row in seen["record"] if row["sample_age_s"] > 0.15]
    assert len(old) > 100 and all(row["fx_N"] == row["fy_N"] == row["fz_N"] == 0 for row in old)
    assert all(row["force_insertion_N"] == 0 for row in old)
    assert seen["exit"] == 0 and in_time(seen, "simulation_gone", "device_gone", late=seen["deaths"] > 1 or gone["late"])
    assert "no samples from the simulation" in seen["logs"]
