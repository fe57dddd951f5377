"""Good meshes in every format give the same model; the cache gives the same without opening Gmsh."""
import json
import os
import random
import re
import shutil
import subprocess

import meshlib
import pytest

FORMATS = {
    "2.2.msh": meshlib.msh2, "2.2b.msh": meshlib.msh2_binary, "4.1.msh": meshlib.msh4, "4.1b.msh": meshlib.msh4_binary,
    "plain.vtk": meshlib.vtk, "5.1.vtk": meshlib.vtk5, "5.1b.vtk": meshlib.vtk5_binary,
    "5.1f.vtk": lambda m: meshlib.vtk5_binary(m, "float", "vtktypeint32"), "5.1c.vtk": lambda m: meshlib.vtk5(m).replace("\n", "\r\n"),
    "plain.mesh": meshlib.medit,
}


def write(path, contents):
    path.write_bytes(contents if isinstance(contents, bytes) else contents.encode())
    return path


def named_block():
    """Two regions, and groups of dimension 0, 1 and 2; one name stands for a surface and a point."""
    m = meshlib.block()
    m.region = [1 if t < 24 else 2 for t in range(48)]
    m.surface = [((0, 4, 1), 5), ((0, 3, 4), 5)]
    m.lines = [((0, 1), 7), ((1, 2), 7)]
    m.dots = [(26, 9), (8, 11)]
    m.names = {(3, 1): "lower part", (3, 2): "upper", (2, 5): "clamp", (1, 7): "edge", (0, 9): "clamp"}
    return m


def info(tm_mesh, path, env, *args):
    figures = path.parent / "figures.json"
    result = meshlib.run(tm_mesh, "info", path, "--json", figures, *args, env=env)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    return json.loads(figures.read_text()), result.stdout


@pytest.mark.parametrize("name", FORMATS)
def test_formats(name, tm_mesh, env, tmp_path):
    figures, text = info(tm_mesh, write(tmp_path / name, FORMATS[name](named_block())), env)
    assert (figures["tets"], figures["vertices"], figures["surface_triangles"], figures["pieces"]) == (48, 27, 48, 1)
    assert figures["volume_m3"] == pytest.approx(1e-3, rel=1e-6 if "f.vtk" in name else 1e-12)
    assert figures["low_m"] == [0, 0, 0] and figures["high_m"] == pytest.approx([0.1] * 3, abs=1e-8 if "f.vtk" in name else 0)
    if name.endswith(".msh"):
        assert {r["name"]: r["tets"] for r in figures["regions"]} == {"lower part": 24, "upper": 24}
        groups = {g["name"]: g["vertices"] for g in figures["groups"]}
        # 0 1 3 4 and the point 26; the line 0 1 2; the nameless point 8; each region's own vertices
        assert groups == {"clamp": 5, "edge": 3, "point_11": 1, "lower part": 18, "upper": 18}
    else:
        assert len(figures["regions"]) == 1


WAYS = {
    "CRLF": lambda t: t.replace("\n", "\r\n"),
    "tabs": lambda t: t.replace(" ", "\t").replace("lower\tpart", "lower part"),
    "comments": lambda t: t.replace("$Nodes", "$Comments\nmade\nby hand\n$EndComments\n$Nodes", 1),
    "no last newline": lambda t: t[:-1],
}


# Gmsh itself does not read 4.1 with tabs
@pytest.mark.parametrize("write_format,way", [(f, w) for f in (meshlib.msh2, meshlib.msh4) for w in WAYS if (f, w) != (meshlib.msh4, "tabs")])
def test_ways_of_writing(write_format, way, tm_mesh, env, tmp_path):
    figures, _ = info(tm_mesh, write(tmp_path / "b.msh", WAYS[way](write_format(named_block()))), env)
    assert figures["tets"] == 48 and {r["name"] for r in figures["regions"]} == {"lower part", "upper"}


def test_scale(tm_mesh, env, tmp_path):
    path = write(tmp_path / "b.msh", meshlib.msh2(meshlib.block()))
    figures, _ = info(tm_mesh, path, env, "--scale", "1e-3")
    assert figures["high_m"] == pytest.approx([1e-4] * 3) and figures["volume_m3"] == pytest.approx(1e-12)
    for bad in ("0", "-1", "nan", "much", "1 mm"):
        result = meshlib.run(tm_mesh, "info", path, "--scale", bad, env=env)
        assert result.returncode == 2 and "scale" in result.stderr


@pytest.mark.parametrize("name", ["2.2.msh", "4.1.msh", "2.2b.msh", "4.1b.msh"])
def test_order_of_the_file_is_kept(name, tm_mesh, env, tmp_path):
    """Tags in no order at all: vertices and tetrahedra still count in file order, as fibre and result files do."""
    m = meshlib.block()
    dice = random.Random(3)
    m.vertex_tag = dice.sample(range(1, 500), len(m.points))
    m.tet_tag = dice.sample(range(1, 500), len(m.tets))
    out = tmp_path / "out.vtk"
    result = meshlib.run(tm_mesh, "convert", write(tmp_path / name, FORMATS[name](m)), "-o", out, env=env)
    assert result.returncode == 0, result.stderr
    points, cells = meshlib.read_vtk(out)
    assert points == [tuple(p) for p in m.points]
    assert cells == [tuple(t) for t in m.tets]


def test_messages_name_the_tags_of_the_file(tm_mesh, env, tmp_path):
    m = meshlib.block()
    m.vertex_tag = [1000 + 3 * i for i in range(27)]
    m.tet_tag = [5000 - 7 * i for i in range(48)]
    t = m.tets[20]
    t[0], t[1] = t[1], t[0]
    result = meshlib.run(tm_mesh, "check", write(tmp_path / "b.msh", meshlib.msh2(m)), env=env)
    assert f"tetrahedron {5000 - 140} (vertices {' '.join(str(1000 + 3 * v) for v in t)}) is inverted" in result.stderr


def opened(command, env):
    """Files that a run and its children opened."""
    env = dict(env, ASAN_OPTIONS="detect_leaks=0")  # LeakSanitizer does not work under strace
    result = subprocess.run(["strace", "-f", "-e", "trace=openat", "-o", "/dev/stdout", *map(str, command)], env=env, capture_output=True, text=True,
                            timeout=120)
    assert result.returncode == 0, result.stderr
    return re.findall(r'"([^"]+)", [^)]*\) = \d', result.stdout)


@pytest.mark.skipif(not shutil.which("strace"), reason="strace is not installed")
def test_cached_mesh_opens_no_gmsh(tm_mesh, env, tmp_path, root):
    command = [tm_mesh, "check", root / "meshes" / "liver_1k.msh"]
    first, second = opened(command, env), opened(command, env)
    assert any("libgmsh" in f for f in first), "the test would see nothing"
    assert any(f.endswith(".tmmesh") for f in second)
    assert not [f for f in second if "gmsh" in f.rsplit("/", 1)[-1]]


def test_reading_leaves_nothing_in_the_home_folder(tm_mesh, env, tmp_path, root):
    """Gmsh brings FLTK, which would write preferences there."""
    env["HOME"] = str(tmp_path / "home")
    assert meshlib.run(tm_mesh, "check", root / "meshes" / "liver_1k.msh", env=env).returncode == 0
    assert not (tmp_path / "home").exists()


def test_damaged_cache_is_rebuilt(tm_mesh, env, tmp_path):
    path = write(tmp_path / "b.msh", meshlib.msh2(named_block()))
    good, text = info(tm_mesh, path, env)
    (cache,) = (tmp_path / "cache").iterdir()
    whole = cache.read_bytes()
    other = bytearray(whole)
    other[len(whole) // 2] ^= 4
    for damaged in (b"", whole[:30], whole[:-1], whole + b"x", bytes(other), b"x" * len(whole)):
        cache.write_bytes(damaged)
        assert info(tm_mesh, path, env)[1] == text
        assert cache.read_bytes() == whole
    (tmp_path / "cache" / "0000000000000000.tmmesh").write_bytes(whole)
    assert info(tm_mesh, path, env)[1] == text


def test_cache_knows_contents_scale_and_format(tm_mesh, env, tmp_path):
    path = write(tmp_path / "b.msh", meshlib.msh2(meshlib.block(2)))
    assert info(tm_mesh, path, env)[0]["tets"] == 48
    write(path, meshlib.msh2(meshlib.block(3)))
    assert info(tm_mesh, path, env)[0]["tets"] == 162
    assert info(tm_mesh, path, env, "--scale", "2")[0]["high_m"] == pytest.approx([0.2] * 3)
    assert len(list((tmp_path / "cache").iterdir())) == 3


@pytest.mark.parametrize("folder", ["/proc/nowhere", "/dev/null/x", "{file}/sub"])
def test_works_without_a_cache(folder, tm_mesh, env, tmp_path):
    path = write(tmp_path / "b.msh", meshlib.msh2(meshlib.block()))
    env["TM_CACHE_DIR"] = folder.format(file=path)
    for _ in range(2):
        assert info(tm_mesh, path, env)[0]["tets"] == 48


def test_traps_in_the_cache(tm_mesh, env, tmp_path):
    """A FIFO where the file should be holds nobody up; a link laid for the temporary file is not followed."""
    path = write(tmp_path / "b.msh", meshlib.msh2(meshlib.block()))
    text = info(tm_mesh, path, env)[1]
    (cache,) = (tmp_path / "cache").iterdir()
    cache.unlink()
    os.mkfifo(cache)
    assert info(tm_mesh, path, env)[1] == text
    assert cache.is_file()
    cache.unlink()
    letters = write(tmp_path / "letters", "somebody's")
    lay = f'ln -s {letters} {cache}.$$~; exec "$0" "$@"'  # the shell's number is the program's
    subprocess.run(["sh", "-c", lay, str(tm_mesh), "check", str(path)], env=env, check=True, timeout=60)
    assert cache.is_file()
    assert letters.read_text() == "somebody's"


def test_cache_falls_back_to_home(tm_mesh, env, tmp_path):
    path = write(tmp_path / "b.msh", meshlib.msh2(meshlib.block()))
    del env["TM_CACHE_DIR"]
    env.pop("XDG_CACHE_HOME", None)
    env["HOME"] = str(tmp_path / "home")
    info(tm_mesh, path, env)
    assert len(list((tmp_path / "home" / ".cache" / "tensormass").iterdir())) == 1
    env["XDG_CACHE_HOME"] = str(tmp_path / "xdg")
    info(tm_mesh, path, env)
    assert len(list((tmp_path / "xdg" / "tensormass").iterdir())) == 1


def test_names_of_paths_are_no_script(tm_mesh, env, tmp_path):
    path = write(tmp_path / "a b;$(touch owned) 'é\".msh", meshlib.msh2(meshlib.block()))
    assert info(tm_mesh, path, env)[0]["tets"] == 48
