"""The same run with another compiler; external organs; every shipped scene."""
import os
import pathlib

import numpy as np
import pytest
from simkit import report, run

SCENES = sorted((pathlib.Path(__file__).resolve().parents[2] / "apps" / "scenes").glob("*.yaml"))


@pytest.mark.parametrize("scene", SCENES, ids=lambda p: p.name)
def test_shipped_scenes_build(bin, scene):
    out, _ = run(bin / "tm-sim", scene, "--check")
    assert "tetrahedra" in out


def test_the_demo_has_ten_thousand_tetrahedra(bin, root, tmp_path):
    r = report(bin / "tm-sim", root / "apps/scenes/liver-press.yaml", "--lockstep", "--frames", 1, tmp=tmp_path)
    assert r["tets"] >= 10000


@pytest.mark.long
def test_clang_gives_the_same_bits(bin, root, make_config, tmp_path):
    """The complete control loop: tissue, contact, grasp, cut, controllers, devices. Every check compares the tissue's bits in tests/hash and the
    controller's in tests/firmware."""
    clang = make_config("clang", "bin/tm-sim") / "bin/tm-sim"
    for name, duration in (("block-cut", "3.2 s"), ("liver-press", "3 s")):
        scene = [root / f"apps/scenes/{name}.yaml", "--lockstep", "--force", "plain", "--duration", duration, "--csv"]
        one = report(bin / "tm-sim", *scene, tmp_path / "gcc.csv", tmp=tmp_path)
        two = report(clang, *scene, tmp_path / "clang.csv", tmp=tmp_path)
        assert one["force_N"]["peak"] > 0.1 and one["state_hash"] == two["state_hash"]
        assert (tmp_path / "gcc.csv").read_bytes() == (tmp_path / "clang.csv").read_bytes()


EXTRA = os.environ.get("TM_EXTRA_MESHES")
if EXTRA:
    ORGANS = [p for p in sorted(pathlib.Path(EXTRA).glob("*.msh")) if not p.name.startswith("bad")]
    BAD = sorted(pathlib.Path(EXTRA).glob("bad*.msh"))
    SCENE = """
tissue:
  mesh: {mesh}
  scale: {scale}
  materials:
    "*": {{young: 4 kPa, poisson: 0.4}}
damping: {{rate: 60 /s}}
contact:
supports:
  - box: {{min: [-10, -10, -10], max: [10, 10, {low}]}}
instruments:
  - trocar: [{x}, {y}, {trocar}]
hand:
  - path:
      - {{time: 0 s, tip: [{x}, {y}, {above}]}}
      - {{time: 1 s, tip: [{x}, {y}, {inside}]}}
haptics:
time: {{duration: 1.4 s}}
"""

    @pytest.mark.parametrize("path", ORGANS, ids=lambda p: p.name)
    def test_a_foreign_organ_can_be_pressed(bin, tmp_path, path):
        lines = path.read_text().splitlines()
        at = lines.index("$Nodes")
        x = np.array([list(map(float, line.split()[1:4])) for line in lines[at + 2:at + 2 + int(lines[at + 1])]])
        scale = 0.2 / np.ptp(x, axis=0).max()
        x *= scale
        top = x[x[:, 2].argmax()]
        thickness = np.ptp(x[:, 2])
        scene = tmp_path / "organ.yaml"
        scene.write_text(SCENE.format(mesh=path, scale=scale, low=x[:, 2].min() + 0.3 * thickness, x=top[0], y=top[1],
                                      trocar=top[2] + 0.1, above=top[2] + 0.006, inside=top[2] + 0.0025 - 0.08 * thickness))
        r = report(bin / "tm-sim", scene, "--lockstep", "--csv", tmp_path / "t.csv", tmp=tmp_path)
        t = np.genfromtxt(tmp_path / "t.csv", delimiter=",", names=True)
        force = np.array([t[f"f{a}_N"] for a in "xyz"])
        assert np.isfinite(force).all() and 0.01 < r["force_N"]["peak"] < 8.9
        assert force[2][t["time_s"] > 1.2].min() > 0  # still pushed out
        assert force[:, t["time_s"] < 0.2].max() == 0

    @pytest.mark.parametrize("path", BAD, ids=lambda p: p.name)
    def test_a_bad_mesh_is_refused_by_a_scene_too(bin, tmp_path, path):
        scene = tmp_path / "bad.yaml"
        scene.write_text(f'tissue:\n  mesh: {path}\n  materials:\n    "*": {{young: 4 kPa, poisson: 0.4}}\n')
        _, said = run(bin / "tm-sim", scene, "--lockstep", "--json", tmp_path / "no.json", code=2)
        assert said.startswith(str(path)) and ";" in said and not (tmp_path / "no.json").exists()
