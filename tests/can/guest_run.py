"""Runs a shell job in a guest that has CAN (tests/can/guest.sh) and reads what stock candump saw there."""
import pathlib
import re
import subprocess

from paths import BUILD, ROOT

RUNS = BUILD / "tests" / "can"
# Shell functions of every job: a listener is there once it wrote down a frame of ours, and has heard all once it wrote down a later one.
LISTENERS = """
listening() { until [ -s $1 ]; do cansend $CAN_B 7FF#; sleep 0.05; done; }
heard() { cansend $CAN_B 7FE#; for try in 1 2 3 4 5 6 7 8 9 10; do tail -n 5 $1 | grep -q " 7FE#" && break; sleep 0.05; done; }
"""
OURS = (0x7FE, 0x7FF)
LINE = re.compile(r"^\((\d+)\.(\d{6})\) (\S+) ([0-9A-F]+)#([0-9A-F]*)(?: ([TR]))?$")


def run(name, job, limit_s):
    """The finished process of guest.sh and the directory of what the job left. `job` is shell text."""
    directory = RUNS / name
    script = RUNS / f"{name}.sh"
    RUNS.mkdir(parents=True, exist_ok=True)
    script.write_text(LISTENERS + job)
    # The guest's own limit ends it; fetching its kernel comes on top.
    done = subprocess.run([ROOT / "tests/can/guest.sh", str(limit_s), directory, script], capture_output=True, text=True, timeout=limit_s + 1800, stdin=subprocess.DEVNULL)
    return done, directory / "out"


def candump(path):
    """[(time in us, interface, identifier, data)] of a `candump -L` log, less what LISTENERS sent. Every line must be one."""
    frames = []
    for number, line in enumerate(pathlib.Path(path).read_text().splitlines(), 1):
        match = LINE.match(line)
        assert match, f"{path}:{number}: not a line of candump -L: {line!r}"
        if int(match[4], 16) in OURS and not match[5]:
            continue
        frames.append((int(match[1]) * 1000000 + int(match[2]), match[3], int(match[4], 16), bytes.fromhex(match[5])))
    return frames
