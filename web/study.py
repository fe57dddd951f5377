"""Condenses studies of tm-accuracy for the page: error of each choice that the page offers, by scene. `make web-study` runs it.

    tm-accuracy --scene apps/scenes/block-press.yaml --finest 90000 --json block.json
    python3 web/study.py build/bin/tm-sim web/page/study.json block.json... > new.json

Scenes of which no study is given keep their figures. Of two studies of a scene, errors are those of the one with an extrapolated limit, changes and
samples those of the longer one. Laws and viscosity are not in a study: each is run once along the scene's path, and its force compared.
"""
import csv
import json
import pathlib
import subprocess
import sys
import tempfile

STEP = {"half the step": "0.45", "the whole critical step": "1"}
LAW = {"rotation": ("law", "rotation"), "gravity": ("gravity", "on"), "friction": ("friction", "on")}
RATES = ("25 Hz", "50 Hz", "100 Hz")
OWN_MESH = {"liver-press": "liver_10k.msh", "liver-cut": "liver_cut.msh", "block-press": "block_1k.msh"}
# The first seconds only: nonlinear laws on 15,238 tetrahedra are slow.
SECONDS = {"liver-cut": "2 s"}
MORE = {"law": {name: [f"tissue.materials.*.law={name}"] for name in ("neo-hooke", "mooney-rivlin", "st-venant-kirchhoff")}
        | {"fung": ["tissue.materials.*.law=fung", "tissue.materials.*.C=5 kPa"]},
        "viscosity": {"on": ["viscosity={terms: [{time: 0.3 s, shear: 0.4}]}"]}}


def errors(study, own):
    """Errors of the force against the limit of fine meshes, of each mesh and of strain smoothing."""
    mesh, smoothing = {}, {}
    for run in study["runs"]:
        name, value = run["name"], run.get("force_error")
        if value is None:
            continue
        if run["knob"] == "own":
            mesh[own] = smoothing["off"] = value
        elif run["knob"] == "mesh" and any(s.endswith("liver_1k.msh") for s in run["set"]) and "strain_smoothing" not in name:
            mesh["liver_1k.msh"] = value
        elif run["knob"] == "strain_smoothing" and name.startswith("as it is"):
            smoothing["on"] = value
    return {"mesh": mesh, "smoothing": smoothing}


def changes(study):
    """By how much each choice changes the force, and the errors of the extrapolators at each rate."""
    change, samples = {"step": {}}, {}
    for run in study["runs"]:
        knob, name, value = run["knob"], run["name"], run.get("force_error")
        if knob == "step" and "change" in run:
            change["step"][STEP[name]] = run["change"]
        elif knob == "add" and name in LAW and "change" in run:
            choice, option = LAW[name]
            change.setdefault(choice, {})[option] = run["change"]
        elif knob == "extrapolator" and value is not None:
            samples.setdefault("25 Hz", {})[name] = value
        elif knob == "rate" and value is not None:
            law, rate = name.split(" at ")
            if rate in RATES:
                samples.setdefault(rate, {})[law] = value
    return change, samples


def forces(tm_sim, scene, sets):
    """Returns the force of each frame, N."""
    with tempfile.TemporaryDirectory() as folder:
        samples, names = pathlib.Path(folder) / "samples.csv", ["haptics"]
        if "\nrendering:" in pathlib.Path(f"apps/scenes/{scene}.yaml").read_text(encoding="utf-8"):
            names.append("rendering")
        subprocess.run([tm_sim, f"apps/scenes/{scene}.yaml", "--lockstep", "--samples", samples, *(["--duration", SECONDS[scene]] if scene in SECONDS else []),
                        *[a for n in names for a in ("--unset", n)], *[a for s in sets for a in ("--set", s)]], check=True, capture_output=True)
        with open(samples, encoding="utf-8") as lines:
            return [[float(row[f"f{a}_N"]) for a in "xyz"] for row in csv.DictReader(lines)]


def size(vectors):
    return sum(x * x for v in vectors for x in v) ** 0.5


def more(tm_sim, scene, change):
    own = forces(tm_sim, scene, [])
    for choice, options in MORE.items():
        for name, sets in options.items():
            try:
                other = forces(tm_sim, scene, sets)
            except subprocess.CalledProcessError:
                continue  # this law cannot be in this scene
            change.setdefault(choice, {})[name] = size([[a - b for a, b in zip(v, w)] for v, w in zip(own, other)]) / size(own)


def rounded(value):
    if isinstance(value, dict):
        return {k: rounded(v) for k, v in value.items()}
    return float(f"{value:.4g}") if isinstance(value, float) else value


def main():
    tm_sim, result = sys.argv[1], json.load(open(sys.argv[2], encoding="utf-8"))
    studies = {}
    for name in sys.argv[3:]:
        study = json.load(open(name, encoding="utf-8"))
        studies.setdefault(pathlib.Path(study["scene"]).stem, []).append(study)
    for scene, found in studies.items():
        limit = next((s for s in found if s["truth"]["extrapolated"]), None)
        change, samples = changes(max(found, key=lambda s: s["duration_s"]))
        more(tm_sim, scene, change)
        entry = {"change": change, "samples": samples}
        if limit:
            entry = {"uncertainty": limit["truth"]["uncertainty"], "error": errors(limit, OWN_MESH[scene]), **entry}
        result["scenes"][scene] = rounded(entry)
    print(json.dumps(result, indent=1))


main()
