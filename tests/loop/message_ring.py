"""Plays the simulation over LCM for haptic-rt and tm-device, inside a network namespace:

    python message_ring.py BIN PYTHON_TYPES DIRECTORY

Prints what it received as JSON."""
import json
import os
import select
import subprocess
import sys
import time

bin_, types, directory = sys.argv[1:4]
sys.path.insert(0, types)
import lcm  # noqa: E402
from tensormass_lcm import contact_patch_t, controller_command_t, controller_status_t, force_sample_t, hand_command_t, sim_status_t, tool_state_t  # noqa: E402

TROCAR, AXIS, UP, WALL_Z, STIFFNESS = [0.01, 0.02, 0.2], [0, 0, -1], [0, 1, 0], 0.08, 300.0
link = lcm.LCM("udpm://239.255.76.67:7667?ttl=0")
seen = {"tools": 0, "statuses": 0}
saw = {}


def on_tool(_, data):
    saw["tool"] = tool_state_t.decode(data)
    seen["tools"] += 1


def on_status(_, data):
    saw["status"] = controller_status_t.decode(data)
    seen["statuses"] += 1


link.subscribe("TOOL_0", on_tool).set_queue_capacity(500)
link.subscribe("CONTROLLER_0", on_status)
seq = 0


def send_status():
    s = sim_status_t()
    s.scene, s.model, s.instrument_count = "test", "dynamic", 1
    s.trocar_m, s.axis, s.up = [TROCAR, [0] * 3], [AXIS, [0] * 3], [UP, [0] * 3]
    link.publish("SIM_STATUS", s.encode())


def sample():
    global seq
    tool = saw["tool"]
    seq += 1
    f = force_sample_t()
    f.seq, f.session, f.instrument, f.tool_session, f.tool_utime, f.tip_m = seq, 5, 0, tool.session, tool.utime, tool.tip_m
    depth = WALL_Z - tool.tip_m[2]
    f.force_N = [0, 0, max(0.0, STIFFNESS * depth)]
    f.stiffness_kind, f.stiffness_N_m = 2, [0] * 8 + [-STIFFNESS if depth > 0 else 0]
    return f


def run(seconds, forces=True, until=None, rival=False, pose=True):
    end, frame = time.monotonic() + seconds, time.monotonic()
    while time.monotonic() < end:
        while select.select([link.fileno()], [], [], max(0, frame - time.monotonic()))[0]:
            link.handle()
        frame += 1 / 30
        if pose:
            send_status()
        if forces and "tool" in saw:
            link.publish("FORCE_0", sample().encode())
        if rival:
            other = sample()
            other.session, other.force_N = 6, [0, 0, 8]
            link.publish("FORCE_0", other.encode())
        if until and until():
            return True
    return False


def hand(insertion, active=0):
    h = hand_command_t()
    h.joints, h.joint, h.active = 5, [0, 0, insertion, 0.3, 0.5, 0, 0], active
    link.publish("HAND_0", h.encode())


def command(extrapolator="", passivity=-1, reset=0):
    c = controller_command_t()
    c.extrapolator, c.passivity, c.reset_fault = extrapolator, passivity, reset
    link.publish("CONTROLLER_COMMAND_0", c.encode())


def start(*argv):
    log = open(os.path.join(directory, f"{argv[0]}_{len(running)}.log"), "w")
    running.append(subprocess.Popen([os.path.join(bin_, argv[0]), *argv[1:]], stdout=log, stderr=log))
    return running[-1]


def logs():
    return "".join(open(os.path.join(directory, name)).read() for name in sorted(os.listdir(directory)) if name.endswith(".log"))


def snapshot(name, ready, **play):
    """Returns the controller's status once `ready`; sets `late` if that took too long: test_messages.py then looks for the reason in the record."""
    late = not ready()
    if late:
        run(PATIENCE_S, until=ready, **play)
    s, t = saw["status"], saw["tool"]
    seen[name] = {"late": late, "state": s.state, "fault": s.fault, "text": s.fault_text, "force": list(s.force_N), "extrapolator": s.extrapolator, "passivity": s.passivity_on,
                  "received": s.samples_received, "rejected": s.samples_rejected, "late": s.samples_late, "lost": s.samples_lost, "tip": list(t.tip_m),
                  "joint": list(t.joint[:t.joints]), "active": t.active, "tool_extrapolator": t.extrapolator, "ticks": s.ticks, "age_s": s.sample_age_s}


def pressed():
    return "status" in saw and saw["status"].state == 3 and saw["status"].force_N[2] > 1.0


def steady():
    if saw["status"].state == FAULT:
        command(reset=1)  # limit flag of a late tick; if a fault occurs without one, the snapshot's `late` says why
    return pressed() and abs(saw["status"].force_N[2] - 1.5) < 0.2


def press_again():
    """Waits until the new device receives: that may be after these samples."""
    hand(0.13)
    return steady() or pressed()


PATIENCE_S = 20  # when waiting for a state on a machine that delays processes, or in a sanitizer's build
IDLE, FAULT = 2, 5
running = []
os.environ["TM_BUS_DIR"] = directory
try:
    controller = start("haptic-rt", "--bus", "virtual:m", "--duration", "300", "--record", os.path.join(directory, "record.csv"), "--extrapolator", "hold")
    device = start("tm-device", "--bus", "virtual:m", "--hand", "lcm")
    run(PATIENCE_S, pose=False, until=lambda: "waiting for the trocar's pose" in logs())
    run(0.4, pose=False)
    seen["published_before_the_pose"] = seen["tools"]
    run(PATIENCE_S, forces=False, until=lambda: "tool" in saw)
    hand(0.13, 1)
    seen["pressed"] = run(5, until=pressed)
    run(0.5)
    snapshot("first", steady)
    command("tangent", 0)
    run(0.6)
    snapshot("switched", lambda: steady() and saw["status"].extrapolator == "tangent" and saw["tool"].extrapolator == 4)
    command("no such law")
    bad = sample()
    bad.force_N = [float("nan"), 0, 0]
    link.publish("FORCE_0", bad.encode())
    other = sample()
    other.tool_session += 1
    link.publish("FORCE_0", other.encode())
    link.publish("FORCE_0", sample().encode()[:40])
    link.publish("FORCE_0", b"nonsense")
    link.publish("CONTROLLER_COMMAND_0", b"\x00" * 24)
    patch = contact_patch_t()
    patch.seq, patch.session, patch.vertex_count, patch.triangle_count = seq + 1, 5, 3, 1
    patch.triangle[:3] = [0, 1, 77]
    link.publish("PATCH_0", patch.encode())
    run(0.5)
    snapshot("after_bad", lambda: steady() and saw["status"].samples_rejected >= seen["switched"]["rejected"] + 3)
    begun = time.monotonic()
    run(2.2, rival=True)  # a second simulation at the same time as the first
    snapshot("two_simulations", lambda: steady() and saw["status"].samples_rejected > seen["after_bad"]["rejected"] + 30, rival=True)
    seen["two_simulations"]["seconds"] = time.monotonic() - begun
    device.kill()
    device.wait()
    run(0.6)
    snapshot("device_gone", lambda: saw["status"].state in (0, FAULT))
    device = start("tm-device", "--bus", "virtual:m", "--hand", "lcm")
    time.sleep(0.3)
    seen["pressed_again"] = run(5 + PATIENCE_S, until=press_again)
    # The simulation dies in contact; repeated if the machine delayed the controller at that moment and the force had stopped before.
    for seen["deaths"] in range(1, 6):
        run(PATIENCE_S, until=steady)
        run(0.3)
        run(0.6, forces=False)
        snapshot("simulation_gone", lambda: saw["status"].state in (IDLE, FAULT), forces=False)
        if saw["status"].state == IDLE and "no samples from the simulation" in logs():
            break
    controller.terminate()
    seen["exit"] = controller.wait(PATIENCE_S)
finally:
    for process in running:
        process.kill()
        process.wait()
print(json.dumps(seen))
