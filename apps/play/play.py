"""make play: starts simulation, controllers and virtual devices in a separate network, and the window whose mouse and keys act as the hands."""
import argparse
import os
import pathlib
import shutil
import subprocess
import sys

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "demo"))
from session import Session  # noqa: E402


def arguments():
    p = argparse.ArgumentParser(description="A window on a live session. Keys are listed in the window (H). What follows -- goes to tm-play.")
    p.add_argument("--build", type=pathlib.Path, default=pathlib.Path("build"))
    p.add_argument("--out", type=pathlib.Path, help="folder for the programs' messages and figures [BUILD/play]")
    p.add_argument("--scene", type=pathlib.Path, default=HERE.parent / "scenes" / "liver-press.yaml")
    p.add_argument("--set", action="append", default=[], metavar="PATH=VALUE", help="as of tm-sim")
    p.add_argument("--record", type=pathlib.Path, metavar="FILE", help="LCM log of the session, for tm-view and lcm-logplayer")
    p.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    p.add_argument("window", nargs="*", help="options of tm-play, after --")
    a = p.parse_args()
    a.build = a.build.resolve()
    a.out = (a.out or a.build / "play").resolve()
    return a


def refuse(message):
    print(f"play: {message}", file=sys.stderr)
    sys.exit(2)


def check(a):
    if not os.environ.get("DISPLAY") and not os.environ.get("WAYLAND_DISPLAY"):
        refuse("no display (neither DISPLAY nor WAYLAND_DISPLAY is set); run it on a desktop or over ssh -X, or use `make demo`, which needs none")
    if not a.scene.exists():
        refuse(f"{a.scene}: this scene does not exist; the scenes are in apps/scenes")
    if a.record and not a.record.resolve().parent.is_dir():
        refuse(f"{a.record}: its folder does not exist; make it, or record to another folder")
    for program in ("lcm-logger", "ip", "unshare"):
        if not shutil.which(program):
            refuse(f"{program} is not installed; run `make play`, which installs what is missing, or tools/setup.sh build demo")


def inside(a):
    session = Session(a.build / "bin", a.scene, a.out, hand="lcm", sets=a.set)
    try:
        if a.record:
            session.start_logger(a.record.resolve())
        session.start_ring()
        # --set may change the mesh, for which the scene's marks are not valid.
        scene = [] if a.set else ["--scene", str(a.scene)]
        code = subprocess.run([str(a.build / "bin" / "tm-play"), *scene, *a.window]).returncode
        dead = [p.name for p in session.running if p.poll() not in (None, 0)]
    finally:
        session.end()
    for name in dead:
        print(f"play: {name} has ended unexpectedly; its messages are in {a.out}/{name}.txt", file=sys.stderr)
    if a.record and code == 0:
        print(f"play: recorded {a.record}; draw it with build/bin/tm-view {a.record} --video session.mp4")
    return code or bool(dead)


def main():
    a = arguments()
    if a.inside:
        sys.exit(inside(a))
    check(a)
    a.out.mkdir(parents=True, exist_ok=True)
    pidfile = a.out / "netns.pid"
    passed = sys.argv[1:]
    cut = passed.index("--") if "--" in passed else len(passed)
    demo = HERE.parent / "demo"
    command = [sys.executable, demo / "display.py", demo / "netns.sh", "run", pidfile, sys.executable, __file__, *passed[:cut], "--inside", *passed[cut:]]
    try:
        code = subprocess.run([str(c) for c in command]).returncode
    finally:
        pidfile.unlink(missing_ok=True)
    sys.exit(code)


if __name__ == "__main__":
    main()
