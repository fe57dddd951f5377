"""`make install`, then programs outside the tree by pkg-config: C, C++, static, under valgrind."""
import json
import os
import shutil
import subprocess

import pytest


@pytest.fixture(scope="module")
def prefix(root, tmp_path_factory):
    prefix = tmp_path_factory.mktemp("prefix")
    run = subprocess.run(["make", "--no-print-directory", "install", f"PREFIX={prefix}"], cwd=root, capture_output=True, text=True, timeout=900)
    assert run.returncode == 0, run.stdout + run.stderr
    return prefix


def flags(prefix, *what):
    env = dict(os.environ, PKG_CONFIG_PATH=str(prefix / "lib/pkgconfig"))
    return subprocess.run(["pkg-config", *what, "tensormass"], env=env, capture_output=True, text=True, check=True).stdout.split()


def build(prefix, root, tmp_path, compiler, *extra):
    source = shutil.copy(root / "tests/install/block.c", tmp_path / ("block.c" if "++" not in compiler else "block.cpp"))
    program = tmp_path / "block"
    subprocess.run([compiler, "-Wall", "-Wextra", "-Werror", source, "-o", program, *flags(prefix, "--cflags", "--libs"),
                    f"-Wl,-rpath,{prefix}/lib", *extra], check=True)
    return program


@pytest.mark.parametrize("compiler", ["gcc", "g++", "clang"])
def test_a_program_outside_the_tree_simulates_a_block(prefix, root, tmp_path, compiler):
    run = subprocess.run([build(prefix, root, tmp_path, compiler)], capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stderr
    sag, left = run.stdout.split()
    assert -1e-2 < float(sag) < -1e-5, "the block does not sag"
    assert int(left) == 0, "bytes not given back to the allocator hook"
    assert run.stderr == ""


def test_it_leaks_nothing_and_reads_nothing_unset(prefix, root, tmp_path):
    program = build(prefix, root, tmp_path, "gcc", "-g")
    run = subprocess.run(["valgrind", "--quiet", "--leak-check=full", "--show-leak-kinds=all", "--error-exitcode=9", program],
                         capture_output=True, text=True, timeout=600)
    assert run.returncode == 0, run.stderr
    assert run.stderr == ""


def test_the_core_needs_libc_and_libm_alone_and_exports_its_prefix_alone(prefix):
    library = prefix / "lib/libtensormass.so"
    needed = subprocess.run(["readelf", "-d", library], capture_output=True, text=True, check=True).stdout
    wanted = {line.split("[")[1].rstrip("]") for line in needed.splitlines() if "(NEEDED)" in line}
    assert wanted <= {"libc.so.6", "libm.so.6"}, wanted
    # The second number breaks the interface until 1.0.
    assert "[libtensormass.so.0.1]" in needed and (prefix / "lib/libtensormass.so.0.1").exists()
    solve = subprocess.run(["readelf", "-d", prefix / "lib/libtensormass_solve.so"], capture_output=True, text=True, check=True).stdout
    assert "[libtensormass_solve.so.0.1]" in solve and "[libtensormass.so.0.1]" in solve
    symbols = subprocess.run(["nm", "-D", "--defined-only", library], capture_output=True, text=True, check=True).stdout.split("\n")
    foreign = [s.split()[-1] for s in symbols if s and not s.split()[-1].startswith("tm_")]
    assert not foreign, foreign
    imported = subprocess.run(["nm", "-D", "--undefined-only", library], capture_output=True, text=True, check=True).stdout
    for name in ("exit", "_exit", "printf", "puts", "fopen", "write"):
        assert f" {name}@" not in imported, f"the library calls {name}"
    # The default contract handler alone prints and aborts.
    objects = subprocess.run(["nm", "-A", "--undefined-only", prefix / "lib/libtensormass.a"], capture_output=True, text=True, check=True).stdout
    loud = {line.split(":")[1] for line in objects.splitlines() if line.split()[-1] in ("abort", "fprintf", "fwrite", "stderr")}
    assert loud == {"contract.o"}, loud


def test_installed_programs_run_away_from_the_tree(prefix, tmp_path):
    for program in sorted((prefix / "bin").iterdir()):
        run = subprocess.run([program, "--version"], cwd=tmp_path, capture_output=True, text=True, timeout=20)
        assert run.returncode == 0 and run.stdout.strip(), (program.name, run)


def test_installed_studies_find_their_references_and_scenes(prefix, tmp_path):
    """tm-accuracy's answers of CalculiX and its models' scenes, from a folder that holds nothing."""
    run = subprocess.run([prefix / "bin/tm-accuracy", "--quick", "--knob", "model", "--json", tmp_path / "a.json"], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    model = json.loads((tmp_path / "a.json").read_text())["model"]
    assert len(model["rows"]) > 3 and [p["model"] for p in model["prices"]] == ["tensor/mass", "hybrid", "precomputed"]
    run = subprocess.run([prefix / "bin/tm-accuracy", "--reference", "nowhere.json", "--json", tmp_path / "b.json"], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert run.returncode == 2 and "nowhere.json" in run.stderr
