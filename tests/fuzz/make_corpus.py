"""Makes seeds of the fuzz targets: small valid inputs of each kind. Run once, from the root of the project; the result is committed."""
import pathlib
import struct
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT / "tests" / "mesh"))
import meshlib  # noqa: E402
import vtk_xml  # noqa: E402
from test_fill import binary, sphere, text  # noqa: E402

HERE = pathlib.Path(__file__).resolve().parent / "corpus"


def put(target, name, contents):
    (HERE / target).mkdir(parents=True, exist_ok=True)
    (HERE / target / name).write_bytes(contents if isinstance(contents, bytes) else contents.encode())


def tiny():
    m = meshlib.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)], [[0, 1, 2, 3], [1, 2, 3, 4]])
    m.names = {(3, 1): "a", (2, 2): "b"}
    m.surface = [((0, 2, 1), 2)]
    return m


for name, write in (("2", meshlib.msh2), ("2b", meshlib.msh2_binary), ("4", meshlib.msh4), ("4b", meshlib.msh4_binary), ("vtk5", meshlib.vtk5), ("vtk5b", meshlib.vtk5_binary),
                    ("vtk2", meshlib.vtk), ("medit", meshlib.medit)):
    put("fuzz_mesh_text", name, write(tiny()))

for name, how in (("vtu", {}), ("vtub", dict(how="binary", packed=True)), ("vtua", dict(how="appended", packed=True))):
    put("fuzz_mesh_text", name, vtk_xml.vtu(tiny(), **how))

# two tetrahedra with a common face, bytes as coordinates in mm
put("fuzz_mesh", "two", bytes([1, 1, 0]) + bytes([0, 1, 2, 3, 1, 2, 3, 4]) + bytes([0, 0, 0, 10, 0, 0, 0, 10, 0, 0, 0, 10, 10, 10, 10]))
put("fuzz_mesh", "one-raw", bytes([0, 0, 1]) + bytes([0, 1, 2, 3]) + struct.pack("<12d", 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1))

for scene in sorted((ROOT / "apps" / "scenes").glob("*.yaml")):
    put("fuzz_scene", scene.stem, scene.read_text())

put("fuzz_snapshot", "untouched", bytes([1]))
put("fuzz_snapshot", "patched", bytes([3]) + struct.pack("<HB", 90, 8) + struct.pack("<d", 1e-3))
put("fuzz_snapshot", "magic", bytes([2]) + b"TMSNAP\r\n" + struct.pack("<II", 2, 0x01020304) + bytes(80))
put("fuzz_responses", "untouched", bytes([1]))
put("fuzz_responses", "one-byte", bytes([1]) + bytes([200, 0, 0, 1, 255]))
put("fuzz_responses", "short", bytes([1]) + bytes([100, 1, 0, 0]))
put("fuzz_responses", "empty", bytes([0]))
put("fuzz_responses", "magic", bytes([0]) + b"TMRESP\r\n" + bytes(300))

frame = bytes([0x10, 0x01, 0, 8]) + bytes(8)
put("fuzz_can", "beats", bytes([1]) + bytes([128] * 60) + bytes([128 | 16]) + frame + bytes([128] * 100))
put("fuzz_can", "frames", bytes([0]) + b"".join(bytes([128 | 16]) + bytes([i & 255, i >> 8, 0, 8]) + bytes(range(8)) for i in range(0x100, 0x140)))

put("fuzz_lcm", "zeros", b"".join(bytes([kind, 0, 64, 3]) + bytes(200) for kind in (0, 2, 3, 4)))
put("fuzz_lcm", "patch", bytes([1, 0, 64, 3]) + bytes(4000) + bytes([0, 0, 64, 15]) + bytes(400))
for kind in range(7):
    put("fuzz_lcm", f"kind-{kind}", bytes([kind, 120, 0, 5]) + bytes(8) + struct.pack(">qiqq", 1, 1, 1, 7) + bytes(92))

put("fuzz_sample", "tame", bytes([5]) + b"".join(bytes([8 | 16 | 2, 4]) + bytes(range(15)) + bytes(24) for _ in range(6)))
put("fuzz_sample", "patch", bytes([5, 8 | 16 | 32 | 64 | 128 | 2, 4]) + bytes(range(15)) + bytes([4, 2, 38]) + bytes([0, 0, 0, 10, 0, 0, 0, 10, 0, 10, 10, 0])
    + bytes([0, 1, 2, 1, 3, 2] + [0] * 90) + bytes([1] * 12) + bytes([0, 0, 1] * 8))

put("fuzz_tables", "profile", b"\0" + b"# a profile\nforce_max_N = 8.9\ntorque_max = 0.5, 0.5, 9\n")
put("fuzz_tables", "hand", b"\1" + b"time_s,pitch_rad,yaw_rad,insertion_m,roll_rad,grip,active\n0,0,0,0.05,0,0,0\n1,0.1,0,0.06,0,0,1\n")
put("fuzz_tables", "samples", b"\2" + b"time_s,instrument,px_m,py_m,pz_m,fx_N,fy_N,fz_N\n0,0,0,0,0,1,0,0\n0.04,0,0,0,0,1,0,0\n")
put("fuzz_tables", "fibres", b"\3" + b"tet,ax,ay,az\n0,1,0,0\n1,0,1,0\n2,0,0,1\n3,1,1,1\n")
put("fuzz_tables", "stl-text", b"\4" + text(sphere(1)).encode())
put("fuzz_tables", "stl", b"\4" + binary(sphere(1)))
for i, words in enumerate(("5 kPa", "3 mm", "-1e-3", "30 deg", "25 Hz", "1050 kg/m^3")):
    put("fuzz_tables", f"quantity-{i}", b"\5" + words.encode())

def packet(flags, body):
    return bytes([len(body) & 255, len(body) >> 8, flags, 1]) + body


put("fuzz_receiver", "short", packet(2, b"LC02" + bytes(4) + b"S\0hello"))
put("fuzz_receiver", "fragments", b"".join(packet(6, b"LC03" + struct.pack(">IIIHH", 1, 100, 50 * i, i, 2) + (b"" if i else b"LARGE\0") + bytes([i]) * 50) for i in (1, 0)))
put("fuzz_receiver", "giant", packet(6, b"LC03" + struct.pack(">IIIHH", 1, (1 << 28) - 1, 0, 0, 4100) + b"LARGE\0" + bytes(100)))
