"""make play's window under a virtual screen: synthetic mouse and keys move the device, and forces are rendered."""
import json
import math
import os
import signal
import subprocess
import sys
import time

import pytest

import synthetic
from test_regions import FLAT, blue, mesh  # noqa: F401 (mesh is a fixture)
from test_session import SCENE, display, screenshot  # noqa: F401 (display is a fixture)
from test_view import needs_namespace, pixels, share, tissue_red


def play(root, build, *args, env=None, timeout=300):
    return subprocess.run([sys.executable, root / "apps" / "play" / "play.py", "--build", build, *map(str, args)], capture_output=True, text=True, timeout=timeout, env=env)


NO_DISPLAY = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}


def test_missing_display_is_reported(root, build, bin, tmp_path):
    run = play(root, build, "--out", tmp_path / "out", env=NO_DISPLAY)
    assert run.returncode == 2 and "no display" in run.stderr and "make demo" in run.stderr
    assert os.listdir(tmp_path) == []
    run = subprocess.run([bin / "tm-play"], capture_output=True, text=True, timeout=120, env=NO_DISPLAY)
    assert run.returncode == 2 and "no window" in run.stderr and "tm-view" in run.stderr
    run = subprocess.run([bin / "tm-play"], capture_output=True, text=True, timeout=120, env={**NO_DISPLAY, "DISPLAY": ":4999"})
    assert run.returncode == 2 and "no window" in run.stderr


@pytest.mark.parametrize("args,said", [(["--size", "9x9"], "--size"), (["--nothing"], "unknown option"), (["stray"], "not an option"), (["--quality", "2"], "--quality"), (["--duration", "x"], "--duration"),
                                       (["--through", "0.5"], "add --scene FILE"), (["--fibres"], "--fibres needs the scene"), (["--through", "1", "--scene", "a.yaml"], "from 0 to 0.95"), (["--scene", "nowhere.yaml"], "nowhere.yaml")])
def test_bad_options(bin, args, said):
    run = subprocess.run([bin / "tm-play", *args], capture_output=True, text=True, timeout=120, env=NO_DISPLAY)
    assert run.returncode == 2 and said in run.stderr


def test_help_and_version(bin):
    for option in ("--help", "--version"):
        run = subprocess.run([bin / "tm-play", option], capture_output=True, text=True, timeout=120, env=NO_DISPLAY)
        assert run.returncode == 0 and "tm-play" in run.stdout


def test_bad_scene_and_record_folder(root, build, tmp_path):
    env = {**NO_DISPLAY, "DISPLAY": ":4999"}
    run = play(root, build, "--out", tmp_path / "out", "--scene", tmp_path / "no.yaml", env=env)
    assert run.returncode == 2 and "this scene does not exist" in run.stderr
    run = play(root, build, "--out", tmp_path / "out", "--scene", root / SCENE, "--record", tmp_path / "no" / "x.lcm", env=env)
    assert run.returncode == 2 and "its folder does not exist" in run.stderr


def xdotool(display_name, *args):
    return subprocess.run(["xdotool", *map(str, args)], env={**os.environ, "DISPLAY": display_name}, capture_output=True, text=True, timeout=120).stdout


# A display's driver leaks a little, and is unloaded before a report could name it.
SOFTWARE = ["--renderer", "osmesa"] if os.environ.get("TM_SANITIZER") else []


def find_window(display_name, patience_s=20):
    end = time.monotonic() + patience_s
    while time.monotonic() < end:
        found = xdotool(display_name, "search", "--name", "^tensormass$").split()
        if found:
            return found[0]
        time.sleep(0.2)
    return None


def read_log(path, types):
    import lcm

    kinds = {"HAND": types.hand_command_t, "TOOL": types.tool_state_t, "CONTROLLER": types.controller_status_t, "FORCE": types.force_sample_t,
             "CONTROLLER_COMMAND": types.controller_command_t}
    out = {}
    for event in lcm.EventLog(str(path), "r"):
        kind = kinds.get(event.channel[:-2])
        if kind:
            out.setdefault(event.channel, []).append(kind.decode(event.data))
    return out


ENGAGED = 3
RENDERERS = """
{bin}/tm-sim {root}/{scene} --realtime --duration '90 s' > {out}/sim.txt 2>&1 & sim=$!
{bin}/tm-view --quiet --size 64x64 --png {out}/there.png || exit 6
for r in opengl osmesa auto; do {bin}/tm-play --watch --duration 1 --renderer $r --size 480x320 --png {out}/$r.png --json {out}/$r.json 2> {out}/$r.txt || exit 9; done
SDL_OPENGL_LIBRARY=/no/such/library {bin}/tm-play --watch --duration 1 --size 480x320 --png {out}/none.png --json {out}/none.json 2> {out}/none.txt || exit 8
SDL_OPENGL_LIBRARY=/no/such/library {bin}/tm-play --watch --duration 1 --renderer opengl 2> {out}/only.txt; [ $? = 2 ] || exit 7
kill $sim; wait $sim; exit 0
"""


@needs_namespace
def test_the_displays_opengl_draws_where_it_can(root, bin, display, tmp_path):  # noqa: F811
    """The same picture by the display's OpenGL as in software; without OpenGL, software, and the reason is printed."""
    script = RENDERERS.format(bin=bin, root=root, scene=SCENE, out=tmp_path)
    run = subprocess.run([root / "apps/demo/netns.sh", "run", tmp_path / "pid", "bash", "-c", script], env={**os.environ, "DISPLAY": display}, capture_output=True, text=True, timeout=600)
    said = {name: (tmp_path / f"{name}.txt").read_text() for name in ("opengl", "osmesa", "auto", "none", "only") if (tmp_path / f"{name}.txt").exists()}
    assert run.returncode == 0, (run, said)
    drawn_by = {name: json.loads((tmp_path / f"{name}.json").read_text()) for name in ("opengl", "osmesa", "auto", "none")}
    assert {name: d["renderer"] for name, d in drawn_by.items()} == {"opengl": "opengl", "osmesa": "osmesa", "auto": "opengl", "none": "osmesa"}
    assert all(d["opengl"] and d["pictures"] > 0 for d in drawn_by.values())
    assert "drawing in software" in said["none"] and "no OpenGL 3.3" in said["only"] and "drawing in software" not in said["auto"] + said["osmesa"]
    picture = {name: pixels(tmp_path / f"{name}.png")[80:240] for name in drawn_by}  # between the panels
    assert share(picture["opengl"], tissue_red) > 0.1
    for name in ("opengl", "auto", "none"):
        assert abs(picture[name] - picture["osmesa"]).mean() < 0.01, name


INSIDE = """
{bin}/tm-sim {scene} --realtime --duration '90 s' > {out}/sim.txt 2>&1 & sim=$!
{bin}/tm-view --quiet --size 64x64 --png {out}/there.png || exit 6
play() {{ {bin}/tm-play --watch --duration 1 --renderer osmesa --size 320x200 --json {out}/$1.json --png {out}/$1.png --scene {scene} "${{@:2}}" 2>> {out}/$1.txt || exit 9; }}
tissue() {{ [ $(wc -c < {out}/$1.png) -gt 12000 ]; }}
for try in 1 2 3 4 5 6 7 8; do play closed; tissue closed && break; done
for try in 1 2 3 4 5 6 7 8; do play open --through 0.8; tissue open && break; done
kill $sim; wait $sim; exit 0
"""


@needs_namespace
def test_the_window_has_the_scenes_regions(root, bin, display, mesh, tmp_path):  # noqa: F811
    """Messages describe a surface without regions: the vein inside, the supports' marks and the title come from the scene, as in tm-view."""
    scene = mesh.with_suffix(".yaml")
    subprocess.run([bin / "tm-scene", "new", mesh, "-o", scene], check=True, capture_output=True, timeout=60)
    script = INSIDE.format(bin=bin, scene=scene, out=tmp_path)
    run = subprocess.run([root / "apps/demo/netns.sh", "run", tmp_path / "pid", "bash", "-c", script], env={**os.environ, "DISPLAY": display}, capture_output=True, text=True, timeout=600)
    assert run.returncode == 0, (run, [p.read_text() for p in tmp_path.glob("*.txt")])
    closed, opened = (pixels(tmp_path / f"{name}.png") for name in ("closed", "open"))
    assert share(closed, blue) == 0 and share(opened, blue) > 0.002, (share(closed, blue), share(opened, blue))
    assert share(closed, held) > 0.0005


def held(r, g, b):
    """Returns points of the picture where a support is."""
    return (g > 0.4) & (g > 1.3 * r) & (g > 1.15 * b)


@needs_namespace
def test_mouse_and_keys_are_felt_and_recorded(root, build, bin, display, tmp_path):  # noqa: F811
    """Pivot by mouse, insert by key until the tissue answers, switch extrapolator and passivity; all of it is in the log."""
    log, figures = tmp_path / "session.lcm", tmp_path / "play.json"
    env = {**os.environ, "DISPLAY": display}
    session = subprocess.Popen([sys.executable, root / "apps" / "play" / "play.py", "--build", build, "--scene", root / SCENE, "--out", tmp_path / "out", "--record", log,
                                "--", "--size", "480x320", "--json", str(figures), *SOFTWARE], env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)
    kinds = synthetic.import_types(build / "python")

    def until(condition, what, act=lambda: None, seconds=60):
        """Repeats the action until the log, which is being written, satisfies the condition."""
        end = time.monotonic() + seconds
        while not (log.exists() and condition(read_log(log, kinds))):
            assert session.poll() is None and time.monotonic() < end, what
            act()
            time.sleep(0.1)

    def drag():
        """Presses again: a window about to get the focus forgets earlier keys."""
        xdotool(display, "mouseup", 1, "mousedown", 1, "mousemove_relative", "--", -4, 2)

    def pivoted(heard):
        first, last = heard["HAND_0"][0].joint, heard["HAND_0"][-1].joint
        return math.hypot(last[0] - first[0], last[1] - first[1]) > 0.012

    def followed(heard):
        hand, tool = heard["HAND_0"][-1].joint, heard["TOOL_0"][-1].joint
        return abs(hand[0] - tool[0]) < 0.02 and abs(hand[2] - tool[2]) < 0.008

    try:
        window = find_window(display, 60)
        assert window, "the window did not open"
        until(lambda heard: len(heard.get("CONTROLLER_0", [])) > 10 and heard["CONTROLLER_0"][-1].state == ENGAGED and "FORCE_0" in heard, "the session is not under way")
        xdotool(display, "mousemove", "--window", window, 240, 160)
        until(lambda heard: "HAND_0" in heard and pivoted(heard), "the mouse moves nothing", drag)
        xdotool(display, "mouseup", 1)
        xdotool(display, "key", "x")
        until(lambda heard: heard["CONTROLLER_0"][-1].extrapolator == "hold", "the key switches no extrapolator")
        xdotool(display, "key", "p")
        until(lambda heard: heard["CONTROLLER_0"][-1].passivity_on != heard["CONTROLLER_0"][5].passivity_on, "the key switches no passivity")
        xdotool(display, "keydown", "w")
        until(lambda heard: heard["HAND_0"][-1].joint[2] - heard["HAND_0"][0].joint[2] > 0.02 and max(math.hypot(*m.force_N) for m in heard["CONTROLLER_0"]) > 0.1, "no tissue is felt")
        xdotool(display, "keyup", "w")
        picture = screenshot(display, tmp_path / "screen.png")
        xdotool(display, "keydown", "s")  # out of the tissue, whose force depends on how late this process was
        until(lambda heard: not any(heard["CONTROLLER_0"][-1].force_N), "the tissue is not left")
        xdotool(display, "keyup", "s")
        until(followed, "the device does not follow")
        xdotool(display, "key", "Escape")
        out, err = session.communicate(timeout=120)
    finally:
        if session.poll() is None:
            os.killpg(session.pid, signal.SIGINT)  # like a terminal; the window has this test's pipes, too
            session.communicate(timeout=120)
    assert session.returncode == 0, out + err
    assert share(picture, tissue_red) > 0.02
    report = json.loads(figures.read_text())
    assert report["hands_sent"] > 10 and report["messages_refused"] == 0
    heard = read_log(log, kinds)
    first, last = heard["HAND_0"][0].joint, heard["HAND_0"][-1].joint
    assert max(m.joint[2] for m in heard["HAND_0"]) - first[2] > 0.02  # inserted
    assert math.hypot(last[0] - first[0], last[1] - first[1]) > 0.01  # pivoted
    tool = heard["TOOL_0"][-1].joint
    assert tool[0] == pytest.approx(last[0], abs=0.03) and tool[2] == pytest.approx(last[2], abs=0.01)  # the device followed
    assert max(math.hypot(*m.force_N) for m in heard["FORCE_0"]) > 0.1
    assert max(math.hypot(*m.force_N) for m in heard["CONTROLLER_0"]) > 0.1
    before, after = heard["CONTROLLER_0"][5], heard["CONTROLLER_0"][-1]
    assert (before.extrapolator, after.extrapolator) == ("adaptive", "hold") and before.passivity_on != after.passivity_on
    assert heard["CONTROLLER_COMMAND_0"]
    assert not list((tmp_path / "out").glob("netns.pid"))
    drawn = subprocess.run([bin / "tm-view", log, "--png", tmp_path / "drawn.png", "--size", "320x200"], capture_output=True, text=True, timeout=300)
    assert drawn.returncode == 0, drawn.stderr
