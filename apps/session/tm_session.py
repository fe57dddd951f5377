#!/usr/bin/python3
"""A live session of a scene: simulation, a controller and a virtual device for each instrument, in a network of their own."""
import argparse
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import tempfile

BIN = pathlib.Path(__file__).resolve().parent
PARTS = BIN.parent / "lib/tensormass/session"
sys.path.insert(0, str(PARTS))
sys.dont_write_bytecode = True
from session import Session  # noqa: E402

SCENES = ("../share/tensormass/apps/scenes", "../../apps/scenes", "../../../apps/scenes")  # PREFIX/bin, build/bin, build/CONFIG/bin


UNITS = {"": 1, "s": 1, "ms": 1e-3, "us": 1e-6, "min": 60}


def seconds(text):
    """Parses a duration as tm-sim's --duration: "10", "10 s", "2 min"."""
    number = text.strip().rstrip("abcdefghijklmnopqrstuvwxyz")
    unit = text.strip()[len(number):]
    try:
        return float(number) * UNITS[unit]
    except (KeyError, ValueError):
        return refuse(f"--duration {text}: this is not a time; write 10 s, 2 min, 500 ms")


def arguments():
    p = argparse.ArgumentParser(prog="tm-session", description=__doc__ + " Ctrl-C ends all of them.",
                                epilog="Scenes that come with the programs are found by their names alone: tm-session liver-press. `tm-sim --list` lists them.")
    p.add_argument("scene", type=pathlib.Path, metavar="SCENE", help="a scene file, or the name of one that comes with the programs")
    p.add_argument("--play", action="store_true", help="open a window in which mouse and keys move the hands; without it the scene's script does")
    p.add_argument("--video", type=pathlib.Path, metavar="FILE.mp4", help="draw the session as a video by tm-view; needs --duration")
    p.add_argument("--record", type=pathlib.Path, metavar="FILE.lcm", help="write every message to an LCM log")
    p.add_argument("--duration", type=seconds, metavar="TIME", help="10 s, 2 min; a bare number is seconds [until Ctrl-C, or until the window is closed]")
    p.add_argument("--set", action="append", default=[], metavar="PATH=VALUE", help="as of tm-sim")
    p.add_argument("--out", type=pathlib.Path, metavar="FOLDER", help="folder for the programs' messages and figures [kept if a program fails]")
    p.add_argument("--no-namespace", action="store_true", help="run in this machine's network (ttl=0: nothing leaves it)")
    p.add_argument("--quiet", action="store_true", help="print errors only")
    p.add_argument("--version", action="version", version="tm-session @VERSION@")
    p.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    if any(a.split("=")[0] == "--film" for a in sys.argv[1:]):
        p.error("--film is called --video since 0.2; write --video")
    return p.parse_args()


def refuse(message):
    print(f"tm-session: {message}", file=sys.stderr)
    sys.exit(2)


def find(scene):
    here = [scene] + [BIN / place / f"{scene}{end}" for place in SCENES for end in ("", ".yaml") if len(scene.parts) == 1]
    for path in here:
        if path.is_file():
            return path.resolve()
    return refuse(f"{scene}: this scene does not exist; give a file, or a name that `tm-sim --list` shows")


def check(a):
    wanted = ["lcm-logger"] if a.record else []
    wanted += [] if a.no_namespace else ["unshare", "ip"]
    for program in wanted:
        if not shutil.which(program):
            refuse(f"{program} is not installed; apt-get install {'liblcm-bin' if program == 'lcm-logger' else 'util-linux iproute2'}")
    for option, path in (("--video", a.video), ("--record", a.record)):
        if path and not path.resolve().parent.is_dir():
            refuse(f"{option} {path}: its folder does not exist; make it, or give another")
    if a.video and not a.duration:
        refuse("--video needs the length of the session; give --duration")
    if a.duration is not None and not 0 < a.duration < 1e6:
        refuse(f"--duration {a.duration:g}: give a time above 0, as 10 s or 2 min")
    if a.play and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        refuse("--play opens a window, and there is no display (neither DISPLAY nor WAYLAND_DISPLAY is set); leave it out, or run this on a desktop or over ssh -X")


def inside(a):
    session = Session(BIN, a.scene, a.out, hand="lcm" if a.play else "script", sets=a.set)
    good, window = True, 0
    try:
        if a.record:
            session.start_logger(a.record.resolve())
        if a.video:
            session.begin("tm-view", BIN / "tm-view", "--video", a.video.resolve(), "--duration", a.duration)
        session.start_ring(a.duration)
        if a.play:
            window = subprocess.run([BIN / "tm-play", "--scene", a.scene, *(["--duration", str(a.duration)] if a.duration else [])]).returncode
            good = session.well()
        else:
            good = session.wait(("tm-sim", "tm-device", "haptic-rt", "tm-view"))
    except KeyboardInterrupt:
        good = session.well()
        if a.duration:
            print("tm-session: interrupted", file=sys.stderr)
            window = 130
    finally:
        session.end()
    return window or (0 if good else 1)


def interrupted(*_):
    raise KeyboardInterrupt


def outside(a, folder):
    """Runs this program in a namespace, with a display that is reachable from there."""
    pidfile = folder / "netns.pid"
    words = [str(a.scene) if w == a.named else w for w in sys.argv[1:]]
    command = [sys.executable, __file__, *words, "--inside", "--out", folder]
    if a.no_namespace:
        pidfile.write_text(str(os.getpid()))
    else:
        command = [PARTS / "netns.sh", "run", pidfile, *command]
    if a.play:
        command = [sys.executable, PARTS / "display.py", *command]
    if not a.quiet:
        print(f"tm-session: {a.scene.name}, {'for %g s' % a.duration if a.duration else 'until the window is closed' if a.play else 'until Ctrl-C'}; to watch its messages:\n"
              f"  {PARTS}/netns.sh join {pidfile} lcm-logger", flush=True)
    child = subprocess.Popen([str(c) for c in command], start_new_session=True)
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: os.killpg(child.pid, signal.SIGINT))
    code = child.wait()
    pidfile.unlink(missing_ok=True)
    return 128 - code if code < 0 else code


def main():
    a = arguments()
    if a.inside:
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, interrupted)
        return inside(a)
    a.named, a.scene = str(a.scene), find(a.scene)
    check(a)
    folder = a.out.resolve() if a.out else pathlib.Path(tempfile.mkdtemp(prefix="tm-session-"))
    folder.mkdir(parents=True, exist_ok=True)
    code = outside(a, folder)
    if not a.out and code in (0, 130):
        shutil.rmtree(folder, ignore_errors=True)
    elif not a.quiet or code:
        print(f"tm-session: messages and figures of the programs are in {folder}", file=sys.stderr if code else sys.stdout)
    return code


if __name__ == "__main__":
    sys.exit(main())
