"""A machine on the same wire sends to a session with ttl=0: python other_machine.py BUILD TESTS DIRECTORY, inside a network namespace. Prints
haptic-rt's figures as JSON."""
import json
import os
import subprocess
import sys
import time

build, tests, directory = sys.argv[1:4]
SHOUT = """
import socket, sys, time
wire = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
wire.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, int(sys.argv[1]))
for _ in range(300):
    wire.sendto(b"LC02" + bytes(4) + b"FORCE_0" + bytes(50), ("239.255.76.67", 7667))
    time.sleep(0.002)
"""


def sh(*argv):
    subprocess.run(argv, check=True)


os.environ["TM_BUS_DIR"] = directory
with open(os.path.join(directory, "samples.csv"), "w") as file:
    file.write("time_s,fx_N,fy_N,fz_N\n" + "".join(f"{k / 30:.4f},0,0,-2\n" for k in range(300)))
other = subprocess.Popen(["unshare", "-n", "sleep", "1000"])
running = [other]
try:
    while os.readlink(f"/proc/{other.pid}/ns/net") == os.readlink("/proc/self/ns/net"):
        time.sleep(0.005)
    inside = ["nsenter", "-t", str(other.pid), "-n"]
    sh("ip", "link", "add", "here", "type", "veth", "peer", "name", "there", "netns", str(other.pid))
    sh("ip", "route", "del", "224.0.0.0/4", "dev", "lo")
    for prefix, device, address in (([], "here", "10.78.0.1/24"), (inside, "there", "10.78.0.2/24")):
        sh(*prefix, "ip", "addr", "add", address, "dev", device)
        sh(*prefix, "ip", "link", "set", device, "up")
        sh(*prefix, "ip", "route", "add", "224.0.0.0/4", "dev", device)
    result = {}
    for ttl in (0, 1):
        figures = os.path.join(directory, f"{ttl}.json")
        controller = subprocess.Popen([os.path.join(build, "bin/haptic-rt"), "--bus", "virtual:t", "--samples", os.path.join(directory, "samples.csv"), "--lcm-url",
                                       f"udpm://239.255.76.67:7667?ttl={ttl}", "--no-key", "--trocar", "0,0,0", "--duration", "4", "--json", figures])
        running.append(controller)
        time.sleep(0.7)
        sh(*inside, sys.executable, "-c", SHOUT, "1")
        sh(sys.executable, "-c", SHOUT, "0")
        controller.wait(20)
        result[f"ttl={ttl}"] = json.load(open(figures))["refused"]
finally:
    for process in running:
        process.kill()
        process.wait()
print(json.dumps(result))
