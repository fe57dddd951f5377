"""Runs haptic-rt with a full stderr that nobody reads, under a flood of invalid messages: python deaf.py BUILD TESTS DIRECTORY, inside a network
namespace. Prints whether it went on pushing, and how it ended, as JSON."""
import fcntl
import json
import os
import signal
import socket
import subprocess
import sys
import time

build, tests, directory = sys.argv[1:4]
sys.path.insert(0, os.path.join(tests, "loop"))
from virtual_bus import VirtualBus, Watch, torque  # noqa: E402

wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
wire.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)
os.environ["TM_BUS_DIR"] = directory
samples = os.path.join(directory, "samples.csv")
with open(samples, "w") as file:
    file.write("time_s,fx_N,fy_N,fz_N\n" + "".join(f"{k / 30:.4f},0,0,-2\n" for k in range(1000)))
unread, full = os.pipe()
fcntl.fcntl(full, fcntl.F_SETFL, os.O_NONBLOCK)
try:
    while True:
        os.write(full, b"x" * 1024)
except BlockingIOError:
    pass
fcntl.fcntl(full, fcntl.F_SETFL, 0)  # the program must not block, even if its stderr would


def pushing(data):
    return bool(data) and bool(data[6] & 0x80) and abs(torque(data)[2]) > 1500


running = []
try:
    running.append(subprocess.Popen([os.path.join(build, "bin/tm-device"), "--bus", "virtual:t"], stderr=subprocess.DEVNULL))
    controller = subprocess.Popen([os.path.join(build, "bin/haptic-rt"), "--bus", "virtual:t", "--trocar", "0,0,0", "--samples", samples, "--lcm-url",
                                   "udpm://239.255.76.67:7667?ttl=0", "--priority", "0"], stderr=full)
    running.append(controller)
    watch = Watch(VirtualBus(directory, "t"))
    end = time.monotonic() + 15
    while time.monotonic() < end and not pushing(watch.last(0x100)[1]):
        time.sleep(0.01)
    begin = time.monotonic()
    while time.monotonic() - begin < 2.5:
        for channel in (b"FORCE_0", b"PATCH_0", b"SIM_STATUS", b"CONTROLLER_COMMAND_0"):
            wire.sendto(b"LC02\0\0\0\0" + channel + b"\0" + os.urandom(40), ("239.255.76.67", 7667))
        time.sleep(0.0005)
    seen = [d for t, i, d in list(watch.frames) if i == 0x100 and t > begin]
    result = {"commands": len(seen), "pushing": sum(map(pushing, seen))}
    controller.send_signal(signal.SIGTERM)
    try:
        result["exit"] = controller.wait(5)
    except subprocess.TimeoutExpired:
        result["exit"] = "it hangs"
finally:
    for process in running:
        process.kill()
        process.wait()
print(json.dumps(result))
