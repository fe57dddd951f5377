"""Effects that exclude each other are rejected with both lines and the remedy: every pair of the library's table; all other effects work in one scene."""
import subprocess

import pytest
from kit import effects

SCENE = """tissue:
  mesh: {root}/meshes/block_1k.msh
  materials:
    "*": {{young: 5 kPa, poisson: 0.45, density: 1000 kg/m3}}
supports:
  - {{name: bottom, group: z_min}}
instruments:
  - trocar: [50 mm, 50 mm, 180 mm]
contact:
"""
EFFECT = {**{e.name: f"{e.name}: {e.example}\n" for e in effects() if e.example is not None}, "fade": "cut: {fade: 50 ms}\n",
          "ties": "ties: {between: [{from: z_max, to: z_min, within: 60 mm, stiffness: 10 N/m}]}\n"}
MODELS = ("precomputed", "hybrid")
PAIRS = [(e.name, other) for e in effects() for other in e.excludes]
EXCLUDED = [(one, other) if other in MODELS else (other, one) for one, other in PAIRS] + [("fade", "hybrid")]


def check(bin, root, tmp_path, text):
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE.format(root=root) + text)
    done = subprocess.run([bin / "tm-sim", scene, "--check"], capture_output=True, text=True, timeout=400)
    return scene, done.returncode, done.stderr


def test_the_table_has_pairs():
    assert {("rotation", "precomputed"), ("friction", "hybrid"), ("cut", "precomputed")} <= set(EXCLUDED) and len(EXCLUDED) >= 12
    assert all(model in MODELS for _, model in EXCLUDED), "a pair of two effects: test it in a scene of its own"


@pytest.mark.parametrize("one,model", EXCLUDED, ids=lambda v: v)
def test_exclusion_names_both_lines(bin, root, tmp_path, one, model):
    text = EFFECT[one] + f"model: {model}\n" + ("hybrid: {box: {min: [0, 0, 0], max: [50 mm, 100 mm, 50 mm]}}\n" if model == "hybrid" else "")
    scene, code, said = check(bin, root, tmp_path, text)
    lines = SCENE.count("\n")
    assert code == 2 and f"{scene}:{lines + 1}" in said and f"{scene}:{lines + 2}" in said, said
    assert "exclude each other" in said and ("remove" in said or "write 'model: dynamic'" in said), said


def test_compatible_effects_run_in_one_scene(bin, root, tmp_path):
    for text in ("strain_smoothing viscosity friction", "rotation viscosity friction", "rotation strain_smoothing viscosity friction", "friction model: precomputed"):
        effects = "".join(EFFECT.get(e, "") for e in text.split())
        if "rotation" in text:
            effects = effects.replace(EFFECT["strain_smoothing"], "strain_smoothing:\n")
        _, code, said = check(bin, root, tmp_path, effects + ("model: precomputed\n" if "model" in text else ""))
        assert code == 0, said


@pytest.mark.parametrize("other", ["rotation", "strain_smoothing: {shear_share: 0.4}", "model: precomputed", "stretch", "single"])
def test_nonlinear_law_rejects_incompatible_effects_by_name(bin, root, tmp_path, other):
    law = "density: 1000 kg/m3, law: neo-hooke"
    text = SCENE.replace("density: 1000 kg/m3", law + (", stretch: 1.1" if other == "stretch" else ""))
    if other == "single":
        text = text.replace("  materials:", "  precision: single\n  materials:")
    scene = tmp_path / "scene.yaml"
    scene.write_text(text.format(root=root) + EFFECT.get("viscosity" if other == "single" else other, f"{other}\n" if ":" in other else ""))
    done = subprocess.run([bin / "tm-sim", scene, "--check"], capture_output=True, text=True, timeout=400)
    expected = {"strain_smoothing: {shear_share: 0.4}": "write 'shear_share: 0'", "model: precomputed": "needs 'model: dynamic'", "stretch": "1.2",
                "single": "tissue.precision = single and law 'neo-hooke' with 'viscosity:' exclude each other"}.get(other, f"{other} exclude each other")
    assert done.returncode == 2 and f"{scene}:" in done.stderr and expected in done.stderr, done.stderr


def test_single_precision_with_rotation_rejects_what_relaxes(bin, root, tmp_path):
    """Rotation alone is accepted; with viscosity or averages the line that has `precision` is named."""
    single = SCENE.replace("  materials:", "  precision: single\n  materials:").replace("{root}", str(root)).replace("{{", "{").replace("}}", "}")
    for other, said in (("", ""), ("viscosity", "tissue.precision = single and rotation with 'viscosity:' exclude each other"),
                        ("strain_smoothing", "strain_smoothing and tissue.precision = single")):
        scene = tmp_path / "scene.yaml"
        scene.write_text(single + EFFECT["rotation"] + (EFFECT["viscosity"] if other == "viscosity" else f"{other}:\n" if other else ""))
        done = subprocess.run([bin / "tm-sim", scene, "--check"], capture_output=True, text=True, timeout=400)
        assert done.returncode == (2 if other else 0) and said in done.stderr and (not other or f"{scene}:" in done.stderr), done.stderr


def test_a_stiff_linear_body_runs_beside_a_soft_one_of_another_law(bin, root, tmp_path):
    """The gall-bladder's bed is linear and twenty times as stiff as the neo-Hookean tissue around it; a press of that tissue runs, and no warning
    concerns the linear part."""
    scene = tmp_path / "scene.yaml"
    text = (root / "apps/scenes/liver-press.yaml").read_text().replace("../../meshes", str(root / "meshes"))
    soft = '"*": {young: 10 kPa, poisson: 0.4, density: 1050 kg/m3'
    assert soft in text
    scene.write_text(text.replace(soft + "}", soft + ", law: neo-hooke}\n    gallbladder_bed: {young: 200 kPa, poisson: 0.4, density: 1050 kg/m3}"))
    done = subprocess.run([bin / "tm-sim", scene, "--lockstep", "--frames", "3", "--quiet"], capture_output=True, text=True, timeout=400)
    assert done.returncode == 0 and "linear" not in done.stderr, done.stderr


def test_a_law_runs_with_averaged_changes_of_volume_and_viscosity(bin, root, tmp_path):
    """The share of averaged shear is 0 by default."""
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE.replace("poisson: 0.45, density: 1000 kg/m3", "poisson: 0.4999, law: neo-hooke").format(root=root) + "strain_smoothing: {}\n" + EFFECT["viscosity"])
    assert "0.4999" in scene.read_text()
    done = subprocess.run([bin / "tm-sim", scene, "--quiet", "--lockstep", "--frames", "3"], capture_output=True, text=True, timeout=400)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("law,said", [("fung", "needs 'C'"), ("fung, C: 10 Pa", "2 w/C <= 6 is violated"), ("mooney-rivlin, C: 1 kPa", "'C' belongs to the law 'fung'"),
                                      ("holzapfel, k1: 1 kPa, k2: 1", "add 'anisotropy:'"), ("neo-hooke, slack: 1", "'slack' belongs to the law 'st-venant-kirchhoff'"),
                                      ("mooney-rivlin, second: 0.3", ""), ("fung, C: 5 kPa, slack: 1", ""), ("st-venant-kirchhoff, slack: 1", "")])
def test_law_without_its_constants_is_rejected(bin, root, tmp_path, law, said):
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE.replace("density: 1000 kg/m3", f"law: {law}").format(root=root))
    done = subprocess.run([bin / "tm-sim", scene, "--check"], capture_output=True, text=True, timeout=400)
    assert done.returncode == (2 if said else 0) and said in done.stderr and (not said or f"{scene}:4: " in done.stderr), done.stderr


def test_rotation_rejects_averaged_shear(bin, root, tmp_path):
    """rotation accepts strain smoothing with a shear share of 0, its default there."""
    scene, code, said = check(bin, root, tmp_path, EFFECT["rotation"] + EFFECT["strain_smoothing"])
    lines = SCENE.count("\n")
    assert code == 2 and f"{scene}:{lines + 2}" in said and f"{scene}:{lines + 1}" in said and "shear_share: 0" in said, said
    _, code, said = check(bin, root, tmp_path, EFFECT["rotation"] + "strain_smoothing: {shear_share: 0}\n")
    assert code == 0, said
