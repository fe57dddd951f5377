"""tm-mesh fill: a closed STL becomes tetrahedra of its volume and good shape; any other surface is refused."""
import json
import math
import re
import resource
import struct
import subprocess

import meshlib
import pytest


def sphere(n, radius=1.0):
    """An octahedron, each face n x n, pushed onto the sphere. Outward triangles."""
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
def test_sphere(write_format, inside_out, tm_mesh, env, tmp_path):
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


@pytest.mark.parametrize("name,contents,what", [("s.obj", "v 0 0 0\n", "an OBJ surface"), ("s.ply", "ply\nformat ascii 1.0\n", "a PLY surface"),
                                                ("s.vtk", "# vtk DataFile Version 5.1\n", "a VTK file"), ("s.stl", "ply\nformat ascii 1.0\n", "a PLY surface")])
def test_other_surfaces_are_named(name, contents, what, tm_mesh, env, tmp_path):
    (tmp_path / name).write_text(contents)
    result = meshlib.run(tm_mesh, "fill", "--size", "5mm", tmp_path / name, "-o", tmp_path / "out.msh", env=env)
    assert result.returncode == 2 and f"{what}; fill reads STL alone: save the surface as STL" in result.stderr


@pytest.mark.parametrize("name,contents,args,expected", [
    ("hole", text(sphere(4)[1:]), [], "not closed: 3 edges.*triangle"),
    ("turned", text([sphere(4)[0][::-1]] + sphere(4)[1:]), [], "not closed"),
    ("empty", "", [], "neither text nor binary"),
    ("words", "hello\n", [], "neither text nor binary"),
    ("no triangles", "solid x\nendsolid x\n", [], "no triangles"),
    ("letters", text(sphere(4)).replace("vertex 0 1 0", "vertex zero 1 0", 1), [], r"line \d+: vertex"),
    ("nan", text(sphere(4)).replace("vertex 0 1 0", "vertex nan 1 0", 1), [], r"triangle \d+ .*nan"),
    ("cut short", binary(sphere(4))[:-7], [], "neither text nor binary"),
    ("too coarse", text(sphere(4)), ["--size", "2 m"], "smaller --size"),
    ("too fine", text(sphere(4)), ["--size", "1 mm"], "larger --size"),
])
def test_refused(name, contents, args, expected, tm_mesh, env, tmp_path):
    stl, out = tmp_path / "s.stl", tmp_path / "out.msh"
    stl.write_bytes(contents if isinstance(contents, bytes) else contents.encode())
    result = meshlib.run(tm_mesh, "fill", *(args or ["--size", "0.3"]), stl, "-o", out, env=env)
    assert result.returncode == 2 and result.stdout == ""
    assert result.stderr.startswith(f"{stl}: ") and re.search(expected, result.stderr) and "; " in result.stderr
    assert not list(tmp_path.glob("out*"))


def test_no_memory_is_told(tm_mesh, env, build, tmp_path):
    """Whatever room there is: a whole file, or exit 1 with a reason and none."""
    if build.name in ("asan", "tsan", "debug"):
        pytest.skip("sanitizers reserve address space of their own")
    stl = tmp_path / "s.stl"
    stl.write_text(text(sphere(16)))
    seen = set()
    for megabytes in (6, 8, 10, 12, 14, 16, 20, 24, 28, 32, 40, 64, 400):
        out = tmp_path / f"{megabytes}.msh"
        limit = megabytes << 20
        result = subprocess.run([tm_mesh, "fill", "--size", "0.12", stl, "-o", out], env=env, capture_output=True, text=True, timeout=60,
                                preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)))
        if result.returncode == 127:
            continue  # the loader itself had no room
        assert result.returncode in (0, 1), (megabytes, result.returncode, result.stderr)
        assert out.exists() == (result.returncode == 0)
        assert result.returncode == 0 or "no memory" in result.stderr, (megabytes, result.stderr)
        seen.add(result.returncode)
    assert seen == {0, 1}, "all runs ended alike: other limits are needed"
