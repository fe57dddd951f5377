"""Derivatives by the adjoint of a rest: those of differences of rests, for the constants of every law, and where there are none."""
import os
import pathlib
import sys

import numpy as np
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "apps/fit"), str(ROOT / "apps/studies/reality")]
import bodies  # noqa: E402
import model  # noqa: E402
from trials import Trials  # noqa: E402

LONG = bool(os.environ.get("TM_LONG"))
SCENE = """title: A block between plates that shift
tissue:
  mesh: block.msh
  materials:
    "*": {MATERIAL}
supports:
  - {name: base, plane: {point: [0, 0, 0], normal: [0, 0, 1]}}
  - {name: top, plane: {point: [0, 0, 20 mm], normal: [0, 0, 1]}, displace: [0.5 mm, 0, 4 mm]}
EFFECTS
"""
YOUNG, POISSON = "tissue.materials.*.young=3 kPa..8 kPa", "tissue.materials.*.poisson=0.1..0.45"
FIBRES = "anisotropy: {rule: constant, direction: [0.3, 0.2, 1]}"
CASES = {
    "linear": ("young: 5 kPa, poisson: 0.3", "gravity:", (YOUNG, POISSON, "tissue.materials.*.density=500 kg/m3..1500 kg/m3")),
    "linear, smoothed": ("young: 5 kPa, poisson: 0.4", "strain_smoothing:", (YOUNG, "tissue.materials.*.poisson=0.1..0.499")),
    "rotation": ("young: 5 kPa, poisson: 0.3", "rotation:", (YOUNG, POISSON)),
    "neo-hooke, smoothed": ("young: 5 kPa, poisson: 0.4, law: neo-hooke", "strain_smoothing:", (YOUNG, "tissue.materials.*.poisson=0.1..0.499")),
    "st-venant-kirchhoff": ("young: 5 kPa, poisson: 0.3, law: st-venant-kirchhoff", "", (YOUNG, POISSON, "tissue.materials.*.compression=0.1..0.9")),
    "mooney-rivlin": ("young: 5 kPa, poisson: 0.3, law: mooney-rivlin", "", (YOUNG, POISSON, "tissue.materials.*.second=0.05..0.8")),
    "fung, viscous": ("young: 5 kPa, poisson: 0.3, law: fung, C: 4 kPa", "viscosity: {terms: [{time: 0.1 s, shear: 0.2}]}",
                      (YOUNG, "tissue.materials.*.C=2 kPa..10 kPa", "viscosity.terms[0].shear=0.05..0.5")),
    "holzapfel": ("young: 5 kPa, poisson: 0.3, law: holzapfel, k1: 1 kPa, k2: 1, dispersion: 0.1", FIBRES,
                  ("tissue.materials.*.k1=0.5 kPa..3 kPa", "tissue.materials.*.k2=0.5..2", "tissue.materials.*.dispersion=0.02..0.3") + ((YOUNG, POISSON) if LONG else ())),
}


def problem_of(folder, case, **more):
    material, effects, constants = CASES[case]
    bodies.write_mesh(folder / "block.msh", *bodies.box((2, 2, 2), (0.02, 0.02, 0.02)))
    (folder / "block.yaml").write_text(SCENE.replace("MATERIAL", material).replace("EFFECTS", effects))
    points = {"side": [0.02, 0.01, 0.012]}
    compared = [model.Compared(t, points) for t in ("x_N=support top x", "z_N=-support top z", "x_m=point side x")]
    data = {"depth_m": np.array([0.004]), **{c.column: np.ones(1) for c in compared}}
    return model.Problem([model.Constant(c) for c in constants], data, ["supports[1].displace=[0.5 mm, 0, {depth_m}]"], compared, points, tolerance=1e-10, **more)


def by_differences(problem, trials, x, step=2e-2):
    """Central differences at one step and at half of it, extrapolated (fourth order)."""
    def central(k, by):
        ends = [problem.at(trials, problem.shifted(x, k, s * by), derivatives=False)[0] for s in (1, -1)]
        return (ends[0] - ends[1]) / (2 * by)
    return np.stack([(4 * central(k, step / 2) - central(k, step)) / 3 for k in range(len(x))], -1)


@pytest.mark.parametrize("case", CASES)
def test_adjoint_equals_differences(bin, tmp_path, case):
    problem = problem_of(tmp_path, case)
    x = np.array([c.inner(c.start) for c in problem.constants])
    with Trials(bin / "tm-sim", tmp_path / "block.yaml") as trials:
        _, adjoint = problem.at(trials, x)
        assert not problem.differences and problem.solutions == 3 and problem.evaluations == 1
        differences = by_differences(problem, trials, x)
    size = np.abs(differences).max(-1, keepdims=True)
    assert size.min() > 0 and np.abs(adjoint - differences).max() <= 1e-6 * np.abs(differences).max()
    assert np.abs((adjoint - differences) / size).max() < 1e-6


def test_rows_that_change_more_than_supports_have_scenes_of_their_own(bin, tmp_path):
    """A row that sets Poisson's ratio: the derivatives of its force are those at this ratio."""
    problem = problem_of(tmp_path, "linear, smoothed")
    problem.constants, problem.row_sets = problem.constants[:1], ["tissue.materials.*.poisson={depth_m}"]
    problem.data = {**{name: np.ones(2) for name in problem.data}, "depth_m": np.array([0.1, 0.45])}
    problem.measured, problem.count = np.ones((2, 3)), 2
    x = np.log([5.0])
    with Trials(bin / "tm-sim", tmp_path / "block.yaml") as trials:
        values, slopes = problem.at(trials, x)
    assert np.allclose(slopes[:, :2, 0], values[:, :2], rtol=1e-7)  # linear: the force is a multiple of E
    assert np.abs(slopes[:, 2]).max() < 1e-6 * np.abs(values[:, 2]).max()


def ask(bin, scene, sets, slopes):
    with Trials(bin / "tm-sim", scene, sets) as trials:
        return trials.ask(settle=1e-6, points_m=[[0.01, 0.01, 0.01]], slopes=slopes)


def test_where_there_is_no_adjoint_the_answer_says_why(bin, tmp_path):
    problem_of(tmp_path, "linear")
    scene, stiffer = tmp_path / "block.yaml", [["tissue.materials.*.young=6 kPa"], ["tissue.materials.*.young=5 kPa"]]
    cases = [([], {"of": [["support", "lid", 2]], "by": []}, "neither a support nor a point"),
             ([], {"of": [["point", 1, 2]], "by": []}, "neither a support nor a point"),
             ([], {"of": [["point", 0, 3]], "by": []}, "a quantity is not"),
             ([], {"of": [], "by": [[["supports[1].displace=[0, 0, 1 mm]"], ["supports[1].displace=[0, 0, 2 mm]"]]]}, "moves a support"),
             ([], {"of": [], "by": [[["supports[1].displace=[0, 0, 1 mm]"], ["tissue.materials.*.yung=1"]]]}, "cannot be built"),
             ([], {"of": [], "by": [[["tissue.scale=2"], ["tissue.scale=2"]]]}, "mesh or supports"),
             (["touch={}"], {"of": [["point", 0, 2]], "by": [stiffer]}, "contact")]
    for sets, slopes, why in cases:
        answer = ask(bin, scene, sets, slopes)
        assert answer["slopes"] is None and why in answer["why"], (slopes, answer["why"])
    assert ask(bin, scene, [], {"of": [["point", 0, 2]], "by": [stiffer]})["slopes"]


def test_a_fit_falls_back_to_differences_and_says_so(bin, tmp_path):
    problem = problem_of(tmp_path, "linear")
    x = np.array([c.inner(c.start) for c in problem.constants])
    with Trials(bin / "tm-sim", tmp_path / "block.yaml") as trials:
        _, adjoint = problem.at(trials, x)
    other = problem_of(tmp_path, "linear")
    with Trials(bin / "tm-sim", tmp_path / "block.yaml", ["touch={}"]) as trials:
        _, differences = other.at(trials, x)
    assert "contact" in other.differences and not other.solutions
    assert np.allclose(adjoint, differences, rtol=0, atol=0.01 * np.abs(adjoint).max())
    asked = problem_of(tmp_path, "linear", adjoint=False)
    with Trials(bin / "tm-sim", tmp_path / "block.yaml") as trials:
        asked.at(trials, x)
    assert asked.differences == "asked for" and asked.evaluations == 4
