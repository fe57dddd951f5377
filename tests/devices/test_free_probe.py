"""An instrument without a trocar: the twins of devices with a handle in lockstep, and the drivers with their emulators in real time."""
import csv
import json
import math

import lcm
import pytest
import scenekit
import test_libraries
from kit import report
from paths import BUILD, LONG, ROOT
from test_haply import built_in

SCENE = ROOT / "apps/scenes/block-probe.yaml"
UPRIGHT_S, LYING_S = 1.1, 1.5  # times of the scene's hand


def force_at(rows, time_s):
    row = min(rows, key=lambda r: abs(float(r["time_s"]) - time_s - 0.1))  # the hand begins 0.1 s late
    return float(row["fz_N"])


@pytest.mark.parametrize("device", ["inverse3_versegrip", "touch_stylus", "omega_wrist", "inverse3"])
def test_free_probe_feels_its_shaft_in_lockstep(tmp_path, types, device):
    """Lying down adds the shaft's contact to the tip's; without a handle the shaft stays upright. The energy account closes."""
    upright = ["--set", "hand[0].path[3].yaw=0", "--set", "hand[0].path[4]={time: 1.9 s, tip: [62 mm, 50 mm, 46 mm]}"] if device == "inverse3" else []
    told = report(BUILD / "bin/tm-sim", SCENE, "--lockstep", "--quiet", "--set", f"instruments[0].device={device}", "--set", "energy=", "--set", "rendering=", *upright,
                  "--csv", tmp_path / "t.csv", "--record", tmp_path / "log", tmp=tmp_path)
    loop, energy = told["controllers"][0], told["energy"]
    assert loop["state"] == "engaged" and not loop["fault"] and loop["tools_rejected"] == loop["samples_rejected"] == 0
    assert abs(energy["residual_J"]) < 1e-12 and energy["generated_J"] < energy["drag_J"] < energy["tool_work_J"][0]
    rows = list(csv.DictReader((tmp_path / "t.csv").open()))
    ratio = force_at(rows, LYING_S) / force_at(rows, UPRIGHT_S)
    assert force_at(rows, UPRIGHT_S) > 0.4 and (ratio > 1.3 if device != "inverse3" else ratio < 1.1)
    seen = [types.sim_status_t.decode(e.data) for e in lcm.EventLog(str(tmp_path / "log"), "r") if e.channel == "SIM_STATUS"]
    assert all(m.is_free[0] for m in seen)
    most = max(m.direction[0][0] for m in seen)
    assert most > 0.99 if device != "inverse3" else most == 0


@pytest.mark.parametrize("device", ["crtk_handle", "sigma"])
def test_torque_turns_the_handle_in_lockstep(tmp_path, device):
    """Lying on the block, the handle leans further than the hand wants, by the torque over the hand's 3 N m/rad, within dry friction. The hand lays it down
    slowly: the handle's mass swings with it."""
    slow = [word for row, time in ((3, 2.4), (4, 3.0), (5, 3.6)) for word in ("--set", f"hand[0].path[{row}].time={time} s")]
    told = report(BUILD / "bin/tm-sim", SCENE, "--lockstep", "--quiet", "--set", f"instruments[0].device={device}", *slow, "--set", "time.duration=2.7 s", "--set", "energy=", "--set", "rendering=",
                  "--csv", tmp_path / "t.csv", tmp=tmp_path)
    loop, energy = told["controllers"][0], told["energy"]
    assert loop["state"] == "engaged" and not loop["fault"] and loop["tools_rejected"] == loop["samples_rejected"] == 0
    assert abs(energy["residual_J"]) < 1e-12 and energy["generated_J"] < energy["damping_J"], energy
    row = min(csv.DictReader((tmp_path / "t.csv").open()), key=lambda r: abs(float(r["time_s"]) - 2.6))
    further = -float(row["tilt_x_rad"]) - math.radians(88)
    assert float(row["fz_N"]) > 0.4 and abs(further - 0.1 * float(row["fz_N"]) / 3) < 0.005 / 3 + 2e-4


# tilt_y: of the emulated handle. The service's is upright, the stylus points away from the user.
@pytest.mark.parametrize(("name", "device", "tilt_y"), [("haply", "inverse3_versegrip", 0.0), ("touch", "touch_stylus", 1.5708), *([("omega", "omega_wrist", 1.5708)] if LONG else [])])
def test_free_probe_with_the_emulator(tmp_path, once, monkeypatch, name, device, tilt_y):
    """The force at the emulator is that of the ticks, and the tool has the handle's direction."""
    if name == "haply" and not built_in():
        pytest.skip("haptic-rt was built without libwebsockets (libwebsockets-dev)")
    stubs = once("stub-libraries", test_libraries.build_stubs)
    monkeypatch.setenv("STUB_WRIST", "passive")
    monkeypatch.setattr(scenekit, "SCENE", SCENE)
    monkeypatch.setattr(scenekit, "TYPES", {name: device})
    monkeypatch.setattr(scenekit, "CURSOR", f"--workspace depth=0.01 --device-type {device}")
    told, compared, worst = scenekit.real_time(tmp_path, name, stubs)
    print(name, told["force_N"], compared, worst)
    assert told["force_N"]["peak"] > 0.1 and compared > 200
    assert worst <= scenekit.quantum_N(name) + 4 * scenekit.motorkit.FLOAT
    rows = list(csv.DictReader(sorted(tmp_path.glob("run*/r.csv"))[-1].open()))
    assert abs(float(rows[-1]["tilt_x_rad"])) < 1e-3 and float(rows[-1]["tilt_y_rad"]) == pytest.approx(tilt_y, abs=1e-3)
    assert json.loads(sorted(tmp_path.glob("run*/s.json"))[-1].read_text())["force_N"]["peak"] > 0.1
