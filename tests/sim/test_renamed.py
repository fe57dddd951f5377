"""Names of 0.1 that 0.2 replaced: the error gives the new word and the place of the old one."""
import subprocess

import pytest
from simkit import BLOCK, block_scene, run

OLD = [
    ("contact: {skin: 1 mm/N}\n", "skin", "compliance"), ("contact:\nfriction: {static: 0.3, sliding: 0.2}\n", "sliding", "kinetic"),
    ("contact:\ngrasp: {fade: 0.1 s}\n", "fade", "release_time"), ("time: {mass_most: 0.1}\n", "mass_most", "mass_scaling_max"),
    ("volume:\n", "volume", "strain_smoothing"), ("strain_smoothing: {shear: 0.4}\n", "shear", "shear_share"),
    ("viscosity: {terms: [{time: 1 s, shear: 0.5, volume: 0.1}]}\n", "volume", "bulk"),
]


@pytest.mark.parametrize("text, old, new", OLD)
def test_an_old_key_names_its_new_one(bin, root, tmp_path, text, old, new):
    scene = block_scene(tmp_path, root, text)
    line = 1 + next(i for i, words in enumerate(scene.read_text().splitlines()) if f"{old}:" in words)
    _, said = run(bin / "tm-sim", scene, "--check", code=2)
    assert f"{scene.name}:{line}: '{old}' is called '{new}' since 0.2; write '{new}'" in said, said


def test_an_old_extrapolator_names_its_new_one(bin, root, tmp_path):
    scene = block_scene(tmp_path, root, "haptics: {extrapolator: contact}\n")
    _, said = run(bin / "tm-sim", scene, "--check", code=2)
    assert "'contact' is called 'local_model' since 0.2; write 'local_model'" in said, said


@pytest.mark.parametrize("program, old, new", [(["tm-view", "x.lcm"], ["--film", "a.mp4"], "--video"), (["tm-mesh", "fill", "x.stl", "-o", "x.msh"], ["--mend"], "--repair"),
                                               (["tm-precompute", "x.yaml"], ["--factor", "shared"], "distributed")])
def test_an_old_option_names_its_new_one(bin, program, old, new):
    done = subprocess.run([bin / program[0], *program[1:], *old], capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and new in done.stderr and old[-1 if "shared" in old else 0] in done.stderr, done.stderr
