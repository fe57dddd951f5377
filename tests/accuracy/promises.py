#!/usr/bin/env python3
"""Compares what tm-accuracy promises of a scene with a run of its recommendation, as a table. Scenes: the demo's and three made from segmented
images, each for two budgets.

python tests/accuracy/promises.py FOLDER [NAME...]     (FOLDER keeps finished studies; needs the module `image`: make image)"""
import json
import pathlib
import subprocess
import sys

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests/mesh"))
import phantom  # noqa: E402

BUDGETS = {"half": "0.5", "two": "2 cores"}
# The meshes to run are limited by size: --limit would depend on the machine's speed.
def most(tets):
    return ["--limit", "7200 s", "--finest", str(tets)]


SHORT = ["--duration", "2.6 s"]
# Scene, or image with its options for tm-organ; then the limits of the study.
SCENES = {
    "block-press": ("apps/scenes/block-press.yaml", None, most(15000)),
    "liver-press": ("apps/scenes/liver-press.yaml", None, ["--quick", "--duration", "2 s", *most(70000)]),
    "liver-cut": ("apps/scenes/liver-cut.yaml", None, ["--quick", "--duration", "5 s", *most(1)]),
    "liver-lift": ("apps/scenes/liver-lift.yaml", None, ["--quick", "--duration", "3 s", *most(60000)]),
    "kidney": ("kidney.nii.gz", "--budget 3000 --label 1=kidney --label 2=vessels", [*SHORT, *most(18000)]),
    "liver": ("liver.nrrd", "--budget 4500 --smooth 0.5 --label 1=liver --label 2=vessels --label 3=tumour", [*SHORT, *most(30000)]),
    "tube": ("tube.mha", "--budget 5500 --label 1=kidney --label 2=vessels", [*SHORT, *most(30000)]),
}
# No setting fits half a processor there: even the coarser mesh takes more (docs/accuracy.md).
TOO_EXPENSIVE = {("liver-lift", "half")}
HEAD = ("scene", "tetrahedra", "budget", "recommended", "error promised", "error held", "of a processor, promised", "held", "above the budget", "machine slower", "late", "promise")


def grid(count, spacing):
    return np.stack(np.meshgrid(*[(np.arange(n) - (n - 1) / 2) * spacing for n in count], indexing="ij"), -1)


def kidney():
    """Returns a bean with its pelvis as a label image."""
    p = grid((44, 40, 60), 2.0)
    body = (phantom.ellipsoid(p, (0, 0, 0), (30, 24, 52)) < 0) & (phantom.ellipsoid(p, (30, 0, 0), (16, 14, 22)) > 0)
    out = body.astype(np.uint8)
    out[body & (phantom.ellipsoid(p, (12, 0, 0), (9, 9, 18)) < 0)] = 2
    return out, (2, 2, 2)


def liver():
    image = phantom.phantom()
    return np.where(image < 4, image, 0).astype(np.uint8), (4, 4, 5)


def tube():
    """Returns a bent tube with a core as a label image."""
    p = grid((70, 36, 44), 2.0)
    off, long = np.hypot(p[..., 1], p[..., 2] - 18 * np.cos(p[..., 0] / 40) + 8), abs(p[..., 0]) < 62
    out = ((off < 15) & long).astype(np.uint8)
    out[(off < 6) & long] = 2
    return out, (2, 2, 2)


def scene_of(name, bin, folder):
    """Returns the path of a scene; makes it from its image with tm-organ if it has one."""
    source, words, _ = SCENES[name]
    if words is None:
        return ROOT / source
    image, spacing = {"kidney": kidney, "liver": liver, "tube": tube}[name]()
    path = phantom.write(folder / source, image, spacing, origin=-(np.array(image.shape) - 1) / 2 * spacing)
    if not (folder / name / "organ.png").exists():
        subprocess.run([bin / "tm-organ", path, *words.split(), "--no-cut", "--no-video", "-o", folder / name], check=True, stdout=subprocess.DEVNULL)
    return folder / name / "organ.yaml"


def promise(name, budget, bin, folder):
    """Runs the study to its end and returns its JSON. Both budgets share its runs."""
    folder.mkdir(parents=True, exist_ok=True)
    scene, study = scene_of(name, bin, folder), folder / f"{name}.json"
    subprocess.run([bin / "tm-accuracy", "--quiet", "--scene", scene, "--json", study, "--budget", BUDGETS[budget], *SCENES[name][2]], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)
    data = json.loads(study.read_text())
    (folder / f"{name}-{budget}.json").write_text(json.dumps(data))
    return data


def row(name, budget, data):
    c = data["recommendation"]
    percent = lambda x: f"{100 * x:.3g} %" if x > 5e-7 else "0"
    words = ", ".join([*c["settings"], *([f"{c['extrapolator']} at {c['sample_rate_Hz']:g} Hz"] if "extrapolator" in c else [])])
    return (name, f"{data['runs'][0]['tets']:,}", BUDGETS[budget], words, percent(c["error"]), percent(c["held_error"]), percent(c["share"]), percent(c["held_share"]), percent(c["held_over"]), f"× {c['held_slower']:.3g}", f"{c['held_late']} of {c['held_frames']}", "kept" if c["kept"] else "NOT KEPT" if c["fits"] else "nothing fits")


def main():
    if len(sys.argv) < 2 or sys.argv[1].startswith("-"):
        sys.exit(__doc__)
    folder = pathlib.Path(sys.argv[1]).resolve()
    print("| " + " | ".join(HEAD) + " |\n" + "|---" * len(HEAD) + "|", flush=True)
    for name in sys.argv[2:] or SCENES:
        for budget in BUDGETS:
            print("| " + " | ".join(row(name, budget, promise(name, budget, ROOT / "build/bin", folder))) + " |", flush=True)


if __name__ == "__main__":
    main()
