"""MuJoCo's flex in `make compare`: RUNNER CASE.npz SETTINGS OUT.npz (case.py).

SETTINGS: {"integrator": "Euler" | "discrete", "dt_s": ...}. The pressed vertices get an armature of ten tonnes and the velocity that leads to their
prescribed positions: the flex cannot slow them, and an implicit integrator knows their motion. The force is that of the flex's springs on them
(qfrc_spring)."""
import time

import case as c
import mujoco
import numpy as np

MODEL = """<mujoco><option gravity="0 0 0" timestep="{dt!r}" integrator="{integrator}"><flag contact="disable"/></option><size memory="1G"/><worldbody>
<flexcomp name="block" type="direct" dim="3" mass="1" radius="0.0001" point="{points}" element="{elements}"><elasticity young="{young!r}" poisson="{poisson!r}"/>
<contact contype="0" conaffinity="0" selfcollide="none"/><pin id="{pins}"/></flexcomp></worldbody></mujoco>"""
ARMATURE_KG = 1e4
RESETS = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


def words(array):
    return " ".join(map(repr, array.ravel().tolist()))


def build(case, settings):
    """Returns (model, data, (F,) free or pressed vertices, (F, 3) their degrees of freedom)."""
    floor = case["held"] & ~case["patch"]
    text = MODEL.format(dt=settings["dt_s"], integrator=settings["integrator"], points=words(case["rest_m"]), elements=words(case["tets"]), young=c.YOUNG_PA,
                        poisson=c.POISSON, pins=words(np.flatnonzero(floor)))
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    moving = np.flatnonzero(~floor)
    body = model.flex_vertbodyid[moving]
    dof = model.body_dofadr[body][:, None] + np.arange(3)
    mass = c.mass_kg(case)[moving]
    model.body_mass[body] = mass
    model.dof_damping[dof] = np.where(case["patch"][moving], 0, c.DRAG_1_S * mass)[:, None]
    model.dof_armature[dof[case["patch"][moving]]] = ARMATURE_KG
    mujoco.mj_setConst(model, data)
    return model, data, moving, dof


def run(case, settings):
    began = time.process_time()
    model, data, moving, dof = build(case, settings)
    prepared, dt = time.process_time() - began, settings["dt_s"]
    pressed = dof[case["patch"][moving]]
    target = case["value_m"][case["patch"]]

    def move(t):
        data.qvel[pressed] = (target * c.ramp(t) - data.qpos[pressed]) / dt
        mujoco.mj_step(model, data)

    def rest(count):
        for _ in range(count):
            data.qvel[pressed] = 0
            mujoco.mj_step(model, data)

    def read():
        mujoco.mj_forward(model, data)
        u = np.zeros_like(case["rest_m"])
        u[moving] = data.qpos[dof]
        return {"u_m": u, "force_N": float(data.qfrc_spring[pressed[:, 2]].sum())}

    step, found = c.march(dt, move, rest, read)
    resets, warnings = sum(data.warning[int(w)].number for w in RESETS), sum(w.number for w in data.warning)
    if resets:
        raise SystemExit(f"MuJoCo reset the body {resets} times: the step was too long for it")
    return {**found, "dt_s": dt, "step_s": step, "prepare_s": prepared,
            "note": f"; warned {warnings} times" if warnings else ""}


if __name__ == "__main__":
    c.runner(run, lambda: mujoco.__version__)
