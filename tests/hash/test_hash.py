"""The golden hash: the same bits from the library as it is built (gcc, optimised), from gcc that does not optimise, from clang, and on every run."""
import fcntl
import shutil
import subprocess

import pytest
from paths import BUILD, LONG

COMMON = ["-std=c11", "-D_GNU_SOURCE", "-ffp-contract=off", "-fno-math-errno", "-w", "-I.", "-Ilibtensormass/include", "-Ilibtensormass/src"]
BUILDS = {"built": ["gcc", "-O3", "-DNDEBUG"], "gcc -O0": ["gcc", "-O0"], "clang -O3": ["clang", "-O3", "-DNDEBUG"]}
LIBRARY = {"built": "release", "clang -O3": "clang"}  # config= of the Makefile with these flags


def library(root, config):
    """The core as a build of the Makefile has it; that of clang serves tests/sim/test_builds.py too: one make at a time."""
    if config == "release":
        return BUILD / "lib" / "libtensormass.a"
    with open(root / "build" / f"{config}.lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        made = subprocess.run(["make", "-s", f"config={config}", f"build/{config}/lib/libtensormass.a"], cwd=root, capture_output=True, text=True, timeout=600)
    assert made.returncode == 0, made.stderr[-4000:]
    return root / "build" / config / "lib" / "libtensormass.a"


def state_hash(root, once, name, command, story):
    if not shutil.which(command[0]):
        pytest.skip(f"{command[0]} is not installed; tools/setup.sh check")

    def compiled(folder):
        sources = [library(root, LIBRARY[name])] if name in LIBRARY else sorted(str(p.relative_to(root)) for p in (root / "libtensormass" / "src").rglob("*.c"))
        build = subprocess.run([*command, *COMMON, "tests/hash/state_hash.c", *sources, "-lm", "-o", folder / "state_hash"], cwd=root, capture_output=True, text=True, timeout=900)
        assert build.returncode == 0, build.stderr[-4000:]

    program = once("hash-" + name.replace(" ", ""), compiled) / "state_hash"
    runs = 2 if LONG or name == "built" else 1  # of the others each is compared with these
    said = [subprocess.run([program, *story], cwd=root, capture_output=True, text=True, timeout=900, check=True).stdout.strip() for _ in range(runs)]
    assert len(set(said)) == 1, f"{name}: two runs differ"
    assert len(said[0]) == 16
    return said[0]


@pytest.mark.parametrize("story", [[], ["volume"], ["viscosity"], ["friction"], ["combinations"]],
                         ids=["linear", "volume", "viscosity", "friction", "combinations"])
def test_compilers_agree_on_every_bit(root, once, story):
    said = {name: state_hash(root, once, name, command, story) for name, command in BUILDS.items()}
    assert len(set(said.values())) == 1, said
