"""Patches of tissue under a nonlinear law while it is pressed by 35 %: every sample in contact carries one, and its age stays bounded (docs/patches.md)."""
import json
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "apps/studies/reality"))
import bodies  # noqa: E402

SCENE = """title: A block of 60 mm under a nonlinear law, pressed by 35 %
tissue:
  mesh: block.msh
  materials:
    "*": {young: 5 kPa, poisson: 0.45, law: neo-hooke}
damping: {rate: 60 /s}
contact:
supports:
  - {name: base, plane: {point: [0, 0, 0], normal: [0, 0, 1]}}
instruments:
  - {mode: probe, trocar: [30 mm, 30 mm, 200 mm], radius: 8 mm}
hand:
  - instrument: 0
    path:
      - {time: 0 s, tip: [30 mm, 30 mm, 69 mm]}
      - {time: 1.2 s, tip: [30 mm, 30 mm, 47 mm]}
      - {time: 1.6 s, tip: [34 mm, 30 mm, 47 mm]}
haptics: {extrapolator: local_model, rate: 25 Hz}
time: {frame_rate: 25 Hz, duration: 1.6 s}
"""


def test_the_age_of_patches_stays_below_a_tenth_at_10000_tetrahedra(bin, tmp_path):
    bodies.write_mesh(tmp_path / "block.msh", *bodies.box((12, 12, 12), (0.06, 0.06, 0.06)))
    (tmp_path / "deep.yaml").write_text(SCENE)
    figures = {}
    for name, words in (("patch", []), ("none", ["--set", "haptics.extrapolator=hold"])):
        subprocess.run([bin / "tm-sim", tmp_path / "deep.yaml", "--lockstep", "--quiet", "--json", tmp_path / "out.json", *words], check=True, timeout=200)
        figures[name] = json.loads((tmp_path / "out.json").read_text())
    coverage, = figures["patch"]["coverage"]
    per_frame_ms = 1e3 * (figures["patch"]["processor_s"] - figures["none"]["processor_s"]) / figures["patch"]["frames"]
    print(f"{figures['patch']['tets']} tetrahedra: {coverage['carried']} of {coverage['touched']} samples with a patch, age at most {100 * coverage['age_max']:.1f} %, {per_frame_ms:.0f} ms of processor a frame")
    assert figures["patch"]["tets"] > 10000 and coverage["touched"] > 25
    assert coverage["carried"] == coverage["touched"] and 0 < coverage["age_max"] < 0.10  # renewed at once from 0.10 on
