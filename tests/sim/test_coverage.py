"""Patches at their sample rates: each sample in which a tool touches or grasps tissue carries a patch, for any effects of the scene."""
import os

import lcm
import pytest
from simkit import report, run

LONG = os.environ.get("TM_LONG") == "1"
EFFECTS = ["--set", "rotation=", "--set", "strain_smoothing=", "--set", "friction={static: 0.3, kinetic: 0.2}",
           "--set", "viscosity={terms: [{time: 0.3 s, shear: 0.25}]}"]
# Evaluation scenes have scripted hands of their own; every other scene with haptics is run, up to its cut or as long as the time limit permits.
RUNS = {
    "block-press": ("block-press", None, []),
    "block-probe": ("block-probe", None, []),
    "block-cut": ("block-cut", 4, []),
    "block-cut, neo-Hooke": ("block-cut", 4, ["--set", "tissue.materials.*.law=neo-hooke"]),
    "block-cut, neo-Hooke, averaged": ("block-cut", 3.2, ["--set", "tissue.materials.*.law=neo-hooke", "--set", "strain_smoothing={shear_share: 0}"]),
    "block-cut, every effect": ("block-cut", 4, EFFECTS),
    "liver-press": ("liver-press", None if LONG else 3, []),
    "liver-cut": ("liver-cut", None if LONG else 5.4, []),
    "liver-dissect": ("liver-dissect", None if LONG else 5.4, []),
    "liver-lift": ("liver-lift", None if LONG else 2, []),
}


def test_every_scene_is_tried(root):
    haptic = {p.stem for p in (root / "apps/scenes").glob("*.yaml") if "\nhaptics" in p.read_text() and not p.stem.startswith("evaluate-")}
    assert haptic == {scene for scene, _, _ in RUNS.values()}


@pytest.mark.parametrize("name", RUNS)
def test_samples_on_tissue_carry_a_patch(bin, root, tmp_path, name):
    scene, seconds, more = RUNS[name]
    length = ["--duration", f"{seconds} s"] if seconds else []
    r = report(bin / "tm-sim", root / f"apps/scenes/{scene}.yaml", "--lockstep", "--set", "haptics.rate=25", *length, *more, tmp=tmp_path)
    assert sum(i["touched"] for i in r["coverage"]) > 15
    for instrument in r["coverage"]:  # each instrument alone: patches of one do not help the other hand
        assert instrument["carried"] >= 0.99 * instrument["touched"], r["coverage"]
        assert (0 < instrument["age_max"] < 0.1) if "neo-Hooke" in name else ("age_max" in instrument) == ("rotation=" in more or "lift" in name), r["coverage"]


# By conjugate gradients: what each instrument carries. In the livers, patches contain supported vertices, whose columns are zero. A cautery that cuts has few.
ITERATIONS = {"block-press": (None, [1]), "liver-press": (None if LONG else 3, [1]), "liver-cut": (None if LONG else 3.4, [1, 0])}


@pytest.mark.parametrize("scene", ITERATIONS)
def test_samples_carry_a_patch_by_iterations(bin, root, tmp_path, scene):
    seconds, least = ITERATIONS[scene]
    length = ["--duration", f"{seconds} s"] if seconds else []
    r = report(bin / "tm-sim", root / f"apps/scenes/{scene}.yaml", "--lockstep", "--set", "haptics.rate=25", "--set", "haptics.compliance=iterations", *length, tmp=tmp_path)
    print(scene, [(i["carried"], i["touched"]) for i in r["coverage"]])
    assert sum(i["touched"] for i in r["coverage"]) > 15
    for instrument, share in zip(r["coverage"], least, strict=True):
        assert instrument["carried"] >= 0.99 * share * instrument["touched"], r["coverage"]


def ages_told(bin, root, tmp_path, types, *more):
    r = report(bin / "tm-sim", root / "apps/scenes/block-cut.yaml", "--lockstep", "--set", "haptics.rate=25", "--duration", "2 s",
               "--set", "tissue.materials.*.law=neo-hooke", "--record", tmp_path / "log", *more, tmp=tmp_path)
    return r["coverage"], [types.sim_status_t.decode(e.data).patch_age for e in lcm.EventLog(str(tmp_path / "log")) if e.channel == "SIM_STATUS"]


def test_the_status_says_how_far_a_patch_has_aged(bin, root, tmp_path, types):
    """Per frame what `coverage` has the largest of while tissue is touched; -1 without a patch."""
    coverage, ages = ages_told(bin, root, tmp_path, types)
    patched = [e.channel for e in lcm.EventLog(str(tmp_path / "log"))]
    for i, instrument in enumerate(coverage):
        own = [age[i] for age in ages if age[i] >= 0]
        assert len(own) == patched.count(f"PATCH_{i}") and all(age[i] == -1 or 0 <= age[i] <= 1 for age in ages)
        assert max(own, default=0) >= instrument["age_max"]
    assert max(i["age_max"] for i in coverage) > 0
    _, ages = ages_told(bin, root, tmp_path, types, "--set", "haptics.extrapolator=tangent")
    assert set(ages) == {(-1, -1)}


def test_lost_patches_are_counted(bin, root, tmp_path):
    """While a cautery cuts tissue that rotates, an iterative solver cannot follow: the report counts this for the affected instrument."""
    r = report(bin / "tm-sim", root / "apps/scenes/liver-dissect.yaml", "--lockstep", "--set", "haptics.rate=25", "--duration", "3.4 s",
               "--set", "rotation=", "--set", "haptics.compliance=iterations", tmp=tmp_path)
    held, cuts = r["coverage"]
    assert cuts["touched"] > 5 and cuts["carried"] < 0.5 * cuts["touched"] and held["carried"] >= 0.99 * held["touched"], r["coverage"]


def test_cause_of_old_patches_is_named(bin, root):
    scene = [bin / "tm-sim", root / "apps/scenes/block-cut.yaml", "--explain", "--set", "haptics.rate=25",
             "--set", "rotation=", "--set", "haptics.compliance=iterations"]
    _, said = run(*scene)
    assert "warning" in said and "rotation" in said and "earlier shape" in said
    _, said = run(*scene[:-2])
    assert "earlier shape" not in said
