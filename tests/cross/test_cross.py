"""`make cross`: what was compiled for other machines says what this one says, bit for bit in the plain form, under qemu-user and wine."""
import os
import shutil
import subprocess

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
    """What this machine says: the one program and the stories of the golden hash."""
    folder = tmp_path_factory.mktemp("here")
    libraries = [build / "lib" / name for name in ("libtensormass_io.a", "libtensormass.a", "libhrt.a")]
    for source in ("tests/cross/everywhere.c", "tests/hash/state_hash.c"):
        subprocess.run(["gcc", *FLAGS, source, *libraries, "-lm", "-o", folder / source.split("/")[-1][:-2]], cwd=root, check=True, timeout=200)
    return said([folder / "everywhere", "scratch.msh"], folder), folder


def test_this_machine(here):
    lines, _ = here
    assert len(lines) == 4 and lines[0].startswith("version 0.1.0, forces ") and lines[3].startswith("nowhere/a.msh: cannot open: ")


@pytest.fixture(scope="module")
def crossed(root):
    run = subprocess.run(["make", "--no-print-directory", "cross"], cwd=root, capture_output=True, text=True, timeout=3000)
    assert run.returncode == 0, run.stdout[-2000:] + run.stderr[-2000:]
    return root / "build/cross"


@pytest.mark.long
@pytest.mark.parametrize("target", RUNNERS)
def test_another_machine_says_the_same_to_the_bit(here, crossed, target, tmp_path):
    runner, words, ending = RUNNERS[target]
    if not shutil.which(runner):
        pytest.skip(f"{runner} is not here; apt-get install qemu-user-static libc6-arm64-cross wine wine64")
    lines, folder = here
    if runner == "wine":
        said(["wineboot", "-i"], tmp_path, tmp_path / "wine")
    assert said([runner, *words, crossed / target / f"everywhere{ending}", "scratch.msh"], tmp_path, tmp_path / "wine") == lines
    for story in STORIES:
        assert said([runner, *words, crossed / target / f"state_hash{ending}", *story], tmp_path, tmp_path / "wine") == said([folder / "state_hash", *story], folder), story


@pytest.mark.long
@pytest.mark.parametrize("target, magic", [("aarch64-macos", b"\xcf\xfa\xed\xfe\x0c\x00\x00\x01"), ("x86_64-macos", b"\xcf\xfa\xed\xfe\x07\x00\x00\x01")])
def test_macos_is_built_and_no_more(crossed, target, magic):
    for name in ("libtensormass", "libtensormass_io", "libtensormass_controller"):
        assert (crossed / target / f"{name}.dylib").read_bytes()[:8] == magic
