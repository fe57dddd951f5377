"""Frames of the drivers and of the emulators read by clients that this project did not write: moteus' own package, and canopen's master for CiA 402."""
import math
import struct
import subprocess
import sys
import time

from drivekit import HERE
from motorkit import ADDRESS, HAPTIC, NODES, Axes
from moteus import moteus, multiplex, protocol
from paths import ROOT

sys.path.insert(0, str(ROOT / "tests/loop"))
from virtual_bus import FD, HEADER, SLOT, SLOTS, VirtualBus  # noqa: E402

REPLY = bytes([0x21, 0x00, 10, 0x2f, 0x01]) + struct.pack("<fff", 0.25, 0.0, 0.0) + bytes([0x21, 0x0f, 0])


def test_moteus_own_package_makes_and_reads_the_same_registers(tmp_path):
    (tmp_path / "s.csv").write_text("time_s,fx_N,fy_N,fz_N\n" + "".join(f"{0.02 * k},0,0,-1\n" for k in range(50)))
    read = protocol.parse_reply(REPLY)
    assert read[moteus.Register.MODE] == 10 and read[moteus.Register.POSITION] == 0.25 and read[moteus.Register.FAULT] == 0
    child = subprocess.Popen([HAPTIC, "--device", ADDRESS.format(kind="moteus", bus="virtual:o"), "--device-type", "desk", "--trocar", "0,0,0", "--duration", "0.6", "--samples", tmp_path / "s.csv"],
                             env={"TM_BUS_DIR": str(tmp_path)}, stderr=subprocess.PIPE, text=True)
    bus, frames = VirtualBus(tmp_path, "o"), []
    while child.poll() is None:
        for identifier, data, flags in bus.receive_flagged():
            if identifier & 0x8000:
                frames.append((identifier, data, flags))
                bus.send((identifier & 0x7f) << 8, REPLY.ljust(24, b"\x50"), FD | 1)
        time.sleep(0.0003)
    assert child.returncode == 0, child.stderr.read()
    resolution = moteus.PositionResolution()
    for name in ("position", "velocity", "feedforward_torque", "kp_scale", "kd_scale", "maximum_torque", "watchdog_timeout"):
        setattr(resolution, name, multiplex.F32)
    theirs, compared = moteus.Controller(1, position_resolution=resolution), 0
    for identifier, data, flags in frames:
        parts = list(multiplex.parse_frame(data))
        wrote = {p.register: p.value for p in parts if p.type == multiplex.SubframeType.WRITE}
        asked = [(p.register, p.resolution) for p in parts if p.type == multiplex.SubframeType.READ]
        assert flags == FD | 1 and identifier >> 8 == 0x80 and identifier & 0x7f in NODES
        assert asked == [(0, multiplex.INT8), (1, multiplex.F32), (2, multiplex.F32), (3, multiplex.F32), (0x0f, multiplex.INT8)]
        if wrote[0] != 10:
            assert wrote == {0: 0}
            continue
        made = theirs.make_position(position=math.nan, velocity=0.0, feedforward_torque=wrote[0x22], kp_scale=0.0, kd_scale=0.0, maximum_torque=wrote[0x25],
                                    watchdog_timeout=wrote[0x27]).data
        same = {p.register: p.value for p in multiplex.parse_frame(made)}
        assert {k: str(v) for k, v in same.items()} == {k: str(v) for k, v in wrote.items()} and abs(wrote[0x27] - 0.02) < 1e-6
        compared += 1
    assert compared > 300, len(frames)


def test_another_master_drives_the_emulator_of_cia_402(tmp_path):
    (tmp_path / "o.bus").write_bytes(struct.pack("<Q", 0x324e414354524854).ljust(HEADER + SLOTS * SLOT, b"\0"))
    bench = Axes(tmp_path, "cia402")
    bench.start()
    try:
        assert bench.child.stdout.readline() == "ready\n"
        done = subprocess.run([sys.executable, HERE / "cia402_master.py", tmp_path, "o", "1", "--log", "/dev/null"], capture_output=True, text=True, timeout=40)
        rows, _ = bench.rows()
    finally:
        bench.end()
    state, turns = (done.stdout + "\n\n").splitlines()[:2]
    assert done.returncode == 0 and state == "OPERATION ENABLED" and float(turns) > 0.01, done.stdout + done.stderr
    assert any(abs(row[2] - 0.024) < 1e-9 for row in rows), "100 thousandths of 240 mN m"
