"""libtensormass_scene in other programs: the C example of docs/scene-guide.md, the C++ interface, diagnostics, and the bits of tm-sim."""
import json
import os
import re
import subprocess

import pytest

HEADERS = ("libtensormass/include", "libtensormass/scene/include")
FACE = r"""
#include <cstdio>
#include "tensormass_scene.hpp"
int main(int count, char **word) {
    try {
        tensormass::scene opened(word[1], {word + 2, word + count}), scene = std::move(opened);
        for (const tm_diagnostic &d : scene.diagnostics()) std::printf("%d|%s|%d|%s|%s\n", d.severity, d.file, d.line, d.what, d.remedy);
        while (scene.about().time_s < scene.about().duration_s - 1e-9)
            if (scene.step() != TM_OK) return 2;
        std::printf("%016llx %zu\n", static_cast<unsigned long long>(scene.hash()), scene.u_m().size());
        return opened ? 3 : 0;
    } catch (const tensormass::error &e) {
        std::printf("%s %s\n", tm_status_name(e.status()), e.what());
        return 1;
    }
}
"""
CONTRACTS = r"""
#include <stdio.h>
#include "tensormass_scene.h"
static void heard(const char *function, const char *sentence, void *user) {
    (void)user;
    printf("%s: %s\n", function, sentence);
}
int main(int count, char **word) {
    const char *const set[] = {"haptics"};
    const double joint[7] = {0};
    tm_scene *scene = NULL;
    tm_scene_def def = tm_scene_def_default();
    def.file = word[count - 1], def.set = set, def.set_count = 1;
    if (tm_scene_open(&def, &scene)) return 1;
    tm_set_contract_handler(heard, NULL);
    for (int i = -1; i < 2; i += 2) {
        const tm_tool_pose to = tm_scene_pose_of(scene, i, joint, true);
        const tm_tool_pose at = tm_scene_pose(scene, i);
        const tm_tool_reaction felt = tm_scene_reaction(scene, i);
        const tm_instrument_def tool = tm_scene_instrument(scene, i);
        if (to.active || at.active || felt.row_count || tool.radius_m > 0 || tm_scene_patch(scene, i)) return 2;
    }
    tm_scene_pose_of(scene, 0, NULL, true);
    if (tm_scene_step(NULL, NULL) != TM_ERR_ARGUMENT || tm_scene_save(scene, NULL) != TM_ERR_ARGUMENT || tm_scene_restore(NULL, "s") != TM_ERR_ARGUMENT) return 3;
    if (tm_scene_mesh(NULL) || tm_scene_tissue(NULL) || tm_scene_world(NULL) || tm_scene_contact(NULL) || tm_scene_displacement(NULL) || tm_scene_hash(NULL)) return 4;
    if (tm_scene_get_info(NULL).vertex_count || tm_scene_surface(NULL).count) return 5;
    tm_scene_close(scene);
    return 0;
}
"""
RESTORED = r"""
#include <string.h>
#include <tensormass_scene.h>
int main(int count, char **word) {
    const char *const set[] = {"haptics"};
    tm_scene_def def = tm_scene_def_default();
    tm_scene *scene, *again;
    if (count != 3) return 2;
    def.file = word[1], def.set = set, def.set_count = 1;
    if (tm_scene_open(&def, &scene) || tm_scene_open(&def, &again)) return 3;
    for (int i = 0; i < 30; i++)
        if (tm_scene_step(scene, NULL)) return 4;
    if (tm_scene_save(scene, word[2]) || tm_scene_restore(again, word[2])) return 5;
    const tm_tool_reaction was = tm_scene_reaction(scene, 0), is = tm_scene_reaction(again, 0);
    if (!(was.force_N[2] > 0.05) || was.row_count == 0) return 6;
    return memcmp(was.force_N, is.force_N, sizeof is.force_N) || was.row_count != is.row_count ? 1 : 0;
}
"""

ENVIRONMENT = r"""
#include <stdlib.h>
#include <tensormass_scene.h>
int main(int count, char **word) {
    const char *const set[] = {"haptics", "model=precomputed", "precomputed={cache: no}"};
    tm_scene_def def = tm_scene_def_default();
    tm_scene *scene;
    def.file = word[count - 1], def.set = set, def.set_count = 3;
    if (tm_scene_open(&def, &scene)) return 1;
    tm_scene_close(scene);
    return getenv("OPENBLAS_NUM_THREADS") ? 2 : 0;
}
"""


def run(*words, code=0, **options):
    out = subprocess.run([str(w) for w in words], capture_output=True, text=True, timeout=400, **options)
    assert out.returncode == code, out.stdout[-4000:] + out.stderr[-4000:]
    return out


@pytest.fixture(scope="module")
def press(root, build, once):
    def made(folder):
        libraries = [build / f"lib/libtensormass{n}.a" for n in ("_scene", "_io", "")]
        run("gcc", "-std=c11", "-Wall", "-Wextra", "-Werror", *(f"-I{root / h}" for h in HEADERS), root / "examples/scene/press.c", *libraries, "-lyaml", "-ldl", "-lm", "-o", folder / "press")
    return once("scene-press", made) / "press"


@pytest.fixture(scope="module")
def face(root, build, once):
    def made(folder):
        (folder / "face.cpp").write_text(FACE)
        run("g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", *(f"-I{root / h}" for h in HEADERS), folder / "face.cpp", f"-L{build}/lib", f"-Wl,-rpath,{build}/lib", "-ltensormass_scene", "-ltensormass",
            "-o", folder / "face")
    return once("scene-face", made) / "face"


def test_a_restored_scene_has_the_reactions_of_the_snapshot(root, build, tmp_path):
    (tmp_path / "restored.c").write_text(RESTORED)
    libraries = [build / f"lib/libtensormass{n}.a" for n in ("_scene", "_io", "")]
    run("gcc", "-std=c11", "-Wall", "-Wextra", "-Werror", *(f"-I{root / h}" for h in HEADERS), tmp_path / "restored.c", *libraries, "-lyaml", "-ldl", "-lm", "-o", tmp_path / "restored")
    run(tmp_path / "restored", root / "apps/scenes/block-press.yaml", tmp_path / "kept")


def test_a_precomputed_scene_leaves_the_environment_alone(root, build, tmp_path):
    (tmp_path / "environment.c").write_text(ENVIRONMENT)
    run("gcc", "-std=c11", "-Wall", "-Wextra", "-Werror", *(f"-I{root / h}" for h in HEADERS), tmp_path / "environment.c", f"-L{build}/lib", f"-Wl,-rpath,{build}/lib", "-ltensormass_scene", "-ltensormass",
        "-o", tmp_path / "environment")
    run(tmp_path / "environment", root / "apps/scenes/block-press.yaml", env={k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"})


def test_the_guides_program_presses(root, press):
    out = run(press, root / "apps/scenes/block-press.yaml", "haptics")
    assert out.stderr == ""
    title, force = re.fullmatch(r"(.*): dynamic, 1176 tetrahedra, \d+ substeps of \d+ us\nat most ([0-9.]+) N up; state [0-9a-f]{16}\n", out.stdout).groups()
    assert title == "A block pressed by a probe" and 0.05 < float(force) < 10


def test_the_page_shows_that_program(root):
    source = " ".join((root / "examples/scene/press.c").read_text().split())
    shown = re.findall(r"^```c\n(.*?)^```", (root / "docs/scene-guide.md").read_text(), re.M | re.S)
    assert len(shown) == 2 and all(" ".join(text.split()) in source for text in shown)


@pytest.mark.parametrize("changed, says", [("young: 5 kPa", r"scene.yaml:7: .*young.*; .+"), ("mode: prod", r"scene.yaml:13: .*'prod' is not allowed; use one of: probe grasper cautery"), ("", r"scene.yaml:1: the scene is empty; .+")])
def test_fault_prints_one_line(root, bin, press, tmp_path, changed, says):
    """Faults have the program's own place and remedy, status 1, and no other output than the program's."""
    text = (root / "apps/scenes/block-press.yaml").read_text().replace("../../meshes", str(root / "meshes"))
    new = {"young: 5 kPa": text.replace("young: 5 kPa", "young: 5 kg"), "mode: prod": text.replace("mode: probe", "mode: prod"), "": ""}[changed]
    (tmp_path / "scene.yaml").write_text(new)
    out = run(press, tmp_path / "scene.yaml", code=1)
    assert out.stdout == "" and re.fullmatch(f".*/{says}\n", out.stderr), out.stderr
    assert run(bin / "tm-sim", tmp_path / "scene.yaml", "--check", code=2).stderr == out.stderr


def test_cpp_has_the_bits_of_tm_sim(root, bin, face, tmp_path):
    scene = root / "apps/scenes/block-press.yaml"
    sets = ("time.duration=0.8 s", "tissue.renumber=no")
    run(bin / "tm-sim", scene, "--lockstep", "--unset", "haptics", *(w for s in sets for w in ("--set", s)), "--quiet", "--json", tmp_path / "run.json")
    out = run(face, scene, "haptics", *sets)
    hash_, numbers = out.stdout.split()
    assert hash_ == json.loads((tmp_path / "run.json").read_text())["state_hash"] and int(numbers) % 3 == 0 and out.stderr == ""


def test_warnings_are_diagnostics(root, face):
    out = run(face, root / "apps/scenes/block-press.yaml", "haptics", "time.duration=0.04 s", "anisotropy={rule: constant}")
    severity, file, line, what, remedy = out.stdout.splitlines()[0].split("|")
    assert (severity, file, line) == ("1", "--set anisotropy={rule: constant}", "0") and out.stderr == ""
    assert what.startswith("fibres have no effect") and remedy.startswith("give a material")


def test_exception_carries_the_fault(root, face):
    out = run(face, root / "apps/scenes/block-press.yaml", "tissue.mesh=nowhere.msh", code=1)
    assert re.match(r"TM_ERR_\w+ --set tissue.mesh=nowhere.msh: tissue.mesh: nowhere.msh cannot be read: .*; correct the path \(it is relative to the working folder\)", out.stdout) and out.stderr == ""


def test_broken_contracts_reach_the_handler(root, build, tmp_path):
    """A missing instrument, and null: reported once each, and the call returns nothing."""
    (tmp_path / "contracts.c").write_text(CONTRACTS)
    run("gcc", "-std=c11", "-Wall", "-Wextra", "-Werror", *(f"-I{root / h}" for h in HEADERS), tmp_path / "contracts.c", *(build / f"lib/libtensormass{n}.a" for n in ("_scene", "_io", "")), "-lyaml", "-ldl", "-lm",
        "-o", tmp_path / "contracts")
    told = [line.split(":")[0].removeprefix("tm_scene_") for line in run(tmp_path / "contracts", root / "apps/scenes/block-press.yaml").stdout.splitlines()]
    assert told == [*("pose_of", "pose", "reaction", "instrument", "patch") * 2, "pose_of", "step", "save", "restore", "mesh", "tissue", "world", "contact", "displacement", "hash", "get_info", "surface"]
