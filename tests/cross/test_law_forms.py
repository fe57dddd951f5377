"""Nonlinear laws, and rotation in single precision, on arm64 under qemu-user: the NEON forms have the plain form's bits, and those of this machine."""
import shutil
import subprocess

import pytest

FLAGS = ["-std=c11", "-D_GNU_SOURCE", "-O1", "-DNDEBUG", "-ffp-contract=off", "-fno-math-errno", "-w", "-I.", "-Ilibtensormass/include", "-Ilibtensormass/src"]


def hashes(run):
    assert run.returncode == 0, run.stdout + run.stderr
    *laws, compared = run.stdout.splitlines()
    assert len(laws) == 6 and len(set(laws)) == 6
    return laws, int(compared.split()[1])


def test_neon_forms_of_laws_have_the_same_bits(root, build, tmp_path):
    if not shutil.which("aarch64-linux-gnu-gcc") or not shutil.which("qemu-aarch64"):
        pytest.skip("aarch64-linux-gnu-gcc or qemu-aarch64 is not installed; tools/setup.sh check")
    here, there = tmp_path / "here", tmp_path / "there"
    subprocess.run(["gcc", *FLAGS, "tests/cross/laws.c", build / "lib/libtensormass.a", "-lm", "-lpthread", "-o", here], cwd=root, check=True, timeout=300)
    folders = [root / "libtensormass/src" / room for room in ("base", "material", "mesh")]
    sources = [*(s for f in folders for s in sorted(f.glob("*.c"))), "libtensormass/src/tissue/force.c"]  # the force loop has a NEON form too
    subprocess.run(["aarch64-linux-gnu-gcc", "-static", "-ffunction-sections", "-Wl,--gc-sections", *FLAGS, "tests/cross/laws.c", *sources, "-lm", "-lpthread", "-o", there], cwd=root, check=True, timeout=900)
    laws, forms = hashes(subprocess.run([here], capture_output=True, text=True, timeout=60))
    arm_laws, arm_forms = hashes(subprocess.run(["qemu-aarch64", there], capture_output=True, text=True, timeout=300))
    assert arm_laws == laws
    assert arm_forms == 44  # five laws at four strains, in double and in single, and rotation in single: one form beside the plain one
    assert forms in (0, 44, 64)  # AVX2 in both, AVX-512 in double, as this processor has them
