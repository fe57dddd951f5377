"""A load's `pressure` in scenes: the fibred beam of Land et al. (2015), problem 1, and rejected input."""
import itertools
import json

import numpy as np
import pytest
from simkit import run

SCENE = """\
title: The fibred beam of Land et al. (2015), problem 1
# 10 x 1 x 1 mm, one end held, fibres along it, Guccione's law (C 2 kPa, bf 8, bt 2, bfs 4), a pressure of 4 Pa below.
# The codes of the paper have the deflected tip at 4.17 mm; 120 x 4 x 12 boxes and lambda 400 kPa 4.09 (tests/physics/test_pressure).
tissue:
  mesh: beam.msh
  materials:
    "*": {law: fung, C: 2 kPa, lambda_T: 100 kPa, lambda_L: 100 kPa, mu_T: 2 kPa, mu_L: 4 kPa, beta: 4 kPa}
strain_smoothing: {shear_share: 0}
anisotropy: {file: beam.fibres.csv}
supports:
  - {name: wall, plane: {point: [0 mm, 0 mm, 0 mm], normal: [1, 0, 0]}}
loads:
  - {name: below, plane: {point: [0 mm, 0 mm, 0 mm], normal: [0, 0, 1]}, pressure: 4 Pa}
"""


def write_beam(path, cells=(40, 2, 4), size=(0.01, 0.001, 0.001)):
    at = np.array(list(itertools.product(*(range(n + 1) for n in cells))))
    number = {tuple(a): i + 1 for i, a in enumerate(at)}
    tets = []
    for corner in itertools.product(*(range(n) for n in cells)):
        for path_ in itertools.permutations(range(3)):
            a = list(corner)
            tet = [number[tuple(a)]]
            for axis in path_:
                a[axis] += 1
                tet.append(number[tuple(a)])
            even = path_ in ((0, 1, 2), (1, 2, 0), (2, 0, 1))
            tets.append(tet if even else [tet[0], tet[2], tet[1], tet[3]])
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", str(len(at))]
    lines += [f"{i + 1} {x:.17g} {y:.17g} {z:.17g}" for i, (x, y, z) in enumerate(at / cells * size)]
    lines += ["$EndNodes", "$Elements", str(len(tets))]
    lines += [f"{i + 1} 4 2 1 1 {a} {b} {c} {d}" for i, (a, b, c, d) in enumerate(tets)]
    path.write_text("\n".join(lines + ["$EndElements", ""]))
    path.with_name("beam.fibres.csv").write_text("tet,ax,ay,az\n" + "".join(f"{i},1,0,0\n" for i in range(len(tets))))


@pytest.fixture
def scene(tmp_path):
    write_beam(tmp_path / "beam.msh")
    (tmp_path / "beam.yaml").write_text(SCENE)
    return tmp_path / "beam.yaml"


def test_the_beam_bends_as_in_the_library(bin, scene, tmp_path):
    run(bin / "tm-sim", scene, "--settle", "1e-6", "--write", tmp_path / "out.csv", "--json", tmp_path / "out.json")
    rest_u = np.loadtxt(tmp_path / "out.csv", delimiter=",", skiprows=1)[:, 1:7]
    tip = [row for row in rest_u if np.allclose(row[:3], (0.01, 0.0005, 0.001), atol=1e-9)]
    assert len(tip) == 1 and 1e3 * (tip[0][2] + tip[0][5]) == pytest.approx(3.738, abs=0.002)
    wall, = json.loads((tmp_path / "out.json").read_text())["supports"]
    assert wall["reaction_N"][2] < 0  # the support holds down what the pressure lifts


@pytest.mark.parametrize("old,new,says", [
    ("pressure: 4 Pa", "pressure: 4 Pa, force: [0 N, 0 N, 1 N]", "give one of them"),
    ("normal: [0, 0, 1]}, pressure", "normal: [0, 0, 1]}, traction", "loads[0].traction"),
    ("plane: {point: [0 mm, 0 mm, 0 mm], normal: [0, 0, 1]}", "plane: {point: [0 mm, 0 mm, 0.5 mm], normal: [0, 0, 1]}", "widen the selector"),
    ("title:", "model: precomputed\ntitle:", "model: dynamic")])
def test_bad_input_is_refused(bin, scene, old, new, says):
    scene.write_text(SCENE.replace(old, new, 1))
    _, said = run(bin / "tm-sim", scene, "--settle", "1e-6", code=2)
    assert says in said, said
