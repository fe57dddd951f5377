"""The demo's scene with each device: in lockstep with its virtual form, in real time with its emulator."""
import csv
import json
import os
import subprocess
import sys

import motorkit
import test_libraries
from drivekit import HERE, commands, expected
from kit import NETWORK, report
from paths import BUILD, ROOT

SCENE = ROOT / "apps/scenes/liver-press.yaml"
SIMULATION = "{bin}/tm-sim {scene} --realtime --quiet --set 'instruments[0].device={type}' --set 'time.duration=20 s' --json {tmp}/s.json 2> {tmp}/sim.txt & sim=$!\n"
CONTROLLER = "{bin}/haptic-rt --device {device} {words} --duration {seconds} --record {tmp}/r.csv --json {tmp}/r.json 2> {tmp}/said.txt\nkill -INT $sim; kill $emulator; wait\n"
CURSOR = "--workspace depth=0.105"
HAPLY_N, LIBRARY_N = 0.5e-5, 0.5e-9  # half the last digit of a message, and of the stub's log: a library takes a double
ADDRESSES = {"haply": "haply:0@127.0.0.1:18001", "touch": "touch:0", "omega": "omega:0", "falcon": "falcon:0", "crtk": "crtk:0", **{kind: motorkit.ADDRESS.format(kind=kind, bus="virtual:o") for kind in motorkit.KINDS}}
TYPES = {"haply": "inverse3", **dict.fromkeys(motorkit.KINDS, "desk")}
NAMES = tuple(ADDRESSES)
EMULATORS = {"haply": "service by its published messages", "touch": "stub of libHD", "omega": "stub of libdhd", "falcon": "stub of libdhd", "crtk": "master by cyclonedds", "odrive": "odrive-can's mock", "moteus": "mock, decodes by moteus' package",
             "cia402": "canopen's LocalNode"}


SECONDS = {"odrive": 6, "crtk": 6}  # their emulators start slowly
HEAD = "| device | virtual form | peak force in lockstep, N | emulator | forces compared in real time | largest difference, mN | half of the emulator's last step, mN | hardware |"


def type_of(name):
    return TYPES.get(name, name)


def lockstep(tmp, device):
    """The report of tm-sim with this type of device."""
    return report(BUILD / "bin/tm-sim", SCENE, "--lockstep", "--quiet", "--set", f"instruments[0].device={device}", "--set", "time.duration=2.4 s", tmp=tmp)


def quantum_N(name):
    """Half the step of the force that the emulator receives, N; of motors at the joint with the largest step."""
    if name in motorkit.KINDS:
        return motorkit.QUANTUM_Nm[name] * 2 * 3.14159265358979 * max(map(abs, motorkit.TURNS))
    return HAPLY_N if name == "haply" else LIBRARY_N


def read_stub(path):
    rows = [[float(word) for word in line.split(",")] for line in path.read_text().splitlines() if not line.startswith("#")]
    return [(row[0], row[1:4]) for row in rows]


def compare_cursor(sent, rows, quantum):
    """Holds each force at the emulator to that of a tick, of increasing time. Returns (number compared, largest difference)."""
    at, worst, compared = 0, 0.0, 0
    for time_us, force in sent:
        if not any(force):
            continue
        while (off := max(abs(a - b) for a, b in zip(force, expected(rows[at])))) > quantum + motorkit.FLOAT * max(map(abs, force)):
            at += 1
            assert at < len(rows) and rows[at]["t_us"] <= time_us, (time_us, force)
        worst, compared = max(worst, off), compared + 1
    return compared, worst


def emulator_of(tmp, name, stubs):
    """Shell text that starts the emulator in the background, and the environment that haptic-rt needs for it."""
    environment = {**os.environ, "TM_BUS_DIR": str(tmp)}
    if name == "haply":
        return f"{sys.executable} {HERE}/haply_service.py --port 18001 --log {tmp}/e.csv --swing 0.045 > {tmp}/port & emulator=$!\n", environment
    if name == "crtk":
        return (f"ip link set lo multicast on; {sys.executable} {HERE}/crtk_bridge.py /MTMR --enabled > {tmp}/bridge.txt 2>&1 & bridge=$!\n"
                f"{sys.executable} {HERE}/crtk_master.py --log {tmp}/e.csv --swing 0.045 --commands '' > {tmp}/said & emulator=\"$bridge $!\"\n"), environment
    if name in motorkit.KINDS:
        hand = f"--start {0.105 * motorkit.TURNS[-1]} --swing {0.045 * motorkit.TURNS[-1]}"
        nodes = ",".join(map(str, motorkit.NODES))
        return f"{sys.executable} {HERE}/{name}_axes.py {tmp} o {nodes} --log {tmp}/e.csv {hand} > {tmp}/said & emulator=$!\n", environment
    return "sleep 0.1 & emulator=$!\n", test_libraries.environment(stubs, name + ":0", tmp / "e.csv", STUB_SWING="0.045")


def run_once(tmp, name, stubs):
    emulator, environment = emulator_of(tmp, name, stubs)
    words = "--device-type desk" if name in motorkit.KINDS else CURSOR
    text = (SIMULATION + emulator + CONTROLLER).format(bin=BUILD / "bin", scene=SCENE, type=type_of(name), tmp=tmp, device=ADDRESSES[name], words=words, seconds=SECONDS.get(name, 4))
    subprocess.run([*NETWORK, "sh", "-c", text], timeout=80, check=False, capture_output=True, env=environment)
    told = json.loads((tmp / "r.json").read_text())
    rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader((tmp / "r.csv").open())]
    for row in rows:
        row["t_us"] = told["start_us"] + 1e6 * row["time_s"]
    assert told["fault"] == "none", (tmp / "said.txt").read_text()
    if name in motorkit.KINDS:
        bench = motorkit.Axes(tmp, name)
        bench.log = tmp / "e.csv"
        return told, *motorkit.compare(name, bench.rows()[0], rows)
    sent = [(row[0], row[1]) for row in commands(tmp / "e.csv")[0]] if name == "haply" else read_stub(tmp / "e.csv")
    return told, *compare_cursor(sent, rows, quantum_N(name))


def real_time(tmp, name, stubs=None, attempts=3):
    """Runs simulation, controller and emulator. Returns (report, forces compared, largest difference in N). On a busy machine one of the three may start
    too late for the others: then it runs again."""
    for attempt in range(attempts):
        folder = tmp / f"run{attempt}"
        folder.mkdir()
        found = run_once(folder, name, stubs)
        if found[1] > 200 and found[0]["force_N"]["peak"] > 0.1:
            break
    return found
