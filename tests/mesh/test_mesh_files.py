"""Valid meshes in every format give the same model."""
import json
import random

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
    """Two regions, and groups of dimension 0, 1 and 2; one name denotes a surface and a point."""
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
def test_formats_give_the_same_model(name, tm_mesh, env, tmp_path):
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


@pytest.mark.parametrize("write_format", [meshlib.msh2, meshlib.msh4])
@pytest.mark.parametrize("way", WAYS)
def test_variants_of_a_format_give_the_same_model(write_format, way, tm_mesh, env, tmp_path):
    figures, _ = info(tm_mesh, write(tmp_path / "b.msh", WAYS[way](write_format(named_block()))), env)
    assert figures["tets"] == 48 and {r["name"] for r in figures["regions"]} == {"lower part", "upper"}


def test_unit_scales_the_mesh(tm_mesh, env, tmp_path):
    path = write(tmp_path / "b.msh", meshlib.msh2(meshlib.block()))
    figures, _ = info(tm_mesh, path, env, "--scale", "1e-3")
    assert figures["high_m"] == pytest.approx([1e-4] * 3) and figures["volume_m3"] == pytest.approx(1e-12)
    assert info(tm_mesh, path, env, "--unit", "mm")[0]["high_m"] == figures["high_m"]
    for more, says in ((["--unit", "mile"], "give m, cm, mm, um or inch"), (["--unit", "mm", "--scale", "1"], "give one")):
        result = meshlib.run(tm_mesh, "info", path, *more, env=env)
        assert result.returncode == 2 and says in result.stderr
    for bad in ("0", "-1", "nan", "much", "1 mm"):
        result = meshlib.run(tm_mesh, "info", path, "--scale", bad, env=env)
        assert result.returncode == 2 and "scale" in result.stderr


@pytest.mark.parametrize("name", ["2.2.msh", "4.1.msh", "2.2b.msh", "4.1b.msh"])
def test_a_region_without_tetrahedra_is_told(name, tm_mesh, env, tmp_path):
    path = write(tmp_path / name, FORMATS[name](named_block()))
    figures, text = info(tm_mesh, path, env)
    assert figures["regions_without_tetrahedra"] == [] and "no tetrahedra" not in text
    head, names = path.read_bytes().split(b"$PhysicalNames\n")
    count, names = names.split(b"\n", 1)
    path.write_bytes(head + b'$PhysicalNames\n%d\n3 77 "lost vein"\n' % (int(count) + 1) + names)
    figures, text = info(tm_mesh, path, env)
    assert figures["regions_without_tetrahedra"] == ["lost vein"] and len(figures["regions"]) == 2
    assert "note: region 'lost vein' has a name and no tetrahedra" in text


@pytest.mark.parametrize("name", ["2.2.msh", "4.1.msh", "2.2b.msh", "4.1b.msh"])
def test_order_of_the_file_is_kept(name, tm_mesh, env, tmp_path):
    """Unordered tags: vertices and tetrahedra still count in file order, as fibre and result files do."""
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


def partitioned(m, write_format):
    """The volume as entity 7, a part of entity 1; a ghost entity; and vertices with a parameter on their curve."""
    text = write_format(m)
    at, end = text.index("$Entities"), text.index("$Nodes")
    parts = "$PartitionedEntities\n2\n1\n8 2\n0 0 0 1\n7 3 1 1 1 0 0 0 1 1 1 1 1 2 -5 6\n$EndPartitionedEntities\n"
    return (text[:at] + "$Entities\n0 0 0 0\n$EndEntities\n" + parts + text[end:]).replace("\n3 1 4 48\n", "\n3 7 4 48\n")


def test_partitioned_mesh_is_read(tm_mesh, env, tmp_path):
    m = meshlib.block()
    m.names = {(3, 1): "whole"}
    figures, _ = info(tm_mesh, write(tmp_path / "p.msh", partitioned(m, meshlib.msh4)), env)
    assert [(r["name"], r["tets"]) for r in figures["regions"]] == [("whole", 48)]


def test_a_volume_in_two_groups_belongs_to_the_first(tm_mesh, env, tmp_path):
    """The volume also belongs to both groups of vertices; volumes in no group are a region without a name."""
    m = meshlib.block()
    m.region = [3 if t < 24 else 4 for t in range(48)]
    m.names = {(3, 9): "first", (3, 11): "second"}
    text = meshlib.msh4(m)
    text = text.replace("3 0 0 0 1 1 1 1 3 0", "3 0 0 0 1 1 1 2 11 -9 0").replace("4 0 0 0 1 1 1 1 4 0", "4 0 0 0 1 1 1 0 0")
    figures, _ = info(tm_mesh, write(tmp_path / "p.msh", text), env)
    assert [(r["name"], r["tets"]) for r in figures["regions"]] == [("first", 24), ("second", 0), ("", 24)]
    assert {g["name"]: g["vertices"] for g in figures["groups"]} == {"first": 18, "second": 18}


def test_groups_that_multiply_are_refused(tm_mesh, env, tmp_path):
    """A short file must not request more memory than its size explains: each entity is in every group."""
    m = meshlib.block(6)
    text = meshlib.msh4(m)
    many = " ".join(map(str, range(1, 500001)))
    text = text.replace("1 0 0 0 1 1 1 1 1 0", f"1 0 0 0 1 1 1 500000 {many} 0")
    result = meshlib.run(tm_mesh, "check", write(tmp_path / "p.msh", text), env=env)
    assert result.returncode in (1, 2) and "groups of the mesh; use fewer" in result.stderr


def test_isolated_vertices_are_repaired(tm_mesh, env, tmp_path):
    m = meshlib.block()
    m.points.append([5.0, 5.0, 5.0])
    m.vertex_tag.append(900)
    path, out = write(tmp_path / "b.msh", meshlib.msh4(m)), tmp_path / "out.msh"
    result = meshlib.run(tm_mesh, "repair", path, "-o", out, env=env)
    assert result.returncode == 0 and "1 vertices removed: unused" in result.stdout
    assert info(tm_mesh, out, env)[0]["vertices"] == 27


def test_reading_leaves_no_files(tm_mesh, env, tmp_path, root):
    """Reading creates no cache and writes nothing into a home folder."""
    env["HOME"] = str(tmp_path / "home")
    assert meshlib.run(tm_mesh, "check", root / "meshes" / "liver_1k.msh", env=env).returncode == 0
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", FORMATS)
def test_what_is_written_reads_the_same(name, tm_mesh, env, tmp_path):
    path = write(tmp_path / name, FORMATS[name](named_block()))
    _, first = info(tm_mesh, path, env)
    for ending in ("msh", "vtk", "mesh"):
        out = tmp_path / f"out.{ending}"
        assert meshlib.run(tm_mesh, "convert", path, "-o", out, env=env).returncode == 0
        _, second = info(tm_mesh, out, env)
        if ending == "msh":
            assert first.split("\n")[1:] == second.split("\n")[1:], "regions, groups or figures changed"
        else:
            assert first.split("\n")[1] == second.split("\n")[1]


def test_paths_are_not_interpreted_by_a_shell(tm_mesh, env, tmp_path):
    path = write(tmp_path / "a b;$(touch owned) 'é\".msh", meshlib.msh2(meshlib.block()))
    assert info(tm_mesh, path, env)[0]["tets"] == 48
