"""haptic-rt with motors on a real kernel's CAN: frames of CAN-FD in the short form; ODrive in two versions of its protocol, moteus and CiA 402 with their
emulators in the long one, in a guest of its own."""
import csv
import json
import sys

import guest_run
import pytest
from guest_scenes import LIMIT_S, part
from paths import BUILD, ROOT

sys.path.insert(0, str(ROOT / "tests/devices"))
import motorkit  # noqa: E402

# At 100 ticks a second: the emulators' Python takes the guest's processor, which counts its instructions, ten times as long as the host's.
JOB = f"""
cd {ROOT}
{{ echo time_s,fx_N,fy_N,fz_N; awk 'BEGIN {{ for (i = 0; i < 500; i++) printf "%.3f,0.3,0.2,-1.5\\n", 0.02 * i }}'; }} > $TMPDIR/s.csv
motors() {{
    out=$OUT/$1 kind=$2
    mkdir -p $out
    {sys.executable} tests/devices/${{kind}}_axes.py socketcan vcan0 1,2,3 --log $out/axes.csv --pause 0.005 ${{@:3}} > $out/said.txt 2>&1 & axes=$!
    until grep -q ready $out/said.txt; do kill -0 $axes || return 1; sleep 0.2; done
    {BUILD}/bin/haptic-rt --device {motorkit.ADDRESS.format(kind="$kind", bus="socketcan:vcan0")} --device-type desk --trocar 0,0,0 --rate 100 --samples $TMPDIR/s.csv --duration 2 \\
        --record $out/r.csv --json $out/r.json 2> $out/c.txt || return 1
    sleep 0.1
    kill $axes
    wait $axes
    true
}}
motors odrive_0.5 odrive --dbc 0.5.6 && motors odrive_0.6 odrive --dbc 0.6.10 && motors moteus moteus && motors cia402 cia402
"""


def test_frames_of_can_fd_pass_and_a_classical_interface_is_refused():
    out = part("fd")
    words = [line.split()[2].split("##") for line in (out / "a.log").read_text().splitlines() if "##" in line]
    assert len(words) > 300 and {word[0] for word in words} == {f"{0x8000 + node:08X}" for node in (1, 2, 3)}
    # 5: CAN-FD, second bit rate. A stop, and the registers that are asked for.
    assert {word[1] for word in words} == {"5" + "010000" + "1100" + "1F01" + "110F" + "505050"}
    assert "socketcan:can0 carries no CAN-FD frames" in (out / "refused.txt").read_text()
    assert (out / "code").read_text() == "2\n"


@pytest.mark.long
def test_torques_arrive_over_the_kernels_can():
    done, out = guest_run.run("motors", JOB, LIMIT_S)
    assert done.returncode == 0, done.stderr
    for name in ("odrive_0.5", "odrive_0.6", "moteus", "cia402"):
        report = json.loads((out / name / "r.json").read_text())
        rows = [{k: float(v) for k, v in row.items()} for row in csv.DictReader((out / name / "r.csv").open())]
        for row in rows:
            row["t_us"] = report["start_us"] + 1e6 * row["time_s"]
        bench = motorkit.Axes(out / name, name.split("_")[0])
        checked, worst = motorkit.compare(bench.kind, bench.rows()[0], rows)
        print(name, checked, worst)
        assert report["fault"] == "none" and report["state"] == "engaged" and checked > 100, (name, report)
