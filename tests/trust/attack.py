"""Attacks a running session inside a network namespace: python attack.py BUILD TESTS DIRECTORY [KEY].

Plays each attack in turn against tm-sim, haptic-rt and tm-device, which press tissue; prints the motor commands meanwhile, and the cost, as JSON."""
import contextlib
import csv
import json
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import time

build, tests, directory = sys.argv[1:4]
key_file = sys.argv[4] if len(sys.argv) > 4 else None
sys.path[:0] = [os.path.join(build, "python"), os.path.join(tests, "loop"), os.path.join(tests, "trust")]
import lcm  # noqa: E402
from seal import seal  # noqa: E402
from tensormass_lcm import contact_patch_t, controller_command_t, controller_status_t, force_sample_t, sim_status_t, tool_state_t  # noqa: E402
from virtual_bus import VirtualBus, Watch, torque  # noqa: E402

GROUP = ("239.255.76.67", 7667)
SCENE = os.path.join(tests, "..", "apps", "scenes", "block-press.yaml")
KEY = bytes.fromhex(open(key_file).read().strip()) if key_file else None
COMMAND = 0x100
wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
wire.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
link = lcm.LCM("udpm://239.255.76.67:7667?ttl=0")
TYPES = {"FORCE_0": force_sample_t, "TOOL_0": tool_state_t, "CONTROLLER_0": controller_status_t, "SIM_STATUS": sim_status_t}
newest, tape, mine = {}, {"FORCE_0": [], "TOOL_0": []}, set()
running, result = [], {"attacks": {}}


def heard(channel, data):
    if data in mine:
        return
    with contextlib.suppress(ValueError, struct.error):
        newest[channel] = TYPES[channel].decode(data)
        if channel in tape:
            tape[channel].append(data)


for name in TYPES:
    link.subscribe(name, heard).set_queue_capacity(500)


def send(channel, data):
    mine.add(data)
    wire.sendto(b"LC02\0\0\0\0" + channel.encode() + b"\0" + data, GROUP)


def listen(seconds):
    end = time.monotonic() + seconds
    while True:
        left = end - time.monotonic()
        if not select.select([link.fileno()], [], [], max(0, left))[0] or left <= 0:
            return
        link.handle()


def start(*argv, **more):
    log = open(os.path.join(directory, f"{argv[0]}_{len(running)}.log"), "w")
    running.append(subprocess.Popen([os.path.join(build, "bin", argv[0]), *map(str, argv[1:])], stdout=log, stderr=log, stdin=subprocess.DEVNULL, cwd=directory, **more))
    return running[-1]


def memory_kB(process):
    with open(f"/proc/{process.pid}/status") as file:
        return sum(int(line.split()[1]) for line in file if line.startswith(("VmRSS", "VmLck")))


# ---------------------------------------------------------------------------------------------- the attacks: each is called repeatedly for its duration

def flood():
    for _ in range(200):
        send("NOISE", bytes(100))
        send("TISSUE", bytes(1000))
        wire.sendto(os.urandom(60), GROUP)


def giants():
    for seq in range(50):
        for channel in (b"FORCE_0\0", b"PATCH_0\0", b"TOOL_0\0", b"SIM_STATUS\0", b"TISSUE\0", b"HAND_1\0"):
            wire.sendto(b"LC03" + struct.pack(">IIIHH", seq, (1 << 28) - 1, 0, 0, 4100) + channel + bytes(90), GROUP)
    time.sleep(0.002)


def not_whole():
    for channel in ("FORCE_0", "PATCH_0", "TOOL_0", "SIM_STATUS", "CONTROLLER_COMMAND_0", "CONTROLLER_0"):
        send(channel, b"nonsense")
        send(channel, newest["FORCE_0"].encode()[:60] + b"\x7f\xff\xff\xff" * 4)
    time.sleep(0.0005)


def sample(**more):
    """Sends the newest sample with a sideways force and a later seq."""
    listen(0.002)
    f = force_sample_t.decode(newest["FORCE_0"].encode())
    f.force_N, f.flags = [8.0, 8.0, 0.0], 0
    f.tool_utime, f.tip_m = newest["TOOL_0"].utime, newest["TOOL_0"].tip_m
    f.seq += 500
    for name, value in more.items():
        setattr(f, name, value)
    return f


def foreign_samples():
    send("FORCE_0", sample(session=123456).encode())


def forged_samples():
    send("FORCE_0", sample().encode())


def forged_patches():
    listen(0.002)
    f = newest["FORCE_0"]
    p = contact_patch_t()
    p.session, p.seq, p.vertex_count, p.triangle_count, p.radius_m, p.contact_length_m = f.session, f.seq + 1, 3, 1, 0.003, 0.02
    p.triangle[:3] = [0, 1, 2]
    send("PATCH_0", p.encode())


def replayed_samples():
    for data in recorded["FORCE_0"][-40:]:
        send("FORCE_0", data)
    time.sleep(0.002)


def tool(**more):
    listen(0.002)
    t = tool_state_t.decode(newest["TOOL_0"].encode())
    t.seq += 200
    t.utime += 400000
    joint = list(t.joint)
    trocar, stretch = newest["SIM_STATUS"].trocar_m[0], 1 + 0.004 / joint[2]
    joint[2] += 0.004
    t.tip_m, t.joint = [o + stretch * (x - o) for x, o in zip(t.tip_m, trocar)], joint
    for name, value in more.items():
        setattr(t, name, value)
    return t


def foreign_tools():
    send("TOOL_0", tool(session=777).encode())


def forged_tools():
    send("TOOL_0", tool().encode())


def replayed_tools():
    for data in recorded["TOOL_0"][-200:]:
        send("TOOL_0", data)
    time.sleep(0.002)


def forged_poses():
    listen(0.002)
    s = sim_status_t.decode(newest["SIM_STATUS"].encode())
    s.seq, s.trocar_m = s.seq + 50, [[0.0, 0.0, 0.3], [0, 0, 0]]
    send("SIM_STATUS", s.encode())


def command(seal_it=False, **more):
    status = newest["CONTROLLER_0"]
    c = controller_command_t()
    c.extrapolator, c.passivity, c.session, c.seq = "", -1, status.session, status.command_seq + 1
    for name, value in more.items():
        setattr(c, name, value)
    data = c.encode()
    return seal(KEY, "CONTROLLER_COMMAND_0", data) if seal_it and KEY else data


def forged_commands():
    send("CONTROLLER_COMMAND_0", command(extrapolator="paper_position"))
    listen(0.005)


def forged_resets():
    for _ in range(5):
        send("CONTROLLER_COMMAND_0", command(reset_fault=1))
    listen(0.005)


# ---------------------------------------------------------------------------------------------- the session

def force(data):
    return [abs(v) for v in torque(data)] if data and data[6] & 0x80 else [0, 0, 0]


def between(begin, end):
    """Returns the largest torque of each motor, and how many commands pushed along the shaft."""
    seen = [force(d) for t, i, d in list(watch.frames) if i == COMMAND and begin <= t < end]
    return {"peak": [max([f[j] for f in seen], default=0) for j in range(3)], "pushing": sum(f[2] > 100 for f in seen), "commands": len(seen)}


def pressing(seconds=20.0):
    """Waits until it has been engaged and pushing for half a second."""
    end, since = time.monotonic() + seconds, time.monotonic()
    while time.monotonic() < end:
        listen(0.02)
        status = newest.get("CONTROLLER_0")
        if not status or status.state != 3 or force(watch.last(COMMAND)[1])[2] < 150:
            since = time.monotonic()
        if time.monotonic() - since > 0.5:
            return True
    return False


def attack(name, act, seconds=0.6):
    good = pressing()
    before = [memory_kB(p) for p in running]
    begin = time.monotonic()
    rounds = 0
    while time.monotonic() - begin < seconds:
        act()
        rounds += 1
    end = time.monotonic()
    listen(0.15)
    status = newest["CONTROLLER_0"]
    after = [memory_kB(p) for p in running]
    result["attacks"][name] = {"pressed_before": good, "rounds": rounds, **between(begin, end + 0.1), "extrapolator": status.extrapolator, "state": status.state,
                               "grown_kB": max(b - a for a, b in zip(before, after))}


hand = os.path.join(directory, "hand.csv")
subprocess.run([os.path.join(build, "bin/tm-sim"), SCENE, "--hands", os.path.join(directory, "scripted")], check=True, stdout=subprocess.DEVNULL, timeout=300)
rows = list(csv.reader(line for line in open(os.path.join(directory, "scripted0.csv")) if not line.startswith("#")))
deepest = max(range(1, len(rows)), key=lambda k: float(rows[k][3]))
with open(hand, "w", newline="") as file:
    csv.writer(file).writerows(rows[:deepest + 1])

os.environ["TM_BUS_DIR"] = directory
keyed = ["--key", key_file] if key_file else []
try:
    simulation = start("tm-sim", SCENE, "--realtime", "--json", "sim.json", *keyed)
    device = start("tm-device", "--bus", "virtual:t", "--hand", hand)
    second = start("tm-device", "--bus", "virtual:t", "--hand", "lcm", "--instrument", "1", *keyed)
    controller = start("haptic-rt", "--bus", "virtual:t", "--extrapolator", "position", "--json", "controller.json", *keyed)
    watch = Watch(VirtualBus(directory, "t"))
    result["pressed"] = pressing(30)
    begin = time.monotonic()
    listen(1.0)
    result["calm"] = between(begin, time.monotonic())
    recorded = {channel: list(data) for channel, data in tape.items()}
    listen(0.5)
    for name, act in (("flood", flood), ("giants", giants), ("not_whole", not_whole), ("foreign_samples", foreign_samples), ("forged_samples", forged_samples),
                      ("forged_patches", forged_patches), ("replayed_samples", replayed_samples), ("foreign_tools", foreign_tools), ("forged_tools", forged_tools),
                      ("replayed_tools", replayed_tools), ("forged_poses", forged_poses), ("forged_commands", forged_commands), ("resets_in_use", forged_resets)):
        attack(name, act)
    # A fault because the loop stands still, then resets: from the attacker, and from the owner of the key.
    result["pressed_again"] = pressing()
    controller.send_signal(signal.SIGSTOP)
    time.sleep(0.6)
    controller.send_signal(signal.SIGCONT)
    listen(0.4)
    result["fault"] = newest["CONTROLLER_0"].fault
    before = newest["CONTROLLER_0"].command_seq
    begin = time.monotonic()
    states = {newest["CONTROLLER_0"].state}  # of the fault: the first reset may be accepted before the next is seen
    while time.monotonic() - begin < 1.0:
        forged_resets()
        states.add(newest["CONTROLLER_0"].state)
    result["states_under_resets"] = sorted(states)
    if KEY:
        for _ in range(20):
            send("CONTROLLER_COMMAND_0", command(seal_it=True, reset_fault=1))
            listen(0.15)
            if newest["CONTROLLER_0"].state != 5:
                break
        result["own_command"] = command(seal_it=True, extrapolator="hold")
        send("CONTROLLER_COMMAND_0", result["own_command"])
        listen(0.3)
        result["own_extrapolator"] = newest["CONTROLLER_0"].extrapolator
        send("CONTROLLER_COMMAND_0", command(seal_it=True, extrapolator="time"))
        listen(0.3)
        for _ in range(20):
            send("CONTROLLER_COMMAND_0", result["own_command"])  # recorded, with its tag
        listen(0.3)
        result["after_replay"] = newest["CONTROLLER_0"].extrapolator
        del result["own_command"]
    result["pressed_at_the_end"] = pressing()
    result["all"] = between(0, time.monotonic())
    for process in (controller, simulation):
        process.terminate()
        process.wait(10)
    result["controller"] = json.load(open(os.path.join(directory, "controller.json")))
    result["simulation"] = json.load(open(os.path.join(directory, "sim.json")))
finally:
    for process in running:
        process.kill()
        process.wait()
print(json.dumps(result))
