"""Runs haptic-rt, the bridge and a master of ROS 2 (crtk_master.py) in this network namespace, with one failure; prints when it began, as JSON.

    crtk_run.py FOLDER PYTHON-OF-THE-MASTER FAILURE [--handle] [WORDS OF THE MASTER]

--handle: the device is crtk_handle, the instrument free."""
import json
import pathlib
import signal
import subprocess
import sys
import time

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[1]), str(pathlib.Path(__file__).resolve().parent)]
from drivekit import Controller, FORCE, HERE, samples, wait_for  # noqa: E402

tmp, master_python, trouble, *words = sys.argv[1:]
tmp = pathlib.Path(tmp)
own = trouble in ("killed", "frozen", "controller", "master")


def pushed():
    lines = (tmp / "m.csv").read_text().splitlines()[-40:] if (tmp / "m.csv").exists() else []
    return any(abs(float(line.split(",")[3])) > 0.9 * abs(FORCE[2]) for line in lines if line.count(",") == 6)


def began():
    return next((line for line in (tmp / "m.csv").read_text().splitlines() if line.startswith("# trouble")), None)


def commanded():
    """Returns whether the master has sent all its commands."""
    orders = words[words.index("--commands") + 1].count(",") + 1 if "--commands" in words else 0
    return sum(line.startswith("# command") for line in (tmp / "m.csv").read_text().splitlines()) >= orders


def now_us():
    return time.monotonic_ns() // 1000


children, told = [], {}
try:
    handle = ["--device-type", "crtk_handle", "--free"] if "--handle" in words else []
    words = [word for word in words if word != "--handle"]
    controller = Controller(tmp, "crtk:0", *handle, "--priority", 0, "--samples", samples(tmp, seconds=40))
    children.append(controller.child)
    with open(tmp / "master.txt", "w") as said:
        master = subprocess.Popen([master_python, str(HERE / "crtk_master.py"), "--log", str(tmp / "m.csv"), *([] if own or trouble == "none" else ["--trouble", trouble]), *words], stdout=said, stderr=said)
    children.append(master)
    with open(tmp / "bridge.txt", "w") as said:
        bridge = subprocess.Popen([sys.executable, str(HERE / "crtk_bridge.py"), "/MTMR", *(["--enabled"] if "--ros" in words else [])], stdout=said, stderr=said)
    children.append(bridge)
    wait_for(pushed, 30)
    time.sleep(0.5)
    if own:
        told["since"] = now_us()
        {"killed": bridge, "frozen": bridge, "controller": controller.child, "master": master}[trouble].send_signal(signal.SIGSTOP if trouble == "frozen" else signal.SIGKILL)
        time.sleep(0.4)
        if trouble == "frozen":
            told["thawed"] = now_us()
            bridge.send_signal(signal.SIGCONT)
    elif trouble != "none":
        wait_for(began, 20)
        told["since"] = int(began().split()[2])
    wait_for(commanded, 20)
    time.sleep(0.8)
    told["ended"] = now_us()
    bridge.send_signal(signal.SIGTERM)
    bridge.wait(timeout=20)
    time.sleep(0.1)
    if trouble != "controller":
        controller.child.send_signal(signal.SIGTERM)
        told["said"] = controller.child.communicate(timeout=20)[1]
finally:
    for child in children:
        if child.poll() is None:
            child.send_signal(signal.SIGCONT)
            child.kill()
            child.wait()
print(json.dumps(told))
