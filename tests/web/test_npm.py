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


TWO = """\
tissue: {materials: {"*": {young: 5 kPa, poisson: 0.4}}}
bodies: {low: {mesh: block_1k.msh}, high: {mesh: block_1k.msh, scale: 0.5, move: [20 mm, 20 mm, 50.6 mm]}, floor: {mesh: block_1k.msh, move: [0, 0, -60 mm], rigid: yes}}
damping: {rate: 60 /s}
gravity:
supports: [{group: low.z_min}]
touch:
ties: {between: [{from: high.z_min, to: low.z_max, stiffness: 30 N/m, spacing: 12 mm}]}
"""


def test_bodies_touch_and_are_tied(tmp_path):
    """As tests/python/inside_bodies.py; the scene has the bits of the native build."""
    (tmp_path / "two.yaml").write_text(TWO)
    shutil.copy(ROOT / "meshes/block_1k.msh", tmp_path)
    subprocess.run([BUILD / "bin/tm-sim", tmp_path / "two.yaml", "--lockstep", "--force", "plain", "--duration", "0.2 s", "--json", tmp_path / "run.json"], check=True, capture_output=True, timeout=300)
    seen = node("bodies.mjs", tmp_path / "two.yaml", tmp_path / "block_1k.msh")
    contact, ties, broken = seen["contact"], seen["ties"], seen["broken"]
    assert contact["before"] is None and contact["force_N"] == pytest.approx(contact["weight_N"], abs=1e-9) and contact["all_N"] < 1e-15 and contact["weights"] < 1e-15
    assert contact["rows"] == contact["again"] == contact["report"]["rows"] > 0 and contact["report"]["deepest_m"] == 0 and not contact["report"]["overflowed"]
    assert seen["apart"]["rows"] == 0 and seen["apart"]["sunk_m"] > 1.1e-3
    assert ties["count"] == ties["again"] == 9 and ties["whole"] and ties["none"] is None and ties["leaked"] == 0 and ties["rest_m"] == pytest.approx([0.01] * 9)
    assert sum(ties["force_N"]) == pytest.approx(ties["weight_N"], rel=1e-3) and ties["force_N"] == pytest.approx([50 * (m - 0.01) for m in ties["length_m"]], rel=1e-4)
    assert broken == {"none_yet": 0, "tie": list(range(9)), "why": [-1], "whole": False, "ends": 0, "again": 0}
    expected = ["names no two of 2 bodies; give 0 to 1", "friction", "mu_static: give bodies, pairs and friction instead", '"thick" is not known; use one of', "bodies: 2 values; give 216",
                "already", "vertex or triangles: outside 0 to 35", "tie 0", "other: 2 values; give 3", "count: give the list of ties instead"]
    assert len(seen["messages"]) == len(expected) and all(words in message for words, message in zip(expected, seen["messages"])), seen["messages"]
    scene = seen["scene"]
    assert scene["hash"] == json.loads((tmp_path / "run.json").read_text())["state_hash"] and scene["rows"] > 10 and scene["ties"] == 16
    assert scene["bodies"] == [["low", False, 320], ["high", False, 320], ["floor", True, 320]]


def test_single_precision_costs_no_more_than_double():
    """Lanes that are written one by one wait for each other's stores: single precision took 1.7 times the time of double."""
    seen = [node("single_cost.mjs", "meshes/block_1k.msh") for _ in range(2)]
    assert seen[0]["far_m"] > 0.005
    assert min(s["single"] for s in seen) < 1.15, seen


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
