"""Runs a script of this folder in a network namespace, with a folder in memory; returns its JSON output."""
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

from kit import LOOPBACK, UNSHARE

HERE = pathlib.Path(__file__).resolve().parent


def play(script, build, *arguments, key=False, seconds=150):
    directory = tempfile.mkdtemp(prefix="tm-test-", dir="/dev/shm")
    if key:
        path = os.path.join(directory, "key")
        os.close(os.open(path, os.O_CREAT, 0o600))
        pathlib.Path(path).write_text(os.urandom(16).hex() + "\n")
        arguments = (*arguments, path)
    try:
        run = subprocess.run([*UNSHARE, "timeout", "-k", "5", str(seconds), *LOOPBACK, sys.executable, HERE / script, build, HERE.parent, directory,
                              *arguments], capture_output=True, text=True, stdin=subprocess.DEVNULL, env=dict(os.environ, PATH=os.environ["PATH"] + ":/usr/sbin:/sbin"))
        logs = "".join(f"--- {p.name}\n{p.read_text(errors='replace')[-3000:]}" for p in sorted(pathlib.Path(directory).glob("*.log")))
        assert run.returncode == 0, run.stderr[-3000:] + logs
        return json.loads(run.stdout)
    finally:
        shutil.rmtree(directory)
