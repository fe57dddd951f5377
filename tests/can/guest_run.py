"""Runs a shell job in a guest that has CAN (tests/can/guest.sh) and reads what stock candump recorded there."""
import pathlib
import re
import subprocess

from paths import BUILD, ROOT

RUNS = BUILD / "tests" / "can"
# Shell functions of every job: a listener is ready once it recorded a frame of ours, and complete once it recorded a later one.
LISTENERS = """
listening() { until [ -s $1 ]; do cansend $CAN_B 7FF#; sleep 0.05; done; }
heard() { cansend $CAN_B 7FE#; for try in 1 2 3 4 5 6 7 8 9 10; do tail -n 5 $1 | grep -q " 7FE#" && break; sleep 0.05; done; }
"""
OURS = (0x7FE, 0x7FF)
LINE = re.compile(r"^\((\d+)\.(\d{6})\) (\S+) ([0-9A-F]+)#([0-9A-F]*)(?: ([TR]))?$")


def run(name, job, limit_s):
    """Returns the finished process of guest.sh and the directory with the job's files. `job` is shell text."""
    directory = RUNS / name
    script = RUNS / f"{name}.sh"
    RUNS.mkdir(parents=True, exist_ok=True)
    script.write_text(LISTENERS + job)
    # The guest has its own limit; fetching its kernel takes additional time.
    done = subprocess.run([ROOT / "tests/can/guest.sh", str(limit_s), directory, script], capture_output=True, text=True, timeout=limit_s + 1800, stdin=subprocess.DEVNULL)
    return done, directory / "out"


def candump(path):
    """Returns [(time in us, interface, identifier, data)] of a `candump -L` log without the frames of LISTENERS. Every line must be a frame."""
    frames = []
    for number, line in enumerate(pathlib.Path(path).read_text().splitlines(), 1):
        match = LINE.match(line)
        assert match, f"{path}:{number}: not a line of candump -L: {line!r}"
        if int(match[4], 16) in OURS and not match[5]:
            continue
        frames.append((int(match[1]) * 1000000 + int(match[2]), match[3], int(match[4], 16), bytes.fromhex(match[5])))
    return frames
