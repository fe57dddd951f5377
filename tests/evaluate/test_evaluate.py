"""tm-evaluate: its logs, its study in the short form, and properties that hold for any figures."""
import json
import subprocess
import sys

import pytest
from paths import LONG

NAMES = ["hold", "time", "position", "broyden", "tangent", "local_model", "paper_position", "adaptive"]


@pytest.fixture(scope="module")
def logs(bin, root, once):
    def make(out):
        subprocess.run([bin / "tm-evaluate", "--generate", out, "--model", "precomputed"], cwd=root, check=True, timeout=900)

    return once("evaluate-logs", make)


@pytest.fixture(scope="module")
def page(bin, root, once):
    def make(out):
        subprocess.run([bin / "tm-evaluate", "--study", "--quick", "--model", "precomputed", "--json", out / "figures.json"], cwd=root, check=True, timeout=900)
        subprocess.run([bin / "tm-stability", "--quick", "--case", "spike-100mm", "--case", "replays", "--json", out / "torture.json"], cwd=root, check=True, timeout=900)
        subprocess.run([sys.executable, root / "apps/studies/evaluate/page.py", out / "figures.json", "-o", out, "--torture", out / "torture.json"], check=True, timeout=900)

    out = once("evaluate-study", make)
    return out, json.loads((out / "evaluate.json").read_text())


def figures(bin, root, tmp_path, *arguments):
    subprocess.run([bin / "tm-evaluate", *arguments, "--json", tmp_path / "e.json"], cwd=root, check=True, timeout=400)
    return json.loads((tmp_path / "e.json").read_text())["logs"]


def test_logs_hold_samples_patches_and_truth(bin, root, logs, tmp_path):
    one, = figures(bin, root, tmp_path, logs / "precomputed-tour.lcm")
    assert one["truth"] == "recorded" and one["samples"] > 100
    rms = {r["extrapolator"]: r["rms"] for r in one["rows"]}
    assert list(rms) == NAMES
    assert rms["local_model"] < rms["tangent"] < rms["position"] < rms["hold"]
    assert rms["local_model"] < rms["position"] / 10


def test_latency_affects_hold_and_not_local_model(bin, root, logs, tmp_path):
    now, = figures(bin, root, tmp_path, logs / "precomputed-tour.lcm")
    late, = figures(bin, root, tmp_path, "--latency", "1", logs / "precomputed-tour.lcm")
    rms = [{r["extrapolator"]: r["rms"] for r in x["rows"]} for x in (now, late)]
    assert rms[1]["hold"] > 1.5 * rms[0]["hold"]
    assert rms[1]["local_model"] < 1.5 * rms[0]["local_model"]
    assert rms[1]["local_model"] < rms[1]["position"] / 30


def test_signed_beats_unsigned_on_reversals(bin, root, logs, tmp_path):
    one, = figures(bin, root, tmp_path, logs / "precomputed-reversals.lcm")
    rms = {r["extrapolator"]: r["rms"] for r in one["rows"]}
    assert rms["position"] < rms["paper_position"]


# --- logs of real time: samples arrive on the wall clock, ticks are on the controller's clock ---

EPOCH_US = 1_700_000_000_000_000


def rewrite(root, build, log, out, change):
    """Copies the log with change(event, message, type) applied to each message; it returns [(timestamp, channel, bytes)]."""
    sys.path.insert(0, str(build / "python"))
    import lcm
    import tensormass_lcm

    types = {"TOOL": tensormass_lcm.tool_state_t, "FORCE": tensormass_lcm.force_sample_t, "TRUTH": tensormass_lcm.force_sample_t, "PATCH": tensormass_lcm.contact_patch_t}
    written = lcm.EventLog(str(out), "w", overwrite=True)
    for event in lcm.EventLog(str(log), "r"):
        kind = event.channel.split("_")[0]
        for at, channel, data in change(event, types[kind].decode(event.data) if kind in types else None, kind):
            written.write_event(at, channel, data)
    written.close()
    return out


def told(one):
    return {r["extrapolator"]: [r[k] for k in ("judged", "rms", "peak", "jump_p99", "direction_rad", "off_patch")] for r in one["rows"]}


def on_the_wall_clock(event, message, kind, offset_us=EPOCH_US):
    at = event.timestamp + offset_us
    if kind in ("FORCE", "PATCH"):
        message.utime = at
    return [(at, event.channel, message.encode() if message else event.data)]


def test_two_clocks_change_no_figure(bin, root, build, logs, tmp_path):
    plain, = figures(bin, root, tmp_path, logs / "precomputed-tour.lcm")
    moved, = figures(bin, root, tmp_path, rewrite(root, build, logs / "precomputed-tour.lcm", tmp_path / "wall.lcm", on_the_wall_clock))
    assert told(moved) == told(plain) and plain["rows"][0]["judged"] > 1000 and plain["rows"][0]["rms"] > 0.01


def test_clock_steps_and_late_messages_change_no_figure(bin, root, build, logs, tmp_path):
    """The clock is set back by an hour in the middle; every message takes up to 1 ms."""
    begin = []

    def change(event, message, kind):
        begin.append(event.timestamp)
        lag = event.eventnum * 7919 % 1000
        return on_the_wall_clock(event, message, kind, EPOCH_US + lag - (3_600_000_000 if event.timestamp > begin[0] + 3_000_000 else 0))

    plain, = figures(bin, root, tmp_path, logs / "precomputed-tour.lcm")
    moved, = figures(bin, root, tmp_path, rewrite(root, build, logs / "precomputed-tour.lcm", tmp_path / "set.lcm", change))
    for name in ("hold", "time", "position", "broyden"):
        assert told(moved)[name][1] == pytest.approx(told(plain)[name][1], rel=0.1), name


def test_every_instrument_and_the_longest_session_of_its_controller(bin, root, build, logs, tmp_path):
    ticks = []

    def change(event, message, kind):
        first = [(event.timestamp, event.channel, event.data)]
        if kind not in ("TOOL", "FORCE"):
            return first
        message.instrument = 1
        if kind == "TOOL":  # an earlier controller that ran for a second, on a clock of its own
            ticks.append(event.timestamp)
            if len(ticks) < 500:
                message.session, message.utime = 77, event.timestamp + 10**12
        return first + [(event.timestamp, event.channel.replace("_0", "_1"), message.encode())]

    both = figures(bin, root, tmp_path, rewrite(root, build, logs / "precomputed-tour.lcm", tmp_path / "both.lcm", change))
    assert [x["instrument"] for x in both] == [0, 1] and [x["controller_sessions"] for x in both] == [1, 2]
    rows = {r["extrapolator"]: r for r in both[1]["rows"]}
    assert rows["local_model"]["needs"] == "patch" and "rms" not in rows["local_model"]  # no PATCH_1 was written
    assert rows["position"]["rms"] > 0.001 and rows["hold"]["rms"] > rows["position"]["rms"]


def test_tangent_and_local_model_report_missing_data(bin, root, tmp_path):
    """A session of `position` sends neither stiffness nor patches: `tangent` and `local_model` ran as `broyden` and are not shown under their names."""
    subprocess.run([bin / "tm-sim", root / "apps/scenes/liver-press.yaml", "--lockstep", "--duration", "2 s", "--set", "haptics.extrapolator=position", "--set", "haptics.rate=25 Hz", "--record", tmp_path / "s.lcm"],
                   check=True, timeout=400, capture_output=True)
    run = subprocess.run([bin / "tm-evaluate", tmp_path / "s.lcm", "--json", tmp_path / "e.json"], cwd=root, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    assert [line.split()[0] for line in run.stdout.splitlines() if "not in this log" in line] == ["tangent", "local_model"]
    one, = json.loads((tmp_path / "e.json").read_text())["logs"]
    rows = {r["extrapolator"]: r for r in one["rows"]}
    assert rows["tangent"] == {"extrapolator": "tangent", "needs": "stiffness"} and rows["local_model"]["needs"] == "patch"
    assert 0 < rows["broyden"]["rms"] < 0.1


@pytest.mark.parametrize("what, says", [("elsewhen", "no tick of TOOL"), ("untouched", "never touched")])
def test_a_log_in_which_nothing_can_be_judged_is_refused(bin, root, build, logs, tmp_path, what, says):
    def change(event, message, kind):
        if kind == "FORCE" and what == "elsewhen":
            message.tool_utime += 10**12
        if kind in ("FORCE", "TRUTH") and what == "untouched":
            message.force_N = [0, 0, 0]
        if kind == "TRUTH" and what == "elsewhen":
            return []
        return [(event.timestamp, event.channel, message.encode() if message else event.data)]

    log = rewrite(root, build, logs / "precomputed-tour.lcm", tmp_path / "bad.lcm", change)
    (tmp_path / "e.json").write_text("old")
    run = subprocess.run([bin / "tm-evaluate", log, "--json", tmp_path / "e.json"], cwd=root, capture_output=True, text=True, timeout=300)
    assert run.returncode == 2 and says in run.stderr, run
    assert (tmp_path / "e.json").read_text() == "old"


def test_the_page_is_complete(page):
    out, data = page
    html = (out / "index.html").read_text()
    for name in ("roughness", "figure5", "rates_precomputed", "jitter", "loss", "loop"):
        assert f'alt="{name}"' in html and (out / f"{name}.png").stat().st_size > 5000
    rows = data["rows"]
    for key, values in {"latency_frames": {0, 1, 2, 3}, "truth": {"model", "interpolated"}, "encoders": {True, False}, "path": {"tour", "reversals", "grasped-and-pulled"}}.items():
        assert {r[key] for r in rows} == values, key
    assert {round(r["loss"], 3) for r in rows} == {0, 0.1, 0.2, 0.3}
    assert {r["extrapolator"] for r in rows} == set(NAMES)
    assert json.loads((out / "rates.json").read_text())["rows"]


def test_page_compares_aims_with_figures(page):
    """Each aim of the runs is listed with a verdict that follows from its two numbers; then the threshold of perception and the times of patches."""
    out, data = page
    aims = {a["what"]: a for a in data["aims"]}
    rms = {r["extrapolator"]: r["rms"] for r in data["rows"] if r["path"] == "tour" and r["latency_frames"] == 2 and abs(r["speed_m_s"] - 0.03) < 1e-9 and r["truth"] == "model"}
    fast = aims["contact on precomputed tissue at 0.03 m/s, 2 late"]
    assert fast["figure"] == pytest.approx(rms["position"] / rms["local_model"]) and fast["met"] == (fast["figure"] >= 30)
    assert fast["figure"] > 27  # patches look ahead as far as a sample may be late: 30.7; 22 if two frames, 11 if one
    rough = aims["the force itself, precomputed, 3 mm"]
    assert rough["met"] == (rough["figure"] <= 0.5) and rough["figure"] == pytest.approx(100 * data["roughness"][0]["largest"])
    html = (out / "index.html").read_text()
    assert all(a["what"] in html for a in data["aims"])
    assert {c["name"]: c["good"] for c in data["torture"]} == {"spike-100mm": True, "replays": True}
    ready, = data["ready"]
    assert 15000 <= ready["tets"] < 16000 and ready["first_whole_patch_s"] > ready["first_whole_patch_worker_s"] > 0
    assert 1 <= ready["exact_after_cut_frames"] <= ready["exact_after_cut_frames_most"] and ready["step_alone_s"] > 0


def test_two_cauteries_never_push_harder_than_tissue_does(bin, root, tmp_path):
    """Random cutting with `local_model`: no force exceeds the reference's peak by more than a tenth, with samples in time and late."""
    subprocess.run([bin / "tm-evaluate", "--study", "--quick", "--quiet", "--part", "cutting", "--model", "isotropic", "--json", tmp_path / "c.json"], cwd=root, check=True, timeout=900)
    rows = json.loads((tmp_path / "c.json").read_text())["cutting"]
    contact = {(r["latency_frames"], r["instrument"]): r for r in rows if r["extrapolator"] == "local_model"}
    assert set(contact) == {(late, hand) for late in (0, 1, 2) for hand in (0, 1)} and all(r["cut"] > 50 and r["judged"] > 3000 for r in rows)
    assert contact[0, 0]["rms"] != contact[0, 1]["rms"]  # each hand's own force, of one run
    for r in contact.values():
        assert 0.5 < r["largest"] < 1.1 and r["over_limit"] < 1, r


def test_roughness_stays_within_the_aim(page):
    """Roughness of the force: the aim is 0.5 % of its peak per tick; measured 0.4 % and less."""
    for row in page[1]["roughness"]:
        assert row["p99"] < 0.005, row


def test_the_loop_is_stable_where_theory_says_so_and_further(page):
    rows = [r for r in page[1]["loop"]["rows"] if not r["passivity"]]
    hold, = (r for r in rows if r["extrapolator"] == "hold")
    assert 0.5 < hold["stiffness_N_m"] / hold["theory_N_m"] < 2
    assert max(r["stiffness_N_m"] for r in rows) > 8 * hold["stiffness_N_m"]


def test_streaming_widens_what_a_hand_can_touch(page):
    """Z-width with hold: 2,694 N/m at 500 samples a second, 377 at 25 (short form), both near theory; damping in the wall helps at high sample rates."""
    at = {(r["rate_Hz"], r["wall_N_s_m"]): r for r in page[1]["loop"]["z_width"] if not r["passivity"]}
    assert all(0.5 < at[rate, 0]["stiffness_N_m"] / at[rate, 0]["theory_N_m"] < 1.5 for rate in (25, 500))
    assert at[500, 0]["stiffness_N_m"] > 4 * at[25, 0]["stiffness_N_m"]
    assert at[500, 0]["stiffness_N_m"] < at[500, 6]["stiffness_N_m"] < 4 * at[500, 0]["stiffness_N_m"]


def test_desk_devices_reach_the_theoretical_stiffness(page):
    """Measured by twins, at 500 samples a second. The theory is sufficient for any passive hand; this hand may be stable beyond it."""
    rows = {r["device"]: r for r in page[1]["devices"]["z_width"]}
    assert set(rows) == {"inverse3", "omega"}
    assert all(0.5 < r["stiffness_N_m"] / r["theory_N_m"] < 2.5 for r in rows.values()), rows


def test_errors_at_the_hand_fall_with_the_rate_and_grow_with_delay(page, root):
    """The page has the errors of this run (omega): 28 mN at 500 Hz, 4.8 mN at 4000; with 2 ms of delay in the device 46 and 17 mN."""
    at = {(r["rate_Hz"], r["late_ms"]): r for r in page[1]["devices"]["errors"]}
    assert set(at) == {(500, 0), (500, 2), (4000, 0), (4000, 2)} and all(r["settled"] for r in at.values())
    assert 3 < at[500, 0]["error_mN"] / at[4000, 0]["error_mN"] < 12
    shown = next(line for line in (root / "docs/devices.md").read_text().splitlines() if line.startswith("| omega |") and len(line.split("|")) == 12).split("|")[6:11]
    assert [float(shown[k]) for k in (0, 3, 4)] == [round(at[key]["error_mN"], 1) for key in ((500, 0), (4000, 0), (4000, 2))], "run tests/devices/device_table.py --twins --write"
    assert at[500, 2]["error_mN"] > 1.3 * at[500, 0]["error_mN"] and at[4000, 2]["error_mN"] > 2 * at[4000, 0]["error_mN"]


def test_the_loop_is_stable_on_cut_tissue_too(bin, root, tmp_path):
    """Measured 14.5 times the stiffness with hold."""
    subprocess.run([bin / "tm-evaluate", "--study", "--quick", "--part", "tissue-loop", "--model", "cut", "--json", tmp_path / "loop.json"], cwd=root, check=True, timeout=900)
    at = {r["extrapolator"]: r["stiffness_N_m"] for r in json.loads((tmp_path / "loop.json").read_text())["tissue-loop"]}
    assert 300 < at["hold"] < 2000 and at["local_model"] > 10 * at["hold"]


@pytest.mark.parametrize("arguments, says", [
    ([], "give logs, --study"),
    (["--study"], "--study needs --json"),
    (["--model", "jelly", "--study"], "no model 'jelly'"),
    (["nowhere.lcm"], "nowhere.lcm: "),
    (["--loss", "2", "x.lcm"], "--loss 2"),
    (["--latency", "-1", "x.lcm"], "--latency -1"),
    (["--study", "--path", "round"], "no path 'round'"),
    (["--study", "--part", "all"], "no part 'all'"),
    (["--frobnicate"], "unknown option, or its value is missing"),
])
def test_invalid_options_are_rejected(bin, tmp_path, arguments, says):
    run = subprocess.run([bin / "tm-evaluate", *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert run.returncode == 2 and says in run.stderr, run
    assert not list(tmp_path.iterdir())


def test_a_log_is_judged_by_its_own_device(bin, root, build, tmp_path):
    """A desk device gives 3.2 N, an Impulse Engine 8.9 N: the force over the limit shows which device's limit was used."""
    log = tmp_path / "desk.lcm"
    subprocess.run([bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", "--quiet", "--set", "instruments[0].device=desk", "--set", f"recording.file={log}"],
                   check=True, timeout=300)
    one, = figures(bin, root, tmp_path, log)
    hold = one["rows"][0]
    assert one["device"] == "desk" and hold["over_limit"] == pytest.approx(one["peak_N"] / 3.2, rel=0.2)

    def change(event, message, kind):
        if kind == "TOOL":
            message.device = 99
        return [(event.timestamp, event.channel, message.encode() if message else event.data)]

    rewrite(root, build, log, tmp_path / "strange.lcm", change)
    run = subprocess.run([bin / "tm-evaluate", tmp_path / "strange.lcm"], capture_output=True, text=True, timeout=60)
    assert run.returncode == 2 and "TOOL_0 is of device 99, which this build does not know" in run.stderr


def test_a_log_without_samples_is_refused(bin, tmp_path):
    (tmp_path / "empty.lcm").write_bytes(b"")
    run = subprocess.run([bin / "tm-evaluate", tmp_path / "empty.lcm"], capture_output=True, text=True, timeout=300)
    assert run.returncode == 2 and "TOOL_0" in run.stderr


def test_a_scene_without_instruments_is_refused(bin, root, tmp_path):
    """Scenes are first looked up in the working directory: this one contains nothing whose force could be replayed."""
    scene = tmp_path / "apps/scenes/liver-press.yaml"
    scene.parent.mkdir(parents=True)
    scene.write_text(f"""tissue: {{mesh: {root}/meshes/block_1k.msh, materials: {{tissue: {{young: 5 kPa, poisson: 0.4, density: 1050 kg/m3}}}}}}
supports: [{{name: bottom, group: z_min}}]
time: {{frame_rate: 20 Hz, duration: 0.1 s}}
""")
    run = subprocess.run([bin / "tm-evaluate", "--study", "--quick", "--part", "operating", "--json", "x.json"], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert run.returncode == 2 and "liver-press.yaml: the scene has no instrument" in run.stderr and "add 'instruments:'" in run.stderr, run
    assert not (tmp_path / "x.json").exists()


# --- tissue that is cut or grasped while it is touched ---

HOLDING = ["isotropic", "precomputed", *(["hybrid"] if LONG else [])]  # the hybrid model costs many times more than both
HELD = [word for model in HOLDING for word in ("--model", model)]


@pytest.fixture(scope="module")
def hands(bin, root, once):
    def make(out):
        for name, words in (("cut", ["--model", "isotropic", "--path", "other-hand-cuts", "--path", "same-hand-cuts"]), ("held", [*HELD, "--path", "grasped-and-pulled"])):
            subprocess.run([bin / "tm-evaluate", "--study", *words, "--json", out / f"{name}.json"], cwd=root, check=True, timeout=600)

    made = once("evaluate-hands", make)
    rows = [r for name in ("cut", "held") for r in json.loads((made / f"{name}.json").read_text())["rates"]["rows"]]
    return lambda path, late, model="isotropic": {r["extrapolator"]: r for r in rows if r["path"] == path and r["latency_frames"] == late and r["model"] == model}


@pytest.mark.parametrize("late", [0, 1, 2])
def test_local_model_follows_cuts_of_the_other_hand(hands, late):
    """Measured 0.44, 0.21 and 0.14 of `position`'s error; a cut elsewhere causes no jump at the hand. Without latency, samples of two simulation
    rates already differ by 0.36 % of the peak, and patches from their samples by 0.7 %; `position` errs by 1.84 %."""
    at = hands("other-hand-cuts", late)
    assert at["local_model"]["cut_true"] > 80 and at["local_model"]["cut_shared"] == at["local_model"]["cut_true"]
    assert at["local_model"]["rms"] < at["position"]["rms"] / (3 if late else 2) and at["tangent"]["rms"] < at["position"]["rms"]
    assert at["local_model"]["jump_arrival"] < 0.03 and at["local_model"]["off_patch"] == 0


def test_two_simulations_cut_nearly_the_same(hands):
    for path in ("other-hand-cuts", "same-hand-cuts"):
        own = hands(f"{path}, own cuts", 0)["local_model"]
        assert own["cut_shared"] > 0.9 * own["cut_true"], path


@pytest.mark.parametrize("late", [0, 1, 2])
def test_a_cautery_errs_where_it_cut_after_its_sample(hands, late):
    """A cut after the sample cannot be known at the hand. The remaining force is as accurate as before, and late news is blended in. (Without latency
    one tick jumps by 3.2 %, long after the last cut, where a patch differs from its sample by as much.)"""
    at = hands("same-hand-cuts", late)
    contact = at["local_model"]
    assert contact["cut_true"] > 80 and contact["cut_since_error2"] > 0.9 and contact["cut_since_ticks"] < 0.5
    assert contact["jump_arrival"] < (0.03 if late else 0.034) and at["position"]["jump_arrival"] > 0.45
    assert contact["jump_arrival"] < at["local_model-unbridged"]["jump_arrival"] / 4


def test_a_run_of_the_study_replays_to_the_bit(bin, root, hands, tmp_path):
    """Exact columns come from a factor that is updated as tissue is removed; in lockstep they are repeatable bit for bit."""
    subprocess.run([bin / "tm-evaluate", "--study", "--model", "isotropic", "--path", "same-hand-cuts", "--json", tmp_path / "again.json"], cwd=root, check=True, timeout=900)
    again = [r for r in json.loads((tmp_path / "again.json").read_text())["rates"]["rows"] if r["path"] == "same-hand-cuts"]
    assert len(again) >= 3 * len(NAMES)
    for r in again:
        before = hands(r["path"], r["latency_frames"])[r["extrapolator"]]
        assert {k: v for k, v in r.items() if k != "ns_per_tick"} == {k: v for k, v in before.items() if k != "ns_per_tick"}


@pytest.mark.parametrize("model", HOLDING)
def test_grasped_and_pulled_has_rows(hands, model):
    for late in (0, 1, 2):
        at = hands("grasped-and-pulled", late, model)
        assert set(NAMES) <= set(at) and at["local_model"]["peak_N"] > 0.3
        assert at["local_model"]["rms"] <= at["position"]["rms"]


# --- operating scenes ---

@pytest.fixture(scope="module")
def operating(page):
    return page[1]["operating"]


def test_operating_scenes_have_every_law_rate_and_phase(operating):
    hands = {(r["scene"], r["mode"]) for r in operating}
    assert {("liver-press", "probe"), ("liver-dissect", "grasper"), ("liver-dissect", "cautery")} <= hands
    assert {r["extrapolator"] for r in operating} == {*NAMES, "frozen"} and {r["rate_Hz"] for r in operating} >= ({25, 100, 500} if LONG else {25, 500})
    phases = {p for r in operating if r["mode"] == "grasper" for p in r["phases"]}
    assert {"free", "touch", "grasp", "lift", "cut", "let go"} <= phases
    assert all(sum(p["ticks"] for p in r["phases"].values()) == r["judged"] for r in operating)


@pytest.mark.parametrize("name", ["hold", "time", "position", "broyden", "tangent", "local_model", "adaptive"])
def test_more_samples_err_less_by_every_law_and_at_the_tick_rate_none_guesses(operating, name):
    """Consistency: the error falls with the rate; with a sample in every tick each extrapolator equals `hold`."""
    for scene, mode in {(r["scene"], r["mode"]) for r in operating}:
        own = {(r["extrapolator"], r["rate_Hz"]): r["rms"] for r in operating if (r["scene"], r["mode"], r["latency_samples"]) == (scene, mode, 0)}
        rates = sorted({rate for _, rate in own})
        assert own[name, rates[-1]] < own["hold", rates[-1]] + 5e-4, (scene, mode, own[name, rates[-1]], own["hold", rates[-1]])
        assert own[name, rates[-1]] < own[name, rates[0]], (scene, mode)


def test_streaming_reaches_its_aims(operating):
    """Samples at the tick rate, one late, with `hold`: aims of 0.5 % for grasped or pressed tissue, 3 % under a cautery."""
    late = {(r["scene"], r["mode"]): r["rms"] for r in operating if r["extrapolator"] == "hold" and r["rate_Hz"] == 500 and r["latency_samples"] == 1}
    assert all(rms <= (0.03 if mode == "cautery" else 0.005) for (_, mode), rms in late.items()), late


def test_fading_cut_has_a_smooth_force(operating):
    """`cut.fade` 50 ms, samples at the tick rate, one late: the cautery's error is half as large (aim 1.5 %), its jumps half as far, and the other
    hand's force is as before."""
    at = {(r["scene"], r["mode"]): r for r in operating if r["extrapolator"] == "adaptive" and r["rate_Hz"] == 500 and r["latency_samples"] == 1}
    plain, faded = at["liver-dissect", "cautery"], at["liver-dissect, fade", "cautery"]
    assert faded["rms"] < 0.015 and faded["rms"] < 0.6 * plain["rms"], (plain["rms"], faded["rms"])
    assert faded["jump_true"] < 0.5 * plain["jump_true"]
    assert faded["peak_N"] < 1.45 * plain["peak_N"]  # the fading force acts in addition to that of the surface behind the cut
    assert at["liver-dissect, fade", "grasper"]["rms"] < 0.005


def test_frozen_directions_are_right_for_a_hold_and_a_small_motion(operating):
    """SOFA's method compared with `local_model`: equally accurate for a grasp, which is linear; several times worse for a probe that slides over
    faces, though better than `hold`."""
    at = lambda scene, mode, name: next(r["rms"] for r in operating if (r["scene"], r["mode"], r["extrapolator"], r["rate_Hz"], r["latency_samples"]) == (scene, mode, name, 25, 1))
    assert abs(at("liver-dissect", "grasper", "frozen") / at("liver-dissect", "grasper", "local_model") - 1) < 0.05
    assert 2 * at("liver-press", "probe", "local_model") < at("liver-press", "probe", "frozen") < 0.5 * at("liver-press", "probe", "hold")


def test_adaptive_is_near_the_best_law_and_never_above_hold(operating):
    """At 25 Hz, in every scene without fading cuts and at every latency; frozen directions excepted."""
    for scene, mode in {(r["scene"], r["mode"]) for r in operating if "fade" not in r["scene"]}:
        for late in (0, 1, 2):
            rms = {r["extrapolator"]: r["rms"] for r in operating if (r["scene"], r["mode"], r["rate_Hz"], r["latency_samples"]) == (scene, mode, 25, late)}
            best = min(v for n, v in rms.items() if n not in ("adaptive", "frozen"))
            assert rms["adaptive"] < 1.1 * best and rms["adaptive"] < 1.01 * rms["hold"], (scene, mode, late, rms)
