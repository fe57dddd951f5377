"""The examples of docs/library-guide.md compile without a warning as C and as C++, and do what the page says."""
import re
import subprocess

import pytest

COMPILERS = pytest.mark.parametrize("compiler", [["gcc", "-std=c11"], ["g++", "-std=c++17", "-x", "c++"]], ids=["C", "C++"])


def run_example(root, build, folder, compiler, number, libraries):
    code = re.findall(r"^```c\n(.*?)^```", (root / "docs" / "library-guide.md").read_text(), re.M | re.S)[number]
    source, program = folder / "example.c", folder / "example"
    source.write_text(code)
    subprocess.run([*compiler, "-Wall", "-Wextra", "-Werror", f"-I{root}/libtensormass/include", source, "-x", "none", *libraries, build / "lib" / "libtensormass.a", "-lm",
                    "-o", program], check=True, timeout=120)
    run = subprocess.run([program], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0 and run.stderr == ""
    return run.stdout


@COMPILERS
def test_example_compiles_and_runs(root, build, tmp_path, compiler):
    out = run_example(root, build, tmp_path, compiler, 0, [])
    borne = float(re.search(r"bears ([0-9.]+) N", out).group(1))
    assert borne == pytest.approx(1060 * 1e-6 * 9.81, rel=1e-3)


@COMPILERS
def test_one_interface_runs_three_models(root, build, tmp_path, compiler):
    solve = [build / "lib" / "libtensormass_solve.a", "-lcholmod", "-lsuitesparseconfig", "-lstdc++", "-lpthread"]
    out = run_example(root, build, tmp_path, compiler, 1, ["-Wl,--start-group", *solve, build / "lib" / "libtensormass.a", "-Wl,--end-group"])
    rows = {m[0]: [float(x) for x in m[1:]] for m in
            re.findall(r"^(\w+) +(\d+) substeps of [0-9.]+ ms: ([0-9.]+) N, (-[0-9.]+) N/m \(kind (\d)\), patch of (\d+) triangles of (\d+)$", out, re.M)}
    assert list(rows) == ["dynamic", "precomputed", "hybrid"]
    assert rows["precomputed"][0] == 1 < rows["hybrid"][0] and [rows[m][3] for m in rows] == [1, 2, 2]
    for substeps, force, stiffness, kind, triangles, surface in rows.values():
        assert force == pytest.approx(rows["precomputed"][1], rel=1e-3) and stiffness == pytest.approx(rows["precomputed"][2], rel=0.02)
        assert 0 < triangles <= 32 < surface == rows["dynamic"][5]
