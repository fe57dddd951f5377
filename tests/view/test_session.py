"""A short complete session: `make demo`'s driver, its log replayed into tm-view and haptic-rt, and lcm-spy as observer."""
import csv
import json
import math
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import time
import types

import pytest

from test_view import needs_namespace, pixels, probe, share, tissue_red

HERE = pathlib.Path(__file__).resolve().parent
SCENE = "apps/scenes/liver-press.yaml"
of_the_demo = pytest.mark.xdist_group("demo")  # one after the other: the second would wait for the demo


@pytest.fixture(scope="session")
def demo(root, build, once):
    """Runs the demo's driver for 4 s with small pictures."""
    def driven(folder):
        run = subprocess.run([sys.executable, root / "apps" / "demo" / "demo.py", "--build", build, "--out", folder / "out", "--scene", root / SCENE,
                              "--duration", "4", "--set", "time.duration=1 s", "--size", "320x180"], capture_output=True, text=True, timeout=900)
        assert run.returncode == 0, run.stderr
        (folder / "said").write_text(run.stdout)

    folder = once("demo", driven)
    return folder / "out", (folder / "said").read_text()


@pytest.fixture(scope="session")
def netns(root):
    script = str(root / "apps" / "demo" / "netns.sh")

    def command(pidfile, *args):
        return [script, "run", str(pidfile), *map(str, args)]

    return command


@of_the_demo
def test_three_models_feel_the_same(demo):
    summary = json.loads((demo[0] / "summary.json").read_text())
    models = summary["models"]
    assert summary["models_scene"].endswith(SCENE) and summary["models_refused"] == {}
    peaks = [models[m]["force_N"]["peak"] for m in ("dynamic", "precomputed", "hybrid")]
    assert min(peaks) > 0.1 and max(peaks) < 1.05 * min(peaks), models  # the same scene; the dynamic ones lag a little


@of_the_demo
def test_summary_has_the_promised_keys(demo):
    s = json.loads((demo[0] / "summary.json").read_text())
    assert s["tets"] >= 10000 and s["frames"] > 0.9 * 4 / s["frame_s"] and s["substeps_per_frame"] > 1
    assert s["ticks"] == 2000 and s["missed_ticks"] >= 0
    assert 0 <= s["lateness_us"]["p50"] <= s["lateness_us"]["p99"] <= s["lateness_us"]["max"]
    assert 0 < s["force_N"]["rms"] < s["force_N"]["peak"] < 8.9
    assert s["sim_seconds_per_wall_second"] > 0
    assert len(s["state_hash"]) == 16 and int(s["state_hash"], 16) != 0
    assert s["lockstep"]["force_form"] == "plain" and s["lockstep"]["runs"] == 2
    assert all(i["fault"] == "none" and i["samples"]["received"] > 50 for i in s["instruments"])


@of_the_demo
def test_hash_is_of_the_final_state(demo):
    """The same run stopped a frame earlier ends in another state."""
    first, second = (json.loads((demo[0] / f"lockstep{n}.json").read_text()) for n in (1, 2))
    assert first["state_hash"] == second["state_hash"] == json.loads((demo[0] / "summary.json").read_text())["state_hash"]
    assert first["frames"] == 25


@of_the_demo
def test_terminal_table(demo):
    for word in ("tetrahedra", "s per s of wall clock", "missed", "N RMS", "the same twice", "summary.json"):
        assert word in demo[1]


@of_the_demo
def test_pictures_film_plot_and_log(demo):
    out = demo[0]
    assert share(pixels(out / "picture.png"), tissue_red) > 0.08
    frames = sorted((out / "frames").glob("frame_*.png"))
    assert 6 <= len(frames) <= 9
    stream = probe(out / "video.mp4")
    assert (stream["width"], stream["height"]) == (320, 180) and 100 < int(stream["nb_read_frames"]) < 130
    assert pixels(out / "force.png").std() > 0.02
    assert (out / "demo.lcm").stat().st_size > 1e6


@of_the_demo
def test_controller_follows_the_simulation(demo):
    """The peak at 500 Hz is near the peak of the samples, and the force is zero before contact."""
    with open(demo[0] / "ticks0.csv") as file:
        rows = [(float(r["time_s"]), math.dist((0, 0, 0), [float(r[k]) for k in ("fx_N", "fy_N", "fz_N")])) for r in csv.DictReader(file)]
    sim = json.loads((demo[0] / "sim.json").read_text())
    peak = max(f for _, f in rows)
    assert peak == pytest.approx(sim["force_N"]["peak"], rel=0.25)
    assert all(f == 0 for t, f in rows if t < 0.5)


@of_the_demo
def test_the_extrapolators_are_judged_on_the_recorded_session(bin, root, demo, tmp_path):
    """The log's two clocks agree: a session with streamed samples errs less than the same scene in lockstep at 25 samples a second, for every
    extrapolator that assumes little."""
    subprocess.run([bin / "tm-sim", root / SCENE, "--lockstep", "--duration", "4 s", "--set", "haptics.rate=25 Hz", "--record", tmp_path / "lockstep.lcm"], check=True, timeout=400,
                   capture_output=True)
    run = subprocess.run([bin / "tm-evaluate", demo[0] / "demo.lcm", tmp_path / "lockstep.lcm", "--json", tmp_path / "e.json"], capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    real, lockstep = ({r["extrapolator"]: r for r in log["rows"]} for log in json.loads((tmp_path / "e.json").read_text())["logs"])
    assert real["hold"]["judged"] > 1000
    assert lockstep["hold"]["rms"] > 0.005 and lockstep["position"]["rms"] < lockstep["hold"]["rms"]
    for name in ("hold", "position", "broyden"):
        assert real[name]["rms"] < 0.7 * lockstep["hold"]["rms"], (name, real[name], lockstep["hold"])


@of_the_demo
def test_the_plot_puts_record_and_log_on_one_clock(root, build, demo):
    """The same joints at the same time: in the controller's record, and in the TOOL messages of the log."""
    import lcm

    sys.path[:0] = [str(root / "apps/demo"), str(build / "python")]
    import demo as driver
    import tensormass_lcm

    begin_us = driver.record_begin_us(types.SimpleNamespace(build=build, out=demo[0]), 0)
    with open(demo[0] / "ticks0.csv") as file:
        rows = {f"{float(r['pitch_rad']):.6f} {float(r['insertion_m']):.6f}": float(r["time_s"]) for r in csv.DictReader(file)}
    apart = []
    for event in lcm.EventLog(str(demo[0] / "demo.lcm"), "r"):
        if event.channel == "TOOL_0":
            m = tensormass_lcm.tool_state_t.decode(event.data)
            at = rows.get(f"{m.joint[0]:.6f} {m.joint[2]:.6f}")
            if at is not None:
                apart.append((event.timestamp - begin_us) * 1e-6 - at)
    assert len(apart) > 300
    assert abs(sorted(apart)[len(apart) // 2]) < 0.03, sorted(apart)[len(apart) // 2]


def finish(process, timeout=300):
    out, err = process.communicate(timeout=timeout)
    assert process.returncode == 0, err
    return out + err


@needs_namespace
def test_recorded_demo_replays_into_view_and_controller(bin, demo, netns, tmp_path):
    out = demo[0]
    script = f"""
        {bin}/tm-view --video {tmp_path}/replay.mp4 --duration 4 --size 320x180 --quality 0 --json {tmp_path}/view.json & view=$!
        {bin}/tm-device --bus virtual:replay{os.getpid()} --hand {out}/hand0.csv --duration 6 --json {tmp_path}/device.json & device=$!
        {bin}/haptic-rt --replay --bus virtual:replay{os.getpid()} --duration 6 --json {tmp_path}/controller.json & controller=$!
        sleep 0.5; timeout 20 lcm-logplayer {out}/demo.lcm
        wait $view && wait $device && wait $controller
    """
    run = subprocess.run(netns(tmp_path / "pid", "bash", "-c", script), capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    view = json.loads((tmp_path / "view.json").read_text())
    assert view["messages_taken"] > 150 and view["messages_refused"] == 0 and view["vertices"] > 500
    assert int(probe(tmp_path / "replay.mp4")["nb_read_frames"]) == 120
    played, recorded = (json.loads(p.read_text()) for p in (tmp_path / "controller.json", out / "controller0.json"))
    assert played["samples"]["received"] > 0.8 * recorded["samples"]["received"]
    assert played["fault"] == "none"
    assert played["force_N"]["peak"] == pytest.approx(recorded["force_N"]["peak"], rel=0.3)


@needs_namespace
def test_replay_of_the_page_renders_forces(bin, demo, netns, root, tmp_path):
    """docs/window.md, Logs: its lines as written, in the network that the first of them makes."""
    block = re.search(r"## Logs.*?```sh\n(.*?)```", (root / "docs/window.md").read_text(), re.S).group(1)
    lines = [line for line in block.splitlines() if line[0] != "#"]
    assert re.match(r"apps/demo/netns.sh run \S+ bash\b", lines[0]) and len(lines) == 5
    script = "\n".join(lines[1:]).replace("build/demo/", f"{demo[0]}/").replace("build/bin/", f"{bin}/").replace("--duration 10", "--duration 4 --size 320x180 --quality 0").replace(
        "virtual:replay", f"virtual:page{os.getpid()}")
    run = subprocess.run(netns(tmp_path / "pid", "bash", "-c", f"{script}\nwait %1; kill %2 %3; wait"), cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert "engaged" in run.stderr, run.stderr
    assert int(probe(tmp_path / "replay.mp4")["nb_read_frames"]) > 100


@needs_namespace
def test_without_replay_a_recording_moves_no_motor(bin, demo, netns, tmp_path):
    """Samples for another controller are foreign: played back by accident, they must not be rendered."""
    script = f"""
        {bin}/tm-device --bus virtual:safe{os.getpid()} --hand {demo[0]}/hand0.csv --duration 4 --json {tmp_path}/device.json & device=$!
        {bin}/haptic-rt --bus virtual:safe{os.getpid()} --duration 4 --json {tmp_path}/controller.json & controller=$!
        sleep 0.5; timeout 20 lcm-logplayer {demo[0]}/demo.lcm
        wait $device && wait $controller
    """
    run = subprocess.run(netns(tmp_path / "pid", "bash", "-c", script), capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    controller = json.loads((tmp_path / "controller.json").read_text())
    assert controller["force_N"]["peak"] == 0 and controller["samples"]["rejected"] > 50


HOSTILE = """
import struct, sys, time
sys.path[:0] = [{here!r}]
import synthetic, lcm
types = synthetic.import_types({types!r})
link = lcm.LCM("udpm://239.255.76.67:7667?ttl=0")
session = synthetic.Session(types, 8)
def spoiled(m, at):
    d = m.encode()
    return [d[:at] + struct.pack(">i", n) + d[at + 4:] for n in (-1, -2**31, 2**31 - 1, 10**6)] + [d[:k] for k in range(0, len(d), 7)] + [d + b"x"]
command = types.controller_command_t()
command.extrapolator = "hold"
status, controller = session.status(0, 0), session.controller(0, 0, 0)
for _ in range(3):
    for channel, message, at in (("CONTROLLER_COMMAND_0", command, 21), ("SIM_STATUS", status, 28), ("CONTROLLER_0", controller, 34)):
        for data in spoiled(message, at):
            link.publish(channel, data)
            time.sleep(0.002)
"""


@needs_namespace
def test_false_string_lengths_end_no_program(bin, build, root, netns, tmp_path):
    """tm-sim receives CONTROLLER_0, haptic-rt SIM_STATUS and CONTROLLER_COMMAND_0: all three contain strings."""
    (tmp_path / "hostile.py").write_text(HOSTILE.format(here=str(HERE), types=str(build / "python")))
    script = f"""
        {bin}/tm-sim {root}/{SCENE} --realtime --duration '4 s' --json {tmp_path}/sim.json & sim=$!
        {bin}/haptic-rt --bus virtual:hostile{os.getpid()} --duration 4 --json {tmp_path}/controller.json & controller=$!
        sleep 1.5; {sys.executable} {tmp_path}/hostile.py || exit 9
        wait $sim && wait $controller
    """
    run = subprocess.run(netns(tmp_path / "pid", "bash", "-c", script), capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    assert (tmp_path / "sim.json").exists() and (tmp_path / "controller.json").exists()


def test_the_models_are_those_of_the_scene(root, build, tmp_path):
    """A user's own scene is compared by the models that can run it, and no other scene replaces it; a shipped scene that is cut has a substitute,
    which is named."""
    sys.path.insert(0, str(root / "apps/demo"))
    import demo

    own = tmp_path / "own.yaml"
    text = (root / "apps/scenes/liver-cut.yaml").read_text().replace("../../", f"{root}/")
    own.write_text(text)
    a = types.SimpleNamespace(build=build, scene=own, set=["time.duration=0.2 s"], duration=0.2, out=tmp_path)
    mine = demo.run_models(a)
    assert list(mine["models"]) == ["dynamic"] and mine["models_scene"].endswith("own.yaml")
    assert set(mine["models_refused"]) == {"precomputed", "hybrid"} and "exclude each other" in mine["models_refused"]["precomputed"]
    assert json.loads((tmp_path / "model_dynamic.json").read_text())["tets"] == 15238
    a.scene = root / "apps/scenes/liver-cut.yaml"
    assert list(demo.models_that_run(a, demo.SHOWN, [])) == list(demo.MODELS)
    assert all(w is None for w in demo.models_that_run(a, demo.SHOWN, []).values())


def test_demo_with_a_bad_scene_says_so(root, build, tmp_path):
    demo = [sys.executable, root / "apps" / "demo" / "demo.py", "--build", build, "--out", tmp_path / "out"]
    run = subprocess.run([*demo, "--scene", tmp_path / "nowhere.yaml"], capture_output=True, text=True, timeout=300)
    assert run.returncode == 2 and "nowhere.yaml: this scene does not exist" in run.stderr


# --- lcm-spy ---


def spy(root, build, env):
    return subprocess.run([root / "apps" / "demo" / "spy.sh"], capture_output=True, text=True, timeout=300, cwd=root, env={**os.environ, "OUT": str(build), "SPY_WAIT": "0", **env})


def test_spy_without_java_display_or_session_says_what_to_do(root, build, tmp_path):
    tools = tmp_path / "bin"
    tools.mkdir()
    for name in ("bash", "dirname", "cat", "make"):
        (tools / name).symlink_to(shutil.which(name))
    run = spy(root, build, {"PATH": str(tools)})
    assert run.returncode == 2 and "no Java" in run.stderr and "default-jre" in run.stderr
    run = spy(root, build, {"DISPLAY": ""})
    assert run.returncode == 2 and "no display" in run.stderr
    run = spy(root, tmp_path, {"DISPLAY": ":99", "OUT": str(build / "no-session-here")})
    assert run.returncode == 2 and ("no session" in run.stderr or "could not be built" in run.stderr)


@pytest.fixture
def display(tmp_path):
    """A virtual screen."""
    if not shutil.which("Xvfb"):
        pytest.skip("Xvfb is not installed; tools/setup.sh check")
    read, write = os.pipe()
    server = subprocess.Popen(["Xvfb", "-displayfd", str(write), "-screen", "0", "1100x800x24", "-nolisten", "tcp", "-noreset"], pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    with os.fdopen(read) as told:  # kept open: the server writes more than once
        yield f":{told.readline().strip()}"
        server.terminate()
        server.wait()


def screenshot(display, path):
    subprocess.run(["ffmpeg", "-loglevel", "error", "-y", "-f", "x11grab", "-video_size", "1100x800", "-i", display, "-frames:v", "1", str(path)], check=True, timeout=120)
    return pixels(path)


def listed(picture):
    """Returns the lines of the picture with text in the table's first rows: channels are listed. None before the window exists."""
    dark = picture[20:110, :350].mean(axis=2) < 0.5
    return dark.any(axis=1).sum() if dark.mean() < 0.5 else 0


@needs_namespace
def test_spy_joins_the_session_and_decodes_its_types(root, build, demo, netns, display, tmp_path):
    if not shutil.which("java"):
        pytest.skip("no Java; tools/setup.sh spy")
    out = tmp_path / "build"
    (out / "demo").mkdir(parents=True)
    jar = build / "java" / "tensormass_types.jar"
    subprocess.run(["make", "-s", os.path.relpath(jar, root)], cwd=root, check=True, timeout=400, capture_output=True)
    player = subprocess.Popen(netns(out / "demo" / "netns.pid", "sh", "-c", 'while lcm-logplayer "$0"; do :; done', demo[0] / "demo.lcm"), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                              start_new_session=True)
    try:
        while not (out / "demo/netns.pid").exists() or not (out / "demo/netns.pid").read_text().strip():
            time.sleep(0.05)
        shutil.copytree(jar.parent, out / "java")
        script = root / "apps" / "demo" / "netns.sh"
        classes = f"/usr/share/java/lcm.jar:/usr/share/java/jchart2d.jar:{jar}"
        window = subprocess.Popen([script, "join", out / "demo" / "netns.pid", "java", "-cp", classes, "lcm.spy.Spy"], env={**os.environ, "DISPLAY": display},
                                  stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        try:
            end = time.monotonic() + 60
            while listed(picture := screenshot(display, tmp_path / "spy.png")) <= 20 and time.monotonic() < end:
                time.sleep(0.3)
        finally:
            window.send_signal(signal.SIGTERM)
            said = window.communicate(timeout=120)[0]
    finally:
        os.killpg(player.pid, signal.SIGTERM)
        player.wait()
    assert f"Found {len(list((root / 'lcm_types').glob('*.lcm')))} LCM types" in said
    assert listed(picture) > 20
