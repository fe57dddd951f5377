"""A law is one file and one row: a scratch build adds yeoh_law.h and its row, and nothing else. The harness of all laws then checks it: energy against
force, force against tangent, objectivity, symmetry, bound, forms, limits, inversion, single precision. tm-sim reads its name and its constant."""
import concurrent.futures
import os
import re
import shutil
import subprocess

import pytest

ROW = "    ROW(HOLZAPFEL, holzapfel)\n"
SOURCES = ("law_facts", "hyperelastic", "hyperelastic_single", "hyperelastic_law", "law")  # what includes the table's files
HARNESS = ("test_laws", "test_law_bound", "test_law_limits", "test_law_single")
LIBRARIES = ("sim", "app", "tensormass_scene", "platform", "tensormass_io", "tensormass", "hrt_device", "hrt_motion", "hrt_io", "hrt", "lcm_types")

pytestmark = pytest.mark.skipif("TM_SANITIZER" in os.environ, reason="links objects of its own with the build's libraries")


def run(*words, **more):
    return subprocess.run([str(w) for w in words], capture_output=True, text=True, **more)


def must(*words, **more):
    done = run(*words, **more)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def scratch(root, once):
    """Returns (folder, compile): the sources of the laws with one more file and row."""
    def compiler(folder):
        include = [f"-I{d}" for d in (folder / "include", folder, root / "libtensormass/src", root)]
        return lambda source, to: must("cc", "-std=c11", "-D_GNU_SOURCE", "-Og", "-ffp-contract=off", "-fno-math-errno", "-fvisibility=hidden", "-fPIC", "-w", *include, "-c", source, "-o", to)

    def make(folder):
        shutil.copytree(root / "libtensormass/src/material", folder / "material")
        shutil.copytree(root / "libtensormass/include", folder / "include")
        shutil.copy(root / "tests/physics/yeoh_law.h", folder / "material")
        table = folder / "include/tensormass/material.h"
        text = table.read_text()
        assert text.count(ROW) == 1
        table.write_text(text.replace(ROW, ROW.rstrip() + " ROW(YEOH, yeoh)\n"))
        compiled = compiler(folder)
        with concurrent.futures.ThreadPoolExecutor(2) as pool:
            made = [pool.submit(compiled, folder / "material" / f"{s}.c", folder / f"{s}.o") for s in SOURCES]
            made += [pool.submit(compiled, root / f"tests/physics/{t}.c", folder / f"{t}.o") for t in HARNESS]
            for m in made:
                m.result()

    folder = once("law", make)
    return folder, compiler(folder)


def linked(folder, build, test, law="law_facts.o"):
    objects = [folder / law, *(folder / f"{s}.o" for s in SOURCES[1:])]
    program = folder / f"{test}-{law}.run"  # the folder is shared by processes
    must("cc", folder / f"{test}.o", *objects, build / "lib/libtensormass.a", "-lcmocka", "-lm", "-lpthread", "-o", program)
    return run(program, env={**os.environ, "TM_LAW": "yeoh"})


@pytest.mark.parametrize("test", HARNESS)
def test_the_harness_checks_the_new_law(scratch, build, test):
    done = linked(scratch[0], build, test)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "yeoh" in done.stdout or test == "test_law_single"


def test_the_harness_finds_a_bound_that_is_too_low(scratch, build):
    folder, compiled = scratch
    law = folder / "material/yeoh_law.h"
    right = law.read_text()
    law.write_text(right.replace("1.5 * k * (most - 1)", "0.2 * k * (most - 1)"))
    assert law.read_text() != right
    compiled(folder / "material/law_facts.c", folder / "low.o")
    law.write_text(right)
    done = linked(folder, build, "test_law_bound", "low.o")
    assert done.returncode != 0 and "FAILED" in done.stdout + done.stderr


def test_scenes_have_the_new_law(scratch, root, build, tmp_path):
    folder, _ = scratch
    (tmp_path / "bin").mkdir()
    (tmp_path / "lib").symlink_to(build / "lib")  # modules
    sim = tmp_path / "bin/tm-sim"
    must("cc", "-rdynamic", "-o", sim, build / "obj/apps/sim/main.o", *(folder / f"{s}.o" for s in SOURCES), "-Wl,--start-group",
         *(build / f"lib/lib{name}.a" for name in LIBRARIES), "-Wl,--end-group", "-lyaml", "-lcjson", "-ldl", "-lm", "-lpthread")
    reference = must(sim, "--schema", "markdown")
    assert "holzapfel, yeoh" in reference and "| `tissue.materials.*.power` | number | 0.2 | 0 to 1 | `yeoh`: stiffness" in reference
    scene = [root / "apps/scenes/block-press.yaml", "--explain", "--set", "tissue.materials.*.law=yeoh"]
    steps = [re.search(r"critical step ([\d.e-]+) s", must(sim, *scene, "--set", f"tissue.materials.*.power={power}")).group(1) for power in (0, 1)]
    assert float(steps[1]) != float(steps[0])
    for more, said in (("power=2", "power = 2 is outside 0 to 1"), ("law=fung", "needs 'C'"), ("law=neo-hooke", "'power' belongs to the law 'yeoh'")):
        done = run(sim, *scene, "--set", "tissue.materials.*.power=0.3", "--set", f"tissue.materials.*.{more}")
        assert done.returncode == 2 and said in done.stderr, done.stdout + done.stderr
