"""tm-mesh fill: closed surfaces become tetrahedra of the same volume and good shape, nested ones become regions; open ones are reported, and repaired on
request."""
import json
import math
import os
import re
import resource
import struct
import subprocess

import meshlib
import pytest
from paths import LONG


def sphere(n, radius=1.0):
    """Makes a sphere: an octahedron with n x n triangles per face, projected outward. Outward triangles."""
    out = []
    for sx in (1, -1):
        for sy in (1, -1):
            for sz in (1, -1):
                def at(i, j):
                    p = (sx * i, sy * j, sz * (n - i - j))
                    r = math.sqrt(sum(x * x for x in p)) / radius
                    return tuple(x / r for x in p)
                for i in range(n):
                    for j in range(n - i):
                        faces = [(at(i, j), at(i + 1, j), at(i, j + 1))]
                        if i + j < n - 1:
                            faces.append((at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)))
                        out += [f if sx * sy * sz > 0 else (f[0], f[2], f[1]) for f in faces]
    return out


def text(triangles):
    return "solid x\n" + "".join(
        "facet normal 0 0 0\nouter loop\n" + "".join("vertex %.9g %.9g %.9g\n" % p for p in t) + "endloop\nendfacet\n" for t in triangles) + "endsolid x\n"


def binary(triangles):
    return b"\0" * 80 + struct.pack("<I", len(triangles)) + b"".join(
        struct.pack("<3f", 0, 0, 0) + b"".join(struct.pack("<3f", *p) for p in t) + b"\0\0" for t in triangles)


def figures(tm_mesh, path, env, tmp_path):
    result = meshlib.run(tm_mesh, "info", path, "--json", tmp_path / "f.json", env=env)
    assert result.returncode == 0, result.stderr
    return json.loads((tmp_path / "f.json").read_text())


@pytest.mark.parametrize("write_format", [text, binary])
@pytest.mark.parametrize("inside_out", [False, True])
def test_sphere_is_filled_with_its_volume(write_format, inside_out, tm_mesh, env, tmp_path):
    triangles = sphere(12, 50)
    if inside_out:
        triangles = [(a, c, b) for a, b, c in triangles]
    stl, out = tmp_path / "s.stl", tmp_path / "s.msh"
    contents = write_format(triangles)
    stl.write_bytes(contents if isinstance(contents, bytes) else contents.encode())
    result = meshlib.run(tm_mesh, "fill", "--size", "12 mm", "--scale", "1e-3", stl, "-o", out, env=env)
    assert result.returncode == 0, result.stderr
    f = figures(tm_mesh, out, env, tmp_path)
    assert f["volume_m3"] == pytest.approx(4 / 3 * math.pi * 0.05**3, rel=0.03)
    assert f["pieces"] == 1 and f["critical_step"]["worst_over_median"] > 0.6 and f["smallest_dihedral_deg"] > 18
    assert {g["name"] for g in f["groups"]} == {"surface", "tissue"} and [r["name"] for r in f["regions"]] == ["tissue"]
    points, cells = vtk_of(tm_mesh, out, env, tmp_path)
    count = {}
    for c in cells:
        for k in range(4):
            face = tuple(sorted(c[:k] + c[k + 1:]))
            count[face] = count.get(face, 0) + 1
    skin = {v for face, n in count.items() if n == 1 for v in face}
    assert all(0.0485 < math.dist(points[v], (0, 0, 0)) < 0.0501 for v in skin), "a vertex of the skin is not on the sphere's facets"


def vtk_of(tm_mesh, path, env, tmp_path):
    assert meshlib.run(tm_mesh, "convert", path, "-o", tmp_path / "v.vtk", env=env).returncode == 0
    return meshlib.read_vtk(tmp_path / "v.vtk")


@pytest.mark.parametrize("name,what", [("s.vtp", "it has no <VTKFile> element; save it again"), ("s.xyz", "unknown type of surface file"), ("s.stl", "neither text nor binary")])
def test_other_file_types_are_named(name, what, tm_mesh, env, tmp_path):
    (tmp_path / name).write_text("ply\nformat ascii 1.0\n")
    result = meshlib.run(tm_mesh, "fill", "--size", "5mm", "--unit", "mm", tmp_path / name, "-o", tmp_path / "out.msh", env=env)
    assert result.returncode == 2 and what in result.stderr


def test_make_tests_renews_a_stale_module(root, tmp_path):
    """`make tests` renews a stale module `image`, and requires none if none was built. A stale one had another interface, and test_mutated hung."""
    (tmp_path / "lib/tensormass").mkdir(parents=True)
    stale, told = tmp_path / "lib/tensormass/image.so", []
    own = {k: v for k, v in os.environ.items() if not k.startswith("MAKE") and k != "MFLAGS"}
    for _ in range(2):
        told.append(subprocess.run(["make", "-n", "-C", root, f"BUILD={tmp_path}", "tests"], env=own, capture_output=True, text=True, timeout=100).stdout)
        stale.touch()
        os.utime(stale, (1e9, 1e9))
    assert [f"-o {stale}" in text for text in told] == [False, True]


def test_missing_unit_is_an_error(tm_mesh, env, tmp_path):
    (tmp_path / "s.stl").write_text(text(sphere(4)))
    for words, what in ([], "give --unit mm"), (["--unit", "parsec"], "m, cm, mm"), (["--unit", "mm", "--scale", "1"], "give one"), (["--scale", "0"], "above 0"):
        result = meshlib.run(tm_mesh, "fill", "--size", "0.3", *words, tmp_path / "s.stl", "-o", tmp_path / "out.msh", env=env)
        assert result.returncode == 2 and what in result.stderr


def indexed(triangles):
    points = sorted({tuple(round(x, 9) for x in p) for t in triangles for p in t})
    number = {p: i for i, p in enumerate(points)}
    return points, [[number[tuple(round(x, 9) for x in p)] for p in t] for t in triangles]


def write_surface(path, triangles):
    """Writes the file type of the ending; .ply binary."""
    points, faces = indexed(triangles)
    if path.suffix == ".stl":
        path.write_text(text(triangles))
    elif path.suffix == ".obj":
        path.write_text("# an organ\no liver\n" + "".join("v %.9g %.9g %.9g\n" % p for p in points) + "".join("f %d %d %d\n" % tuple(i + 1 for i in f) for f in faces))
    elif path.suffix == ".off":
        path.write_text("OFF\n%d %d 0\n" % (len(points), len(faces)) + "".join("%.9g %.9g %.9g\n" % p for p in points) + "".join("3 %d %d %d\n" % tuple(f) for f in faces))
    else:
        head = "ply\nformat binary_little_endian 1.0\nelement vertex %d\nproperty double x\nproperty double y\nproperty double z\nelement face %d\nproperty list uchar int vertex_indices\nend_header\n"
        path.write_bytes((head % (len(points), len(faces))).encode() + b"".join(struct.pack("<3d", *p) for p in points) + b"".join(struct.pack("<B3i", 3, *f) for f in faces))
    return path


def moved(triangles, by):
    return [tuple(tuple(x + d for x, d in zip(p, by)) for p in t) for t in triangles]


@pytest.mark.parametrize("ending", [".stl", ".obj", ".ply", ".off"])
def test_every_kind_gives_the_same_volume(ending, image_module, tm_mesh, env, tmp_path):
    path = write_surface(tmp_path / ("s" + ending), sphere(8, 50))
    result = meshlib.run(tm_mesh, "fill", "--size", "20 mm", "--unit", "mm", path, "-o", tmp_path / "s.msh", env=env)
    assert result.returncode == 0, result.stderr
    assert figures(tm_mesh, tmp_path / "s.msh", env, tmp_path)["volume_m3"] == pytest.approx(ball_m3(50, 8), rel=0.06)


@pytest.mark.parametrize("name,contents", [("a.obj", "v 0 0 0\nf 1 2 3\n"), ("b.obj", "v 0 0 0\n"), ("c.ply", "ply\nformat ascii 1.0\nelement vertex 999999999999\nend_header\n"), ("d.off", "OFF\n3 1 0\n0 0 0\n")])
def test_damaged_surfaces_are_reported(name, contents, image_module, tm_mesh, env, tmp_path):
    (tmp_path / name).write_text(contents)
    result = meshlib.run(tm_mesh, "fill", "--size", "5mm", "--unit", "mm", tmp_path / name, "-o", tmp_path / "out.msh", env=env)
    assert result.returncode in (1, 2) and result.stderr.startswith(f"{tmp_path / name}: ") and "; " in result.stderr and not list(tmp_path.glob("out*"))


def test_holes_and_crossings_are_named_and_repaired(image_module, tm_mesh, env, tmp_path):
    ball = sphere(8, 50)
    pushed = [tuple(tuple(-1.3 * x for x in p) if math.dist(p, (0, 0, 50)) < 1e-6 else p for p in t) for t in ball]  # the pole, through the opposite side
    for name, triangles, what in ("hole", ball[:20] + ball[21:], r"1 hole, the largest of 3 edges near"), ("cross", pushed, r"\d+ pairs of triangles that intersect"), (
            "turned", [ball[5][::-1]] + ball[:5] + ball[6:], None):
        path = write_surface(tmp_path / f"{name}.obj", triangles)
        words = ["--size", "20 mm", "--unit", "mm", path, "-o", tmp_path / f"{name}.msh"]
        refused = meshlib.run(tm_mesh, "fill", *words, env=env)
        assert refused.returncode == 2 and re.search(what or "not closed", refused.stderr) and "--repair" in refused.stderr, refused.stderr
        repaired = meshlib.run(tm_mesh, "fill", "--repair", *words, env=env)
        assert repaired.returncode == 0 and (not what or re.search("repaired: " + what, repaired.stderr)), repaired.stderr
        assert figures(tm_mesh, tmp_path / f"{name}.msh", env, tmp_path)["volume_m3"] == pytest.approx(ball_m3(50, 8), rel=0.1)


def ball_m3(radius_mm, n):
    """Returns the volume of sphere(n, radius_mm)."""
    return sum(a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0]) for a, b, c in sphere(n, radius_mm)) / 6e9


def test_surfaces_in_surfaces_become_regions(image_module, tm_mesh, env, tmp_path):
    """Two files and a cavity: an organ with a cavity, a tumour in the remainder; common faces are shared."""
    hollow = [t[::-1] for t in moved(sphere(6, 12), (-24, 0, 0))]
    liver = write_surface(tmp_path / "liver.stl", sphere(12, 50) + hollow)
    tumour = write_surface(tmp_path / "tumour.ply", moved(sphere(8, 15), (20, 0, 0)))
    out = tmp_path / "organ.msh"
    result = meshlib.run(tm_mesh, "fill", "--size", "18mm", "--unit", "mm", tumour, liver, "-o", out, env=env)
    assert result.returncode == 0, result.stderr
    f = figures(tm_mesh, out, env, tmp_path)
    volume = {r["name"]: r["volume_m3"] for r in f["regions"]}
    assert volume["tumour"] == pytest.approx(ball_m3(15, 8), rel=0.1)
    assert volume["liver"] == pytest.approx(ball_m3(50, 12) - ball_m3(15, 8) - ball_m3(12, 6), rel=0.04)
    assert f["pieces"] == 1 and f["smallest_dihedral_deg"] > 5
    assert {g["name"] for g in f["groups"]} >= {"surface", "liver_outer"}
    assert meshlib.run(tm_mesh, "check", out, env=env).returncode == 0


def test_one_file_of_nested_surfaces(image_module, tm_mesh, env, tmp_path):
    path = write_surface(tmp_path / "both.obj", sphere(10, 50) + moved(sphere(6, 20), (10, 0, 0)))
    result = meshlib.run(tm_mesh, "fill", "--size", "18mm", "--unit", "mm", path, "-o", tmp_path / "o.msh", env=env)
    assert result.returncode == 0, result.stderr
    volume = {r["name"]: r["volume_m3"] for r in figures(tm_mesh, tmp_path / "o.msh", env, tmp_path)["regions"]}
    assert set(volume) == {"tissue", "inside_1"} and volume["inside_1"] == pytest.approx(ball_m3(20, 6), rel=0.1)


@pytest.mark.parametrize("name,contents,args,expected", [
    ("hole", text(sphere(4)[1:]), [], "not closed: 3 edges.*triangle|1 hole, the largest of 3 edges"),
    ("turned", text([sphere(4)[0][::-1]] + sphere(4)[1:]), [], "not closed"),
    ("empty", "", [], "neither text nor binary"),
    ("words", "hello\n", [], "neither text nor binary"),
    ("no triangles", "solid x\nendsolid x\n", [], "no triangles"),
    ("letters", text(sphere(4)).replace("vertex 0 1 0", "vertex zero 1 0", 1), [], r"line \d+: 'vertex'"),
    ("nan", text(sphere(4)).replace("vertex 0 1 0", "vertex nan 1 0", 1), [], r"triangle \d+ .*nan"),
    ("cut short", binary(sphere(4))[:-7], [], "neither text nor binary"),
    ("too coarse", text(sphere(4)), ["--size", "2 m"], "smaller --size"),
    ("too fine", text(sphere(4)), ["--size", "1 mm"], "larger --size"),
])
def test_bad_surface_is_refused(name, contents, args, expected, tm_mesh, env, tmp_path):
    stl, out = tmp_path / "s.stl", tmp_path / "out.msh"
    stl.write_bytes(contents if isinstance(contents, bytes) else contents.encode())
    result = meshlib.run(tm_mesh, "fill", *(args or ["--size", "0.3"]), "--unit", "m", stl, "-o", out, env=env)
    assert result.returncode == 2 and result.stdout == ""
    assert result.stderr.startswith(f"{stl}: ") and re.search(expected, result.stderr) and "; " in result.stderr
    assert not list(tmp_path.glob("out*"))


def test_exhausted_memory_is_reported(tm_mesh, env, build, tmp_path):
    """For any amount of memory: a complete file, or exit 1 with a reason and no file."""
    if build.name in ("asan", "tsan", "debug"):
        pytest.skip("sanitizers reserve address space of their own")
    stl = tmp_path / "s.stl"
    stl.write_text(text(sphere(16)))
    seen = set()
    for megabytes in (6, 8, 10, 12, 16, 24, 40, 400) if LONG else (6, 8, 10, 400):
        out = tmp_path / f"{megabytes}.msh"
        limit = megabytes << 20
        result = subprocess.run([tm_mesh, "fill", "--size", "0.16", "--unit", "m", stl, "-o", out], env=env, capture_output=True, text=True, timeout=300,
                                preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)))
        if result.returncode == 127:
            continue  # the loader itself had no memory
        assert result.returncode in (0, 1), (megabytes, result.returncode, result.stderr)
        assert out.exists() == (result.returncode == 0)
        assert result.returncode == 0 or "no memory" in result.stderr, (megabytes, result.stderr)
        seen.add(result.returncode)
    assert seen == {0, 1}, "all runs ended alike: other limits are needed"
