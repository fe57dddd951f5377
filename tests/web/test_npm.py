"""The npm package under node: the same bits as the native build, the controller, errors. `make web` builds it; the page is tested by test_page.py."""
import json
import shutil
import subprocess

import pytest
from paths import BUILD, LONG, ROOT

NPM = BUILD / "web/npm"
HERE = ROOT / "tests/web"
# Each with contact within the time; two with cuts, grasps and fibres in the long form.
SCENES = {"block-press": 1.0, "block-cut": 1.6}
if LONG:
    SCENES |= {"cylinder-fibre": 1.0, "evaluate-cautery": 2.0, "evaluate-fibred": 1.2, "evaluate-grasper": 1.6, "evaluate-two-cauteries": 1.2, "evaluate-two-hands": 1.6,
               "liver-cut": 3.0, "liver-dissect": 2.0, "liver-lift": 2.0, "liver-press": 2.0}
SET = {"haptics.compliance": "iterations"}

pytestmark = pytest.mark.skipif(not (NPM / "simd.js").is_file() or not shutil.which("node"), reason="the package for browsers is not built; make web")


def node(script, *arguments):
    ran = subprocess.run(["node", HERE / script, NPM, *map(str, arguments)], capture_output=True, text=True, timeout=600, cwd=ROOT)
    assert ran.returncode == 0, ran.stderr[-2000:]
    return json.loads(ran.stdout)


@pytest.mark.parametrize("scene", SCENES)
def test_both_forms_have_the_bits_of_the_native_build(scene, tmp_path):
    seconds, result = SCENES[scene], tmp_path / "run.json"
    subprocess.run([BUILD / "bin/tm-sim", f"apps/scenes/{scene}.yaml", "--lockstep", "--unset", "haptics", "--force", "plain", "--duration", f"{seconds} s",
                    "--json", result], check=True, capture_output=True, timeout=600, cwd=ROOT)
    native = json.loads(result.read_text())["state_hash"]
    for form in ("plain", "simd"):
        seen = node("scene_hash.mjs", form, f"apps/scenes/{scene}.yaml", seconds, "haptics")
        assert seen["form"] == form
        assert seen["hash"] == native, f"{form}: {seen['hash']} where tm-sim has {native}"
        assert seen["restored"] == native and seen["again"], f"{form}: a snapshot does not continue"
    if scene == "block-press":
        assert sum(f * f for f in seen["force"]) > 0.1, "the comparison is of a tissue that nothing touches"


def test_the_controller_follows_the_scene_and_falls_silent_with_it():
    seen = node("controller.mjs", "apps/scenes/block-press.yaml", "meshes/block_1k.msh", "adaptive")
    assert seen["state"] == "engaged" and seen["patches"] > 20
    assert seen["largest"] > 0.5, "nothing was felt"
    assert seen["error"] < 0.15 * seen["largest"]
    assert seen["silent"][0] != "engaged" and seen["silent"][1] == 0, seen["silent"]


def test_errors_are_the_librarys_own_sentences():
    psychic, force, axes, instrument, mesh, poisson = node("controller.mjs", "apps/scenes/block-press.yaml", "meshes/block_1k.msh", "hold")["messages"]
    assert "psychic" in psychic and "adaptive" in psychic
    assert "range" in force
    assert "parallel" in axes
    assert instrument == "instrument 7 of 1"
    assert mesh.startswith("scene.yaml:") and "none.msh" in mesh
    assert "0.5" in poisson
