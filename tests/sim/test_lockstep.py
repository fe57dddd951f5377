"""Lockstep runs: bit-identical repetition, no cost of absent effects, logs, forces."""
import json
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from kit import effects
from simkit import block_scene, report, run

EFFECTS = ["anisotropy", "damping", "gravity", "contact", "haptics", "recording", "rendering"]


def columns(path):
    return np.atleast_1d(np.genfromtxt(path, delimiter=",", names=True))


def test_same_bits_twice_and_not_for_another_scene(bin, root, tmp_path):
    scene = root / "apps" / "scenes" / "block-press.yaml"
    runs = []
    for i in range(2):
        log, csv = tmp_path / f"{i}.lcm", tmp_path / f"{i}.csv"
        r = report(bin / "tm-sim", scene, "--lockstep", "--record", log, "--csv", csv, tmp=tmp_path)
        runs.append((r["state_hash"], log.read_bytes(), csv.read_bytes()))
    assert runs[0] == runs[1]
    other = report(bin / "tm-sim", scene, "--lockstep", "--set", "tissue.materials.*.young=5.001 kPa", tmp=tmp_path)
    assert other["state_hash"] != runs[0][0]


def test_summary_has_the_keys_of_the_contract(bin, root, tmp_path):
    r = report(bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", tmp=tmp_path)
    assert r["tets"] >= 1000 and r["frames"] == 50 and r["substeps_per_frame"] >= 1 and r["ticks"] == 1001
    assert set(r["lateness_us"]) == {"p50", "p99", "p999", "max"} and r["missed_ticks"] == 0
    assert 0 < r["force_N"]["rms"] < r["force_N"]["peak"] < 8.9
    assert r["sim_seconds_per_wall_second"] > 0 and len(r["state_hash"]) == 16
    assert (r["frames_over"] > 0) == (r["frame_compute_us"]["max"] > 1e6 * r["sim_s"] / r["frames"])
    assert r["compute_s"] / r["frames"] <= r["frame_compute_us"]["max"] * 1e-6
    (c,) = r["controllers"]
    assert c["state"] == "engaged" and c["samples_rejected"] == 0 and c["samples_received"] >= 998


def test_force_resists_the_press_and_vanishes_after_it(bin, root, tmp_path):
    run(bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", "--csv", tmp_path / "t.csv", "--samples", tmp_path / "s.csv")
    t, s = columns(tmp_path / "t.csv"), columns(tmp_path / "s.csv")
    pressed = (t["time_s"] > 1.1) & (t["time_s"] < 1.3)
    assert (t["fz_N"][pressed] > 0.05).all()  # up, out of the tissue
    assert (t["fz_N"][t["time_s"] < 0.4] == 0).all() and np.abs(t["fz_N"][-20:]).max() < 1e-6
    assert (s["fz_N"] >= 0).all() and s["fz_N"].max() > 0.1


def test_latency_delays_the_force(bin, root, tmp_path):
    first = []
    for samples in (0, 1):
        path = tmp_path / f"{samples}.csv"
        run(bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", "--csv", path, "--set", f"haptics.latency={samples}", "--set", "haptics.extrapolator=hold",
            "--set", "haptics.rate=25 Hz")
        t = columns(path)
        first.append(t["time_s"][np.argmax(t["fz_N"] > 1e-4)])
    assert first[1] - first[0] == pytest.approx(0.04, abs=0.003)


def rms(a, b):
    """Returns the RMS of the force's error over the peak of the reference `b`."""
    force = [np.column_stack([run[f"f{axis}_N"] for axis in "xyz"]) for run in (a, b)]
    return np.sqrt(((force[0] - force[1]) ** 2).sum(axis=1).mean()) / np.linalg.norm(force[1], axis=1).max()


def test_more_force_samples_err_less(bin, root, tmp_path):
    """With `hold` the hand's error falls with the rate of force samples; the rates of frames, pictures and log are unchanged."""
    traces, counts = {}, {}
    for rate in (25, 50, 125, 250, 500):
        csv, samples = tmp_path / f"{rate}.csv", tmp_path / "samples.csv"
        r = report(bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", "--csv", csv, "--samples", samples, "--set", f"haptics.rate={rate} Hz",
                   "--set", "haptics.latency=0", "--set", "haptics.extrapolator=hold", tmp=tmp_path)
        assert r["frames"] == 50
        traces[rate], counts[rate] = columns(csv), len(columns(samples))
    assert counts == {rate: 2 * rate for rate in counts}
    errors = [rms(traces[rate], traces[500]) for rate in (25, 50, 125, 250)]
    assert 0.01 < errors[0] < 0.2 and all(later < 0.75 * earlier for earlier, later in zip(errors, errors[1:])), errors


def test_a_rate_that_no_frame_divides_into_is_told(bin, root):
    _, said = run(bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--check", "--set", "haptics.rate=60 Hz")
    assert "haptics.rate" in said and "at 50 Hz" in said
    for rate in ("auto", "100 Hz"):
        assert not run(bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--check", "--set", f"haptics.rate={rate}")[1]
    _, said = run(bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--check", "--set", "haptics.rate=often", code=2)
    assert "haptics.rate" in said and ";" in said


def test_samples_between_frames_take_no_substep_more(bin, root, tmp_path):
    """At one rate for both a frame is one sample, with the same bits as without streaming; more samples round the number of substeps up by less than
    one each."""
    scene = [bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", "--set", "haptics.extrapolator=hold"]
    one, many = (report(*scene, "--set", f"haptics.rate={rate} Hz", tmp=tmp_path) for rate in (25, 500))
    assert one["substeps_per_frame"] <= many["substeps_per_frame"] < one["substeps_per_frame"] + 20 and many["substeps_per_frame"] % 20 == 0


def test_a_device_profile_is_obeyed(bin, root, tmp_path):
    weak = tmp_path / "weak.profile"
    weak.write_text("force_max_N = 0.2\n")
    scene = [bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", "--set", f"haptics.profile={weak}"]
    assert 0.15 < report(*scene, tmp=tmp_path)["force_N"]["peak"] <= 0.2 * (1 + 1e-5)
    weak.write_text("force_max_N = strong\n")
    _, said = run(*scene, "--json", tmp_path / "no.json", code=2)
    assert said.startswith(f"{weak}:1: ") and ";" in said and not (tmp_path / "no.json").exists()


def test_loss_loses_samples_the_same_way_every_time(bin, root, tmp_path):
    args = [bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", "--set", "haptics.loss=0.3", "--set", "haptics.rate=25 Hz"]
    a, b = report(*args, tmp=tmp_path), report(*args, tmp=tmp_path)
    assert a["state_hash"] == b["state_hash"]
    assert 20 < a["controllers"][0]["samples_received"] < 45
    c = report(*args, "--set", "haptics.seed=2", tmp=tmp_path)
    assert c["controllers"][0]["samples_received"] != a["controllers"][0]["samples_received"] or c["state_hash"] != a["state_hash"]


def test_the_log_is_a_plain_lcm_log(bin, build, root, tmp_path):
    log = tmp_path / "session.lcm"
    r = report(bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", "--record", log, "--set", "rendering.every=5", "--set", "haptics.rate=50 Hz", tmp=tmp_path)
    code = f"""
import sys, json, lcm
sys.path.insert(0, {str(build / 'python')!r})
import tensormass_lcm as t
kinds = {{'FORCE_0': t.force_sample_t, 'TOOL_0': t.tool_state_t, 'PATCH_0': t.contact_patch_t, 'TISSUE': t.tissue_t, 'SIM_STATUS': t.sim_status_t, 'CONTROLLER_0': t.controller_status_t}}
count, last, forces, tools = {{}}, -1, [], {{}}
for e in lcm.EventLog({str(log)!r}):
    assert e.timestamp >= last; last = e.timestamp
    count[e.channel] = count.get(e.channel, 0) + 1
    m = kinds[e.channel].decode(e.data)
    if e.channel == 'TISSUE': assert m.triangle_count == len(m.triangle) and max(map(max, m.triangle)) == m.vertex_count - 1
    if e.channel == 'TOOL_0': tools[m.utime] = m
    if e.channel == 'FORCE_0' and m.tool_utime: forces.append(m)
    if e.channel == 'SIM_STATUS': assert m.instrument_count == 1 and abs(m.trocar_m[0][2] - 0.18) < 1e-12 and m.axis[0][2] == -1
# The echoed time and place are the controller's own: the tip was there at that time.
near = 0
for f in forces:
    a, b = (max(u for u in tools if u <= f.tool_utime), min(u for u in tools if u >= f.tool_utime))
    near = max(near, min(sum((x - y) ** 2 for x, y in zip(tools[u].tip_m, f.tip_m)) ** 0.5 for u in (a, b)))
print(json.dumps([count, near]))
"""
    # The venv's python has the lcm package.
    count, near = json.loads(run(sys.executable, "-c", code)[0])
    assert 0 < count.pop("PATCH_0") <= 2 * r["frames"]
    assert count == {"FORCE_0": 2 * r["frames"], "TOOL_0": r["ticks"], "TISSUE": 10, "SIM_STATUS": r["frames"], "CONTROLLER_0": 21}
    assert near < 1e-3


def loaded(bin, scene, *args, code=0):
    """Returns the libraries mapped by a running tm-sim, which ends with `code` when it is interrupted."""
    p = subprocess.Popen([bin / "tm-sim", scene, *args], stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    try:
        time.sleep(0.7)
        assert p.poll() is None, "ended too early to be looked at"
        return open(f"/proc/{p.pid}/maps").read()
    finally:
        p.send_signal(signal.SIGINT)
        assert p.wait(timeout=120) == code


def test_a_scene_without_solver_picture_or_messages_loads_none_of_their_libraries(bin, root, tmp_path):
    scene = block_scene(tmp_path, root)
    run(bin / "tm-sim", scene, "--check")  # the cache has the mesh now
    maps = loaded(bin, scene, "--realtime")
    for library in ("liblcm", "libglib", "cholmod", "OSMesa", "libGL", "tensormass/lcm.so", "tensormass/solve.so", "libstdc++"):
        assert library not in maps, library
    assert "libm" in maps
    maps = loaded(bin, scene, "--lockstep", "--duration", "1000000 s", "--record", str(tmp_path / "log"), code=130)
    for library in ("liblcm", "libglib", "tensormass/lcm.so"):  # lockstep's link and a log need none
        assert library not in maps, library
    maps = loaded(bin, scene, "--realtime", "--set", "rendering.every=1", "--url", "memq://")
    assert "tensormass/lcm.so" in maps and "liblcm" in maps  # the check can see a loaded module


def test_ctrl_c_ends_a_run_with_its_files(bin, root, tmp_path):
    p = subprocess.Popen([bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", "--duration", "1000000 s", "--csv", tmp_path / "t.csv", "--json", tmp_path / "o.json"],
                         stdout=subprocess.DEVNULL)
    time.sleep(0.7)
    p.send_signal(signal.SIGINT)
    assert p.wait(timeout=120) == 130  # and reports it
    assert json.loads((tmp_path / "o.json").read_text())["frames"] > 10 and len(columns(tmp_path / "t.csv")) > 100


def test_realtime_keeps_the_clock(bin, root, tmp_path):
    scene = block_scene(tmp_path, root)
    begin = time.monotonic()
    r = report(bin / "tm-sim", scene, "--realtime", "--frames", 20, tmp=tmp_path)
    assert r["frames"] == 20 and 0.75 < time.monotonic() - begin  # 0.8 s, or later on a busy machine: never earlier
    assert r["sim_s"] <= r["wall_s"] + 0.05


# --- effects ---


def explain(bin, scene, tmp_path, *args):
    r = report(bin / "tm-sim", scene, "--explain", *args, tmp=tmp_path)
    return r, {row["name"]: row for row in r["stages"]}


INSTRUMENT = "instruments:\n  - trocar: [50 mm, 50 mm, 180 mm]\n"


def test_explain_names_stage_and_line(bin, root, tmp_path):
    scene = block_scene(tmp_path, root, "gravity:\n" + INSTRUMENT + "contact: {compliance: 1 mm/N}\n")
    r, rows = explain(bin, scene, tmp_path)
    assert [row["name"] for row in r["stages"] if row["in_step"]] == ["contact", "force", "gravity", "integrate", "support",
                                                                           "contact detect", "contact solve", "contact forces"]
    assert rows["gravity"]["line"] == 8 and rows["contact"]["line"] == 11 and rows["support"]["line"] == 7 and rows["force"]["line"] == 1
    assert rows["contact"]["asked_by"] == f"{scene}:11"
    assert abs(sum(row.get("share", 0) for row in r["stages"]) - 1) < 1e-9
    assert r["left_out"] == [e for e in r["left_out"] if e not in ("gravity", "contact")] and "damping" in r["left_out"]
    out, _ = run(bin / "tm-sim", scene, "--explain", "--unset", "gravity", "--set", "damping.rate=3 /s")
    assert "--set damping.rate=3 /s" in out and "not in the scene, without cost: anisotropy strain_smoothing gravity" in out


CONTACT = INSTRUMENT + "contact:\n"


EXAMPLES = [(e.name, e.example, {"instruments": INSTRUMENT, "contact": CONTACT}.get("".join(e.needs), "")) for e in effects() if e.example is not None]
NO_STAGE = ("damping", "strain_smoothing", "rotation", "viscosity", "haptics", "rendering")  # of their own name


@pytest.mark.parametrize("effect,value,more", EXAMPLES + [
    ("strain_smoothing", "{shear_share: 1}", CONTACT + "cut:\n"), ("haptics", "{extrapolator: local_model}", CONTACT), ("viscosity", "{terms: [{time: 0.1 s, shear: 0.3, bulk: 0}]}", CONTACT + "cut:\nstrain_smoothing:\n")])
def test_an_effect_added_and_removed_returns_memory_and_stages_exactly(bin, root, tmp_path, effect, value, more):
    scene = block_scene(tmp_path, root, more)
    without, rows = explain(bin, scene, tmp_path)
    named, rows_named = explain(bin, scene, tmp_path, "--set", f"{effect}={value}")
    back, rows_back = explain(bin, scene, tmp_path, "--set", f"{effect}={value}", "--unset", effect)
    cost = sum(row["bytes"] for row in named["stages"]) - sum(row["bytes"] for row in without["stages"])
    assert named["memory_bytes"] - without["memory_bytes"] == cost
    assert back["memory_bytes"] == without["memory_bytes"] and set(rows_back) == set(rows)
    new = set(rows_named) - set(rows)
    assert new and effect in without["left_out"] and effect not in named["left_out"]
    assert all(rows_named[name]["asked_by"] == f"--set {effect}={value}" for name in new)
    if effect not in NO_STAGE:
        assert rows_named[effect]["in_step"] and cost > 0


def test_fibres_cost_their_memory_and_nothing_in_the_step(bin, root, tmp_path):
    scene = block_scene(tmp_path, root)
    plain, rows = explain(bin, scene, tmp_path)
    fibred, rows_fibred = explain(bin, scene, tmp_path, "--set", "anisotropy={rule: radial}",
                                  "--set", "tissue.materials.*={lambda_T: 10 kPa, mu_T: 3 kPa, lambda_L: 12 kPa, mu_L: 9 kPa}")
    assert rows_fibred["anisotropy"]["bytes"] == fibred["memory_bytes"] - plain["memory_bytes"] > 0
    assert [r for r in rows_fibred if rows_fibred[r]["in_step"]] == [r for r in rows if rows[r]["in_step"]]


def test_explain_says_what_a_sliver_costs_where_tissue_is_cut(bin, root, tmp_path):
    lines = (root / "meshes/block_1k.msh").read_text().split("\n")
    first = lines.index("$Nodes") + 2
    point = np.array([line.split()[1:] for line in lines[first:first + int(lines[first - 1])]], float)
    low, above = np.unique(point[:, 2])[:2]
    inside = [i for i, x in enumerate(point) if x[2] == above and all(x[:2] > point.min(0)[:2]) and all(x[:2] < point.max(0)[:2])][0]
    x = point[inside]
    lines[first + inside] = f"{inside + 1} {x[0]} {x[1]} {low + 0.05 * (above - low)}"
    (tmp_path / "sliver.msh").write_text("\n".join(lines))
    sound = block_scene(tmp_path, root, CONTACT + "cut:\n")
    thin = block_scene(tmp_path, tmp_path, CONTACT + "cut:\n", name="thin.yaml", mesh="../sliver.msh")
    (tmp_path / "meshes").mkdir()
    assert "slivers" not in explain(bin, sound, tmp_path)[0]
    assert "slivers" not in explain(bin, thin, tmp_path, "--unset", "cut")[0]
    said = explain(bin, thin, tmp_path)[0]["slivers"]
    assert 0.01 < said["of_median"] < 0.2
    step = report(bin / "tm-mesh", "info", tmp_path / "sliver.msh", tmp=tmp_path)["critical_step"]
    assert said["tetrahedron"] == step["cut_tet"] and abs(said["of_median"] / step["worst_over_median"] - 1) < 0.5  # another nu
    assert "time.mass_scaling" in run(bin / "tm-sim", thin, "--explain")[0]
    scaled = ["--set", "time.step=0.5 ms", "--set", "time.mass_scaling=yes", "--set", "time.mass_scaling_max=10"]
    assert "slivers" not in explain(bin, thin, tmp_path, *scaled)[0]
