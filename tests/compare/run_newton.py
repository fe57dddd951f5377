"""Newton on the processor in `make compare`: RUNNER CASE.npz SETTINGS OUT.npz (case.py).

SETTINGS: {"solver": "semi-implicit" | "VBD", "dt_s": ..., "iterations": ...}. Both solvers have the stable neo-Hookean law of Smith, de Goes and Kim
(ACM Trans. Graph. 37, 2018). VBD takes Lame's constants. The semi-implicit solver takes the law's own, so it gets 4/3 mu and lambda + 5/6 mu.
Prescribed vertices have no mass. Neither solver reports forces: they are computed here, from the positions, by the same law."""
import contextlib
import sys
import time

import case as c
import numpy as np

with contextlib.redirect_stdout(sys.stderr):  # suppresses warp's banner
    import newton
    import warp as wp

    wp.config.quiet = True
    wp.set_device("cpu")


@wp.kernel
def resist(velocity: wp.array(dtype=wp.vec3), mass: wp.array(dtype=float), rate: float, force: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    force[i] = -rate * mass[i] * velocity[i]


@wp.kernel
def place(vertex: wp.array(dtype=int), where: wp.array(dtype=wp.vec3), position: wp.array(dtype=wp.vec3)):
    i = wp.tid()
    position[vertex[i]] = where[i]


def elastic_force(case, x, mu, lam, log):
    """Returns (V, 3) N of Psi = mu/2 (I - 3) + lam/2 (J - a)^2, less mu/2 ln(I + 1) if `log`."""
    tets = case["tets"]
    rest, now = (np.stack([p[tets[:, k]] - p[tets[:, 0]] for k in (1, 2, 3)], -1) for p in (case["rest_m"], x))
    inverse, volume = np.linalg.inv(rest), np.linalg.det(rest) / 6
    F = now @ inverse
    J = np.linalg.det(F)
    shear = mu * (1 - log / ((F ** 2).sum((1, 2)) + 1))
    a = 1 + (1 - log / 4) * mu / lam
    P = shear[:, None, None] * F + (lam * (J - a) * J)[:, None, None] * np.linalg.inv(F).transpose(0, 2, 1)
    H = -volume[:, None, None] * (P @ inverse.transpose(0, 2, 1))
    force = np.zeros_like(x)
    for k in range(3):
        np.add.at(force, tets[:, k + 1], H[:, :, k])
        np.subtract.at(force, tets[:, 0], H[:, :, k])
    return force


def build(case, settings):
    """Returns (model, solver, mu and lambda of its form of the law)."""
    lam, mu = c.lame()
    semi = settings["solver"] == "semi-implicit"
    given = (4 / 3 * mu, lam + 5 / 6 * mu) if semi else (mu, lam)
    builder = newton.ModelBuilder(gravity=(0, 0, 0))
    builder.add_soft_mesh(pos=wp.vec3(0, 0, 0), rot=wp.quat_identity(), scale=1.0, vel=wp.vec3(0, 0, 0), vertices=[wp.vec3(*p) for p in case["rest_m"]],
                          indices=case["tets"].ravel().tolist(), density=c.DENSITY, k_mu=given[0], k_lambda=given[1], k_damp=0.0, particle_radius=1e-4,
                          add_surface_mesh_edges=False)
    for i in np.flatnonzero(case["held"]):
        builder.particle_mass[i] = 0.0
        builder.particle_flags[i] &= ~newton.ParticleFlags.ACTIVE
    if not semi:
        builder.color()
    model = builder.finalize(device="cpu")
    model.particle_grid = None  # no contact among particles
    solver = newton.solvers.SolverSemiImplicit(model, enable_tri_contact=False) if semi else newton.solvers.SolverVBD(model, iterations=settings["iterations"])
    return model, solver, given if semi else (mu, lam + mu)


def run(case, settings):
    began, dt = time.process_time(), settings["dt_s"]
    model, solver, (mu, lam) = build(case, settings)
    before, after, control = model.state(), model.state(), model.control()
    vertex = np.flatnonzero(case["patch"])
    rest_m, value = case["rest_m"][vertex], case["value_m"][vertex]
    pressed, mass = wp.array(vertex.astype(np.int32), dtype=int), wp.array(c.mass_kg(case).astype(np.float32), dtype=float)
    drag = c.DRAG_1_S if settings.get("drag", True) else 0.0

    def rest(count):
        nonlocal before, after
        for _ in range(count):
            before.clear_forces()
            if drag:
                wp.launch(resist, dim=len(case["rest_m"]), inputs=[before.particle_qd, mass, drag, before.particle_f])
            solver.step(before, after, control, None, dt)
            before, after = after, before

    def move(t):
        where = wp.array((rest_m + value * c.ramp(t)).astype(np.float32), dtype=wp.vec3)
        for state in (before, after):
            wp.launch(place, dim=len(vertex), inputs=[pressed, where, state.particle_q])
        rest(1)

    def read():
        x = before.particle_q.numpy().astype(float)
        force = elastic_force(case, x, mu, lam, settings["solver"] == "semi-implicit")
        return {"u_m": x - case["rest_m"], "force_N": float(force[vertex, 2].sum())}

    with contextlib.redirect_stdout(sys.stderr):  # compiles at the first step
        wp.load_module(sys.modules[__name__])
        rest(1)
        prepared = time.process_time() - began
        step, found = c.march(dt, move, rest, read)
    return {**found, "dt_s": dt, "step_s": step, "prepare_s": prepared}


if __name__ == "__main__":
    c.runner(run, lambda: f"{newton.__version__}, Warp {wp.__version__}")
