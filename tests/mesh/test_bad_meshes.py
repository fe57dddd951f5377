"""Bad meshes are rejected with exit 2, the invalid entity and the remedy; nothing is written."""
import json
import os
import pathlib
import re

import meshlib
import pytest


def nan_vertex(m):
    m.points[4][1] = float("nan")
    return meshlib.msh2(m)


def infinite_vertex(m):
    m.points[4][1] = float("inf")
    return meshlib.msh2(m)


def flat(m):
    m.tets.insert(0, [0, 1, 4, 3])  # all on z = 0
    m.region.append(1)
    return meshlib.msh2(m)


def inverted(m):
    m.tets[7][0], m.tets[7][1] = m.tets[7][1], m.tets[7][0]
    return meshlib.msh2(m)


def isolated(m):
    m.points.append([5.0, 5.0, 5.0])
    m.vertex_tag.append(900)
    return m


def vertex_twice(m):
    m.tets[3][3] = m.tets[3][1]
    return meshlib.msh2(m)


def tet_twice(m):
    t = m.tets[10]
    m.tets.append([t[1], t[2], t[0], t[3]])
    m.region.append(1)
    return meshlib.msh2(m)


def third_on_a_face(m):
    """Two more vertices far out, each with a tetrahedron on the same outer face."""
    a, b, c = 0, 1, 4  # on z = 0
    m.points += [[0.04, 0.03, -0.05], [0.03, 0.04, -0.06]]
    m.vertex_tag += [28, 29]
    m.tets += [[a, c, b, 27], [a, c, b, 28]]
    m.region += [1, 1]
    return meshlib.msh2(m)


def overlap(m):
    """One more tetrahedron on the outer face, but on its inner side."""
    m.points.append([0.04, 0.03, 0.07])
    m.vertex_tag.append(28)
    m.tets.append([0, 1, 4, 27])
    m.region.append(1)
    return meshlib.msh2(m)


def element(text, line):
    count = int(re.search(r"\$Elements\n(\d+)", text).group(1))
    text = text.replace("$Elements\n%d\n" % count, "$Elements\n%d\n%s\n" % (count + 1, line))
    return text


def wrong_corner(m, write_format):
    m.points.append([0, 0, 1])
    m.vertex_tag.append(555)
    m.tets[0][0] = 27
    text = write_format(m)
    del m.points[-1], m.vertex_tag[-1]
    m.tets[0][0] = 0
    right = write_format(m)
    at = text.index(b"$Elements")
    return right[:right.index(b"$Elements")] + text[at:]


CASES = {
    "nan": (nan_vertex, r"vertex 5 .*nan"),
    "infinite": (infinite_vertex, r"vertex 5 "),
    "flat": (flat, r"tetrahedron 1 .*flat"),
    "inverted": (inverted, r"tetrahedron 8 .*inverted"),
    "isolated 2.2": (lambda m: meshlib.msh2(isolated(m)), r"vertex 900 is in no tetrahedron"),
    "isolated 4.1": (lambda m: meshlib.msh4(isolated(m)), r"vertex 900 is in no tetrahedron"),
    "isolated 2.2 binary": (lambda m: meshlib.msh2_binary(isolated(m)), r"vertex 900 is in no tetrahedron"),
    "vertex twice": (vertex_twice, r"tetrahedron 4 .*has vertex \d+ twice"),
    "tetrahedron twice": (tet_twice, r"tetrahedron 49 .*tetrahedron 11"),
    "third on a face": (third_on_a_face, r"tetrahedron 50 .*shares a face with tetrahedron"),
    "overlap": (overlap, r"tetrahedron 49 .*overlaps tetrahedron"),
    "empty": (lambda m: "", r"empty"),
    "empty mesh": (lambda m: "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n0\n$EndNodes\n$Elements\n0\n$EndElements\n", r"no tetrahedra"),
    "empty mesh 4.1": (lambda m: "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n0 0 0 0\n$EndNodes\n$Elements\n0 0 0 0\n$EndElements\n", r"no tetrahedra"),
    "blank": (lambda m: "\n\n", r"not a \.msh file"),
    "words": (lambda m: "hello\n", r"not a \.msh file"),
    "script": (lambda m: 'SystemCall "touch owned";\n', r"not a \.msh file"),
    "script after header": (lambda m: '$MeshFormat\n2.2 0 8\n$EndMeshFormat\nSystemCall "touch owned";\n', r"no \$Nodes"),
    "stl": (lambda m: "solid x\nfacet normal 0 0 1\nouter loop\nendsolid x\n", r"not a \.msh file"),
    "garbage": (lambda m: bytes((i * 73 + i // 7) % 256 for i in range(5000)), r"not a \.msh file"),
    "garbage after header": (lambda m: b"$MeshFormat\n4.1 1 8\n\x01\0\0\0\n$EndMeshFormat\n$Nodes\n" + bytes((i * 73 + i // 7) % 256 for i in range(5000)), r"."),
    "missing vertex 4.1": (lambda m: meshlib.msh4(m).replace("\n3 1 4 48\n1 ", "\n3 1 4 48\n1 600 "), r"too many vertices"),
    "missing vertex binary": (lambda m: wrong_corner(m, meshlib.msh2_binary), r"element 1 has vertex 555"),
    "missing vertex binary 4.1": (lambda m: wrong_corner(m, meshlib.msh4_binary), r"element 1 has vertex 555"),
    "old format": (lambda m: meshlib.msh2(m).replace("2.2 0 8", "1.0 0 8"), r"format '1\.0 0 8'.*4\.1 or 2\.2"),
    "4.0": (lambda m: meshlib.msh2(m).replace("2.2 0 8", "4 0 8"), r"format '4 0 8'"),
    "quadratic": (lambda m: element(meshlib.msh2(m), "99 11 2 1 1 1 2 4 10 3 5 6 7 8 9"), r":\d+: element 99 .*first-order"),
    "hexahedron": (lambda m: element(meshlib.msh2(m), "99 5 2 1 1 1 2 5 4 10 11 14 13"), r"element 99 .*hexahedron"),
    "all quadratic": (lambda m: re.sub(r"\$Elements.*", "$Elements\n1\n7 11 2 1 1 1 2 4 10 3 5 6 7 8 9\n$EndElements\n", meshlib.msh2(m), flags=re.S), r"element 7 .*first-order"),
    "surface only": (lambda m: re.sub(r"\$Elements.*", "$Elements\n1\n1 2 2 1 1 1 2 4\n$EndElements\n", meshlib.msh2(m), flags=re.S), r"no tetrahedra"),
    "missing vertex": (lambda m: element(meshlib.msh2(m), "99 4 2 1 1 1 2 4 555"), r"element 99 has vertex 555"),
    "vertex number twice": (lambda m: meshlib.msh2(m).replace("\n2 0.05", "\n1 0.05"), r"vertex 1 occurs twice"),
    "element number twice": (lambda m: element(meshlib.msh2(m), "5 4 2 1 1 1 2 4 10"), r"5"),
    "letters for a number": (lambda m: meshlib.msh2(m).replace("\n3 0.1 ", "\n3 zero "), r":8: .*not a number"),
    "vertices end early": (lambda m: meshlib.msh2(m)[:300], r":\d+: "),
    "elements end early": (lambda m: meshlib.msh2(m)[:1100], r":\d+: "),
    "no end mark": (lambda m: meshlib.msh2(m).replace("$EndElements\n", ""), r":\d+: \$EndElements"),
    "too many announced": (lambda m: meshlib.msh2(m).replace("$Nodes\n27", "$Nodes\n999999999"), r":\d+: "),
    "2.2 binary ends early": (lambda m: meshlib.msh2_binary(m)[:900], r"ends early"),
    "4.1 binary ends early": (lambda m: meshlib.msh4_binary(m)[:2000], r"ends early"),
    "4.1 ends early": (lambda m: meshlib.msh4(m)[:700], r":\d+: "),
    "long name": (lambda m: meshlib.msh2(named(m, "x" * 90)), r"longer than 63"),
}


def named(m, name):
    m.names[3, 1] = name
    return m


def write(path, contents):
    if isinstance(contents, bytes):
        path.write_bytes(contents)
    else:
        path.write_text(contents)


def check_refused(result, path, expected):
    assert result.returncode == 2, (result.returncode, result.stdout, result.stderr)
    assert result.stdout == ""
    lines = result.stderr.strip().split("\n")
    assert re.match(re.escape(str(path)) + r":(\d+:)? ", lines[0]), result.stderr
    assert re.search(expected, lines[0]), result.stderr
    assert "; " in lines[0], "it says what is wrong, not what to do: " + lines[0]


@pytest.mark.parametrize("case", CASES)
def test_bad_mesh_is_refused_with_its_entity(case, tm_mesh, env, tmp_path):
    make, expected = CASES[case]
    path = tmp_path / "bad.msh"
    write(path, make(meshlib.block()))
    result = meshlib.run(tm_mesh, "check", path, "--json", tmp_path / "out.json", env=env)
    check_refused(result, path, expected)
    assert sorted(p.name for p in tmp_path.iterdir() if p.name != "cache") == ["bad.msh"], "something was written"


@pytest.mark.parametrize("write_format,ending", [(meshlib.vtk, "vtk"), (meshlib.medit, "mesh")])
@pytest.mark.parametrize("share", [0.5, 0.7, 0.8, 0.9, 0.97])
def test_truncated_mesh_is_refused(write_format, ending, share, tm_mesh, env, tmp_path):
    text = write_format(meshlib.block())
    if ending == "vtk":
        share *= text.index("CELL_TYPES") / len(text)
    path = tmp_path / f"bad.{ending}"
    path.write_text(text[:int(share * len(text))])
    check_refused(meshlib.run(tm_mesh, "check", path, env=env), path, "truncated|cannot be read|no tetrahedra")


QUADRATIC_VTK = meshlib.vtk(meshlib.Mesh(meshlib.block().points, [])).replace("CELLS 0 0\n", "CELLS 1 11\n10 0 1 3 9 2 4 5 6 7 8\n").replace(
    "CELL_TYPES 0\n", "CELL_TYPES 1\n24\n")


VTK5 = meshlib.vtk5(meshlib.block())
BAD_VTK5 = {
    "hexahedron": (VTK5.replace("\n10\n", "\n12\n", 1), r"cell 0 is not a tetrahedron \(type 12, 4 vertices\); mesh"),
    "quadratic": (VTK5.replace("\n10\n", "\n24\n", 1), "cell 0 is of higher order .*first-order"),
    "corner out of range": (VTK5.replace("CONNECTIVITY vtktypeint64\n", "CONNECTIVITY vtktypeint64\n99 ", 1), "cell 0 has vertex 99"),
    "offsets": (VTK5.replace("vtktypeint64\n0 4", "vtktypeint64\n0 9", 1), "OFFSETS are not ascending"),
    "types": (VTK5.replace("CELL_TYPES 49", "CELL_TYPES 48"), "different lengths"),
    "grid": (VTK5.replace("UNSTRUCTURED_GRID", "POLYDATA"), "save an unstructured grid"),
    "count of points": (VTK5.replace("POINTS 27", "POINTS 500000000"), "truncated"),
    "count of corners": (VTK5.replace("CELLS 50 195", "CELLS 50 9000000000000000000"), "truncated"),
    "count of offsets": (VTK5.replace("CELLS 50 195", "CELLS 9223372036854775807 195"), "truncated"),
    "words": (VTK5.replace("POINTS 27 double", "POINTS many"), "cannot be read"),
    "type": (VTK5.replace("POINTS 27 double", "POINTS 27 quaternion"), "cannot be read"),
    "no tetrahedra": (meshlib.vtk5(meshlib.Mesh(meshlib.block().points, []), extra=False), "no tetrahedra"),
    "isolated": (meshlib.vtk5(isolated(meshlib.block())), "vertex 28 .*is in no tetrahedron"),
}


@pytest.mark.parametrize("case", BAD_VTK5)
def test_bad_vtk_5_is_refused(case, tm_mesh, env, tmp_path):
    text, expected = BAD_VTK5[case]
    path = tmp_path / "bad.vtk"
    assert text != VTK5
    path.write_text(text)
    check_refused(meshlib.run(tm_mesh, "check", path, env=env), path, expected)


@pytest.mark.parametrize("share", [0.01, 0.05, 0.3, 0.5, 0.7, 0.8, 0.9, 0.97, 0.999])
@pytest.mark.parametrize("contents", [VTK5.encode()[:-1], meshlib.vtk5_binary(meshlib.block())[:-len("\nCELL_DATA 1\n")]], ids=["text", "binary"])
def test_truncated_vtk_5_is_refused(contents, share, tm_mesh, env, tmp_path):
    path = tmp_path / "bad.vtk"
    path.write_bytes(contents[:int(share * len(contents))])
    check_refused(meshlib.run(tm_mesh, "check", path, env=env), path, "truncated|no tetrahedr|does not begin|expected|neither|cannot be read")


def test_quadratic_vtk_is_refused(tm_mesh, env, tmp_path):
    path = tmp_path / "bad.vtk"
    path.write_text(QUADRATIC_VTK)
    check_refused(meshlib.run(tm_mesh, "check", path, env=env), path, r"cell 0 is of higher order \(type 24\)")


@pytest.mark.parametrize("ending,write_format", [("vtk", meshlib.vtk), ("mesh", meshlib.medit)])
def test_isolated_vertex_is_refused_in_other_formats(ending, write_format, tm_mesh, env, tmp_path):
    path = tmp_path / f"bad.{ending}"
    path.write_text(write_format(isolated(meshlib.block())))
    check_refused(meshlib.run(tm_mesh, "check", path, env=env), path, "vertex 28 .*is in no tetrahedron")


@pytest.mark.parametrize("name,expected", [("no.msh", "cannot open"), ("folder.msh", "not a regular file"), ("x.stl", "is a surface, not a volume; fill it"), ("x.obj", "tm-mesh fill"), ("x.vtp", "is a surface, not a volume; fill it"), ("noending", "unknown type of mesh file")])
def test_not_a_mesh_file(name, expected, tm_mesh, env, tmp_path):
    path = tmp_path / name
    if "folder" in name:
        path.mkdir()
    elif name != "no.msh":
        path.write_text(meshlib.msh2(meshlib.block()))
    check_refused(meshlib.run(tm_mesh, "check", path, env=env), path, expected)


def test_a_second_start_refuses_as_the_first(tm_mesh, env, tmp_path):
    path = tmp_path / "bad.msh"
    path.write_text(inverted(meshlib.block()))
    first, second = (meshlib.run(tm_mesh, "check", path, env=env) for _ in range(2))
    check_refused(second, path, "tetrahedron 8")
    assert first.stderr == second.stderr


def test_every_defect_is_listed(tm_mesh, env, tmp_path):
    m = meshlib.block()
    for t in m.tets[:30]:
        t[0], t[1] = t[1], t[0]
    path = tmp_path / "bad.msh"
    path.write_text(meshlib.msh2(m))
    result = meshlib.run(tm_mesh, "check", path, env=env)
    lines = result.stderr.strip().split("\n")
    assert result.returncode == 2 and len(lines) == 21
    for i in range(20):
        assert f"tetrahedron {i + 1} " in lines[i] and "inverted" in lines[i]
    assert "10 more defects" in lines[20]


EXTRA = os.environ.get("TM_EXTRA_MESHES")
if EXTRA:
    FILES = sorted(p for p in pathlib.Path(EXTRA).iterdir() if p.suffix in (".msh", ".vtk", ".mesh"))

    @pytest.mark.parametrize("path", FILES, ids=lambda p: p.name)
    def test_extra_mesh(path, tm_mesh, env, build):
        """Meshes of a folder: good ones load, bad ones (named bad*) are refused with the entity; each verdict is kept in build/tests/extra_meshes/."""
        result = meshlib.run(tm_mesh, "check", path, env=env, timeout=600)
        folder = build / "tests" / "extra_meshes"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / (path.name + ".json")).write_text(json.dumps({"exit": result.returncode, "said": result.stdout + result.stderr}) + "\n")
        assert result.returncode in (0, 2), result.stderr
        if path.name.startswith("bad") or result.returncode == 2:
            check_refused(result, path, r"tetrahedron|vertex|element|line|coordinate")
