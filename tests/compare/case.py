"""The case that every program of `make compare` computes, and the result that its runner returns. Needs only numpy: each runner has its own
environment.

A block of soft tissue with a fixed floor. A prescribed, smooth displacement presses the middle of its top, then holds it until the block is at rest."""
import json
import sys
import time

import numpy as np

SIZE_M = (0.06, 0.06, 0.03)
PATCH_M = 0.015  # half the width of the pressed square
YOUNG_PA, POISSON, DENSITY = 5e3, 0.45, 1060.0
DRAG_1_S = 60.0  # gamma_i = 60 /s times lumped mass: half critical for the block's lowest mode
RAMP_S, TOTAL_S = 0.1, 0.6  # e^-15 of the oscillation is left at the end


def cells(k):
    """Mesh k has 192 k^3 tetrahedra."""
    return 4 * k, 4 * k, 2 * k


def make(rest_m, tets, press):
    """The case as arrays. press: deepest displacement over the block's height. held: vertices with all components prescribed; patch: those under the
    press."""
    x, y, z = np.asarray(rest_m, float).T
    x, y = x - SIZE_M[0] / 2, y - SIZE_M[1] / 2
    patch = (z > SIZE_M[2] - 1e-9) & (np.abs(x) < PATCH_M + 1e-9) & (np.abs(y) < PATCH_M + 1e-9)
    value = np.zeros((len(z), 3))
    depth = press * SIZE_M[2] * (np.cos(np.pi * x / 2 / PATCH_M) * np.cos(np.pi * y / 2 / PATCH_M)) ** 2
    value[patch, 2] = -depth[patch]
    return {"rest_m": np.asarray(rest_m, float), "tets": np.asarray(tets, np.int32), "held": patch | (z < 1e-9), "patch": patch, "value_m": value}


def lame():
    """Returns (lambda, mu), Pa."""
    return YOUNG_PA * POISSON / ((1 + POISSON) * (1 - 2 * POISSON)), YOUNG_PA / (2 * (1 + POISSON))


def mass_kg(case):
    """Returns (V,) lumped masses, kg."""
    rest, tets = case["rest_m"], case["tets"]
    corner = rest[tets]
    volume = np.abs(np.linalg.det(corner[:, 1:] - corner[:, :1])) / 6
    return np.bincount(tets.ravel(), np.repeat(DENSITY * volume / 4, 4), len(rest))


def ramp(t_s):
    """Returns the progress of the press, 0 to 1."""
    return 0.5 - 0.5 * np.cos(np.pi * min(t_s / RAMP_S, 1.0))


def steps(dt_s):
    """Returns (steps while the press moves, steps at rest), at least ten of each."""
    moving = int(np.ceil(RAMP_S / dt_s - 1e-9))
    return moving, max(10, int(np.ceil((TOTAL_S - RAMP_S) / dt_s - 1e-9)))


WORTH_S = 0.5  # of processor time: its clock may have a resolution of 0.01 s


def march(dt_s, move, rest, read):
    """Runs a program through the press. move(t): one step, with the press at its position of time t at the end. rest(n): n steps more. Returns
    processor seconds per step, at rest, and the result of read() at TOTAL_S. Steps beyond TOTAL_S only prolong the timing and are not part of the
    case."""
    moving, still = steps(dt_s)
    for i in range(moving):
        move(min((i + 1) * dt_s, RAMP_S))
    warm = still // 5
    rest(warm)
    found, spent, done = None, 0.0, 0
    while spent < WORTH_S:
        began = time.process_time()
        rest(still - warm)
        spent += time.process_time() - began
        done += still - warm
        found = found or read()
    return spent / done, found


def runner(run, version):
    """Main function of a runner: RUNNER CASE.npz SETTINGS OUT.npz. run(case, settings) -> dict of u_m (V, 3), known (V,) bool, force_N of the press,
    dt_s, step_s (of processor time), prepare_s."""
    case, settings, out = dict(np.load(sys.argv[1])), json.loads(sys.argv[2]), sys.argv[3]
    done = run(case, settings)
    np.savez(out, u_m=done.pop("u_m"), known=done.pop("known", np.ones(len(case["rest_m"]), bool)))
    print(json.dumps({**done, "version": version()}))
