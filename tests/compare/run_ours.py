"""tensormass in `make compare`: RUNNER CASE.npz SETTINGS OUT.npz (case.py). SETTINGS: {"do": "mesh" | "static" | "dynamic" | "precomputed", ...}."""
import json
import sys
import time

import numpy as np
import tensormass as tm

import case as c


def tissue_of(case, settings):
    mesh = tm.Mesh(case["rest_m"], case["tets"])
    material = tm.Material.young(c.YOUNG_PA, c.POISSON, density_kg_m3=c.DENSITY, damping_1_s=c.DRAG_1_S)
    return tm.Tissue(mesh, material, strain_smoothing=settings.get("volume", False), precision=settings.get("precision", "double"))


def fixed(case):
    return np.repeat(case["held"][:, None], 3, 1)


def static(case, settings):
    tissue = tissue_of(case, settings)
    began = time.process_time()
    u, reaction, _ = tm.solve_static(tissue, fixed(case), case["value_m"])
    return {"u_m": u, "force_N": -reaction[case["patch"], 2].sum(), "dt_s": 0, "step_s": 0, "prepare_s": time.process_time() - began,
            "critical_s": tissue.critical_step()[0]}


def dynamic(case, settings):
    began = time.process_time()
    tissue = tissue_of(case, settings)
    world = tm.World(tissue)
    held = np.flatnonzero(case["held"])
    world.add_support(held)
    pressed = [(3 * i + 2, float(case["value_m"][v, 2])) for i, v in enumerate(held) if case["patch"][v]]
    prepared = time.process_time() - began

    def move(t):
        for component, value in pressed:
            world.move_support(component, value * c.ramp(t))
        world.step(1)

    def read():
        return {"u_m": np.array(world.u_m), "force_N": -world.support_reaction_N[case["patch"], 2].sum()}

    step, found = c.march(world.dt_s, move, world.step, read)
    return {**found, "dt_s": world.dt_s, "step_s": step, "prepare_s": prepared}


def precomputed(case, settings):
    began = time.process_time()
    tissue = tissue_of(case, settings)
    floor = np.repeat((case["held"] & ~case["patch"])[:, None], 3, 1)
    model = tm.Precomputed(tm.Problem(tissue, floor, threads=1), max_contact_vertices=int(case["patch"].sum()))
    prepared = time.process_time() - began
    patch = np.flatnonzero(case["patch"])

    def move(t):
        model.impose(patch, case["value_m"][patch] * c.ramp(t))
        model.update([])

    def rest(count):
        for i in range(count):  # a tiny oscillation: no program may skip work because nothing moves
            model.impose(patch, case["value_m"][patch] * (1 - 1e-9 * (i % 2)))
            model.update([])

    def read():
        return {"u_m": np.array(model.u_m), "force_N": -sum(model.imposed_force(i)[2] for i in range(len(patch)))}

    step, found = c.march(settings["dt_s"], move, rest, read)
    known = np.zeros(len(case["rest_m"]), bool)
    known[model.surface_vertices] = True
    return {**found, "known": known, "dt_s": settings["dt_s"], "step_s": step, "prepare_s": prepared}


if __name__ == "__main__":
    asked = json.loads(sys.argv[2])
    if asked["do"] == "mesh":
        block = tm.Mesh.block(c.SIZE_M, c.cells(asked["k"]))
        np.savez(sys.argv[1], **c.make(block.rest_m, block.tets, asked["press"]))
    else:
        c.runner({"static": static, "dynamic": dynamic, "precomputed": precomputed}[asked["do"]], lambda: tm.__version__)
