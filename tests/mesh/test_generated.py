"""The committed meshes equal the generator's output, with the quality stated in meshes/README.md."""
import csv
import json
import math
import re

import meshlib
import pytest

MESHES = [(shape, size) for shape in ("block", "cylinder", "liver") for size in (1000, 10000)] + [("gallbladder", 1000)]
GROUPS = {
    "block": {"x_min", "x_max", "y_min", "y_max", "z_min", "z_max", "tissue"},
    "cylinder": {"side", "end_0", "end_1", "muscle"},
    "liver": {"free_surface", "vena_cava", "ligament", "gallbladder_fossa", "parenchyma", "gallbladder_bed"},
    "gallbladder": {"serosa", "bed", "fundus", "neck", "wall"},
}


@pytest.mark.parametrize("shape,size", MESHES)
def test_generator_gives_the_committed_bytes(shape, size, build, root, tmp_path):
    name = f"{shape}_{size // 1000}k"
    result = meshlib.run(build / "obj" / "apps" / "mesh" / "generate", shape, size, tmp_path / name)
    assert result.returncode == 0, result.stderr
    made = sorted(p.name for p in tmp_path.iterdir())
    assert made == sorted(p.name for p in (root / "meshes").glob(name + ".*"))
    for file in made:
        assert (tmp_path / file).read_bytes() == (root / "meshes" / file).read_bytes(), file + " differs; run make meshes-committed"


def test_the_cut_liver_is_the_refined_one_renumbered(tm_mesh, env, root, tmp_path):
    box = re.search(r"^CUT_BOX := (.*)$", (root / "apps/module.mk").read_text(), re.M).group(1)
    result = meshlib.run(tm_mesh, "refine", "--box", box, "--size", "8mm", "--fibres", root / "meshes" / "liver_10k.fibres.csv",
                         "--write-fibres", tmp_path / "refined.fibres.csv", root / "meshes" / "liver_10k.msh", "-o", tmp_path / "refined.msh", env=env)
    assert result.returncode == 0, result.stderr
    result = meshlib.run(tm_mesh, "renumber", "--fibres", tmp_path / "refined.fibres.csv", "--write-fibres", tmp_path / "liver_cut.fibres.csv",
                         tmp_path / "refined.msh", "-o", tmp_path / "liver_cut.msh", env=env)
    assert result.returncode == 0, result.stderr
    for file in ("liver_cut.msh", "liver_cut.fibres.csv"):
        assert (tmp_path / file).read_bytes() == (root / "meshes" / file).read_bytes(), file + " differs; run make meshes-committed"


@pytest.mark.parametrize("shape,size", MESHES)
def test_quality_is_that_of_the_readme(shape, size, tm_mesh, env, root, tmp_path):
    """The worst element sets the critical step: it must not be far below the median's."""
    result = meshlib.run(tm_mesh, "info", root / "meshes" / f"{shape}_{size // 1000}k.msh", "--json", tmp_path / "f.json", env=env)
    assert result.returncode == 0, result.stderr
    f = json.loads((tmp_path / "f.json").read_text())
    assert size <= f["tets"] <= 1.2 * size
    assert f["pieces"] == 1
    assert {g["name"] for g in f["groups"]} == GROUPS[shape] and all(g["vertices"] >= 3 for g in f["groups"])
    assert all(r["tets"] > 0 for r in f["regions"])
    assert f["critical_step"]["worst_over_median"] > 0.65
    assert f["smallest_dihedral_deg"] > 20 and f["worst_aspect"] < 4


@pytest.mark.parametrize("shape,size", [m for m in MESHES if m[0] != "block"])
def test_fibres_are_unit_and_one_a_tetrahedron(shape, size, root):
    name = f"{shape}_{size // 1000}k"
    rows = list(csv.reader((root / "meshes" / f"{name}.fibres.csv").open()))
    assert rows[0] == ["tet", "ax", "ay", "az"]
    assert [int(r[0]) for r in rows[1:]] == list(range(len(rows) - 1))
    assert all(abs(math.hypot(*map(float, r[1:])) - 1) < 1e-5 for r in rows[1:])


@pytest.mark.parametrize("change,line,expected", [
    (lambda r: [], 1, "empty"),
    (lambda r: ["a,b"] + r[1:], 1, "header"),
    (lambda r: r[:-1], 1045, "ends after 1043 rows"),
    (lambda r: r + ["1044,1,0,0"], 1046, "more rows"),
    (lambda r: r[:5] + ["4,0,0,0"] + r[6:], 6, "no length"),
    (lambda r: r[:5] + ["4,nan,0,0"] + r[6:], 6, "not finite"),
    (lambda r: r[:5] + ["4,1,0"] + r[6:], 6, "tet,ax,ay,az"),
    (lambda r: r[:5] + ["4,1,0,0,7"] + r[6:], 6, "more than four columns"),
    (lambda r: r[:5] + ["5,1,0,0"] + r[6:], 6, "in file order"),
])
def test_bad_fibres_are_refused_with_their_line(change, line, expected, tm_mesh, env, root, tmp_path):
    rows = (root / "meshes" / "liver_1k.fibres.csv").read_text().splitlines()
    path = tmp_path / "f.csv"
    path.write_text("".join(r + "\n" for r in change(rows)))
    result = meshlib.run(tm_mesh, "refine", "--box", "0,0,0,1mm,1mm,1mm", "--size", "20mm", "--fibres", path, "--write-fibres", tmp_path / "out.csv",
                         root / "meshes" / "liver_1k.msh", "-o", tmp_path / "out.msh", env=env)
    assert result.returncode == 2, result.stderr
    assert result.stderr.startswith(f"{path}:{line}: ") and expected in result.stderr
    assert not list(tmp_path.glob("out*"))
