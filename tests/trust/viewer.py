"""tm-view waits for a picture while huge messages are announced: python viewer.py BUILD TESTS DIRECTORY, inside a network namespace. Prints its
memory growth as JSON."""
import json
import os
import socket
import struct
import subprocess
import sys
import time

build, tests, directory = sys.argv[1:4]
wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
wire.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 0)


def memory_kB():
    with open(f"/proc/{viewer.pid}/status") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmRSS"))


viewer = subprocess.Popen([os.path.join(build, "bin/tm-view"), "--wait", "5", "--png", os.path.join(directory, "x.png")], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
try:
    time.sleep(1.5)
    before = memory_kB()
    for seq in range(400):
        for channel in (b"TISSUE\0", b"SIM_STATUS\0", b"CONTROLLER_0\0"):
            wire.sendto(b"LC03" + struct.pack(">IIIHH", seq, (1 << 28) - 1, 0, 0, 4100) + channel + bytes(90), ("239.255.76.67", 7667))
        wire.sendto(b"LC02" + bytes(4) + b"TISSUE\0" + os.urandom(200), ("239.255.76.67", 7667))
        time.sleep(0.002)
    print(json.dumps({"alive": viewer.poll() is None, "grown_kB": memory_kB() - before, "exit": viewer.wait(20)}))
finally:
    viewer.kill()
    viewer.wait()
