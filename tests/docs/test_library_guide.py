"""The examples of docs/library-guide.md and library-models.md compile without warnings as C and C++, and do what the page states."""
import re
import subprocess

import pytest

COMPILERS = pytest.mark.parametrize("compiler", [["gcc", "-std=c11"], ["g++", "-std=c++17", "-x", "c++"]], ids=["C", "C++"])


def run_example(root, build, folder, compiler, number, libraries, words=(), code=0):
    text = re.findall(r"^```c\n(.*?)^```", "".join((root / "docs" / page).read_text() for page in ("library-guide.md", "library-api.md", "library-models.md")), re.M | re.S)[number]
    source, program = folder / "example.c", folder / "example"
    source.write_text(text)
    subprocess.run([*compiler, "-Wall", "-Wextra", "-Werror", f"-I{root}/libtensormass/include", f"-I{root}/libtensormass/io/include", source, "-x", "none", *libraries, build / "lib" / "libtensormass.a", "-lm",
                    "-o", program], check=True, timeout=400)
    run = subprocess.run([program, *words], capture_output=True, text=True, timeout=400)
    assert run.returncode == code and (run.stderr == "") == (code == 0)
    return run.stdout + run.stderr


@COMPILERS
def test_example_compiles_and_runs(root, build, tmp_path, compiler):
    out = run_example(root, build, tmp_path, compiler, 0, [])
    borne = float(re.search(r"bears ([0-9.]+) N", out).group(1))
    assert borne == pytest.approx(1060 * 1e-6 * 9.81, rel=1e-3)


@COMPILERS
def test_one_interface_runs_three_models(root, build, tmp_path, compiler):
    solve = [build / "lib" / "libtensormass_solve.a", "-lcholmod", "-lsuitesparseconfig", "-lblas", "-lstdc++", "-lpthread"]
    out = run_example(root, build, tmp_path, compiler, 1, ["-Wl,--start-group", *solve, build / "lib" / "libtensormass.a", "-Wl,--end-group"])
    rows = {m[0]: [float(x) for x in m[1:]] for m in
            re.findall(r"^(\w+) +(\d+) substeps of [0-9.]+ ms: ([0-9.]+) N, (-[0-9.]+) N/m \(kind (\d)\), patch of (\d+) triangles of (\d+)$", out, re.M)}
    assert list(rows) == ["dynamic", "precomputed", "hybrid"]
    assert rows["precomputed"][0] == 1 < rows["hybrid"][0] and [rows[m][3] for m in rows] == [1, 2, 2]
    for substeps, force, stiffness, kind, triangles, surface in rows.values():
        assert force == pytest.approx(rows["precomputed"][1], rel=1e-3) and stiffness == pytest.approx(rows["precomputed"][2], rel=0.02)
        assert 0 < triangles <= 32 < surface == rows["dynamic"][5]


@COMPILERS
def test_a_mesh_and_its_fibres_come_from_files(root, build, tmp_path, compiler):
    fibres, damaged = tmp_path / "fibres.csv", tmp_path / "damaged.msh"
    whole = (root / "meshes/cylinder_1k.msh").read_text()
    fibres.write_text("tet,ax,ay,az\n" + "".join(f"{t},0,0,{1 + t}\n" for t in range(1134)))
    damaged.write_text(whole[:len(whole) // 2])

    def example(*words, code=0):
        return run_example(root, build, tmp_path, compiler, 2, [build / "lib" / "libtensormass_io.a"], words, code)
    out = example(root / "meshes/cylinder_1k.msh", fibres)
    assert re.match(r"1134 tetrahedra, 1 regions \(\w+\), \d+ groups; fibre 0 0 1\n", out), out
    lines = whole[:len(whole) // 2].count("\n") + 1
    assert re.match(rf"{damaged}:{lines}: .*; .*save it again\n$", example(damaged, fibres, code=1))
    fibres.write_text("tet,ax,ay,az\n0,0,0,1\n1,0,0,zero\n")
    assert f"{fibres}:3: tetrahedron 1 expected here: a row is tet,ax,ay,az; correct the row" in example(root / "meshes/cylinder_1k.msh", fibres, code=1)
