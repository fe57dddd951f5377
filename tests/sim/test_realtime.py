"""tm-sim on the wall clock, over LCM, in a network namespace of its own."""
import json
import sys

import lcm
import pytest
from kit import NETWORK
from simkit import block_scene, run


@pytest.fixture(scope="module")
def session(bin, build, root, tmp_path_factory):
    tmp = tmp_path_factory.mktemp("realtime")
    scene = block_scene(tmp, root, "instruments:\n  - trocar: [50 mm, 50 mm, 180 mm]\ncontact:\ndamping: {rate: 60 /s}\nhaptics:\nrendering:\n")
    out, _ = run(*NETWORK, sys.executable, root / "tests/sim/fake_controller.py", build, bin / "tm-sim", scene, tmp / "report.json")
    return json.loads(out), json.loads((tmp / "report.json").read_text()), scene


def test_session_ends_cleanly_and_reports_its_peers(session):
    heard, report, scene = session
    assert heard["exit"] == 0 and "controller of instrument 0 is connected" in heard["said"]
    assert heard["scene"] == str(scene) and heard["trocar"] == [0.05, 0.05, 0.18]
    assert heard["others"].get("TISSUE", 0) > 10 and "PATCH_0" not in heard["others"] and "FORCE_1" not in heard["others"]


def test_untrusted_tool_states_are_refused_and_counted(session):
    heard, report, _ = session
    (tool,) = report["tools"]
    assert heard["sent"]["bad"] > 50
    # UDP on loopback may drop packets under load, never add any.
    for counted, sent in (("rejected", heard["sent"]["bad"]), ("foreign", heard["sent"]["foreign"])):
        assert 0.8 * sent <= tool[counted] <= sent, (counted, tool, heard["sent"])
    assert 0 < tool["accepted"] <= heard["sent"]["good"]
    assert tool["late"] >= 0.8 * heard["sent"]["late"]


def test_the_force_is_finite_pushes_back_and_echoes_the_controllers_own_time(session):
    heard, _, _ = session
    mine = [f for f in heard["forces"] if f[0] == 5000000]
    assert len(mine) > 20
    assert all(abs(x) < 50 for f in heard["forces"] for x in f[2])
    assert mine[-1][2][2] > 0.05
    assert heard["echo_error_m"] < 2e-4  # 12 mm/s, samples 4 ms apart, and a frame's average over a curved path
    seqs = [f[4] for f in heard["forces"]]
    assert seqs == sorted(set(seqs)) and len({f[5] for f in heard["forces"]}) == 1


def test_a_controller_restarted_with_an_earlier_clock_is_taken_up(session):
    heard, _, _ = session
    assert heard["forces"][-1][0] == 5000000 - 7
    assert "a new controller of instrument 0 is connected (session 4999993 after 5000000)" in heard["said"]


def test_one_packet_from_the_future_blocks_no_sender(session):
    heard, _, _ = session
    # Of another session: not accepted while the controller was active.
    assert all(f[0] in (0, 5000000, 5000000 - 7) for f in heard["forces"])
    # Of its own session: accepted; normal again a second later.
    assert max(f[1] for f in heard["forces"]) == 2**62 and 4300000 < heard["forces"][-1][1] < 5000000


def test_refusals_are_told_with_their_reason_once_a_second(session):
    heard, _, _ = session
    lines = [line for line in heard["said"].splitlines() if "refused" in line]
    assert any("another session is sending" in line for line in lines) and any("seq is older than the newest" in line for line in lines)
    assert 3 <= len(lines) <= 7  # in six seconds


def test_messages_are_in_the_log(session):
    heard, report, scene = session
    count = {}
    for e in lcm.EventLog(str(scene.parent / "report.json.lcm")):
        count[e.channel] = count.get(e.channel, 0) + 1
    assert set(count) == {"TOOL_0", "FORCE_0", "TISSUE", "SIM_STATUS"}
    assert count["SIM_STATUS"] == report["frames"] < count["FORCE_0"] == report["force_samples"]["count"] <= 20 * (report["frames"] + 1)
    (tool,) = report["tools"]
    assert count["TOOL_0"] >= sum(tool[k] for k in ("accepted", "late", "foreign", "rejected"))


def test_a_machine_too_slow_drops_time_and_never_catches_up(bin, root, tmp_path):
    """A scene too large for any machine in real time: frames stay frequent; simulated time falls behind, which is reported."""
    scene = block_scene(tmp_path, root, mesh="block_10k.msh")
    path = tmp_path / "o.json"
    run(bin / "tm-sim", scene, "--realtime", "--duration", "1.5 s", "--set", "tissue.materials.*.young=1e12", "--json", path, timeout=300)
    r = json.loads(path.read_text())
    assert r["overruns"] > 3 and r["sim_s"] < 0.5 * r["wall_s"]
    assert r["frames"] > 5  # no frame was computed completely
    assert abs(r["wall_s"] - r["sim_s"] - r["dropped_s"]) < 0.3 * r["wall_s"]
    assert r["sim_seconds_per_wall_second"] < 0.5
