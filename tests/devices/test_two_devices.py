"""Two devices of different kinds hold the two instruments of one scene: their twins in lockstep, and a Haply Inverse3 and motors by moteus in real time."""
import csv
import json
import os
import subprocess
import sys

import motorkit
import pytest
import scenekit
from drivekit import HERE, commands
from kit import NETWORK, report
from paths import BUILD, ROOT
from test_haply import built_in

DEPTH_M, SWING_M = 0.125, 0.012  # below the trocars, 5 mm above the block
TURNS = motorkit.TURNS[-1]
PATH = "[{time: 0 s, tip: [%d mm, 50 mm, 55 mm]}, {time: 1 s, tip: [%d mm, 50 mm, %d mm]}, {time: 2 s, tip: [%d mm, 50 mm, 55 mm]}]"
RUN = """
{bin}/tm-sim {scene} --realtime --quiet --set 'time.duration=30 s' 2> {tmp}/sim.txt & sim=$!
{python} {here}/haply_service.py --port 18003 --log {tmp}/haply.csv --swing {swing} > {tmp}/port & haply=$!
{python} {here}/moteus_axes.py {tmp} o {nodes} --log {tmp}/moteus.csv --start {start} --swing {turns} > {tmp}/axes.txt & moteus=$!
{bin}/haptic-rt --device haply:0@127.0.0.1:18003 --workspace depth={depth} --duration 5 --record {tmp}/0.csv --json {tmp}/0.json 2> {tmp}/0.txt & first=$!
{bin}/haptic-rt --device {address} --device-type desk --instrument 1 --duration 5 --record {tmp}/1.csv --json {tmp}/1.json 2> {tmp}/1.txt
wait $first; kill -INT $sim; kill $haply $moteus; wait
"""


def two(tmp):
    """Returns the scene of a pressed block with two probes, held by an Inverse3 and by motors."""
    head, rest = (ROOT / "apps/scenes/block-press.yaml").read_text().replace("../../meshes", str(ROOT / "meshes")).split("instruments:\n")
    tail = rest[rest.index("haptics:"):]
    hands = "".join(f"  - {{instrument: {i}, path: {PATH % (x, x, z, x)}}}\n" for i, x, z in ((0, 30, 46), (1, 70, 43)))
    path = tmp / "two.yaml"
    path.write_text(f"{head}instruments:\n  - {{mode: probe, device: inverse3, trocar: [30 mm, 50 mm, 180 mm]}}\n  - {{mode: probe, device: desk, trocar: [70 mm, 50 mm, 180 mm]}}\nhand:\n{hands}{tail}")
    return path


def test_twins_in_lockstep_press_by_their_own_hands(tmp_path):
    told = report(BUILD / "bin/tm-sim", two(tmp_path), "--lockstep", "--quiet", "--csv", tmp_path / "t.csv", tmp=tmp_path)
    assert [loop["state"] for loop in told["controllers"]] == ["engaged", "engaged"] and not any(loop["fault"] for loop in told["controllers"])
    rows = list(csv.DictReader((tmp_path / "t.csv").open()))
    peak = [max(float(row["fz_N"]) for row in rows if row["instrument"] == i) for i in "01"]
    assert 0.1 < peak[0] < 0.8 * peak[1], "the second presses deeper"


def read(tmp, i):
    told = json.loads((tmp / f"{i}.json").read_text())
    rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader((tmp / f"{i}.csv").open())]
    for row in rows:
        row["t_us"] = told["start_us"] + 1e6 * row["time_s"]
    assert told["fault"] == "none", (tmp / f"{i}.txt").read_text()
    return told, rows


def play(tmp):
    """Returns [(report, forces compared, largest difference in N)] of both."""
    text = RUN.format(bin=BUILD / "bin", scene=two(tmp), tmp=tmp, python=sys.executable, here=HERE, swing=SWING_M, nodes=",".join(map(str, motorkit.NODES)), start=DEPTH_M * TURNS,
                      turns=SWING_M * TURNS, depth=DEPTH_M, address=motorkit.ADDRESS.format(kind="moteus", bus="virtual:o"))
    subprocess.run([*NETWORK, "sh", "-c", text], timeout=80, check=False, capture_output=True, env={**os.environ, "TM_BUS_DIR": str(tmp)})
    (first, rows), (second, others) = read(tmp, 0), read(tmp, 1)
    bench = motorkit.Axes(tmp, "moteus")
    bench.log = tmp / "moteus.csv"
    return [(first, *scenekit.compare_cursor([(row[0], row[1]) for row in commands(tmp / "haply.csv")[0]], rows, scenekit.quantum_N("haply"))),
            (second, *motorkit.compare("moteus", bench.rows()[0], others))]


@pytest.mark.skipif(not built_in(), reason="haptic-rt was built without libwebsockets (libwebsockets-dev)")
def test_two_emulators_feel_the_forces_of_their_own_instruments(tmp_path):
    for attempt in range(3):  # on a busy machine one of the five programs may start too late for the others
        folder = tmp_path / f"run{attempt}"
        folder.mkdir()
        both = play(folder)
        if all(compared > 200 and told["force_N"]["peak"] > 0.1 for told, compared, _ in both):
            break
    for name, (told, compared, worst) in zip(("haply", "moteus"), both):
        print(name, told["force_N"], compared, worst)
        assert told["force_N"]["peak"] > 0.1 and compared > 200
        assert worst <= scenekit.quantum_N(name) + 4 * motorkit.FLOAT
