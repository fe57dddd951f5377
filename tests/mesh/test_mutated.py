"""Damaged files of every format that tm-mesh reads: each run ends in time with a message, whatever a third-party library does. TM_LONG=1: 100,000
files."""
import os
import random
import re
import struct
import subprocess
import time

import dicom_seg
import numpy as np
import phantom
import pytest
from paths import BUILD, LONG
from test_fill import binary, sphere, text
from vtk_xml import Writer

pytestmark = pytest.mark.usefixtures("image_module")
CLOCK_S = 30  # no file takes longer
NUMBERS = [b"-1", b"0", b"1", b"3", b"255", b"65536", b"2000000000", b"2147483648", b"4294967295", b"18446744073709551615", b"1e308", b"-1e308", b"nan", b"inf", b"-inf", b"1e-320", b"%s%n", b""]
PLACES = [b"\0" * 4, b"\xff" * 4, b"\xff" * 8, struct.pack("<i", -1), struct.pack("<i", 2**31 - 1), struct.pack(">i", 2**31 - 1), struct.pack("<f", np.nan), struct.pack("<f", np.inf), struct.pack("<d", 1e308), b"\n", b" "]


def labels():
    image = np.zeros((8, 8, 8), "u1")
    image[1:7, 1:7, 1:7] = 1
    image[3:6, 2:5, 3:6] = 2
    return image


def indexed(triangles):
    places = sorted({p for t in triangles for p in t})
    number = {p: i for i, p in enumerate(places)}
    return places, [[number[p] for p in t] for t in triangles]


def ply(triangles):
    places, faces = indexed(triangles)
    head = "ply\nformat %s 1.0\ncomment of a test\nelement vertex %d\nproperty float x\nproperty float y\nproperty float z\nelement face %d\nproperty list uchar int vertex_indices\nend_header\n"
    yield (head % ("ascii", len(places), len(faces)) + "".join("%.6g %.6g %.6g\n" % p for p in places) + "".join("3 %d %d %d\n" % tuple(f) for f in faces)).encode()
    yield (head % ("binary_little_endian", len(places), len(faces))).encode() + b"".join(struct.pack("<3f", *p) for p in places) + b"".join(struct.pack("<B3i", 3, *f) for f in faces)


def off(triangles):
    places, faces = indexed(triangles)
    return (f"OFF\n# of a test\n{len(places)} {len(faces)} 0\n" + "".join("%.6g %.6g %.6g\n" % p for p in places) + "".join("3 %d %d %d\n" % tuple(f) for f in faces)).encode()


def obj(triangles):
    places, faces = indexed(triangles)
    return ("".join("v %.6g %.6g %.6g\n" % p for p in places) + "".join("f %d %d %d\n" % tuple(i + 1 for i in f) for f in faces)).encode()


def vtp(triangles, how):
    places, faces = indexed(triangles)
    w = Writer(how, packed=how != "ascii")
    body = "<Points>\n" + w.array("Points", places, "f4", 3) + "</Points>\n<Polys>\n" + w.array("connectivity", [v for f in faces for v in f], "i4") + w.array("offsets", [3 * i + 3 for i in range(len(faces))], "i4") + "</Polys>\n"
    return w.file("PolyData", f'NumberOfPoints="{len(places)}" NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0" NumberOfPolys="{len(faces)}"', body)


def vtu(triangles):
    places, faces = indexed(triangles)
    w = Writer("ascii")
    body = "<Points>\n" + w.array("Points", places, "f4", 3) + "</Points>\n<Cells>\n" + w.array("connectivity", [v for f in faces for v in f], "i4") + w.array("offsets", [3 * i + 3 for i in range(len(faces))], "i4") + w.array("types", [5] * len(faces), "u1") + "</Cells>\n"
    return w.file("UnstructuredGrid", f'NumberOfPoints="{len(places)}" NumberOfCells="{len(faces)}"', body)


def vtk(triangles):
    places, faces = indexed(triangles)
    return (f"# vtk DataFile Version 3.0\nof a test\nASCII\nDATASET POLYDATA\nPOINTS {len(places)} float\n" + "".join("%.6g %.6g %.6g\n" % p for p in places)
            + f"POLYGONS {len(faces)} {4 * len(faces)}\n" + "".join("3 %d %d %d\n" % tuple(f) for f in faces)).encode()


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    """Returns [(ending, bytes, bytes of the header)] of valid files: images of 8 x 8 x 8 and balls of 32 triangles."""
    folder, out, ball = tmp_path_factory.mktemp("seeds"), [], sphere(2, 20.0)
    for name in ("a.nii", "a.nii.gz", "a.nrrd", "a.mha", "a.mhd"):
        path = phantom.write(folder / name, labels(), (4, 4, 4))
        out.append((name[1:], path.read_bytes(), 352 if name == "a.nii" else 700))
    for kind in ("BINARY", "LABELMAP"):
        dicom_seg.write_dicom_seg(folder / "a.dcm", labels(), (4, 4, 4), kind=kind)
        out.append((".dcm", (folder / "a.dcm").read_bytes(), 1500))
    out += [(".ply", data, 230) for data in ply(ball)] + [(".off", off(ball), 60), (".obj", obj(ball), 2000), (".stl", text(ball).encode(), 2000), (".stl", binary(ball), 200)]
    out += [(".vtp", vtp(ball, "ascii"), 800), (".vtp", vtp(ball, "appended"), 900), (".vtu", vtu(ball), 900), (".vtk", vtk(ball), 150)]
    return out, (folder / "a.raw").read_bytes()


def mutated(dice, data, head):
    """Makes one to four changes, most of them in the header."""
    data = bytearray(data)
    for _ in range(dice.choice((1, 1, 1, 2, 4))):
        at = dice.randrange(min(head, len(data)) if dice.random() < 0.7 else len(data)) if data else 0
        what = dice.randrange(8)
        if what == 0:
            for i in range(at, min(len(data), at + dice.choice((1, 1, 4)))):
                data[i] = dice.randrange(256)
        elif what == 1:
            word = dice.choice(PLACES)
            data[at:at + len(word)] = word
        elif what == 2:
            del data[at:at + dice.choice((1, 4, 40, len(data)))]
        elif what == 3:
            data[at:at] = data[at // 2:at // 2 + dice.choice((1, 20, 200))]
        elif what == 4:
            data[at:at] = bytes([dice.choice(b"a9 \n\"\xff")]) * dice.choice((1, 90, 1100, 9000))
        elif what == 5:
            lines = bytes(data).split(b"\n")
            i = bytes(data[:at]).count(b"\n")
            lines[i:i + 1] = dice.choice(([], [lines[i]] * 2, [lines[dice.randrange(len(lines))]]))
            data = bytearray(b"\n".join(lines))
        else:
            found = [m.span() for m in re.finditer(rb"-?\d[\d.e+-]*", bytes(data[:max(head, 1)]))]
            if found:
                begin, end = dice.choice(found)
                data[begin:end] = dice.choice(NUMBERS)
    return bytes(data)


def command(path, out, dice):
    """Returns the words of tm-mesh for a file."""
    if path.suffix in (".nii", ".gz", ".nrrd", ".mha", ".mhd", ".dcm"):
        return ["image", "--size", "16mm", "--optimise", "none", "-o", str(out), str(path)]
    return ["fill", "--unit", "mm", *(["--size", "15mm"] if dice.randrange(30) else []), *(["--repair"] if dice.randrange(3) == 0 else []), "-o", str(out), str(path)]


def damaged(folder, seeds, count, seed):
    """Makes `count` damaged files in the folder; returns [(words, path)]."""
    dice, (good, raw), out = random.Random(seed), seeds, []
    (folder / "a.raw").write_bytes(raw)
    for i in range(count):
        ending, data, head = good[i % len(good)]
        path = folder / f"{i}{ending}"
        path.write_bytes(mutated(dice, data, head))
        out.append((command(path, folder / "out.msh", dice), path))
    return out


def check(code, seconds, said, path):
    """Checks that the run ended by itself and in time, and that a refusal is a sentence with the file's name and without control characters from the
    file."""
    good = code in (0, 1, 2) and seconds < CLOCK_S and (code == 0 or said.startswith(str(path)) and not re.search(r"[\x00-\x08\x0b-\x1f\x7f]", said))
    return [] if good else [(path, code, round(seconds, 1), said)]


def try_all(files):
    words = "".join("\t".join(w) + "\n" for w, _ in files)
    done = subprocess.run([BUILD / "tests/many_files", str(CLOCK_S)], input=words.encode(), capture_output=True)
    rows = [line.split("\t", 2) for line in done.stdout.decode(errors="replace").split("\n")[:-1]]
    assert done.returncode == 0 and len(rows) == len(files), done.stderr
    wrong = [bad for (code, seconds, said), (_, path) in zip(rows, files) for bad in check(int(code), float(seconds), said, path)]
    return wrong, [int(code) for code, _, _ in rows]


# Small files that once crashed a library or never ended: name, bytes, words of the message.
KNOWN = [
    ("dims.mha", b"ObjectType = Image\nNDims = 18446744073709551615\nDimSize = 8 8 8\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n" + bytes(512), "NDims 18446744073709551615, which is not a whole number"),
    ("dims2.mha", b"ObjectType = Image\nNDims = 2000000000\nDimSize = 8 8 8\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n" + bytes(512), "NDims 2000000000, which is not a whole number"),
    ("none.ply", b"ply\nformat ascii 1.0\nproperty float x\nend_header\n", "a property before any element"),
    ("space.nrrd", b"NRRD0005\ntype: uint8\ndimension: 3\nspace: " + b"x" * 9000 + b"\nsizes: 8 8 8\nencoding: raw\n\n" + bytes(512), "line 4 of its header has more than 1000 characters"),
    ("type.nrrd", b"NRRD0005\ntype: " + b"x" * 9000 + b"\ndimension: 3\nsizes: 8 8 8\nencoding: raw\n\n" + bytes(512), "line 2 of its header has more than 1000 characters"),
    ("escape.mha", b"ObjectType = Image\nNDims = \x1b[31m\x07\nDimSize = 8 8 8\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n" + bytes(512), "NDims ?[31m?, which is not a whole number"),
    ("many.mhd", b"ObjectType = Image\nNDims = 3\nDimSize = 8 8 8\nElementType = MET_UCHAR\nElementDataFile = %s%n 1 9 1\n", "its voxels are in several files"),
]


@pytest.mark.parametrize("name, data, said", KNOWN, ids=[k[0] for k in KNOWN])
def test_known_files_are_refused(tmp_path, bin, name, data, said):
    path = tmp_path / name
    path.write_bytes(data)
    done = subprocess.run([bin / "tm-mesh", *command(path, tmp_path / "out.msh", random.Random(0))], capture_output=True, text=True, timeout=CLOCK_S)
    assert done.returncode == 2 and said in done.stderr and done.stderr.startswith(str(path)), (done.returncode, done.stderr)


@pytest.mark.parametrize("bad", ["nan", "inf", "-inf", "1e300"])
def test_non_finite_vertices_are_refused(tmp_path, bin, bad):
    for ending, data in ((".ply", next(ply(sphere(2, 20.0)))), (".off", off(sphere(2, 20.0))), (".obj", obj(sphere(2, 20.0))), (".stl", text(sphere(2, 20.0)).encode()), (".vtp", vtp(sphere(2, 20.0), "ascii"))):
        path = tmp_path / f"a{ending}"
        path.write_bytes(data.replace(b"-20", bad.encode()))
        done = subprocess.run([bin / "tm-mesh", "fill", "--unit", "mm", path, "-o", tmp_path / "out.msh"], capture_output=True, text=True, timeout=CLOCK_S)
        assert done.returncode == 2 and done.stderr.startswith(str(path)), (ending, done.returncode, done.stderr)


def waiting(folder):
    """An image whose voxels never arrive: its reader waits indefinitely."""
    path = phantom.write(folder / "a.mhd", labels(), (4, 4, 4))
    path.with_suffix(".raw").unlink()
    os.mkfifo(path.with_suffix(".raw"))
    return path


def test_the_first_signal_ends_a_reader(tmp_path, bin):
    path, children = waiting(tmp_path), lambda pid: subprocess.run(["pgrep", "-P", str(pid)], capture_output=True, text=True).stdout.split()
    process = subprocess.Popen([bin / "tm-mesh", "image", path, "-o", tmp_path / "out.msh"], stderr=subprocess.PIPE)
    end = time.monotonic() + 10
    while not children(process.pid) and time.monotonic() < end:
        time.sleep(0.05)
    time.sleep(0.5)  # it is inside the reader
    (child,) = children(process.pid)
    process.terminate()
    process.communicate(timeout=5)
    assert process.returncode == 143 and not os.path.exists(f"/proc/{child}"), process.returncode


def test_a_reader_that_waits_is_ended_by_the_clock(tmp_path, bin):
    path = waiting(tmp_path)
    done = subprocess.run([bin / "tm-mesh", "image", path, "-o", tmp_path / "out.msh"], capture_output=True, text=True, timeout=CLOCK_S)
    assert done.returncode == 2 and "did not finish within" in done.stderr and done.stderr.startswith(str(path)), done.stderr


def test_good_files_are_read(tmp_path, seeds):
    """The undamaged forms of the files below are accepted."""
    (tmp_path / "a.raw").write_bytes(seeds[1])
    files = []
    for i, (ending, data, _) in enumerate(seeds[0]):
        (tmp_path / f"{i}{ending}").write_bytes(data)
        files.append((command(tmp_path / f"{i}{ending}", tmp_path / "out.msh", random.Random(0)), tmp_path / f"{i}{ending}"))
    wrong, codes = try_all(files)
    assert not wrong and not any(codes), codes


def test_damaged_files_end_with_a_sentence(tmp_path, seeds):
    batches, seed, count = (100, 1, 1000) if LONG else (1, 1, 240)
    refused = 0
    for batch in range(batches):
        folder = tmp_path / "batch"
        folder.mkdir()
        files = damaged(folder, seeds, count, seed + batch)
        wrong, codes = try_all(files)
        assert not wrong, wrong
        refused += sum(code == 2 for code in codes)
        for path in folder.iterdir():
            path.unlink()
        folder.rmdir()
    assert 0.3 < refused / (count * batches) < 0.99, "mutations are too mild, or nothing is read"


def test_complete_program_gives_the_same_message(tmp_path, seeds, bin):
    """Some damaged files with tm-mesh itself, from its start."""
    for words, path in damaged(tmp_path, seeds, 50, 7):
        began = time.monotonic()
        done = subprocess.run([bin / "tm-mesh", *words], capture_output=True, text=True, errors="replace", timeout=2 * CLOCK_S)
        assert not check(done.returncode, time.monotonic() - began, done.stderr, path), (done.returncode, done.stderr)
