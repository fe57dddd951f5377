"""Condenses a study of tm-accuracy for the page: error of each choice that the page offers, in the scene "liver-press".

    tm-accuracy --scene apps/scenes/liver-press.yaml --mesh meshes/liver_1k.msh --finest 90000 --limit "25 min" --json study.json
    python3 web/study.py study.json > web/page/study.json
"""
import json
import sys

STEP = {"half the step": "0.45", "the whole critical step": "1"}
LAW = {"rotation": ("law", "rotation"), "gravity": ("gravity", "on"), "friction": ("friction", "on")}


def condensed(study):
    error, change, samples = {"mesh": {}, "smoothing": {}}, {"step": {}}, {}
    for run in study["runs"]:
        if "change" not in run:
            continue  # this setting cannot be
        knob, name, value = run["knob"], run["name"], run.get("force_error")
        if knob == "own":
            error["mesh"]["liver_10k.msh"] = error["smoothing"]["off"] = value
        elif knob == "mesh" and any(s.endswith("liver_1k.msh") for s in run["set"]) and "volume" not in name:
            error["mesh"]["liver_1k.msh"] = value
        elif knob == "volume" and name.startswith("as it is"):
            error["smoothing"]["on"] = value
        elif knob == "step":
            change["step"][STEP[name]] = run["change"]
        elif knob == "add" and name in LAW:
            choice, option = LAW[name]
            change.setdefault(choice, {})[option] = run["change"]
        elif knob == "extrapolator":
            samples.setdefault("25 Hz", {})[name] = value
        elif knob == "rate":
            law, rate = name.split(" at ")
            samples.setdefault(rate, {})[law] = value
    return {"command": f"tm-accuracy --scene {study['scene']} --mesh meshes/liver_1k.msh --finest 90000", "scene": "liver-press", "uncertainty": study["truth"]["uncertainty"],
            "error": error, "change": change, "samples": samples}


print(json.dumps(condensed(json.load(open(sys.argv[1], encoding="utf-8"))), indent=1))
