"""The table of formats in docs/meshes.md: each row tried, in and out."""
import re
import xml.etree.ElementTree as xml

import meshlib
import numpy as np
import phantom
import pytest
from test_fill import sphere, write_surface
from test_mesh_files import info, named_block, write

TETRAHEDRA = {".msh": meshlib.msh4, ".vtk": meshlib.vtk, ".mesh": meshlib.medit}


@pytest.fixture(scope="module")
def rows(root):
    table = re.search(r"\n## Formats\n.*?\n\|---.*?\n(.*?)\n\n", (root / "docs" / "meshes.md").read_text(), re.S).group(1)
    return {cells[0].strip("` "): (cells[2].strip(), cells[3].strip()) for cells in (line.strip("|").split("|") for line in table.split("\n"))}


def small_image():
    image = np.zeros((14, 12, 12), "u1")
    image[2:12, 2:10, 2:10] = 1
    return image


def come_in(ending, how, tm_mesh, env, folder):
    path, out = folder / ("in" + ending), folder / "got.msh"
    if how == "tetrahedra":
        return meshlib.run(tm_mesh, "convert", write(path, TETRAHEDRA[ending](named_block())), "-o", out, env=env)
    if how.startswith("`fill`"):
        return meshlib.run(tm_mesh, "fill", "--size", "20mm", "--unit", "mm", write_surface(path, sphere(6, 50)), "-o", out, env=env)
    if how.startswith("`image`"):
        return meshlib.run(tm_mesh, "image", "--size", "8mm", phantom.write(path, small_image(), (3, 3, 3)), "-o", out, env=env)
    assert how.startswith("no")
    path.write_text("<?xml version=\"1.0\"?>\n<VTKFile/>\n")
    tried = [meshlib.run(tm_mesh, *words, path, "-o", out, env=env) for words in (["convert"], ["fill", "--size", "9mm", "--unit", "mm"])]
    assert all(t.returncode == 2 and "; " in t.stderr for t in tried), [t.stderr for t in tried]
    return tried[0]


def test_each_row_of_the_table(rows, build, tm_mesh, env, tmp_path):
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
    """As a reader of VTK's format sees it: places, corners, regions, groups."""
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
