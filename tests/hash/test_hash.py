"""The golden hash: bit-identical results from the library as built (gcc, optimised), from other compilers and optimisation levels, and in every run."""
import shutil
import subprocess

import pytest
from paths import BUILD, LONG

COMMON = ["-std=c11", "-D_GNU_SOURCE", "-ffp-contract=off", "-fno-math-errno", "-w", "-I.", "-Ilibtensormass/include", "-Ilibtensormass/src"]
# Compilers with their options, and the Makefile's config= that has such a library. Every check compares the library as shipped with the AddressSanitizer build of another
# compiler, which is hardly optimised; `make check-long` also with clang's optimised build and gcc's unoptimised one.
BUILDS = {"built": (["gcc", "-O3", "-DNDEBUG"], "release"), "clang -O1": (["clang", "-O1", "-fsanitize=address,undefined"], "asan")}
if LONG:
    BUILDS |= {"gcc -O0": (["gcc", "-O0"], None), "clang -O3": (["clang", "-O3", "-DNDEBUG"], "clang")}
CORE = "lib/libtensormass.a"


def state_hash(root, once, make_config, name, story):
    command, config = BUILDS[name]
    if not shutil.which(command[0]):
        pytest.skip(f"{command[0]} is not installed; tools/setup.sh check")

    def compiled(folder):
        if config:
            sources = [(BUILD if config == "release" else make_config(config, CORE)) / CORE]
        else:
            sources = sorted((root / "libtensormass/src").rglob("*.c"))
        build = subprocess.run([*command, *COMMON, "tests/hash/state_hash.c", *sources, "-lm", "-o", folder / "state_hash"], cwd=root, capture_output=True, text=True, timeout=900)
        assert build.returncode == 0, build.stderr[-4000:]

    program = once("hash-" + name.replace(" ", ""), compiled) / "state_hash"
    runs = 2 if LONG or name == "built" else 1  # the other effects are compared with these
    said = [subprocess.run([program, *story], cwd=root, capture_output=True, text=True, timeout=900, check=True).stdout.strip() for _ in range(runs)]
    assert len(set(said)) == 1, f"{name}: two runs differ"
    assert len(said[0]) == 16
    return said[0]


@pytest.mark.parametrize("story", [[], ["volume"], ["viscosity"], ["friction"], ["combinations" if LONG else "pairs"]],
                         ids=["linear", "volume", "viscosity", "friction", "combinations"])
def test_compilers_agree_on_every_bit(root, once, make_config, story):
    said = {name: state_hash(root, once, make_config, name, story) for name in BUILDS}
    assert len(set(said.values())) == 1, said
