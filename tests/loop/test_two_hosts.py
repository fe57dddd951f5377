"""Simulation and controller on two hosts with a bad network between them. Compares the controller's forces with the simulation's at the controller's times
(in its samples), as in the paper, at 25 samples a second and at the machine's rate. The force stops when the network is cut or the simulation killed."""
import bisect
import csv
import json
import math
import shutil
import subprocess
import sys
import tempfile

import lcm
import pytest
import two_hosts_run
from paths import BUILD, LONG, ROOT

sys.path.insert(0, str(BUILD / "python"))
SECONDS = 60 if LONG else 8
SCENE = ROOT / "apps" / "scenes" / "block-press.yaml"
ZERO_WITHIN_S = 0.150
CLEAN = {}
BAD = {"delay_ms": 4, "jitter_ms": 4, "drop": 0.05, "double": 0.05, "reorder": 0.05, "seed": 7}


def play(name, link, seconds=SECONDS, extrapolator="tangent", kill=None, rate="25 Hz"):
    """`rate`: samples a second; the bounds below are for the paper's."""
    bus = tempfile.mkdtemp(prefix="tm-test-", dir="/dev/shm")
    directory = two_hosts_run.directory(name)
    url = two_hosts_run.LCM_URL
    key = two_hosts_run.key(directory)
    try:
        subprocess.run([BUILD / "bin/tm-sim", SCENE, "--hands", directory / "hand"], check=True, timeout=300, stdout=subprocess.DEVNULL)
        hosts = {
            "simulation": [[BUILD / "bin/tm-sim", SCENE, "--set", f"haptics.rate={rate}", "--realtime", "--url", url, "--key", key, "--duration", f"{seconds} s", "--json", directory / "sim.json"],
                           ["lcm-logger", "-q", "--lcm-url=" + url, "-c", "FORCE_0", directory / "sim.log"]],
            "controller": [["env", f"TM_BUS_DIR={bus}", BUILD / "bin/tm-device", "--bus", "virtual:two", "--hand", directory / "hand0.csv", "--repeat",
                            "--duration", str(seconds)],
                           ["env", f"TM_BUS_DIR={bus}", BUILD / "bin/haptic-rt", "--bus", "virtual:two", "--url", url, "--key", key, "--extrapolator", extrapolator,
                            "--duration", str(seconds), "--json", directory / "controller.json", "--record", directory / "controller.csv"]],
        }
        result = two_hosts_run.run(directory, hosts, link, seconds + 1.5, kill)
    finally:
        shutil.rmtree(bus)
    with open(directory / "controller.csv") as file:
        ticks = [{k: float(v) for k, v in row.items()} for row in csv.DictReader(file)]
    return ticks, json.loads((directory / "controller.json").read_text()), directory, result


def sent(directory):
    """Returns [(t_n in s of the controller's clock, force)] of all samples that the simulation sent, whether they arrived or not, and the share that
    the logger missed."""
    from tensormass_lcm import force_sample_t
    messages = [force_sample_t.decode(event.data) for event in lcm.EventLog(str(directory / "sim.log"))]
    samples = {m.tool_utime: m.force_N for m in messages}
    return sorted((t * 1e-6, f) for t, f in samples.items() if t > 0), 1 - len(messages) / (max(m.seq for m in messages) + 1)


def on_one_clock(ticks, sent, controller):
    """Returns the offset in seconds from ticks' times, which count from the loop's start, to samples' times. Every t_n that a tick used (its time
    less the sample's age) is one of the samples'."""
    samples, missed = sent
    offset = controller["start_us"] * 1e-6
    times = [t for t, _ in samples]
    seen = [tick["time_s"] - tick["sample_age_s"] + offset for tick in ticks if tick["sample_age_s"] >= 0]
    unknown = [t for t in seen if min(abs(t - near) for near in times[max(bisect.bisect(times, t) - 1, 0):][:2]) > 20e-6]
    assert len(unknown) <= (2 * missed + 0.01) * len(seen), f"of {len(seen)} ticks {len(unknown)} saw samples that were not sent; the logger missed {100 * missed:.1f} %"
    return offset


def error_percent(ticks, sent, controller):
    """Returns (RMS, peak) of the difference in % of the peak force, and that force in N, over ticks at full force."""
    offset, samples = on_one_clock(ticks, sent, controller), sent[0]
    peak = max(math.dist(f, (0, 0, 0)) for _, f in samples)
    errors, k = [], 0
    for tick in ticks:
        t = tick["time_s"] + offset
        while k + 1 < len(samples) and samples[k + 1][0] <= t:
            k += 1
        if k + 1 >= len(samples) or not samples[k][0] <= t or tick["state"] != 3 or tick["gain"] < 1:
            continue
        (t0, f0), (t1, f1) = samples[k], samples[k + 1]
        s = (t - t0) / (t1 - t0)
        truth = [a + s * (b - a) for a, b in zip(f0, f1)]
        force = [tick["fx_N"], tick["fy_N"], tick["fz_N"]]
        errors.append(math.dist(force, truth))
    assert len(errors) > 0.4 * len(ticks), f"full force in {len(errors)} of {len(ticks)} ticks only"
    return 100 * math.sqrt(sum(e * e for e in errors) / len(errors)) / peak, 100 * max(errors) / peak, peak


# RMS in % of the peak. The extrapolation study has 7.4 for `position` and 3.7 for `tangent` a frame late. This hand is faster, and a wire that loses a
# twentieth of its packets and reorders as many delays every tenth sample by another frame.
@pytest.mark.parametrize("wire, extrapolator, bound_percent", [("clean", "position", 8.0), ("clean", "tangent", 8.0), ("bad", "tangent", 16.0)])
def test_forces_stay_accurate_over_a_bad_network(wire, extrapolator, bound_percent):
    controller, result = forces_are_right(f"{wire}_{extrapolator}", BAD if wire == "bad" else CLEAN, extrapolator, bound_percent, "25 Hz")
    if wire == "bad":
        assert min(result["count"][k] for k in ("dropped", "doubled", "reordered")) > SECONDS
        assert controller["samples"]["lost"] > 0 and controller["samples"]["late"] > 0


def test_streamed_forces_stay_accurate_over_a_bad_network():
    """As many samples as the machine computes, hundreds a second on a quiet one: no worse than at 25, and never so few."""
    controller, _ = forces_are_right("stream", CLEAN, "tangent", 8.0, "auto")
    assert controller["samples"]["received"] > 40 * SECONDS


def forces_are_right(name, link, extrapolator, bound_percent, rate):
    ticks, controller, directory, result = play(name, link, extrapolator=extrapolator, rate=rate)
    rms, worst, peak = error_percent(ticks, sent(directory), controller)
    (directory / "error.json").write_text(json.dumps({"rms_percent": rms, "worst_percent": worst, "peak_N": peak, "link": result}, indent=1))
    assert peak > 0.2, "the probe hardly touched"
    assert rms < bound_percent, f"RMS {rms:.1f} % of {peak:.2f} N, worst {worst:.1f} %"
    assert controller["fault"] == "none"
    return controller, result


def pushing(tick):
    return math.dist((tick["fx_N"], tick["fy_N"], tick["fz_N"]), (0, 0, 0)) > 0


def test_force_stops_while_the_wire_is_cut():
    ticks, controller, directory, result = play("cut", {"cut_at_s": 3.0, "heal_at_s": 4.5}, seconds=7)
    on_one_clock(ticks, sent(directory), controller)
    silence = [t for t in ticks if t["sample_age_s"] > 0.3]
    assert len(silence) > 200, "the cut did not reach the controller"
    first, last = silence[0]["time_s"], silence[-1]["time_s"]
    assert any(pushing(t) for t in ticks if t["time_s"] < first - 0.3), "no force before the cut"
    assert max(t["sample_age_s"] for t in ticks if pushing(t)) < ZERO_WITHIN_S
    assert any(pushing(t) for t in ticks if t["time_s"] > last), "no force after the wire was repaired"
    assert controller["fault"] == "none" and controller["resets"] == 0


def test_force_stops_when_the_simulation_is_killed():
    """SIGKILL while the hand pushes: the last sample of the simulation has no effect after 150 ms."""
    ticks, controller, directory, _ = play("killed", CLEAN, seconds=5, kill={"at_s": 3.1, "host": "simulation", "command": 0})
    silence = [t for t in ticks if t["sample_age_s"] > 0.3]
    assert silence and silence[-1] is ticks[-1], "the simulation went on"
    last_s = silence[0]["time_s"] - silence[0]["sample_age_s"]
    assert any(pushing(t) for t in ticks if last_s - 0.04 < t["time_s"] < last_s + 0.04), "the hand did not push when it happened"
    assert max(t["sample_age_s"] for t in ticks if pushing(t)) < ZERO_WITHIN_S
    assert not any(pushing(t) for t in silence)
    assert controller["fault"] == "none" and controller["state"] in ("idle", "stale")
