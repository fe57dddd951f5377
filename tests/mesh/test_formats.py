"""The table of formats in docs/mesh-formats.md: tries each row, in and out."""
import re
import xml.etree.ElementTree as xml

import dicom_seg
import meshlib
import numpy as np
import phantom
import pytest
import vtk_xml
from test_fill import indexed, sphere, write_surface
from test_mesh_files import info, named_block, write

TETRAHEDRA = {".msh": meshlib.msh4, ".vtk": meshlib.vtk, ".mesh": meshlib.medit, ".vtu": lambda m: vtk_xml.vtu(m).decode()}


FILLED = {".vtp": vtk_xml.vtp, ".vtu": vtk_xml.surface_vtu, ".vtk": lambda p, f: vtk_xml.polydata(p, f).encode()}


def surface_file(path, triangles):
    if path.suffix not in FILLED:
        return write_surface(path, triangles)
    path.write_bytes(FILLED[path.suffix](*indexed(triangles)))
    return path


@pytest.fixture(scope="module")
def rows(root):
    table = re.search(r"\n## Formats\n.*?\n\|---.*?\n(.*?)\n\n", (root / "docs" / "mesh-formats.md").read_text(), re.S).group(1)
    return {cells[0].strip("` "): (cells[2].strip(), cells[3].strip()) for cells in (line.strip("|").split("|") for line in table.split("\n"))}


def small_image():
    image = np.zeros((14, 12, 12), "u1")
    image[2:12, 2:10, 2:10] = 1
    return image


def come_in(ending, how, tm_mesh, env, folder):
    path, out = folder / ("in" + ending), folder / "got.msh"
    if how.startswith("tetrahedra, "):
        first = come_in(ending, "tetrahedra", tm_mesh, env, folder)
        assert first.returncode == 0, first.stderr
        return come_in(ending, how.partition(", ")[2], tm_mesh, env, folder)
    if how == "tetrahedra":
        return meshlib.run(tm_mesh, "convert", write(path, TETRAHEDRA[ending](named_block())), "-o", out, env=env)
    if how.startswith("`fill`"):
        return meshlib.run(tm_mesh, "fill", "--size", "20mm", "--unit", "mm", surface_file(path, sphere(6, 50)), "-o", out, env=env)
    if how.startswith("`image`"):
        if ending == ".dcm":
            dicom_seg.write_dicom_seg(path, small_image(), (3, 3, 3))
            return meshlib.run(tm_mesh, "image", "--size", "8mm", path, "-o", out, env=env)
        return meshlib.run(tm_mesh, "image", "--size", "8mm", phantom.write(path, small_image(), (3, 3, 3)), "-o", out, env=env)
    assert how.startswith("no")
    path.write_text("<?xml version=\"1.0\"?>\n<VTKFile/>\n")
    tried = [meshlib.run(tm_mesh, *words, path, "-o", out, env=env) for words in (["convert"], ["fill", "--size", "9mm", "--unit", "mm"])]
    assert all(t.returncode == 2 and "; " in t.stderr for t in tried), [t.stderr for t in tried]
    return tried[0]


def test_formats_of_the_table_are_read_and_written(rows, build, tm_mesh, env, tmp_path):
    assert len(rows) == 15
    assert {e for e, (_, out) in rows.items() if out.startswith("yes")} == set(re.search(r"-o OUT +(.*)", meshlib.run(tm_mesh, "convert", "--help").stdout).group(1).replace(" or ", ", ").split(", "))
    module = (build / "lib/tensormass/image.so").exists()
    block = write(tmp_path / "b.msh", meshlib.msh2(named_block()))
    for ending, (how, out) in rows.items():
        folder = tmp_path / ending[1:]
        folder.mkdir()
        if module or "module" not in how:
            came = come_in(ending, how, tm_mesh, env, folder)
            assert (came.returncode == 0) == (not how.startswith("no")), (ending, came.stderr)
            assert (folder / "got.msh").exists() == (came.returncode == 0), ending
        went = meshlib.run(tm_mesh, "convert", block, "-o", folder / ("out" + ending), env=env)
        assert went.returncode == (0 if out.startswith("yes") else 2), (ending, went.stderr)
        if out.startswith("yes") and not how.startswith("no"):
            assert info(tm_mesh, folder / ("out" + ending), env)[0]["tets"] == 48


def test_vtu_holds_the_mesh(tm_mesh, env, tmp_path):
    """Reads places, corners, regions and groups by VTK's format."""
    m = named_block()
    m.names[(2, 5)] = m.names[(0, 9)] = "<clamp> & b"
    path = tmp_path / "b.vtu"
    done = meshlib.run(tm_mesh, "convert", write(tmp_path / "b.msh", meshlib.msh2(m)), "-o", path, env=env)
    assert done.returncode == 0, done.stderr
    data = path.read_bytes()
    mark = data.index(b'<AppendedData encoding="raw">')
    begin = data.index(b"_", mark) + 1
    piece = xml.fromstring(data[:mark] + b"</VTKFile>").find("UnstructuredGrid/Piece")
    arrays, used = {}, 0
    for array in piece.iter("DataArray"):
        at = begin + int(array.get("offset"))
        size = int(np.frombuffer(data, "<u8", 1, at)[0])
        kind = {"Float64": "<f8", "Int32": "<i4", "Int64": "<i8", "UInt8": "<u1"}[array.get("type")]
        arrays[array.get("Name")] = np.frombuffer(data[at + 8:at + 8 + size], kind)
        used += 8 + size
    assert begin + used == data.rindex(b"\n</AppendedData>") and b"region 0: lower part" in data
    assert np.allclose(arrays["Points"].reshape(-1, 3), m.points, atol=1e-15)
    assert arrays["connectivity"].reshape(-1, 4).tolist() == [list(t) for t in m.tets]
    assert arrays["offsets"].tolist() == list(range(4, 4 * 48 + 1, 4)) and set(arrays["types"]) == {10}
    assert arrays["region"].tolist() == [r - 1 for r in m.region]
    assert np.flatnonzero(arrays["group:<clamp> & b"]).tolist() == [0, 1, 3, 4, 26]


HOW = [dict(how="ascii"), dict(how="binary"), dict(how="binary", packed=True), dict(how="appended"), dict(how="appended", packed=True, wide=False), dict(how="appended", base64_appended=True, packed=True, big=True),
       dict(how="appended", base64_appended=True, wide=False)]


@pytest.mark.parametrize("how", HOW, ids=lambda h: "-".join(map(str, h.values())))
def test_every_way_that_vtk_writes_xml(how, tm_mesh, env, tmp_path):
    """The same mesh, regions and surface for every packing; a truncated file is refused."""
    m = named_block()
    path, plain = tmp_path / "m.vtu", write(tmp_path / "m.vtk", meshlib.vtk(m))
    path.write_bytes(vtk_xml.vtu(m, **how))
    got = [meshlib.run(tm_mesh, "convert", p, "-o", tmp_path / ("got" + p.suffix + ".msh"), env=env) for p in (path, plain)]
    assert all(g.returncode == 0 for g in got), got[0].stderr
    ours, theirs = ((tmp_path / f"got.{e}.msh").read_text() for e in ("vtu", "vtk"))
    assert ours.split("$Nodes")[1].split("$Elements")[0] == theirs.split("$Nodes")[1].split("$Elements")[0]
    assert [r["tets"] for r in info(tm_mesh, path, env)[0]["regions"]] == [m.region.count(r) for r in sorted(set(m.region))]
    (tmp_path / "s.vtp").write_bytes(vtk_xml.vtp(*indexed(sphere(5, 50)), **how))
    assert meshlib.run(tm_mesh, "fill", "--size", "25mm", "--unit", "mm", tmp_path / "s.vtp", "-o", tmp_path / "s.msh", env=env).returncode == 0
    data = path.read_bytes()
    for share in (0.2, 0.5, 0.8):
        path.write_bytes(data[:int(share * len(data))])
        cut = meshlib.run(tm_mesh, "convert", path, "-o", tmp_path / "cut.msh", env=env)
        assert cut.returncode == 2 and "save it again" in cut.stderr and not (tmp_path / "cut.msh").exists(), (share, cut.stderr)


def test_damaged_packed_data_end_with_a_message(tm_mesh, env, tmp_path):
    m, dice, path = named_block(), np.random.default_rng(3), tmp_path / "m.vtu"
    data = vtk_xml.vtu(m, how="appended", packed=True)
    begin = data.index(b"\n_") + 2
    for _ in range(40):
        spoilt = bytearray(data)
        for at in dice.integers(begin, len(data) - 40, 3):
            spoilt[at] ^= 1 << dice.integers(8)
        path.write_bytes(spoilt)
        done = meshlib.run(tm_mesh, "convert", path, "-o", tmp_path / "m.msh", env=env)
        assert done.returncode in (0, 2) and (done.returncode == 0 or "; " in done.stderr), done.stderr


@pytest.mark.parametrize("ending", [".vtu", ".vtk"])
def test_there_and_back_keeps_regions_groups_and_names(ending, tm_mesh, env, tmp_path):
    m = named_block()
    m.names[(2, 5)] = m.names[(0, 9)] = "clamp & b 100%"
    paths = [tmp_path / n for n in ("m.msh", "there" + ending, "back.msh", "direct.msh")]
    write(paths[0], meshlib.msh2(m))
    for a, b in ((0, 1), (1, 2), (0, 3)):
        assert meshlib.run(tm_mesh, "convert", paths[a], "-o", paths[b], env=env).returncode == 0
    told = [info(tm_mesh, p, env)[0] for p in (paths[2], paths[3])]
    for key in ("regions", "tets", "vertices", "volume_m3"):
        assert told[0][key] == told[1][key], key
    assert sorted(map(str, told[0]["groups"])) == sorted(map(str, told[1]["groups"])) and "clamp & b 100%" in str(told[0]["groups"])


def test_fibres_are_written(tm_mesh, env, tmp_path):
    m = named_block()
    fibres = np.random.default_rng(2).normal(size=(48, 3))
    write(tmp_path / "m.msh", meshlib.msh2(m))
    (tmp_path / "f.csv").write_text("tet,ax,ay,az\n" + "".join("%d,%.9g,%.9g,%.9g\n" % (t, *f) for t, f in enumerate(fibres)))
    fibres /= np.linalg.norm(fibres, axis=1)[:, None]
    for ending in (".vtk", ".vtu"):
        done = meshlib.run(tm_mesh, "convert", "--fibres", tmp_path / "f.csv", tmp_path / "m.msh", "-o", tmp_path / ("m" + ending), env=env)
        assert done.returncode == 0, done.stderr
    lines = (tmp_path / "m.vtk").read_text().split("VECTORS fibre double\n")[1].splitlines()[:48]
    assert np.allclose([[float(x) for x in line.split()] for line in lines], fibres, atol=1e-7)
    data = (tmp_path / "m.vtu").read_bytes()
    assert b'Name="fibre" NumberOfComponents="3"' in data
    tail = data[:data.rindex(b"\n</AppendedData>")]
    assert np.allclose(np.frombuffer(tail[-48 * 24:], "<f8").reshape(-1, 3), fibres, atol=1e-7)
    bad = meshlib.run(tm_mesh, "convert", "--fibres", tmp_path / "f.csv", tmp_path / "m.msh", "-o", tmp_path / "x.mesh", env=env)
    assert bad.returncode == 2 and "only with .vtk and .vtu" in bad.stderr


@pytest.mark.parametrize("kind,change,said", [
    ("vtu", (b'type="UnstructuredGrid"', b'type="ImageData"'), "contains 'ImageData'"), ("vtu", (b"vtkZLib", b"vtkLZ4"), "compressed by vtkLZ4DataCompressor"), ("vtu", (b'NumberOfCells="49"', b'NumberOfCells="999999999"'), "truncated|not numbers"),
    ("vtp", (b'NumberOfStrips="0"', b'NumberOfStrips="3"'), "strips"), ("vtp", (b"</Piece>", b'</Piece>\n<Piece NumberOfPoints="0">\n</Piece>'), "several pieces"), ("vtp", (b'Name="offsets"', b'Name="ends"'), "array 'offsets' is missing")])
def test_other_xml_is_refused(kind, change, said, tm_mesh, env, tmp_path):
    path, out = tmp_path / ("m." + kind), tmp_path / "m.msh"
    data = vtk_xml.vtu(named_block(), how="binary", packed=True) if kind == "vtu" else vtk_xml.vtp(*indexed(sphere(3, 50)))
    assert change[0] in data
    path.write_bytes(data.replace(*change))
    words = ["convert"] if kind == "vtu" else ["fill", "--size", "20mm", "--unit", "mm"]
    done = meshlib.run(tm_mesh, *words, path, "-o", out, env=env)
    assert done.returncode == 2 and re.search(said, done.stderr) and done.stderr.startswith(str(path)) and not out.exists(), done.stderr


def test_polygons_and_strips_of_legacy_surfaces(tm_mesh, env, tmp_path):
    """A cube of quadrilaterals, text of both versions; a file of tetrahedra is not a surface."""
    points = [(x, y, z) for z in (0, 50) for y in (0, 50) for x in (0, 50)]
    sides = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    for version in (4, 5):
        (tmp_path / "c.vtk").write_text(vtk_xml.polydata(points, sides, version))
        done = meshlib.run(tm_mesh, "fill", "--size", "20mm", "--unit", "mm", tmp_path / "c.vtk", "-o", tmp_path / "c.msh", env=env)
        assert done.returncode == 0 and info(tm_mesh, tmp_path / "c.msh", env)[0]["volume_m3"] > 0.9 * 0.05 ** 3, done.stderr
    for words, file, said in ((["fill", "--size", "20mm", "--unit", "mm"], write(tmp_path / "t.vtk", meshlib.vtk(named_block())), "neither triangle nor polygon"), (["convert"], tmp_path / "c.vtk", "is a surface, not a volume")):
        done = meshlib.run(tm_mesh, *words, file, "-o", tmp_path / "no.msh", env=env)
        assert done.returncode == 2 and said in done.stderr, done.stderr
