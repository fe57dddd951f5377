"""Two machines on one wire, made of network namespaces, with a relay between them that delays, drops, doubles and reorders.

    python two_hosts_net.py SPEC.json     (inside `unshare -n -m -p --fork --mount-proc`; see two_hosts.py)

The spec is {"seconds": S, "link": {...}, "kill": {"at_s", "host", "command"} or null, "hosts": {"simulation": [[argv], ...], "controller": [[argv],
...]}}. The output of each command is written to NAME_N.log in the spec's folder. This process is the relay, in a third namespace; when it ends, all
its children end."""
import heapq
import json
import os
import pathlib
import random
import select
import signal
import socket
import subprocess
import sys
import time

ADDRESS = {"simulation": "10.77.0.1/24", "controller": "10.77.0.2/24"}
DEFAULT_LINK = {"seed": 1, "delay_ms": 0.0, "jitter_ms": 0.0, "drop": 0.0, "double": 0.0, "reorder": 0.0, "cut_at_s": None, "heal_at_s": None}
HOLD_BACK_S = 0.060  # additional delay of a reordered packet: more than a frame of a 25 Hz simulation


def sh(*argv):
    subprocess.run(argv, check=True)


def make_host(name):
    """Makes a namespace held by a child process, with one end of a cable whose other end is here. Returns (pid, this end's name)."""
    holder = subprocess.Popen(["unshare", "-n", "sleep", "1000000"])
    here, there = f"to_{name[:8]}", "eth0"
    while os.readlink(f"/proc/{holder.pid}/ns/net") == os.readlink("/proc/self/ns/net"):
        time.sleep(0.005)
    sh("ip", "link", "add", here, "type", "veth", "peer", "name", there, "netns", str(holder.pid))
    inside = ["nsenter", "-t", str(holder.pid), "-n"]
    # The relay copies frames unchanged, so their checksums must be present.
    sh(*inside, "ethtool", "-K", there, "tx", "off")
    sh(*inside, "ip", "link", "set", "lo", "up")
    sh(*inside, "ip", "addr", "add", ADDRESS[name], "dev", there)
    sh(*inside, "ip", "link", "set", there, "up")
    sh(*inside, "ip", "route", "add", "224.0.0.0/4", "dev", there)
    sh("ip", "link", "set", here, "up")
    return inside, here


class Relay:
    """Copies frames between two cables; each frame's impairment is drawn from the seed, in order of arrival on each cable."""

    def __init__(self, link, cables):
        self.link = {**DEFAULT_LINK, **link}
        self.socks = []
        for cable in cables:
            sock = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(0x0003))
            sock.bind((cable, 0))
            sock.setblocking(False)
            self.socks.append(sock)
        self.random = [random.Random(self.link["seed"] + i) for i in range(2)]
        self.queue, self.order = [], 0
        self.count = {k: 0 for k in ("forwarded", "dropped", "doubled", "reordered", "cut")}

    def is_cut(self, elapsed_s):
        cut, heal = self.link["cut_at_s"], self.link["heal_at_s"]
        return cut is not None and elapsed_s >= cut and (heal is None or elapsed_s < heal)

    def take(self, side, now_s, elapsed_s):
        while True:
            try:
                frame, address = self.socks[side].recvfrom(65536)
            except BlockingIOError:
                return
            if address[2] == socket.PACKET_OUTGOING:
                continue
            draw = self.random[side]
            lost, doubled, held = draw.random() < self.link["drop"], draw.random() < self.link["double"], draw.random() < self.link["reorder"]
            if self.is_cut(elapsed_s) or lost:
                self.count["cut" if self.is_cut(elapsed_s) else "dropped"] += 1
                continue
            delay_s = 1e-3 * (self.link["delay_ms"] + draw.random() * self.link["jitter_ms"]) + (HOLD_BACK_S if held else 0)
            self.count["reordered"] += held
            self.count["doubled"] += doubled
            for _ in range(2 if doubled else 1):
                self.order += 1
                heapq.heappush(self.queue, (now_s + delay_s, self.order, 1 - side, frame))

    def send_due(self, now_s):
        while self.queue and self.queue[0][0] <= now_s:
            _, _, side, frame = heapq.heappop(self.queue)
            try:
                self.socks[side].send(frame)
                self.count["forwarded"] += 1
            except OSError as error:
                self.count[f"send error {error.errno}"] = self.count.get(f"send error {error.errno}", 0) + 1

    def run(self, start_s, until_s, alive):
        cut_at = None
        while (now := time.monotonic()) < until_s and alive(now - start_s):
            if cut_at is None and self.is_cut(now - start_s):
                cut_at = time.monotonic_ns() // 1000
            wait = min(0.05, max(0.0, self.queue[0][0] - now)) if self.queue else 0.05
            ready = select.select(self.socks, [], [], wait)[0]
            now = time.monotonic()
            for side, sock in enumerate(self.socks):
                if sock in ready:
                    self.take(side, now, now - start_s)
            self.send_due(time.monotonic())
        return cut_at


def main():
    spec_path = pathlib.Path(sys.argv[1])
    spec = json.loads(spec_path.read_text())
    sh("ip", "link", "set", "lo", "up")
    inside = {}
    cables = []
    for name in ("simulation", "controller"):
        inside[name], cable = make_host(name)
        cables.append(cable)
    relay = Relay(spec["link"], cables)
    started, by_host = [], {}
    kill = spec.get("kill")
    start_s = time.monotonic()
    for name, commands in spec["hosts"].items():
        for i, argv in enumerate(commands):
            log = open(spec_path.parent / f"{name}_{i}.log", "w")
            started.append(subprocess.Popen(inside[name] + argv, stdout=log, stderr=subprocess.STDOUT, stdin=subprocess.DEVNULL))
            by_host.setdefault(name, []).append(started[-1])

    def alive(elapsed_s):
        nonlocal kill
        if kill and elapsed_s >= kill["at_s"]:
            by_host[kill["host"]][kill["command"]].kill()
            kill = None
        return any(p.poll() is None for p in started)

    cut_us = relay.run(start_s, start_s + spec["seconds"], alive)
    for process in started:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
    for process in started:
        try:
            process.wait(5)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
    result = {"link": relay.link, "count": relay.count, "cut_monotonic_us": cut_us, "exit": [p.returncode for p in started]}
    (spec_path.parent / "link.json").write_text(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
