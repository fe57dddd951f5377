"""tm-mesh renumber: what stays the same, independence of the original numbers, and the programs that recommend it."""
import csv
import json
import random
import re

import meshlib
import pytest
from test_mesh_files import info, named_block, write


def shuffled(m, seed=1):
    """Writes the same mesh with other numbers, tags with gaps, and tetrahedra in another order; was[v] is the original number of each vertex and
    tetrahedron."""
    draw = random.Random(seed)
    was, was_tet = list(range(len(m.points))), list(range(len(m.tets)))
    draw.shuffle(was)
    draw.shuffle(was_tet)
    now = {old: new for new, old in enumerate(was)}
    out = meshlib.Mesh([m.points[v] for v in was], [[now[v] for v in m.tets[t]] for t in was_tet])
    out.region, out.names = [m.region[t] for t in was_tet], m.names
    out.surface = [(tuple(now[v] for v in f), g) for f, g in m.surface]
    out.lines, out.dots = [((now[a], now[b]), g) for (a, b), g in m.lines], [(now[a], g) for a, g in m.dots]
    out.vertex_tag = [3 * v + 5 for v in range(len(m.points))]
    return out, was, was_tet


def sections(path):
    text = path.read_text()
    names = dict(re.findall(r'^(\d \d+) "(.*)"$', text.split("$PhysicalNames")[1].split("$EndPhysicalNames")[0], re.M)) if "$PhysicalNames" in text else {}
    nodes = {p[0]: tuple(map(float, p[1:])) for p in map(str.split, text.split("$Nodes\n")[1].split("$EndNodes")[0].splitlines()[1:])}
    elements = [line.split() for line in text.split("$Elements\n")[1].split("$EndElements")[0].splitlines()[1:]]
    return names, nodes, elements


def as_sets(path):
    """Returns the places of each group's vertices, and each tetrahedron's places (in order, as corners stay) with its region."""
    names, nodes, elements = sections(path)
    tets, groups = set(), {}
    for e in elements:
        places = tuple(nodes[v] for v in e[3 + int(e[2]):])
        name = names.get({"15": "0", "1": "1", "2": "2", "4": "3"}[e[1]] + " " + e[3], "")
        if e[1] == "4":
            tets.add((places, name))
        else:
            groups.setdefault(name, set()).update(places)
    return sorted(nodes.values()), tets, groups


def renumber(tm_mesh, env, path, out, *args):
    done = meshlib.run(tm_mesh, "renumber", *args, path, "-o", out, env=env)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_geometry_groups_and_labels_stay(tm_mesh, env, root, tmp_path):
    """A refined mesh, whose new vertices are numbered last, compared with its output of convert: the same sets in another order."""
    mesh = tmp_path / "refined.msh"
    refined = meshlib.run(tm_mesh, "refine", "--box", "35mm,-70mm,-20mm,75mm,-35mm,60mm", "--size", "8mm", root / "meshes/liver_10k.msh", "-o", mesh, env=env)
    assert refined.returncode == 0, refined.stderr
    meshlib.run(tm_mesh, "convert", mesh, "-o", tmp_path / "plain.msh", env=env)
    said = renumber(tm_mesh, env, mesh, tmp_path / "out.msh")
    before, after = (float(x) for x in re.search(r"differ by (\d+) on average \(before: (\d+)\)", said).group(2, 1))
    assert after < before / 3
    plain, out = as_sets(tmp_path / "plain.msh"), as_sets(tmp_path / "out.msh")
    assert plain == out and out[2]["vena_cava"] and len(out[1]) == 15238
    told = [info(tm_mesh, p, env)[0] for p in (mesh, tmp_path / "out.msh")]
    assert [(r["name"], r["tets"]) for r in told[0]["regions"]] == [(r["name"], r["tets"]) for r in told[1]["regions"]]
    for key in ("pieces", "vertices", "edges", "surface_triangles", "aspect"):
        assert told[0][key] == told[1][key], key
    assert sorted(map(str, told[0]["groups"])) == sorted(map(str, told[1]["groups"]))
    assert told[1]["critical_step"]["cut_s"] == pytest.approx(told[0]["critical_step"]["cut_s"], rel=1e-9)


@pytest.mark.parametrize("pieces", [1, 2])
def test_result_is_independent_of_the_original_numbers(pieces, tm_mesh, env, tmp_path):
    """Three numberings of one mesh, and a renumbered result, give the same bytes."""
    m = named_block()
    if pieces == 2:
        n, far = len(m.points), meshlib.block(3)
        m.points += [[x + 1, y, z] for x, y, z in far.points]
        m.tets += [[v + n for v in t] for t in far.tets]
        m.region += [2] * len(far.tets)
        m.vertex_tag = list(range(1, len(m.points) + 1))
    outs = []
    for i, one in enumerate([m, shuffled(m, 1)[0], shuffled(m, 2)[0]]):
        renumber(tm_mesh, env, write(tmp_path / f"{i}.msh", meshlib.msh2(one)), tmp_path / f"out{i}.msh")
        outs.append((tmp_path / f"out{i}.msh").read_bytes())
    renumber(tm_mesh, env, tmp_path / "out0.msh", tmp_path / "again.msh")
    assert outs[0] == outs[1] == outs[2] == (tmp_path / "again.msh").read_bytes()


def test_numbers_and_fibres_are_carried(tm_mesh, env, tmp_path):
    m, _, _ = shuffled(named_block())
    path = write(tmp_path / "m.msh", meshlib.msh2(m))
    middle = [[sum(m.points[v][k] for v in t) / 4 for k in range(3)] for t in m.tets]
    (tmp_path / "f.csv").write_text("tet,ax,ay,az\n" + "".join("%d,%.17g,%.17g,%.17g\n" % (t, *c) for t, c in enumerate(middle)))
    (tmp_path / "v.csv").write_text("vertex,ax,ay,az\n" + "".join("%d,1,%.17g,%.17g\n" % (v, p[1], p[2]) for v, p in enumerate(m.points)))
    renumber(tm_mesh, env, path, tmp_path / "out.msh", "--fibres", tmp_path / "f.csv", "--write-fibres", tmp_path / "g.csv", "--write-numbers", tmp_path / "n.csv")
    _, nodes, elements = sections(tmp_path / "out.msh")
    points = [nodes[str(v + 1)] for v in range(len(nodes))]
    was = [int(row["was"]) for row in csv.DictReader(open(tmp_path / "n.csv"))]
    assert sorted(was) == list(range(27)) and was != list(range(27))
    assert [tuple(m.points[v]) for v in was] == points
    tets = [[int(v) - 1 for v in e[-4:]] for e in elements if e[1] == "4"]
    fibres = [[float(row[k]) for k in ("ax", "ay", "az")] for row in csv.DictReader(open(tmp_path / "g.csv"))]
    assert len(fibres) == len(tets) == 48
    for t, f in zip(tets, fibres):  # it still points to its tetrahedron's place
        c = [sum(points[v][k] for v in t) / 4 for k in range(3)]
        assert f == pytest.approx([x / sum(y * y for y in c) ** 0.5 for x in c], abs=1e-8)
    assert tets == sorted(tets, key=sorted)
    renumber(tm_mesh, env, path, tmp_path / "out.msh", "--fibres", tmp_path / "v.csv", "--write-fibres", tmp_path / "h.csv")
    assert len((tmp_path / "h.csv").read_text().splitlines()) == 49


def test_renumbering_is_recommended_if_it_pays(tm_mesh, bin, env, tmp_path):
    """info, check and --explain recommend it for a shuffled block, on the scene's line; not for the block itself, for the renumbered one, or if
    everything fits the cache anyway."""
    scene = tmp_path / "scene.yaml"
    scene.write_text('tissue:\n  mesh: MESH\n  materials: {"*": {young: 5 kPa, poisson: 0.4, density: 1000 kg/m3}}\nsupports:\n  - {plane: {point: [0, 0, 0], normal: [0, 0, 1]}}\n')
    block = meshlib.block(10)
    write(tmp_path / "ordered.msh", meshlib.msh2(block))
    write(tmp_path / "poor.msh", meshlib.msh2(shuffled(block)[0]))
    write(tmp_path / "small.msh", meshlib.msh2(shuffled(meshlib.block(3))[0]))
    renumber(tm_mesh, env, tmp_path / "poor.msh", tmp_path / "good.msh")
    for name, poor in (("ordered", False), ("poor", True), ("good", False), ("small", False)):
        figures, text = info(tm_mesh, tmp_path / (name + ".msh"), env)
        assert figures["numbering"]["poor"] == poor and ("tm-mesh renumber" in text) == poor, name
        check = meshlib.run(tm_mesh, "check", tmp_path / (name + ".msh"), env=env)
        assert check.returncode == 0 and check.stderr == "" and ("tm-mesh renumber" in check.stdout) == poor, name
        assert meshlib.run(tm_mesh, "check", "--quiet", tmp_path / (name + ".msh"), env=env).stdout == ""
        told = meshlib.run(bin / "tm-sim", scene, "--explain", "--set", f"tissue.mesh={tmp_path / name}.msh", "--json", tmp_path / "e.json", env=env)
        assert told.returncode == 0, told.stderr
        explained = json.loads((tmp_path / "e.json").read_text())["numbering"]
        assert explained == {**figures["numbering"], "inside": poor} and ("renumbered internally" in told.stdout) == poor, name
    scene.write_text(scene.read_text().replace("MESH", "poor.msh"))
    told = meshlib.run(bin / "tm-sim", scene, "--explain", env=env).stdout
    assert re.search(r"scene\.yaml:2: large bandwidth: .* differ by (\d+) on average; renumbered internally, by (\d+)", told)


@pytest.mark.parametrize("args,said", [
    (["MESH"], "no output"), (["-o", "OUT"], "name one mesh"), (["MESH", "MESH", "-o", "OUT"], "name one mesh"), (["MESH", "-o", "out.stl"], "stl"),
    (["--fibres", "x.csv", "MESH", "-o", "OUT"], "go together"), (["--nonsense", "MESH", "-o", "OUT"], "unknown option"), (["--scale", "0", "MESH", "-o", "OUT"], "scale"),
    (["BAD", "-o", "OUT"], "flat"), (["MESH", "--fibres", "F", "--write-fibres", "OUTF", "-o", "OUT"], "f.csv:"), (["MESH", "-o", "/nowhere/out.msh"], "/nowhere"),
    (["MESH", "-o", "OUT", "--write-numbers", "/nowhere/n.csv"], "/nowhere"), (["none.msh", "-o", "OUT"], "none.msh")])
def test_invalid_use_is_refused(args, said, tm_mesh, env, tmp_path):
    m = named_block()
    write(tmp_path / "m.msh", meshlib.msh2(m))
    m.points[13] = [0.05, 0.05, 0.0]
    write(tmp_path / "bad.msh", meshlib.msh2(m))
    (tmp_path / "f.csv").write_text("tet,ax,ay,az\n0,1,0,0\n")
    names = {"MESH": "m.msh", "BAD": "bad.msh", "F": "f.csv", "OUT": "out.msh", "OUTF": "out.csv"}
    result = meshlib.run(tm_mesh, "renumber", *[tmp_path / names[a] if a in names else a for a in args], env=env)
    assert result.returncode == 2 and said in result.stderr and result.stdout == "", result.stderr
    assert not list(tmp_path.glob("out*"))
