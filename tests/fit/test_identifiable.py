"""What data determine: intervals of two constants from the simulation itself hold the truth, constants that data do not determine are named, others are not."""
import json
import os
import pathlib
import subprocess
import sys

import numpy as np
import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "apps/fit"), str(ROOT / "apps/studies/reality")]
import bodies  # noqa: E402
import model  # noqa: E402
import statistics_of_fit as statistics  # noqa: E402
from trials import Trials  # noqa: E402

LONG = bool(os.environ.get("TM_LONG"))
SCENE = """title: A block between plates
tissue:
  mesh: block.msh
  materials:
    "*": {MATERIAL}
supports:
  - {name: base, plane: {point: [0, 0, 0], normal: [0, 0, 1]}, axes: AXES}
  - {name: top, plane: {point: [0, 0, 20 mm], normal: [0, 0, 1]}, displace: [0, 0, -1 mm], axes: AXES}
FREE"""
# Plates without friction: two edges keep the block from sliding.
FREE = """  - {name: left, plane: {point: [0, 0, 0], normal: [1, 0, 0]}, axes: x}
  - {name: front, plane: {point: [0, 0, 0], normal: [0, 1, 0]}, axes: y}
"""
ROW, FORCE, BULGE = "supports[1].displace=[0, 0, -{depth_m}]", "force_N=-support top z", "bulge_m=point side x"
YOUNG, POISSON, STIFFENS = "tissue.materials.*.young=1 kPa..50 kPa", "tissue.materials.*.poisson=0.1..0.45", "tissue.materials.*.C=1 kPa..60 kPa"
POINT = {"side": [0.02, 0.01, 0.01]}
LINEAR, FUNG, NEO = "young: 8 kPa, poisson: 0.35", "young: 8 kPa, poisson: 0.35, law: fung, C: 5 kPa", "young: 8 kPa, poisson: 0.35, law: neo-hooke"
TRUTH = {YOUNG: 8, POISSON: 0.35, STIFFENS: 5}


def make(folder, material, free=False):
    bodies.write_mesh(folder / "block.msh", *bodies.box((2, 2, 2), (0.02, 0.02, 0.02)))
    scene = folder / "press.yaml"
    scene.write_text(SCENE.replace("MATERIAL", material).replace("AXES", "z" if free else "xyz").replace("FREE", FREE if free else ""))
    return scene


def problem_of(constants, compares, depths):
    compared = [model.Compared(t, POINT) for t in compares]
    data = {"depth_m": depths, **{c.column: np.ones(len(depths)) for c in compared}}
    return model.Problem([model.Constant(c) for c in constants], data, [ROW], compared, POINT, tolerance=1e-8)


def calibrate(problem, trials, cases):
    """Fits data with 1 % noise, seed by seed. Returns (how often each interval holds the truth, how many verdicts)."""
    constants = problem.constants
    low, high, start = (np.array([c.inner(v) for c, v in zip(constants, values)]) for values in zip(*[(c.low, c.high, c.start) for c in constants]))
    truth = np.array([c.inner(TRUTH[t]) for c, t in zip(constants, problem.texts)])
    exact, known = problem.at(trials, truth, derivatives=False)[0], {}
    hits, verdicts = np.zeros(len(truth), int), 0
    for seed in range(cases):
        noise = 0.01 * np.abs(exact)
        measured = exact + noise * np.random.default_rng(seed).standard_normal(exact.shape)

        def evaluate(x):
            key = np.round(x, 12).tobytes()
            if key not in known:
                known[key] = problem.at(trials, x)
            values, slopes = known[key]
            return ((values - measured) / noise).ravel(), (slopes / noise[..., None]).reshape(values.size, -1)
        x, residual, jacobian = statistics.fit(evaluate, start, low, high)
        found = statistics.summary(x, residual, jacobian, low, high)
        hits += (found["interval"][:, 0] <= truth) & (truth <= found["interval"][:, 1])
        verdicts += sum(statistics.verdict(k, x, found, low, high, c.log).startswith("not") for k, c in enumerate(constants))
    return hits, verdicts


CALIBRATIONS = {"force and bulge of linear tissue": (LINEAR, (YOUNG, POISSON), (FORCE, BULGE), 0.006)}
if LONG:
    CALIBRATIONS["force under an exponential law"] = (FUNG, (YOUNG, STIFFENS), (FORCE,), 0.007)


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_intervals_of_two_constants_hold_the_truth_and_no_verdict_is_false(bin, tmp_path, name):
    """1 % noise: in at least 90 of 100 cases (twenty here: 17, which 95 % misses once in 60; seeds are fixed)."""
    material, constants, compares, deepest = CALIBRATIONS[name]
    problem, cases = problem_of(constants, compares, np.linspace(0.15, 1, 8) * deepest), 100 if LONG else 20
    problem.texts = constants
    with Trials(bin / "tm-sim", make(tmp_path, material)) as trials:
        hits, verdicts = calibrate(problem, trials, cases)
    print(name, hits, "of", cases)
    assert hits.min() >= (90 if LONG else 17) and verdicts == 0
    assert not problem.differences


def fitted(bin, scene, depths, constants, points=(), sets=()):
    """Fits the scene's own forces with 1 % noise. Returns {path: constant}."""
    with Trials(bin / "tm-sim", scene) as trials:
        answers = [trials.ask([ROW.format(depth_m=d)], settle=1e-9, points_m=POINT.values()) for d in depths]
    noise = 1 + 0.01 * np.random.default_rng(5).standard_normal((len(depths), 2))
    rows = [f"{d:.9g},{-a['supports_N'][0][1][2] * n[0]:.9g},{a['points_m'][0][0][0] * n[1]:.9g}\n" for d, a, n in zip(depths, answers, noise)]
    (scene.parent / "press.csv").write_text("depth_m,force_N,bulge_m\n" + "".join(rows))
    words = [w for c in constants for w in ("--fit", c)] + [w for c in (FORCE, *points) for w in ("--compare", c)]
    words += [w for c in ("force_N", *(("bulge_m",) if points else ())) for w in ("--noise", f"{c}=1%")]
    done = subprocess.run([bin / "tm-fit", scene, "-o", scene.parent / "fit", "--data", scene.parent / "press.csv", "--row", ROW, "--point", "side=0.02,0.01,0.01", *words],
                          capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return {c["path"].split(".")[-1]: c for c in json.loads((scene.parent / "fit/fit.json").read_text())["constants"]}


def test_poisson_of_a_free_press_is_not_identifiable_and_its_bulge_tells_it(bin, tmp_path):
    """Uniaxial stress: the force is E times the strain, whatever Poisson's ratio. The bulge is the ratio itself."""
    scene, depths = make(tmp_path, LINEAR, free=True), np.linspace(0.0005, 0.004, 6)
    alone = fitted(bin, scene, depths, (YOUNG, POISSON))
    assert alone["poisson"]["verdict"].startswith("not identifiable from this")
    assert not alone["young"]["verdict"] and abs(alone["young"]["value"] / 8 - 1) < 0.03
    both = fitted(bin, scene, depths, (YOUNG, POISSON), (BULGE,))
    assert not both["poisson"]["verdict"] and not both["young"]["verdict"] and abs(both["poisson"]["value"] / 0.35 - 1) < 0.03


def test_the_exponent_is_not_identifiable_from_a_small_press_and_is_from_a_deep_one(bin, tmp_path):
    scene = make(tmp_path, FUNG)
    small = fitted(bin, scene, np.linspace(0.00005, 0.0002, 5), (YOUNG, STIFFENS))
    assert small["C"]["verdict"].startswith("not identifiable from this"), small
    deep = fitted(bin, scene, np.linspace(0.001, 0.007, 6), (YOUNG, STIFFENS))
    assert not deep["C"]["verdict"] and not deep["young"]["verdict"]
    assert deep["C"]["interval"][0] < 5 < deep["C"]["interval"][1]
