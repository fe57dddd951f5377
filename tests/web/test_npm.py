"""The npm package under node: the same bits as the native build, the controller, errors. `make web` builds it; the page is tested by test_page.py."""
import json
import shutil
import subprocess

import pytest
from paths import BUILD, LONG, ROOT

NPM = BUILD / "web/npm"
HERE = ROOT / "tests/web"
# Tissue by itself has the bits of the native build. Poses of instruments do not: their sines come from another C library.
TISSUE = {"block-gravity": 1.0, "cylinder-fibre": 1.0}
TOOLS = {"block-press": 1.0}
if LONG:
    TOOLS |= {"block-cut": 2.0, "evaluate-fibred": 2.0, "evaluate-grasper": 2.0, "liver-cut": 2.0, "liver-press": 2.0}

pytestmark = pytest.mark.skipif(not (NPM / "simd.js").is_file() or not shutil.which("node"), reason="the package for browsers is not built; make web")


def node(script, *arguments):
    ran = subprocess.run(["node", HERE / script, NPM, *map(str, arguments)], capture_output=True, text=True, timeout=600, cwd=ROOT)
    assert ran.returncode == 0, ran.stderr[-2000:]
    return json.loads(ran.stdout)


def native(scene, seconds, folder):
    """Returns state hash and forces of the last frame, as tm-sim computes and prints them with its plain form."""
    without = ["--unset", "haptics"] if "haptics" in (ROOT / f"apps/scenes/{scene}.yaml").read_text() else []
    subprocess.run([BUILD / "bin/tm-sim", f"apps/scenes/{scene}.yaml", "--lockstep", *without, "--force", "plain", "--duration", f"{seconds} s",
                    "--json", folder / "run.json", *(["--samples", folder / "samples.csv"] if without else [])], check=True, capture_output=True, timeout=600, cwd=ROOT)
    last = (folder / "samples.csv").read_text().splitlines()[-1].split(",") if without else []
    return json.loads((folder / "run.json").read_text())["state_hash"], [float(x) for x in last[7:10]]


@pytest.mark.parametrize("form", ["plain", "simd"])
@pytest.mark.parametrize("scene", TISSUE)
def test_tissue_has_the_bits_of_the_native_build(scene, form, tmp_path):
    state_hash, _ = native(scene, TISSUE[scene], tmp_path)
    seen = node("scene_hash.mjs", form, f"apps/scenes/{scene}.yaml", TISSUE[scene])
    assert (seen["form"], seen["hash"]) == (form, state_hash)
    assert seen["restored"] == state_hash and seen["again"], "a snapshot does not continue"


@pytest.mark.parametrize("form", ["plain", "simd"])
@pytest.mark.parametrize("scene", TOOLS)
def test_instruments_feel_the_force_of_the_native_build(scene, form, tmp_path):
    _, force = native(scene, TOOLS[scene], tmp_path)
    seen = node("scene_hash.mjs", form, f"apps/scenes/{scene}.yaml", TOOLS[scene], "haptics")
    if scene == "block-press":
        assert sum(f * f for f in force) > 0.1, "nothing is touched"
    assert seen["force"] == pytest.approx(force, rel=1e-8, abs=1e-9)  # as printed: nine digits
    assert seen["restored"] == seen["hash"] and seen["again"], "a snapshot does not continue"


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
