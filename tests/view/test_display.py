"""The display of `ssh -X` (a TCP port of this machine, with a cookie) from a network namespace that cannot reach it: apps/demo/display.py."""
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import time

import pytest

from test_session import SCENE
from test_view import needs_namespace


def bridge(root, *command, env, timeout=120):
    return subprocess.run([root / "apps/demo/display.py", *map(str, command)], env=env, capture_output=True, text=True, timeout=timeout)


@pytest.fixture
def forwarded(tmp_path):
    """Sets up what sshd does: DISPLAY=localhost:N.0, the cookie under unix:N, no socket file."""
    for program in ("Xvfb", "xauth", "xdpyinfo"):
        if not shutil.which(program):
            pytest.skip(f"{program} is not installed; tools/setup.sh check")
    cookie = os.urandom(16).hex()
    server = None
    for number in range(500 + os.getpid() % 400, 1000):
        for name, entry in (("server", f"localhost:{number}"), ("user", f"unix:{number}")):
            subprocess.run(["xauth", "-q", "-f", tmp_path / name, "add", entry, "MIT-MAGIC-COOKIE-1", cookie], check=True, stderr=subprocess.DEVNULL)
        server = subprocess.Popen(["Xvfb", f":{number}", "-listen", "tcp", "-nolisten", "unix", "-nolisten", "local", "-auth", tmp_path / "server", "-screen", "0", "1100x800x24",
                                   "-noreset"], stderr=subprocess.DEVNULL)
        env = {**os.environ, "DISPLAY": f"localhost:{number}.0", "XAUTHORITY": str(tmp_path / "user")}
        for _ in range(100):
            if server.poll() is not None or subprocess.run(["xdpyinfo"], env=env, capture_output=True).returncode == 0:
                break
            time.sleep(0.1)
        if server.poll() is None:
            break
    assert not pathlib.Path(f"/tmp/.X11-unix/X{number}").exists()
    yield env, number
    server.terminate()
    server.wait()


@needs_namespace
def test_a_namespace_reaches_the_display_of_ssh(root, forwarded, tmp_path):
    env, number = forwarded
    ask = [root / "apps/demo/netns.sh", "run", tmp_path / "pid", "xdpyinfo"]
    alone = subprocess.run(ask, env=env, capture_output=True, text=True, timeout=120)
    assert alone.returncode != 0 and "unable to open display" in alone.stderr, "the namespace is none"
    run = bridge(root, *ask, env=env)
    assert run.returncode == 0 and f"name of display:    :{number}" in run.stdout, run.stderr
    assert not pathlib.Path(f"/tmp/.X11-unix/X{number}").exists(), "left behind"
    stranger = bridge(root, *ask, env={**env, "XAUTHORITY": str(tmp_path / "none")})
    assert stranger.returncode != 0, "the cookie is not asked for"
    assert bridge(root, "sh", "-c", "exit 7", env=env).returncode == 7


@needs_namespace
def test_play_opens_its_window_there(root, build, forwarded, tmp_path):
    """make play's driver over such a display: its window exists, and its session ends with it."""
    env, _ = forwarded
    play = subprocess.Popen([sys.executable, root / "apps/play/play.py", "--build", build, "--out", tmp_path / "out", "--scene", root / SCENE, "--",
                             "--duration", "3", "--json", tmp_path / "play.json"], env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        said = play.communicate(timeout=300)
    finally:
        if play.poll() is None:
            play.send_signal(signal.SIGINT)
            play.wait(timeout=120)
    assert play.returncode == 0, said
    assert json.loads((tmp_path / "play.json").read_text())["pictures"] > 5


@needs_namespace
def test_a_session_opens_its_window_there(bin, forwarded, tmp_path):
    env, _ = forwarded
    run = subprocess.run([bin / "tm-session", "liver-press", "--play", "--duration", "3", "--out", tmp_path / "out", "--record", tmp_path / "session.lcm"], env=env, capture_output=True, text=True,
                         timeout=300)
    assert run.returncode == 0, run.stdout + run.stderr
    assert b"HAND_0" in (tmp_path / "session.lcm").read_bytes(), "no window moved the hand"


def test_displays_that_cannot_be_reached_are_told(root):
    for name, text in (("localhost:4999.0", "does not answer"), (":4999", "does not answer"), ("nonsense", "is not a display")):
        run = bridge(root, "true", env={**os.environ, "DISPLAY": name})
        assert run.returncode == 2 and text in run.stderr, (name, run.stderr)
    assert bridge(root, "sh", "-c", "echo ${DISPLAY-none}", env={k: v for k, v in os.environ.items() if k != "DISPLAY"}).stdout == "none\n"
