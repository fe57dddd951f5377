"""Relays between a running tm-sim and haptic-rt, on a port for each: passes every message on, and plants flags in the force samples.

    python relay.py BUILD TESTS DIRECTORY     (inside a network namespace)

Prints the hand's force under each flag as JSON."""
import json
import os
import select
import socket
import struct
import subprocess
import sys
import time

build, tests, directory = sys.argv[1:4]
sys.path[:0] = [os.path.join(build, "python"), os.path.join(tests, "loop")]
from tensormass_lcm import controller_status_t, force_sample_t  # noqa: E402
from virtual_bus import VirtualBus, Watch, torque  # noqa: E402

GROUP, SIMULATION, CONTROLLER = "239.255.76.67", 7667, 7668
SCENE = os.path.join(tests, "..", "apps", "scenes", "block-press.yaml")
FLAGS = {"none": 0, "capped": 1, "overflowed": 2, "overran": 4, "unconverged": 16, "repeated": 32, "unstable": 64, "too fast": 128, "inside": 256, "releasing": 512, "cutting": 1024, "unknown": 2048}
running, result = [], {}
state = {"plant": 0, "status": None, "planted": 0}


def listener(port):
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
    sock.bind((GROUP, port))
    sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, struct.pack("4s4s", socket.inet_aton(GROUP), bytes(4)))
    sock.setblocking(False)
    return sock


wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
wire.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
sides = {listener(SIMULATION): (CONTROLLER, ("FORCE_0", "PATCH_0", "SIM_STATUS")), listener(CONTROLLER): (SIMULATION, ("TOOL_0", "CONTROLLER_0"))}


def hand_on(packet, to, channels):
    if packet[:4] != b"LC02":
        return
    channel, data = packet[8:].split(b"\0", 1)
    if channel.decode() not in channels:
        return
    if channel == b"FORCE_0" and state["plant"]:
        f = force_sample_t.decode(data)
        f.flags |= state["plant"]
        if state["plant"] == FLAGS["unstable"]:
            f.force_N = [50.0, 50.0, 50.0]  # its force must never be rendered
        data, state["planted"] = f.encode(), state["planted"] + 1
    if channel == b"CONTROLLER_0":
        state["status"] = controller_status_t.decode(data)
    wire.sendto(packet[:8] + channel + b"\0" + data, (GROUP, to))


def run(seconds):
    end = time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        for sock in select.select(list(sides), [], [], left)[0]:
            hand_on(sock.recv(65536), *sides[sock])


def start(*argv):
    log = open(os.path.join(directory, f"{argv[0]}.log"), "w")
    running.append(subprocess.Popen([os.path.join(build, "bin", argv[0]), *map(str, argv[1:])], stdout=log, stderr=log, stdin=subprocess.DEVNULL))


def force(data):
    return [abs(v) for v in torque(data)] if data and data[6] & 0x80 else [0, 0, 0]


def pressing(seconds=20.0):
    end, since = time.monotonic() + seconds, time.monotonic()
    while time.monotonic() < end and time.monotonic() - since < 0.5:
        run(0.02)
        if not state["status"] or state["status"].state != 3 or force(watch.last(0x100)[1])[2] < 150:
            since = time.monotonic()
    return time.monotonic() - since >= 0.5


def plant(name):
    good = pressing()
    before = force(watch.last(0x100)[1])
    state["plant"], state["planted"] = FLAGS[name], 0
    begin = time.monotonic()
    run(0.7)
    end, status = time.monotonic(), state["status"]
    seen = [(t - begin, force(d)) for t, i, d in list(watch.frames) if i == 0x100 and begin <= t < end]
    state["plant"] = 0
    result[name] = {"pressed_before": good, "planted": state["planted"], "before": before, "peak": [max(f[j] for _, f in seen) for j in range(3)],
                    "last_felt_s": max([t for t, f in seen if any(f)], default=0), "state": status.state, "limits": status.limits}


subprocess.run([os.path.join(build, "bin/tm-sim"), SCENE, "--hands", os.path.join(directory, "scripted")], check=True, stdout=subprocess.DEVNULL, timeout=300)
rows = open(os.path.join(directory, "scripted0.csv")).read().splitlines()
head = next(k for k, row in enumerate(rows) if not row.startswith("#"))
deepest = max(range(head + 1, len(rows)), key=lambda k: float(rows[k].split(",")[3]))
with open(os.path.join(directory, "hand.csv"), "w") as file:
    file.write("\n".join(rows[:deepest + 1]) + "\n")
os.environ["TM_BUS_DIR"] = directory
try:
    start("tm-sim", SCENE, "--realtime", "--lcm-url", f"udpm://{GROUP}:{SIMULATION}?ttl=0", "--json", os.path.join(directory, "sim.json"))
    start("tm-device", "--bus", "virtual:t", "--hand", os.path.join(directory, "hand.csv"))
    start("haptic-rt", "--bus", "virtual:t", "--lcm-url", f"udpm://{GROUP}:{CONTROLLER}?ttl=0", "--extrapolator", "position")
    watch = Watch(VirtualBus(directory, "t"))
    for name in FLAGS:
        plant(name)
    result["pressed_at_the_end"] = pressing()
    result["said"] = open(os.path.join(directory, "haptic-rt.log")).read()
finally:
    for process in running:
        process.kill()
        process.wait()
print(json.dumps(result))
