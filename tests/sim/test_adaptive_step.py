"""time.adaptive of a scene: long substeps at rest, 2^k of them under a deep press, the same force. The report and --explain state it; incompatible
settings are rejected with their line."""
import subprocess

import pytest
from simkit import report, run

LAW = ["tissue.materials.*.law=fung", "tissue.materials.*.C=1200 Pa"]
DEEP = ["time.adaptive=yes", "hand[0].path[2].tip=[52 mm, 50 mm, 40 mm]", "hand[0].path[3].tip=[52 mm, 50 mm, 40 mm]"]


def sets(*words):
    return [part for word in words for part in ("--set", word)]


def test_a_press_takes_short_steps_while_deep(build, root, tmp_path):
    scene = root / "apps/scenes/block-press.yaml"
    told = report(build / "bin/tm-sim", scene, "--explain", "--quiet", *sets(*LAW, "time.adaptive=yes"), tmp=tmp_path)
    assert told["adaptive"]["levels"][0]["strain_max"] >= 0.1 and len(told["adaptive"]["levels"]) == 3
    text = run(build / "bin/tm-sim", scene, "--explain", *sets(*LAW, "time.adaptive=yes"))[0]
    assert "time.adaptive (--set" in text and "a 4th beyond" in text
    ran = {}
    for adaptive in "yes", "no":
        ran[adaptive] = report(build / "bin/tm-sim", scene, "--frames", "50", "--lockstep", *sets(*LAW, *DEEP, f"time.adaptive={adaptive}"), tmp=tmp_path)
    assert "adaptive" not in ran["no"] and 2 * ran["yes"]["substeps_per_frame"] < ran["no"]["substeps_per_frame"]
    levels = ran["yes"]["adaptive"]["levels"]
    assert sum(level["steps"] for level in levels) == 50 * ran["yes"]["substeps_per_frame"]
    assert levels[0]["steps"] > 0 and levels[1]["steps"] + levels[2]["steps"] > 0 and ran["yes"]["adaptive"]["substeps"] in (1, 2, 4)


@pytest.mark.parametrize("words, said", [
    ([], "needs a nonlinear law"),
    ([*LAW, "time.step=20 ms"], "guaranteed for strains up to 0.1"),
])
def test_incompatible_settings_are_refused(build, root, words, said):
    done = subprocess.run([build / "bin/tm-sim", root / "apps/scenes/block-press.yaml", "--explain", *sets(*words, "time.adaptive=yes")], capture_output=True, text=True, timeout=100)
    assert done.returncode == 2 and said in done.stderr and ("--set" in done.stderr or ".yaml:" in done.stderr)


def test_mass_is_added_for_the_long_step_only(build, root, tmp_path):
    scene, added, ran = root / "apps/scenes/block-press.yaml", {}, {}
    words = [*LAW, "strain_smoothing={}", *DEEP[1:], "time.step=1.4 ms", "time.mass_scaling=yes", "time.mass_scaling_max=20"]
    for adaptive in "yes", "no":
        args = sets(*words, f"time.adaptive={adaptive}")
        added[adaptive] = report(build / "bin/tm-sim", scene, "--explain", "--quiet", *args, tmp=tmp_path)["mass_scaling"]["added_kg"]
        ran[adaptive] = report(build / "bin/tm-sim", scene, "--frames", "30", "--lockstep", *args, tmp=tmp_path)
    assert 0 < added["yes"] < 0.5 * added["no"]
    levels = ran["yes"]["adaptive"]["levels"]
    assert levels[0]["steps"] > 0 and sum(level["steps"] for level in levels[1:]) > 0
