"""tm-session from an installed prefix: one command starts a scene with controllers and devices, from an empty folder."""
import importlib.util
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time

import pytest

ENVIRONMENT = {k: v for k, v in os.environ.items() if k not in ("MAKEFLAGS", "MAKELEVEL", "MFLAGS")}


@pytest.fixture(scope="module")
def prefix(root, tmp_path_factory):
    prefix = tmp_path_factory.mktemp("live") / "prefix"
    run = subprocess.run(["make", "--no-print-directory", "install-programs", "install-controller", f"PREFIX={prefix}"], cwd=root, env=ENVIRONMENT, capture_output=True, text=True,
                         timeout=900)
    assert run.returncode == 0, run.stdout + run.stderr
    return prefix


def running(prefix):
    return subprocess.run(["pgrep", "-f", f"^{prefix}/bin/"], capture_output=True, text=True).stdout.split()


ENGAGED = """
import lcm, sys, tensormass_lcm, time
link, said, end = lcm.LCM("udpm://239.255.76.67:7667?ttl=0"), [], time.monotonic() + 60
link.subscribe("CONTROLLER_0", lambda _, data: said.append(tensormass_lcm.controller_status_t.decode(data)))
while not said or said[-1].state != 3 or (sys.argv[1:] and said[-1].extrapolator != sys.argv[1]):
    assert time.monotonic() < end, f"the controller says {[(m.state, m.extrapolator) for m in said[-1:]]}"
    link.handle_timeout(100)
"""


def until_engaged(prefix, build, out, *extrapolator):
    """Waits until all three programs run and the controller reports this extrapolator."""
    end = time.monotonic() + 60
    while not (out / "netns.pid").exists() or not (out / "netns.pid").read_text().strip():
        assert time.monotonic() < end, "no session"
        time.sleep(0.05)
    run = subprocess.run([prefix / "lib/tensormass/session/netns.sh", "join", out / "netns.pid", sys.executable, "-c", ENGAGED, *extrapolator],
                         env={**ENVIRONMENT, "PYTHONPATH": str(build / "python")}, capture_output=True, text=True, timeout=400)
    assert run.returncode == 0, run.stderr


def test_session_renders_forces(prefix, tmp_path):
    run = subprocess.run([prefix / "bin/tm-session", "liver-press", "--set", "hand[0].path[1].time=0.5 s", "--set", "hand[0].path[0].time=0 s", "--duration", "4 s", "--out", "out", "--record",
                          "session.lcm"], cwd=tmp_path, env=ENVIRONMENT, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    assert "netns.sh join" in run.stdout
    controller = json.loads((tmp_path / "out/controller0.json").read_text())
    assert controller["force_N"]["peak"] > 0.05 and controller["fault"] == "none", controller
    assert (tmp_path / "session.lcm").stat().st_size > 1e5
    assert not running(prefix)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_signal_ends_all(prefix, build, tmp_path, number):
    """Checks that all have ended, their reports are written, and the temporary folder is gone."""
    session = subprocess.Popen([prefix / "bin/tm-session", "liver-press", "--out", "out"], cwd=tmp_path, env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    until_engaged(prefix, build, tmp_path / "out")
    assert len(running(prefix)) >= 3
    if number == signal.SIGKILL:  # processes inside the session's namespace, where nothing else ends them
        inner = subprocess.run(["pgrep", "-f", f"python3 {prefix}/bin/tm-session .*--inside"], capture_output=True, text=True).stdout.split()
        assert len(inner) == 1
        os.kill(int(inner[0]), number)
    else:
        session.send_signal(number)
    said = session.communicate(timeout=300)
    assert session.returncode == (137 if number == signal.SIGKILL else 0), said
    end = time.monotonic() + 20
    while running(prefix) and time.monotonic() < end:
        time.sleep(0.1)
    assert not running(prefix)
    if number != signal.SIGKILL:
        assert {"sim.json", "controller0.json", "device0.json"} <= {p.name for p in (tmp_path / "out").iterdir()}


@pytest.mark.parametrize("words, said", [
    (["no-such-scene"], "tm-sim --list"),
    (["liver-press", "--video", "a.mp4"], "--duration"),
    (["liver-press", "--record", "no/a.lcm"], "its folder does not exist"),
    (["liver-press", "--duration", "-1"], "above 0"),
    (["liver-press", "--play"], "no display"),
])
def test_bad_input(prefix, tmp_path, words, said):
    env = {k: v for k, v in ENVIRONMENT.items() if k not in ("DISPLAY", "WAYLAND_DISPLAY")}
    run = subprocess.run([prefix / "bin/tm-session", *words], cwd=tmp_path, env=env, capture_output=True, text=True, timeout=300)
    assert run.returncode == 2 and said in run.stderr and run.stderr.startswith("tm-session: "), run.stderr
    assert not list(tmp_path.iterdir())


# --- pages that need a live session, as written ---


def test_users_organ_renders_forces(prefix, root, tmp_path):
    """docs/your-own-organ.md, last step: the liver's first scene, with the page's command."""
    page = (root / "docs/your-own-organ.md").read_text()
    (tmp_path / "felt").mkdir()
    shutil.copy(root / "meshes/liver_10k.msh", tmp_path / "felt/organ.msh")
    subprocess.run([prefix / "bin/tm-scene", "new", "organ.msh", "-o", "organ.yaml"], cwd=tmp_path / "felt", env=ENVIRONMENT, check=True, timeout=300, capture_output=True)
    command = re.search(r"^    (tm-session .*)$", page, re.M).group(1)
    run = subprocess.run(command, shell=True, cwd=tmp_path, env={**ENVIRONMENT, "PATH": f"{prefix}/bin:{os.environ['PATH']}"}, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    assert json.loads((tmp_path / "session/controller0.json").read_text())["force_N"]["peak"] > 0.05


def test_manual_command_is_obeyed(prefix, root, build, tmp_path):
    """docs/messages.md, Sending a message by hand: the session's controller switches to the extrapolator that the page's lines request."""
    block = re.search(r"## Sending a message by hand.*?```sh\n(.*?)```", (root / "docs/messages.md").read_text(), re.S).group(1)
    for named, here in (("session/netns.pid", tmp_path / "session/netns.pid"), ("build/venv/bin/python", sys.executable), ("build/python", build / "python")):
        assert named in block
        block = block.replace(named, str(here))
    session = subprocess.Popen([prefix / "bin/tm-session", "liver-press", "--out", "session"], cwd=tmp_path, env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        until_engaged(prefix, build, tmp_path / "session")
        run = subprocess.run(["bash", "-ec", block], cwd=root, env=ENVIRONMENT, capture_output=True, text=True, timeout=300)
        assert run.returncode == 0, run.stderr
        until_engaged(prefix, build, tmp_path / "session", "tangent")
    finally:
        session.send_signal(signal.SIGINT)
        said = session.communicate(timeout=300)
    assert session.returncode == 0, said
    assert json.loads((tmp_path / "session/controller0.json").read_text())["extrapolator"] == "tangent"


def test_the_window_gets_the_scene_and_durations_have_units(root, monkeypatch, capsys):
    """tm-play shows title, supports and regions; durations are as tm-sim's."""
    monkeypatch.syspath_prepend(str(root / "apps/demo"))
    spec = importlib.util.spec_from_file_location("tm_session", root / "apps/session/tm_session.py")
    program = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(program)

    class Ring:
        def __init__(self, *_, **more):
            self.hand = more["hand"]

        start_ring = end = lambda self, *_: None
        well = lambda self: True

    started = []
    monkeypatch.setattr(program, "Session", Ring)
    monkeypatch.setattr(program.subprocess, "run", lambda command: started.append([str(c) for c in command]) or subprocess.CompletedProcess(command, 0))
    monkeypatch.setattr(sys, "argv", ["tm-session", "--play", "some.yaml", "--duration", "1.5 min"])
    assert program.inside(program.arguments()) == 0
    assert started == [[str(program.BIN / "tm-play"), "--scene", "some.yaml", "--duration", "90.0"]]
    assert [program.seconds(t) for t in ("4", "4 s", "500ms", "2 min", "1e3 ms")] == [4, 4, 0.5, 120, 1]
    for wrong in ("4 kg", "long", "", "4 h"):
        with pytest.raises(SystemExit, match="2"):
            program.seconds(wrong)
        assert f"--duration {wrong}: this is not a time" in capsys.readouterr().err
