"""tm-mesh from the command line: help, usage, info, refine, repair, convert."""
import csv
import json
import math
import random
import re
import subprocess

import meshlib
import pytest
from test_mesh_files import info, named_block, write

COMMANDS = ["info", "check", "fill", "refine", "repair", "renumber", "convert"]


@pytest.mark.parametrize("args", [["--help"], ["--version"]] + [[c, "--help"] for c in COMMANDS])
def test_help(args, tm_mesh):
    result = meshlib.run(tm_mesh, *args)
    assert result.returncode == 0 and result.stdout and result.stderr == ""


@pytest.mark.parametrize("args", [
    [], ["nonsense"], ["info"], ["info", "--wrong", "MESH"], ["info", "MESH", "MESH"], ["info", "--young", "5 mm", "MESH"], ["info", "--young"],
    ["check", "--poisson", "0.5", "MESH"], ["check", "--density", "heavy", "MESH"], ["check", "--young", "-5 kPa", "MESH"],
    ["refine", "MESH", "-o", "OUT"], ["refine", "--size", "1mm", "MESH", "-o", "OUT"], ["refine", "--region", "none", "--size", "1mm", "MESH", "-o", "OUT"],
    ["refine", "--region", "lower part", "--size", "0", "MESH", "-o", "OUT"], ["refine", "--box", "0,0,0,1,1", "--size", "1mm", "MESH", "-o", "OUT"],
    ["refine", "--box", "0,0,0,1,1,0", "--size", "1mm", "MESH", "-o", "OUT"], ["refine", "--region", "upper", "--size", "1mm", "MESH"],
    ["refine", "--region", "upper", "--size", "1mm", "--fibres", "x.csv", "MESH", "-o", "OUT"],
    ["repair", "MESH"], ["repair", "MESH", "-o", "out.xyz"], ["convert", "MESH", "-o", "out.stl"], ["convert", "--merge", "1mm", "MESH", "-o", "OUT"],
    ["convert", "MESH", "-o", "/nowhere/out.msh"], ["convert", "--region", "none", "MESH", "-o", "OUT"], ["convert", "--region", "upper", "--fibres", "x.csv", "MESH", "-o", "out.vtk"],
    ["repair", "--region", "upper", "MESH", "-o", "OUT"],
])
def test_bad_usage(args, tm_mesh, env, tmp_path):
    path = write(tmp_path / "b.msh", meshlib.msh2(named_block()))
    args = [str(path) if a == "MESH" else str(tmp_path / "out.msh") if a == "OUT" else a for a in args]
    result = meshlib.run(tm_mesh, *args, env=env)
    assert result.returncode == 2, (result.returncode, result.stdout, result.stderr)
    assert result.stderr.strip() and result.stdout == ""
    assert not list(tmp_path.glob("out*"))


@pytest.mark.parametrize("name", ["--quiet", "--help", "--quiet.msh"])
def test_what_follows_two_dashes_is_a_file(name, bin, tmp_path):
    (tmp_path / name).write_text("not much\n")
    done = subprocess.run([bin / "tm-mesh", "check", "--", name], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and done.stderr.startswith(f"{name}: "), (done.returncode, done.stdout, done.stderr)


@pytest.mark.parametrize("words", [["refine", "--region", "upper", "--size", "70um"], ["renumber"], ["repair"], ["convert"]], ids=lambda w: w[0])
def test_every_command_takes_a_unit(words, tm_mesh, env, tmp_path):
    path, out = write(tmp_path / "in.msh", meshlib.msh2(named_block())), tmp_path / "out.msh"

    def made(*scale):
        result = meshlib.run(tm_mesh, *words, *scale, path, "-o", out, env=env)
        assert result.returncode == 0, result.stderr
        return out.read_bytes(), info(tm_mesh, out, env)[0]["volume_m3"]

    assert made("--unit", "mm") == made("--scale", "1e-3") and made("--unit", "mm")[1] == pytest.approx(1e-12)
    for scale, said in ((["--unit", "mm", "--scale", "1"], "--unit and --scale both set the unit; give one"), (["--unit", "mile"], "--unit mile: give m, cm, mm, um or inch")):
        result = meshlib.run(tm_mesh, *words, *scale, path, "-o", out, env=env)
        assert result.returncode == 2 and said in result.stderr, result.stderr


def test_info_names_the_worst_element(tm_mesh, env, tmp_path):
    """One vertex moved close to a face: info names one of its elements; the step falls with the altitude, E and density as expected."""
    m = meshlib.block()
    plain, _ = info(tm_mesh, write(tmp_path / "a.msh", meshlib.msh2(m)), env)
    m.points[13] = [0.05, 0.05, 0.002]
    bad, text = info(tm_mesh, write(tmp_path / "b.msh", meshlib.msh2(m)), env)
    step = bad["critical_step"]
    assert 13 in m.tets[step["cut_tet"] - 1] and 13 in m.tets[bad["worst_aspect_tet"] - 1]
    assert step["cut_s"] < 0.2 * plain["critical_step"]["cut_s"]
    # Uncut, the masses around a sliver permit a longer step.
    assert 2 * step["cut_s"] < step["guaranteed_s"] < plain["critical_step"]["guaranteed_s"]
    assert f"tetrahedron {step['tet']} " in text and f"tetrahedron {step['cut_tet']} " in text
    stiff, _ = info(tm_mesh, tmp_path / "b.msh", env, "--young", "20 kPa", "--density", "1060")
    assert stiff["critical_step"]["guaranteed_s"] == pytest.approx(step["guaranteed_s"] / 2, rel=1e-9)
    heavy, _ = info(tm_mesh, tmp_path / "b.msh", env, "--density", "4240 kg/m3")
    assert heavy["critical_step"]["guaranteed_s"] == pytest.approx(step["guaranteed_s"] * 2, rel=1e-9)


def test_info_counts_pieces(tm_mesh, env, tmp_path):
    m = meshlib.block()
    n = len(m.points)
    far = meshlib.block()
    m.points += [[x + 1, y, z] for x, y, z in far.points]
    m.tets += [[v + n for v in t] for t in far.tets[:24]]
    used = sorted({v for t in m.tets for v in t})
    m.points = [m.points[v] for v in used]
    m.tets = [[used.index(v) for v in t] for t in m.tets]
    m.region, m.vertex_tag = [1] * len(m.tets), list(range(1, len(m.points) + 1))
    path = write(tmp_path / "two.msh", meshlib.msh2(m))
    figures, text = info(tm_mesh, path, env)
    assert figures["pieces"] == 2 and "2 pieces" in text
    out = tmp_path / "one.msh"
    assert meshlib.run(tm_mesh, "repair", "--largest", path, "-o", out, env=env).returncode == 0
    assert info(tm_mesh, out, env)[0]["tets"] == 48


def longest_edge(points, tet):
    return max(math.dist(points[a], points[b]) for i, a in enumerate(tet) for b in tet[:i])


def reaches(points, tet, low, high):
    return all(min(points[v][k] for v in tet) <= high[k] and max(points[v][k] for v in tet) >= low[k] for k in range(3))


def test_refine_box(tm_mesh, env, tmp_path, root):
    """Inside the box no edge is longer than requested; volume, regions and groups stay; the mesh is valid; fibres follow their tetrahedra."""
    source, out = root / "meshes" / "liver_1k.msh", tmp_path / "fine.msh"
    low, high, size = (-0.03, -0.07, -0.06), (0.0, -0.03, -0.02), 0.010
    box = ",".join(f"{1e3 * x}mm" for x in low + high)
    result = meshlib.run(tm_mesh, "refine", "--box", box, "--size", "10mm", "--fibres", root / "meshes" / "liver_1k.fibres.csv",
                         "--write-fibres", tmp_path / "fine.csv", source, "-o", out, env=env)
    assert result.returncode == 0, result.stderr
    coarse, fine = figures(tm_mesh, source, env, tmp_path), figures(tm_mesh, out, env, tmp_path)
    assert fine["tets"] > coarse["tets"] + 500
    assert fine["volume_m3"] == pytest.approx(coarse["volume_m3"], rel=1e-9)
    for a, b in zip(coarse["regions"], fine["regions"]):
        assert a["name"] == b["name"] and b["volume_m3"] == pytest.approx(a["volume_m3"], rel=1e-9)
    assert [g["name"] for g in coarse["groups"] if g["vertices"]] and {g["name"] for g in coarse["groups"]} == {g["name"] for g in fine["groups"]}
    assert fine["smallest_dihedral_deg"] > 8
    points, tets = vtk_of(tm_mesh, out, env, tmp_path)
    there = [t for t in tets if reaches(points, t, low, high)]
    assert len(there) > 200 and max(longest_edge(points, t) for t in there) < (1 + 1e-9) * size
    far = [t for t in tets if not reaches(points, t, [x - 0.04 for x in low], [x + 0.04 for x in high])]
    assert min(longest_edge(points, t) for t in far) > 1.5 * size, "refined far from the box"
    fibres = list(csv.reader((tmp_path / "fine.csv").open()))[1:]
    old = list(csv.reader((root / "meshes" / "liver_1k.fibres.csv").open()))[1:]
    assert len(fibres) == len(tets)
    for row, was in zip(fibres, old):  # the first part of each tetrahedron keeps its number
        assert [float(x) for x in row[1:]] == pytest.approx([float(x) for x in was[1:]], abs=2e-6)
    known = {tuple(round(float(x) / 1e-4) for x in r[1:]) for r in old}
    for row in fibres[len(old):]:
        x, y, z = (round(float(x) / 1e-4) for x in row[1:])
        assert any((x + i, y + j, z + k) in known for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1))


def figures(tm_mesh, path, env, tmp_path):
    result = meshlib.run(tm_mesh, "info", path, "--json", tmp_path / "f.json", env=env)
    assert result.returncode == 0, result.stderr
    return json.loads((tmp_path / "f.json").read_text())


def vtk_of(tm_mesh, path, env, tmp_path):
    result = meshlib.run(tm_mesh, "convert", path, "-o", tmp_path / "v.vtk", env=env)
    assert result.returncode == 0, result.stderr
    return meshlib.read_vtk(tmp_path / "v.vtk")


def test_refine_says_that_nothing_is_in_the_box(tm_mesh, env, tmp_path):
    path, out = write(tmp_path / "a.msh", meshlib.msh2(meshlib.block())), tmp_path / "b.msh"
    result = meshlib.run(tm_mesh, "refine", "--box", "20,20,20,40,40,40", "--size", "10mm", path, "-o", out, env=env)  # millimetres, meant
    assert result.returncode == 2 and not out.exists()
    assert "no tetrahedron is inside it, and the mesh is within 0,0,0,0.1,0.1,0.1 m; write units" in result.stderr
    result = meshlib.run(tm_mesh, "refine", "--box", "20mm,20mm,20mm,40mm,40mm,40mm", "--size", "1", path, "-o", out, env=env)
    assert result.returncode == 0 and "so nothing was refined; choose a smaller --size" in result.stdout


def test_outputs_are_refused_before_the_work(tm_mesh, env, tmp_path):
    path = write(tmp_path / "a.msh", meshlib.msh2(meshlib.block()))
    for command in (["repair"], ["convert"], ["refine", "--region", "no such", "--size", "1mm"], ["fill", "--size", "1mm", "--unit", "m"]):
        for out, words in (("b.xyz", "-o: .*b.xyz: is neither .msh nor .vtk nor .mesh nor .vtu; give"), ("nowhere/b.msh", "No such file"), (".", "neither|folder")):
            result = meshlib.run(tm_mesh, *command, path, "-o", tmp_path / out, env=env)
            assert result.returncode == 2 and re.search(words, result.stderr), result.stderr


def test_refine_region(tm_mesh, env, tmp_path):
    path, out = write(tmp_path / "b.msh", meshlib.msh2(named_block())), tmp_path / "out.msh"
    result = meshlib.run(tm_mesh, "refine", "--region", "upper", "--size", "30 mm", path, "-o", out, env=env)
    assert result.returncode == 0, result.stderr
    fine = figures(tm_mesh, out, env, tmp_path)
    tets = {r["name"]: r["tets"] for r in fine["regions"]}
    assert tets["upper"] > 4 * 24 and 24 <= tets["lower part"] < tets["upper"]
    assert {r["name"]: round(r["volume_m3"], 9) for r in fine["regions"]} == {"upper": 5e-4, "lower part": 5e-4}
    points, cells = vtk_of(tm_mesh, out, env, tmp_path)
    assert all(math.dist(points[v], p) < 1e-12 for v, p in enumerate(meshlib.block().points)), "an old vertex of the surface or between regions moved"


@pytest.mark.parametrize("seed", range(4))
def test_refine_is_sound_on_any_mesh(seed, tm_mesh, env, tmp_path):
    """Random irregular meshes, random boxes: conforming, positive, the same volume."""
    dice = random.Random(seed)
    m = meshlib.block(3)
    for p in m.points:
        if all(0.001 < x < 0.099 for x in p):
            for k in range(3):
                p[k] += dice.uniform(-0.008, 0.008)
    path, out = write(tmp_path / "b.msh", meshlib.msh2(m)), tmp_path / "out.msh"
    c, r = [dice.uniform(0, 0.1) for _ in range(3)], dice.uniform(0.001, 0.04)
    box = ",".join(str(x) for x in [x - r for x in c] + [x + r for x in c])
    result = meshlib.run(tm_mesh, "refine", f"--box={box}", "--size", "12mm", path, "-o", out, env=env)
    assert result.returncode == 0, result.stderr
    fine = figures(tm_mesh, out, env, tmp_path)
    assert fine["volume_m3"] == pytest.approx(1e-3, rel=1e-9) and fine["tets"] > 162


def test_repair_fixes_all_defects_at_once(tm_mesh, env, tmp_path):
    """All repairable defects at once are reported and repaired; groups and regions stay."""
    m = named_block()
    m.tets[7][0], m.tets[7][1] = m.tets[7][1], m.tets[7][0]
    m.tets += [m.tets[20][::-1], [0, 1, 4, 3], [0, 1, 1, 5]]
    m.region += [2, 1, 1]
    m.points.append([9, 9, 9])
    m.vertex_tag.append(77)
    path, out = write(tmp_path / "bad.msh", meshlib.msh2(m)), tmp_path / "good.msh"
    assert meshlib.run(tm_mesh, "check", path, env=env).returncode == 2
    result = meshlib.run(tm_mesh, "repair", path, "-o", out, env=env)
    assert result.returncode == 0, result.stderr
    for said in ("1 tetrahedra removed: a vertex twice", "1 tetrahedra removed: flat", "1 tetrahedra removed: double", "1 vertices removed: unused"):
        assert said in result.stdout, result.stdout
    fixed = figures(tm_mesh, out, env, tmp_path)
    assert (fixed["tets"], fixed["vertices"]) == (48, 27) and fixed["volume_m3"] == pytest.approx(1e-3)
    assert {g["name"]: g["vertices"] for g in fixed["groups"]}["clamp"] == 5


def test_repair_merges(tm_mesh, env, tmp_path):
    """Every tetrahedron has vertices of its own, as some exporters write: one connected mesh again."""
    m = meshlib.block()
    m.points = [m.points[v] for t in m.tets for v in t]
    m.tets = [[4 * i + k for k in range(4)] for i in range(48)]
    m.vertex_tag = list(range(1, 193))
    path, out = write(tmp_path / "soup.msh", meshlib.msh2(m)), tmp_path / "good.msh"
    assert figures(tm_mesh, path, env, tmp_path)["pieces"] == 48
    assert meshlib.run(tm_mesh, "repair", "--merge", "1 um", path, "-o", out, env=env).returncode == 0
    fixed = figures(tm_mesh, out, env, tmp_path)
    assert (fixed["pieces"], fixed["vertices"]) == (1, 27)


def test_repair_gives_up(tm_mesh, env, tmp_path):
    m = meshlib.block()
    m.points[3][0] = float("nan")
    path, out = write(tmp_path / "bad.msh", meshlib.msh2(m)), tmp_path / "good.msh"
    result = meshlib.run(tm_mesh, "repair", path, "-o", out, env=env)
    assert result.returncode == 2 and "vertex 4 " in result.stderr and not out.exists()


@pytest.mark.parametrize("ending", ["msh", "vtk", "mesh"])
def test_convert_round_trip(ending, tm_mesh, env, tmp_path):
    m = named_block()
    dice = random.Random(1)
    for p in m.points:
        for k in range(3):
            p[k] += dice.uniform(-1e-3, 1e-3)
    path, out = write(tmp_path / "a.msh", meshlib.msh4(m)), tmp_path / f"b.{ending}"
    assert meshlib.run(tm_mesh, "convert", path, "-o", out, env=env).returncode == 0
    assert vtk_of(tm_mesh, out, env, tmp_path) == ([tuple(p) for p in m.points], [tuple(t) for t in m.tets])
