"""tm-sim, haptic-rt and tm-device are killed, stopped, started twice, and their clocks set, at random. After every burst each is accepted again
within a second, or one line a second gives the reason.

    python soak.py BUILD SCENE FOLDER SEED EVENTS [KEY FILE]

Runs inside a network namespace. Prints its events as JSON; exit 1 and the last output of all programs if one was not accepted."""
import json
import os
import pathlib
import random
import re
import select
import signal
import struct
import subprocess
import sys
import time

build, scene, folder = map(pathlib.Path, sys.argv[1:4])
seed, events = map(int, sys.argv[4:6])
key = ["--key", sys.argv[6]] if len(sys.argv) > 6 else []
sys.path.insert(0, str(build / "python"))
import lcm  # noqa: E402
from tensormass_lcm import controller_status_t, force_sample_t  # noqa: E402

# Allowance beyond the promised second: time to start and schedule a program on a busy machine.
SECOND, SLACK, AT_LAST = 1.0, 1.0, 15.0
REASON = re.compile(r"refused|waiting for|fault|is already|no samples from|not within|while in use")
YEAR_US = 365 * 86400 * 1000000
random.seed(seed)
link = lcm.LCM("udpm://239.255.76.67:7667?ttl=0")
heard = {"status": (0.0, None), "force": (0.0, None)}
link.subscribe("CONTROLLER_0", lambda _, data: heard.__setitem__("status", (time.monotonic(), controller_status_t.decode(data))))
link.subscribe("FORCE_0", lambda _, data: heard.__setitem__("force", (time.monotonic(), force_sample_t.decode(data))))
COMMAND = {"sim": ["tm-sim", scene, "--realtime", *key],
           "controller": ["haptic-rt", "--bus", "virtual:soak", "--auto-reset", "0.2", *key],
           "device": ["tm-device", "--bus", "virtual:soak"]}
counts = dict.fromkeys(("kill", "stop", "clock", "double"), 0)
story, took = [], []


class Program:
    """A process with clocks of its own."""
    number = 0

    def __init__(self, kind):
        Program.number += 1
        self.kind, name = kind, f"{kind}_{Program.number}"
        self.clock = folder / f"{name}.clock"
        self.set_clock()
        up_us = int(time.monotonic() * 1e6)
        monotonic_us = random.choice([0, random.randint(-up_us // 2, 10 * up_us), 86400 * 1000000 * random.randint(1, 1000)])
        env = dict(os.environ, TM_BUS_DIR=str(folder), LD_PRELOAD=str(build / "tests/loop/fake_clock.so"), TM_FAKE_CLOCK=str(self.clock),
                   TM_FAKE_MONOTONIC=str(monotonic_us))
        self.log, self.said, self.spoke = folder / f"{name}.log", 0, 0.0
        argv = COMMAND[kind]
        with open(self.log, "w") as log:
            self.process = subprocess.Popen([build / "bin" / argv[0], *argv[1:]], env=env, stdin=subprocess.DEVNULL, stdout=log, stderr=log)

    def set_clock(self):
        us = random.choice([0, -3600 * 1000000, 3600 * 1000000, random.randint(-YEAR_US * 10, YEAR_US * 10), random.randint(-2000000, 2000000)])
        with open(self.clock, "r+b" if self.clock.exists() else "wb") as file:
            file.write(struct.pack("<q", us))
        return us

    def new_reasons(self):
        """Returns True if, since the last call, it reported why a peer is not accepted."""
        with open(self.log, errors="replace") as log:
            log.seek(self.said)
            text = log.read()
            self.said = log.tell()
        return bool(REASON.search(text))

    def kill(self):
        self.process.kill()
        self.process.wait()


running = {}
spare = []  # second simulations


def listen(seconds):
    end = time.monotonic() + seconds
    while True:
        left = end - time.monotonic()
        if not select.select([link.fileno()], [], [], max(0, left))[0]:
            return
        link.handle()


def fail(why):
    print(json.dumps({"seed": seed, "failed": why, "story": story[-12:]}, indent=1))
    for p in [*running.values(), *spare]:
        print(f"--- {p.log.name}", *p.log.read_text(errors="replace").splitlines()[-25:], sep="\n")
    sys.exit(1)


def taken_up(since):
    (status_at, status), (force_at, force) = heard["status"], heard["force"]
    now = time.monotonic()
    return (status and force and status_at > since and force_at > since and now - status_at < 0.4 and now - force_at < 0.4 and status.state == 3
            and force.tool_session == status.session)


def settle():
    """Waits until all three work together again, or the reason is reported once a second after the first."""
    began = reason = time.monotonic()
    while not taken_up(began + 0.12):
        listen(0.02)
        now = time.monotonic()
        if any([p.new_reasons() for p in [*running.values(), *spare]]):
            reason = now
        for p in [*running.values(), *spare]:
            if p.process.poll() is not None:
                fail(f"{p.kind} ended by itself with {p.process.returncode}")
        if now - reason > SECOND + SLACK:
            fail(f"not taken up for {now - began:.1f} s, and no word why for {now - reason:.1f} s")
        if now - began > AT_LAST:
            fail(f"not taken up within {AT_LAST} s")
    took.append(time.monotonic() - began)


def refused(kind):
    """A second controller or device on the same bus ends by itself, with exit 2 and a reason."""
    second = Program(kind)
    try:
        code = second.process.wait(10)
    except subprocess.TimeoutExpired:
        second.kill()
        code = "no end"
    if code != 2 or not second.new_reasons():
        spare.append(second)
        fail(f"a second {kind} was not refused: {code}")


def event():
    what, kind = random.choice(list(counts)), random.choice(list(running))
    counts[what] += 1
    program = running[kind]
    wait = 0.0
    if what == "kill":
        program.kill()
        wait = random.choice([0, 0, random.uniform(0, 0.3)])
        listen(wait)
        running[kind] = Program(kind)
    elif what == "stop":
        wait = random.choice([random.uniform(0.005, 0.1), random.uniform(0.1, 0.6)])
        program.process.send_signal(signal.SIGSTOP)
        listen(wait)
        program.process.send_signal(signal.SIGCONT)
    elif what == "clock":
        wait = program.set_clock()
    elif kind == "sim":  # two may send at once: the first is accepted, the other one when it ends
        spare.append(Program(kind))
        listen(random.uniform(0, 0.5))
    else:
        refused(kind)
    story.append(f"{what} {kind} {wait:g}")


def drop_spares():
    """Either of two simulations may end: the one left is accepted."""
    while spare:
        second = spare.pop()
        if random.random() < 0.5:
            second, running["sim"] = running["sim"], second
        second.kill()
        story.append("one of two simulations ends")
        settle()


try:
    for name in random.sample(list(COMMAND), len(COMMAND)):
        running[name] = Program(name)
    settle()
    while sum(counts.values()) < events:
        for _ in range(min(random.randint(1, 4), events - sum(counts.values()))):
            event()
            listen(random.uniform(0, 0.08))
        settle()
        drop_spares()
    took.sort()
    print(json.dumps({"seed": seed, "events": counts, "bursts": len(took), "s": {"median": took[len(took) // 2], "p90": took[len(took) * 9 // 10], "max": took[-1]}}))
finally:
    for p in [*running.values(), *spare]:
        p.kill()
