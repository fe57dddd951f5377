"""The stages of a step match the table: phases, work shared by threads and the law of the force, with and without each effect."""
import pytest
from simkit import report

PRESS, CUT = "block-press", "block-cut"
SHEAR = "viscosity={terms: [{time: 50 ms, shear: 0.3, bulk: 0.1}]}"
ALIKE = "viscosity={terms: [{time: 50 ms, shear: 0.3, bulk: 0.3}]}"
BEGIN = ["contact begin"]
MOTION = ["force force divided", "integrate integrate divided", "support constrain divided"]
ROWS = ["contact detect constrain overlap", "contact solve constrain", "contact forces constrain"]
PLAIN = BEGIN + MOTION + ROWS + ["patch on demand"]


def among(rows, **after):
    """Returns the rows of stages, each followed by the stages that `after` names for it (spaces are underscores)."""
    return [line for row in rows for line in [row, *after.get(row.replace(" ", "_"), [])]]


def law_of(stage, rows):
    return [f"{row}: law of {stage}" if row.startswith("force ") else row for row in rows]


TURNED = among(PLAIN, force_force_divided=["rotation force divided"])
CASES = {
    "press": (PRESS, [], PLAIN),
    "volume": (PRESS, ["strain_smoothing={}"], PLAIN),
    "rotation": (PRESS, ["rotation={}"], TURNED),
    "rotation and volume": (PRESS, ["rotation={}", "strain_smoothing={}"], law_of("rotation", TURNED)),
    "viscosity": (PRESS, [ALIKE], law_of("viscosity", [BEGIN[0], "viscous strain force divided", *MOTION, *ROWS, "viscosity end divided", "patch on demand"])),
    "viscosity of unlike shares": (PRESS, [SHEAR], law_of("viscosity", among([BEGIN[0], "viscous strain force divided", *MOTION, *ROWS, "viscosity end divided", "patch on demand"],
                                                                             force_force_divided=["viscous bulk force divided"]))),
    "rotation and viscosity": (PRESS, ["rotation={}", ALIKE], law_of("viscosity", among(TURNED, rotation_force_divided=["viscosity force divided"]))),
    "law": (PRESS, ["tissue.materials.*.law=neo-hooke"], law_of("law", [BEGIN[0], "law force divided", *MOTION, *ROWS, "patch on demand"])),
    "adaptive law": (PRESS, ["tissue.materials.*.law=neo-hooke", "time.adaptive=yes"], law_of("law", ["adaptive step begin divided", *BEGIN, "law force divided", *MOTION, *ROWS, "patch on demand"])),
    "law and viscosity": (PRESS, ["tissue.materials.*.law=neo-hooke", ALIKE], law_of("viscosity", [BEGIN[0], "law force divided", "viscosity force divided", *MOTION, *ROWS, "patch on demand"])),
    "friction": (PRESS, ["friction={}"], among(PLAIN, support_constrain_divided=["friction constrain"])),
    "energy": (PRESS, ["energy={}"], among(PLAIN, contact_forces_constrain=["energy end"])),
    "cut": (CUT, [], ["cut begin", *among(PLAIN, support_constrain_divided=["cut search constrain overlap", "grasp constrain"])]),
}


@pytest.mark.parametrize("case", CASES)
def test_explain_prints_the_step(build, root, tmp_path, case):
    scene, sets, expected = CASES[case]
    said = report(build / "bin/tm-sim", root / f"apps/scenes/{scene}.yaml", "--explain", "--quiet", *[word for s in sets for word in ("--set", s)], tmp=tmp_path)
    rows = [f"{s['name']} {s['phase']} {s['threads']}".strip() + (f": law of {s['law_of']}" if "law_of" in s else "") for s in said["stages"] if "threads" in s]
    assert [r for r in rows if not r.startswith("load ") and not r.startswith("gravity ")] == expected
