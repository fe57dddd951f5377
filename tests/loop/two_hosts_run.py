"""Starts two_hosts_net.py in namespaces of its own and returns its results. Every process ends with the call."""
import json
import os
import shutil
import subprocess
import sys

from paths import BUILD, ROOT

# Messages leave this machine, but not beyond the next one: the relay's wire is the complete network.
LCM_URL = "udpm://239.255.76.67:7667?ttl=1"


def directory(name):
    """Makes an empty folder for a run's files."""
    path = BUILD / "tests" / "two_hosts" / name
    shutil.rmtree(path, ignore_errors=True)
    path.mkdir(parents=True)
    return path


def key(path):
    """Makes a key for both sides: messages leave the machine."""
    file = path / "key"
    file.touch(0o600)
    file.write_text(os.urandom(16).hex() + "\n")
    return file


def run(path, hosts, link, seconds, kill=None):
    """Returns the contents of link.json. `hosts` = {"simulation": [argv...], "controller": [argv...]}; `kill` = {"at_s": S, "host": NAME, "command":
    N}: SIGKILL."""
    spec = {"seconds": seconds, "link": link, "kill": kill, "hosts": {h: [[str(a) for a in argv] for argv in commands] for h, commands in hosts.items()}}
    (path / "spec.json").write_text(json.dumps(spec))
    own = [] if os.geteuid() == 0 else ["-r"]
    # A process namespace: when the relay ends or is killed, every process in it ends.
    command = ["timeout", "-k", "5", str(int(seconds) + 30), "unshare", *own, "-n", "-m", "-p", "--fork", "--mount-proc", "--kill-child",
               sys.executable, ROOT / "tests/loop/two_hosts_net.py", path / "spec.json"]
    environment = dict(os.environ, LCM_DEFAULT_URL=LCM_URL, PATH=os.environ["PATH"] + ":/usr/sbin:/sbin")
    done = subprocess.run(command, cwd=path, env=environment, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    logs = "".join(f"--- {p.name}\n{p.read_text()[-4000:]}" for p in sorted(path.glob("*.log")) if "sim.log" not in p.name)
    assert done.returncode == 0, f"two hosts: status {done.returncode}\n{done.stderr[-4000:]}\n{logs}"
    return json.loads((path / "link.json").read_text())
