"""`make cross`, `make wheels`: programs for other machines print the same as here, under qemu-user (bit-identical in the plain form) and wine."""
import os
import re
import shutil
import subprocess
import sys
import zipfile

import pytest

RUNNERS = {"aarch64-linux": ("qemu-aarch64-static", ["-L", "/usr/aarch64-linux-gnu"], ""), "x86_64-windows": ("wine", [], ".exe")}
STORIES = [[], ["volume"], ["viscosity"]]
FLAGS = ["-std=c11", "-D_GNU_SOURCE", "-O2", "-ffp-contract=off", "-fno-math-errno", "-w", "-I.", "-Ilibtensormass/include", "-Ilibtensormass/io/include", "-Ilibtensormass/src", "-Ihaptic_rt/core"]


def said(command, cwd, wine=None):
    environment = dict(os.environ, WINEDEBUG="-all", **({"WINEPREFIX": str(wine)} if wine else {}))
    run = subprocess.run([str(c) for c in command], cwd=cwd, env=environment, capture_output=True, text=True, timeout=900)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout.replace("\r", "").splitlines()


@pytest.fixture(scope="module")
def here(root, build, tmp_path_factory):
    """Returns this machine's output: the one program and the sequences of the golden hash."""
    folder = tmp_path_factory.mktemp("here")
    libraries = [build / "lib" / name for name in ("libtensormass_io.a", "libtensormass.a", "libhrt.a")]
    for source in ("tests/cross/everywhere.c", "tests/hash/state_hash.c"):
        subprocess.run(["gcc", *FLAGS, source, *libraries, "-lm", "-o", folder / source.split("/")[-1][:-2]], cwd=root, check=True, timeout=600)
    return said([folder / "everywhere", "scratch.msh"], folder), folder


def test_programs_run_on_this_machine(here):
    lines, _ = here
    assert len(lines) == 4 and lines[0].startswith("version 0.2.0, forces ") and lines[3].startswith("nowhere/a.msh: cannot open: ")


@pytest.fixture(scope="module")
def crossed(root, make_once):
    make_once("cross")
    return root / "build/cross"


@pytest.mark.long
@pytest.mark.parametrize("target", RUNNERS)
def test_other_machines_print_the_same_bits(here, crossed, target, tmp_path):
    runner, words, ending = RUNNERS[target]
    if not shutil.which(runner):
        pytest.skip(f"{runner} is not here; apt-get install qemu-user-static libc6-arm64-cross wine wine64")
    lines, folder = here
    if runner == "wine":
        said(["wineboot", "-i"], tmp_path, tmp_path / "wine")
    assert said([runner, *words, crossed / target / f"everywhere{ending}", "scratch.msh"], tmp_path, tmp_path / "wine") == lines
    for story in STORIES:
        there = [runner, *words, crossed / target / f"state_hash{ending}", *story]
        if runner == "wine":  # another C library's sine rotates the tool: other bits, but always the same
            assert re.fullmatch("[0-9a-f]{16}", said(there, tmp_path, tmp_path / "wine")[0]) and said(there, tmp_path, tmp_path / "wine") == said(there, tmp_path, tmp_path / "wine")
        else:
            assert said(there, tmp_path) == said([folder / "state_hash", *story], folder), story


@pytest.mark.long
@pytest.mark.parametrize("target, triple", [("aarch64-linux", "aarch64-linux-gnu.2.28"), ("x86_64-windows", "x86_64-windows-gnu")])
def test_struct_layouts_equal_those_in_the_wheel(root, crossed, target, triple, tmp_path):
    """Struct sizes, which python/bind.py measures here and writes into every wheel, as measured by the other machine's compiler and run there."""
    runner, words, ending = RUNNERS[target]
    if not shutil.which(runner):
        pytest.skip(f"{runner} is not here; apt-get install qemu-user-static libc6-arm64-cross wine wine64")
    include = ["libtensormass/include", "libtensormass/io/include", "haptic_rt/core"]
    script = f"""
import sys; sys.path.insert(0, "python")
import bind
print(bind.read("cc", {include}, [("a", "libtensormass/include/tensormass.h"), ("b", "libtensormass/io/include/tensormass_io.h"), ("c", "haptic_rt/core/hrt.h")])[1])
"""
    tool = root / "build/wheel/venv/bin/python"
    if not tool.exists():
        subprocess.run(["make", "--no-print-directory", "build/wheel/venv/.done"], cwd=root, check=True, timeout=600)
    program = tmp_path / "layout.c"
    program.write_text(subprocess.run([tool, "-c", script], cwd=root, capture_output=True, text=True, check=True).stdout)
    flags = ["-std=gnu11", "-w", *(f"-I{i}" for i in include), str(program)]
    subprocess.run(["gcc", *flags, "-o", tmp_path / "here"], cwd=root, check=True)
    subprocess.run([root / "build/cross/venv/bin/python", "-m", "ziglang", "cc", "-target", triple, *flags, "-o", tmp_path / f"there{ending}"], cwd=root, check=True)
    told = said([runner, *words, tmp_path / f"there{ending}"], tmp_path, tmp_path / "wine")
    assert len(told) > 300 and told == said([tmp_path / "here"], tmp_path)


@pytest.mark.long
@pytest.mark.parametrize("target, magic", [("aarch64-macos", b"\xcf\xfa\xed\xfe\x0c\x00\x00\x01"), ("x86_64-macos", b"\xcf\xfa\xed\xfe\x07\x00\x00\x01")])
def test_macos_builds(crossed, target, magic):
    for name in ("libtensormass", "libtensormass_io", "libtensormass_controller"):
        assert (crossed / target / f"{name}.dylib").read_bytes()[:8] == magic


WHEELS = {"win_amd64": ".dll", "manylinux_2_28_aarch64": ".so.0.2", "macosx_11_0_arm64": ".0.2.dylib", "macosx_11_0_x86_64": ".0.2.dylib"}
USED = """
import numpy as np
import tensormass as tm
import tensormass._core as core
block = tm.Mesh.block((0.06, 0.06, 0.03), (4, 4, 2))
world = tm.World(tm.Tissue(block, tm.Material.young(5e3, 0.45, density_kg_m3=1060, damping_1_s=40), form="plain"))
world.add_support(block.near((0, 0, 0), (0, 0, 1)))
world.add_gravity((0, 0, -9.81))
world.step(100)
liver = tm.Mesh.read("meshes/liver_1k.msh")
assert tm.parameters().force_max_N > 8
print(world.u_m.tobytes().hex(), liver.tet_count, core.platform.machine())
"""


@pytest.fixture(scope="module")
def wheels(root, crossed, make_once):
    make_once("wheels")
    return {tag: next(iter((root / "build/wheel").glob(f"*-py3-none-{tag}.whl")), None) for tag in WHEELS}


@pytest.mark.long
@pytest.mark.parametrize("tag", WHEELS)
def test_each_platform_has_a_wheel(wheels, tag):
    """Three libraries under the names by which they load each other, and the package."""
    with zipfile.ZipFile(wheels[tag]) as wheel:
        names = wheel.namelist()
    assert {n for n in names if "/lib/" in n} == {f"tensormass/lib/lib{n}{WHEELS[tag]}" for n in ("tensormass", "tensormass_io", "tensormass_controller")}
    assert "tensormass/_bind.py" in names and "tensormass/py.typed" in names


@pytest.mark.long
def test_arm64_wheel_gives_the_same_bits(root, wheels, tmp_path):
    """Runs in Debian's Python for arm64, unpacked into a folder and run by qemu-user: bit-identical displacements."""
    if not shutil.which("qemu-aarch64-static"):
        pytest.skip("qemu-aarch64-static is not here; apt-get install qemu-user-static")
    system = arm64_python(tmp_path)
    with zipfile.ZipFile(wheels["manylinux_2_28_aarch64"]) as wheel:
        wheel.extractall(tmp_path / "there")
    own, = (root / "build/wheel").glob("*linux*_x86_64.whl")
    subprocess.run([sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--target", tmp_path / "here", own], check=True)
    environment = {"LC_ALL": "C.UTF-8", "OPENBLAS_NUM_THREADS": "1"}
    there = subprocess.run(["qemu-aarch64-static", "-L", system, "-E", f"LD_LIBRARY_PATH={system}/usr/lib/aarch64-linux-gnu/blas:{system}/usr/lib/aarch64-linux-gnu/lapack", system / "usr/bin/python3.11", "-c", USED],
                           cwd=root, env={**environment, "PYTHONPATH": f"{tmp_path / 'there'}:{system / 'usr/lib/python3/dist-packages'}", "PYTHONHOME": str(system / "usr")},
                           capture_output=True, text=True, timeout=900)
    here = subprocess.run([sys.executable, "-c", USED], cwd=root, env={**os.environ, **environment, "PYTHONPATH": str(tmp_path / "here")}, capture_output=True, text=True, timeout=900)
    assert there.returncode == 0 and here.returncode == 0, there.stderr + here.stderr
    assert there.stdout.split()[1:] == [here.stdout.split()[1], "aarch64"] and len(there.stdout) > 3600
    assert there.stdout.split()[0] == here.stdout.split()[0]


def arm64_python(folder):
    """Unpacks Debian's packages of python3-numpy and its dependencies; fetches them by an apt configuration of its own, not this system's."""
    apt = folder / "apt"
    for part in ("state/lists/partial", "cache/archives/partial", "dpkg"):
        (apt / part).mkdir(parents=True)
    (apt / "dpkg/status").write_text("")
    options = [f"-oDir::State={apt}/state", f"-oDir::Cache={apt}/cache", f"-oDir::State::status={apt}/dpkg/status", "-oAPT::Architecture=arm64", "-oAPT::Architectures=arm64",
               "-oAPT::Sandbox::User=root", "-oAcquire::Languages=none"]
    for command in (["update", "-q"], ["install", "-q", "-y", "--download-only", "--no-install-recommends", "python3-numpy", "python3.11"]):
        run = subprocess.run(["apt-get", *options, *command], capture_output=True, text=True, timeout=1200)
        assert run.returncode == 0, run.stdout[-2000:] + run.stderr[-2000:]
    for package in sorted((apt / "cache/archives").glob("*.deb")):
        subprocess.run(["dpkg-deb", "-x", package, folder / "system"], check=True)
    return folder / "system"
