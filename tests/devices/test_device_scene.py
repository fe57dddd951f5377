"""The demo's scene with a desk device: in lockstep with the virtual form of each device, and in real time with the emulator of Haply's service."""
import csv
import json
import subprocess
import sys

import pytest
from drivekit import HERE, commands, expected
from kit import NETWORK, report
from paths import BUILD, ROOT
from test_haply import QUANTUM_N, built_in

SCENE = ROOT / "apps/scenes/liver-press.yaml"
DEVICES = ("inverse3", "touch", "omega", "falcon")


@pytest.mark.parametrize("device", DEVICES)
def test_lockstep_with_the_twin(tmp_path, device):
    seen = report(BUILD / "bin/tm-sim", SCENE, "--lockstep", "--quiet", "--set", f"instruments[0].device={device}", "--set", "time.duration=2.4 s", tmp=tmp_path)
    print(device, seen["force_N"], seen["state_hash"])
    assert 0.1 < seen["force_N"]["peak"] < 2.0
    assert seen["controllers"][0]["state"] == "engaged" and not seen["controllers"][0]["fault"]


RUN = """
{bin}/tm-sim {scene} --realtime --quiet --set 'instruments[0].device=inverse3' --set 'time.duration=20 s' --json {tmp}/s.json 2> {tmp}/sim.txt & sim=$!
{python} {here}/haply_service.py --port 18001 --log {tmp}/service.csv --swing 0.045 > {tmp}/port & service=$!
{bin}/haptic-rt --device haply:0@127.0.0.1:18001 --workspace depth=0.105 --duration 6 --record {tmp}/r.csv --json {tmp}/r.json 2> {tmp}/said.txt
kill -INT $sim; kill $service; wait
"""


@pytest.mark.skipif(not built_in(), reason="haptic-rt was built without libwebsockets (libwebsockets-dev)")
def test_real_time_with_the_emulator(tmp_path):
    """The emulator's forces equal those of the controller's ticks, in order, to the last digit of the message."""
    text = RUN.format(bin=BUILD / "bin", scene=SCENE, tmp=tmp_path, python=sys.executable, here=HERE)
    subprocess.run([*NETWORK, "sh", "-c", text], timeout=60, check=False, capture_output=True)
    told = json.loads((tmp_path / "r.json").read_text())
    rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader((tmp_path / "r.csv").open())]
    felt = [row for row in commands(tmp_path / "service.csv")[0] if any(row[1])]
    print(told["force_N"], told["drive"], told["samples"], len(felt))
    assert told["fault"] == "none" and told["force_N"]["peak"] > 0.1, (tmp_path / "said.txt").read_text()
    ticks = iter(rows)
    tick = next(ticks)
    for time_us, wanted, _, _ in felt:
        while max(abs(a - b) for a, b in zip(wanted, expected(tick))) > QUANTUM_N:
            tick = next(ticks, None)
            assert tick and told["start_us"] + 1e6 * tick["time_s"] <= time_us
    assert len(felt) > 200
