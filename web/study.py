"""Condenses a study of tm-accuracy for the page: error of each choice that the page offers, in the scene "liver-press".

    tm-accuracy --scene apps/scenes/liver-press.yaml --mesh meshes/liver_1k.msh --finest 90000 --limit "25 min" --json study.json
    python3 web/study.py study.json build/bin/tm-sim > web/page/study.json

Laws and viscosity are not in that study: each is run once along the scene's path, and its force compared.
"""
import csv
import json
import pathlib
import subprocess
import sys
import tempfile

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


SCENE = "apps/scenes/liver-press.yaml"
MORE = {"law": {name: [f"tissue.materials.*.law={name}"] for name in ("neo-hooke", "mooney-rivlin", "st-venant-kirchhoff")}
        | {"fung": ["tissue.materials.*.law=fung", "tissue.materials.*.C=5 kPa"]},
        "viscosity": {"on": ["viscosity={terms: [{time: 0.3 s, shear: 0.4}]}"]}}


def forces(tm_sim, sets):
    """Returns the force of each frame, N."""
    with tempfile.TemporaryDirectory() as folder:
        samples = pathlib.Path(folder) / "samples.csv"
        subprocess.run([tm_sim, SCENE, "--lockstep", "--unset", "haptics", "--unset", "rendering", "--samples", samples, *[a for s in sets for a in ("--set", s)]],
                       check=True, capture_output=True)
        with open(samples, encoding="utf-8") as lines:
            return [[float(row[f"f{a}_N"]) for a in "xyz"] for row in csv.DictReader(lines)]


def size(vectors):
    return sum(x * x for v in vectors for x in v) ** 0.5


def main():
    result, tm_sim = condensed(json.load(open(sys.argv[1], encoding="utf-8"))), sys.argv[2]
    own = forces(tm_sim, [])
    for choice, options in MORE.items():
        for name, sets in options.items():
            other = forces(tm_sim, sets)
            result["change"].setdefault(choice, {})[name] = size([[a - b for a, b in zip(v, w)] for v, w in zip(own, other)]) / size(own)
    print(json.dumps(result, indent=1))


main()
