"""The npm package under node: the same bits as the native build, the controller, errors. `make web` builds it; the page is tested by test_page.py."""
import json
import shutil
import subprocess

import pytest
from paths import BUILD, LONG, ROOT

NPM = BUILD / "web/npm"
HERE = ROOT / "tests/web"
# Scene: seconds. Precomputed and hybrid scenes are refused there.
SCENES = {"block-gravity": 1.0, "cylinder-fibre": 1.0, "block-press": 1.0}
if LONG:
    SCENES = {p.stem: 3.0 for p in sorted((ROOT / "apps/scenes").glob("*.yaml")) if p.stem not in ("evaluate-precomputed", "evaluate-hybrid")}

pytestmark = pytest.mark.skipif(not (NPM / "simd.js").is_file() or not shutil.which("node"), reason="the package for browsers is not built; make web")


def node(script, *arguments):
    ran = subprocess.run(["node", HERE / script, NPM, *map(str, arguments)], capture_output=True, text=True, timeout=600, cwd=ROOT)
    assert ran.returncode == 0, ran.stderr[-2000:]
    return json.loads(ran.stdout)


def native(scene, seconds, folder):
    """Returns the arguments that leave haptics out under node, and the state hash that tm-sim computes with its plain form."""
    without = ["haptics"] if "\nhaptics" in (ROOT / f"apps/scenes/{scene}.yaml").read_text() else []
    subprocess.run([BUILD / "bin/tm-sim", f"apps/scenes/{scene}.yaml", "--lockstep", *(["--unset", "haptics"] if without else []), "--force", "plain",
                    "--duration", f"{seconds} s", "--json", folder / "run.json"], check=True, capture_output=True, timeout=600, cwd=ROOT)
    return without, json.loads((folder / "run.json").read_text())["state_hash"]


@pytest.mark.parametrize("form", ["plain", "simd"])
@pytest.mark.parametrize("scene", SCENES)
def test_a_scene_has_the_bits_of_the_native_build(scene, form, tmp_path):
    without, state_hash = native(scene, SCENES[scene], tmp_path)
    seen = node("scene_hash.mjs", form, f"apps/scenes/{scene}.yaml", SCENES[scene], *without)
    assert (seen["form"], seen["hash"]) == (form, state_hash)
    assert seen["restored"] == state_hash and seen["again"], "a snapshot does not continue"
    if scene == "block-press":
        assert sum(f * f for f in seen["force_1s"]) > 0.1, "nothing is touched"  # later the hand has left


def test_the_objects_make_the_bits_of_a_scene(tmp_path):
    log = tmp_path / "press.log"
    ran = subprocess.run([BUILD / "bin/tm-sim", "apps/scenes/block-press.yaml", "--lockstep", "--set", "rendering={}", "--duration", "1 s", "--record", log, "--json", tmp_path / "run.json",
                          "--samples", tmp_path / "samples.csv"], capture_output=True, text=True, timeout=300, cwd=ROOT)
    assert ran.returncode == 0, ran.stderr
    seen = node("objects.mjs", "apps/scenes/block-press.yaml", "meshes/block_1k.msh", log)
    assert seen["world"] == seen["scene"] and seen["force"] == 0 and seen["tets"] == 1176
    assert seen["leaked"] == 0
    assert seen["held"][0] == "holding" and seen["held"][1] > 3
    assert seen["removed"] > 0
    last = [float(x) for x in (tmp_path / "samples.csv").read_text().splitlines()[-1].split(",")[7:10]]
    assert seen["log"]["last"] == pytest.approx(last, rel=1e-8, abs=1e-9)
    assert seen["log"]["skipped"] == 0 and seen["log"]["type"] == "force_sample_t" and seen["log"]["triangles"] > 100
    assert seen["log"]["channels"]["TISSUE"] == 25 and seen["log"]["channels"]["TOOL_0"] == 501
    order, text, poisson, option, mode, log = seen["messages"]
    assert "negative order" in order and "$MeshFormat" in text and "0.5" in poisson and "strain_smoothing" in option and "cautery" in mode and "lcm-logger" in log


def test_the_controller_follows_the_scene_and_falls_silent_with_it():
    seen = node("controller.mjs", "apps/scenes/block-press.yaml", "meshes/block_1k.msh", "adaptive")
    assert seen["state"] == "engaged" and seen["patches"] > 20
    assert seen["largest"] > 0.5, "nothing was felt"
    assert seen["error"] < 0.15 * seen["largest"]
    assert seen["silent"][0] != "engaged" and seen["silent"][1] == 0, seen["silent"]


def test_only_a_pause_excuses_a_jump_of_the_tip(tmp_path):
    for name in ("law.worker.js", "pauses.js"):
        (tmp_path / name).write_text((ROOT / "web/page" / name).read_text())
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "lib").symlink_to(NPM)
    ran = subprocess.run(["node", HERE / "law.mjs", tmp_path / "law.worker.js"], capture_output=True, text=True, timeout=120)
    assert ran.returncode == 0, ran.stderr[-2000:]
    seen = json.loads(ran.stdout)
    latched = {name for name, (state, fault) in seen.items() if state == "fault" and "faster than possible" in fault}
    assert latched == {"jump", "again"}
    assert all(state == "idle" for name, (state, _) in seen.items() if name not in latched), seen


def test_the_example_presses_a_block(tmp_path):
    (tmp_path / "press.mjs").write_text((ROOT / "examples/web/press.mjs").read_text().replace("../../build/web/npm", str(NPM)))
    ran = subprocess.run(["node", tmp_path / "press.mjs"], capture_output=True, text=True, timeout=120, check=True)
    last = [float(x) for x in ran.stdout.splitlines()[-1].split()[2:5]]
    assert 0.1 < last[2] < 1 and max(map(abs, last[:2])) < 0.05 * last[2]


def test_errors_are_the_librarys_own_sentences():
    psychic, force, axes, instrument, mesh, poisson = node("controller.mjs", "apps/scenes/block-press.yaml", "meshes/block_1k.msh", "hold")["messages"]
    assert "psychic" in psychic and "adaptive" in psychic
    assert "range" in force
    assert "parallel" in axes
    assert instrument == "instrument 7 does not exist; give 0 to 0"
    assert mesh.startswith("scene.yaml:") and "none.msh" in mesh
    assert "0.5" in poisson
