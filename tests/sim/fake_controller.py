"""A controller that also sends false messages: runs inside a network namespace, sends valid and invalid tool states, prints what it received as JSON.

    python fake_controller.py BUILD TM-SIM SCENE REPORT"""
import json
import math
import subprocess
import sys
import time

import lcm

build, program, scene, report = sys.argv[1:]
sys.path.insert(0, f"{build}/python")
import tensormass_lcm as t  # noqa: E402

link = lcm.LCM("udpm://239.255.76.67:7667?ttl=0")
forces, statuses, others = [], [], {}
link.subscribe("FORCE_0", lambda c, d: forces.append(t.force_sample_t.decode(d)))
link.subscribe("SIM_STATUS", lambda c, d: statuses.append(t.sim_status_t.decode(d)))
for name in ("TISSUE", "PATCH_0", "FORCE_1"):
    link.subscribe(name, lambda c, d: others.__setitem__(c, others.get(c, 0) + 1))

TROCAR, SESSION = (0.05, 0.05, 0.18), 5000000
sent = {"good": 0, "bad": 0, "foreign": 0, "late": 0}
mine = {}


def state(utime, seq, insertion, session=SESSION, **wrong):
    m = t.tool_state_t()
    m.utime, m.seq, m.session, m.instrument, m.state = utime, seq, session, 0, 3
    m.tip_m = [TROCAR[0], TROCAR[1], TROCAR[2] - insertion]
    m.joints, m.joint = 5, [0, 0, insertion, 0, 0, 0, 0]
    for key, value in wrong.items():
        setattr(m, key, value)
    return m


def send(kind, m):
    sent[kind] += 1
    link.publish("TOOL_0", m.encode())


sim = subprocess.Popen([program, scene, "--realtime", "--json", report, "--record", report + ".lcm"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
begin = time.monotonic()
seq = 0
while not statuses and time.monotonic() - begin < 20:
    link.handle_timeout(20)
began = time.monotonic()
while time.monotonic() - began < 2.0:
    age = time.monotonic() - began
    utime = 1000 + int(age * 1e6)
    insertion = 0.12 + 0.012 * min(age, 1)  # from 2 mm above the block's top to 2.5 + ... mm into it
    seq += 1
    mine[utime] = insertion
    send("good", state(utime, seq, insertion))
    if seq % 5 == 0:
        nan = float("nan")
        send("bad", state(utime, seq + 1000, insertion, tip_m=[nan, 0, 0]))
        send("bad", state(utime, seq + 1000, insertion, joint=[0, math.inf, insertion, 0, 0, 0, 0]))
        send("bad", state(utime, seq + 1000, 3.0))
        send("bad", state(utime, seq + 1000, insertion, tip_m=[0, 0, 0]))  # not the position of the joints
        send("bad", state(utime, seq + 1000, insertion, tip_m=[TROCAR[0], TROCAR[1] + 1e-5, TROCAR[2] - insertion]))  # by more than rounding
        send("foreign", state(utime, seq + 1000, insertion, session=SESSION - 1))
        send("foreign", state(2**62, 0, insertion, session=2**63 - 1))  # whose clock is far ahead
        send("foreign", state(utime, seq + 1000, insertion, instrument=1))
        send("late", state(utime - 1, seq - 1, insertion))
        link.publish("TOOL_0", b"not a message")
    until = time.monotonic() + 0.004
    while time.monotonic() < until:
        link.handle_timeout(1)


def speak(seconds, session, first_utime, first_seq, kind="good", gap=0.004):
    began, i = time.monotonic(), 0
    while time.monotonic() - began < seconds:
        send(kind, state(first_utime + int((time.monotonic() - began) * 1e6), first_seq + i, 0.12, session=session))
        i += 1
        until = time.monotonic() + gap
        while time.monotonic() < until:
            link.handle_timeout(1)


# A restarted controller with an earlier clock: an earlier session that begins again at seq 0, accepted a second after the first one's last message.
speak(0.85, SESSION - 7, 50, 0, "foreign", 0.1)
time.sleep(0.2)
speak(0.5, SESSION - 7, 1000000, 100)
# One packet in its name, far ahead in seq and time: within a second its own are accepted again.
send("good", state(2**62, 2**30, 0.12, session=SESSION - 7))
speak(0.85, SESSION - 7, 2000000, 1000, "late", 0.02)
time.sleep(0.2)
speak(0.5, SESSION - 7, 4000000, 2000)
while link.handle_timeout(100):
    if forces[-1].tool_utime > 4300000:
        break
sim.send_signal(2)
said = sim.communicate(timeout=120)[1]
nearest = 0.0
for f in forces:
    if f.tool_session == SESSION and f.tool_utime:
        k = min(mine, key=lambda u: abs(u - f.tool_utime))
        nearest = max(nearest, abs(f.tip_m[2] - (TROCAR[2] - mine[k])))
print(json.dumps({
    "exit": sim.returncode, "said": said, "sent": sent, "others": others,
    "forces": [[f.tool_session, f.tool_utime, f.force_N, f.tip_m, f.seq, f.session] for f in forces],
    "echo_error_m": nearest, "statuses": len(statuses), "scene": statuses[0].scene, "trocar": statuses[0].trocar_m[0],
}))
