"""Run by test_package.py with the wheel's Python: mesh, tissue, world."""
import gc
import signal
import threading
import time

import numpy as np
import pytest
import tensormass as tm

LIVER = tm.Material.young(5e3, 0.45, density_kg_m3=1060, damping_1_s=40)


def block(cells=(4, 4, 2), **options):
    mesh = tm.Mesh.block((0.04, 0.04, 0.02), cells)
    tissue = tm.Tissue(mesh, LIVER, form="plain", **options)
    world = tm.World(tissue)
    world.add_support(mesh.near((0, 0, 0), (0, 0, 1)))
    return mesh, tissue, world


def test_mesh_arrays_are_the_librarys_own():
    mesh, tissue, _ = block()
    assert mesh.rest_m.shape == (75, 3) and mesh.tets.shape == (192, 4)
    assert mesh.rest_m.ctypes.data == mesh.rest_m.ctypes.data and not mesh.rest_m.flags.owndata, "no copy"
    assert not mesh.rest_m.flags.writeable
    assert mesh.volume_m3.sum() == pytest.approx(0.04 * 0.04 * 0.02)
    assert np.linalg.norm(np.cross(*(mesh.rest_m[mesh.surface[:, 1:]] - mesh.rest_m[mesh.surface[:, :1]]).transpose(1, 0, 2)), axis=1).sum() / 2 == pytest.approx(
        2 * 0.04 * 0.04 + 4 * 0.04 * 0.02)
    assert tissue.mass_kg.sum() == pytest.approx(1060 * 0.04 * 0.04 * 0.02)
    assert mesh.quality(0).volume_m3 == mesh.volume_m3[0]


def test_a_mesh_whose_numbers_jump():
    """A mesh is renumbered on request if that pays: values convert there and back, and a world moves identically."""
    plain = tm.Mesh.block((0.1, 0.1, 0.1), (10, 10, 10))
    was = np.random.default_rng(1).permutation(plain.vertex_count)
    now = np.argsort(was)
    kept = tm.Mesh(plain.rest_m[was], now[plain.tets])
    mesh = tm.Mesh(plain.rest_m[was], now[plain.tets], renumber=True)
    assert kept.original_vertex is None and np.array_equal(kept.to_original(kept.rest_m), kept.rest_m)
    assert tm.Mesh(plain.rest_m, plain.tets, renumber=True).original_vertex is None
    assert np.array_equal(np.sort(mesh.original_vertex), np.arange(plain.vertex_count)) and np.array_equal(mesh.original_vertex[mesh.tets], kept.tets)
    assert np.array_equal(mesh.to_original(mesh.rest_m), kept.rest_m) and np.array_equal(mesh.from_original(kept.rest_m), mesh.rest_m)
    assert np.abs(np.diff(mesh.edges)).mean() < np.abs(np.diff(kept.edges)).mean() / 3
    marks = np.arange(plain.vertex_count) % 7 == 0
    assert np.array_equal(mesh.to_original(mesh.from_original(marks)), marks)
    with pytest.raises(tm.ArgumentError, match="one row each"):
        mesh.to_original(np.zeros(3))
    moved = []
    for m in (kept, mesh):
        world = tm.World(tm.Tissue(m, LIVER, form="plain"))
        world.add_support(m.near((0, 0, 0), (0, 0, 1)))
        world.add_gravity()
        world.step(50)
        moved.append(m.to_original(world.u_m))
    assert np.allclose(*moved, rtol=0, atol=1e-9 * np.abs(moved[0]).max())


def test_force_is_the_gradient_of_energy():
    mesh, tissue, _ = block()
    rng = np.random.default_rng(0)
    u, d = 1e-3 * rng.standard_normal((2, mesh.vertex_count, 3))
    h = 1e-3
    slope = (tissue.energy(u + h * d) - tissue.energy(u - h * d)) / (2 * h)
    assert -np.sum(tissue.force(u) * d) == pytest.approx(slope, rel=1e-9)


def test_voigt_matches_lame():
    C = tm.Material.lame(2000, 1000).voigt()
    assert C[0, 0] == pytest.approx(4000) and C[0, 1] == pytest.approx(2000) and C[3, 3] == pytest.approx(1000)
    with pytest.raises(tm.ArgumentError):
        tm.Material.paper(2000, 1000, 3000, 2000).voigt()


def test_arrays_keep_what_they_belong_to_alive():
    before = tm.memory_in_use()
    _, _, world = block()
    world.add_gravity()
    world.step(10)
    u = world.u_m
    expected = u.copy()
    del world, _
    gc.collect()
    assert tm.memory_in_use() > before and np.array_equal(u, expected)
    del u
    gc.collect()
    assert tm.memory_in_use() == before


def test_objects_in_a_cycle_go_in_the_right_order():
    before = tm.memory_in_use()
    for _ in range(20):
        mesh, tissue, world = block((2, 2, 1))
        world.add_stage("mine", lambda w, mine=(mesh, tissue, world): None)
        world.step()
        del mesh, tissue, world
    gc.collect()
    assert tm.memory_in_use() == before


def test_errors_are_the_librarys_sentences():
    with pytest.raises(tm.MeshError, match=";") as caught:
        tm.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 3, 2]])
    assert caught.value.status == "TM_ERR_MESH" and caught.value.entity == 0
    with pytest.raises(tm.MaterialError, match="positive definite"):
        tm.Material.young(-1, 0.3)
    with pytest.raises(tm.MaterialError, match="stretch <= 4 is violated"):
        LIVER.with_law("neo-hooke", 9)
    with pytest.raises(tm.MaterialError, match="2 w/C <= 6 is violated"):
        LIVER.with_law("fung", constants=[100])
    assert tm.Material.laws()["fung"] == ("C", "slack") and "k1" in tm.Material.laws()["holzapfel"] and tm.Material.laws()["linear"] == ()
    with pytest.raises(tm.ArgumentError, match="neo-hooke"):
        LIVER.with_law("hooke")
    mesh, tissue, world = block()
    with pytest.raises(tm.StepError, match="critical"):
        world.dt_s = 1
    with pytest.raises(ValueError, match="shape"):
        tissue.force(np.zeros((3, 3)))
    with pytest.raises(tm.ArgumentError, match="not whole"):
        tm.Mesh(mesh.rest_m, mesh.tets + 0.5)
    with pytest.raises(tm.SupportError):
        tm.World(tissue).check_constrained()


def test_broken_contracts_raise_and_change_nothing():
    _, _, world = block()
    before = world.hash
    with pytest.raises(tm.ContractError, match="tm_support_move"):
        world.move_support(10**6, 0.1)
    with pytest.raises(tm.ContractError):
        world.step(-1)
    assert world.hash == before
    world.step()


def test_a_fall_of_the_whole():
    """Without supports, after n steps every vertex has fallen g t^2 / 2, with the scheme's half step."""
    mesh = tm.Mesh.block((0.02, 0.02, 0.02), (2, 2, 2))
    world = tm.World(tm.Tissue(mesh, tm.Material.young(5e3, 0.4)), damped=False)
    world.add_gravity((0, 0, -9.81))
    world.step(100)
    n, dt = world.steps, world.dt_s
    assert np.allclose(world.u_m[:, 2], -9.81 * dt * dt * n * (n + 1) / 2, rtol=1e-9)


def test_settled_is_solved():
    mesh, tissue, world = block()
    world.add_gravity()
    settled = world.settle(1e-9)
    load = np.zeros((mesh.vertex_count, 3))
    load[:, 2] = -9.81 * tissue.mass_kg
    u, reaction, report = tm.solve_static(tissue, world.support_mask, None, load)
    assert settled.residual <= 1e-9 and np.abs(u - world.u_m).max() < 1e-6 * np.abs(u).max()
    assert reaction[:, 2].sum() == pytest.approx(9.81 * tissue.mass_kg.sum())
    assert report.free_dofs == int((world.support_mask == 0).sum())


def test_progress_stops_and_raises():
    _, tissue, world = block((10, 10, 5))  # the library asks every 128 steps
    world.add_gravity()
    with pytest.raises(tm.ConvergenceError):
        world.settle(1e-14, progress=lambda step, residual: False)

    def broken(*_):
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        world.settle(1e-14, progress=broken)
    with pytest.raises(KeyError, match="mine"):
        tm.solve_static(tissue, world.support_mask, progress=broken)


def test_traction_and_load():
    mesh, _, world = block()
    top = mesh.surface[(mesh.rest_m[mesh.surface][:, :, 2] > 0.02 - 1e-9).all(1)]
    force = world.traction(top, (0, 0, -100.0))
    assert force.sum(0) == pytest.approx([0, 0, -100 * 0.04 * 0.04])
    world.add_load(force)
    world.settle(1e-8)
    assert world.support_reaction_N.sum(0) == pytest.approx([0, 0, 0.16], abs=1e-6)


def test_a_pressure_follows_the_surface():
    """A block pressed on its top: at rest the floor bears the pressure over the deformed area, which is not that at rest."""
    mesh, _, world = block()
    top = np.flatnonzero((mesh.rest_m[mesh.surface][:, :, 2] > 0.02 - 1e-9).all(1))
    world.add_pressure(top[1:], 200.0 * np.ones(len(top) - 1))
    with pytest.raises(tm.ArgumentError, match="already has stage pressure"):
        world.add_pressure(top[:1], 200.0)
    world.remove_stage("pressure")
    for wrong, says in ((([len(mesh.surface)], 1.0), "outside 0 to"), ((top[:2], [1.0, np.nan]), f"triangle {top[1]}")):
        with pytest.raises(tm.ArgumentError, match=says):
            world.add_pressure(*wrong)
    world.add_pressure(np.append(top, top), 100.0)
    world.settle(1e-9)
    p, q, r = np.moveaxis((mesh.rest_m + world.u_m)[mesh.surface[top]], 1, 0)
    force = (-200.0 * np.cross(q - p, r - p) / 2).sum(0)
    assert abs(force[2] / (-200.0 * 0.04 * 0.04) - 1) > 1e-3
    assert world.support_reaction_N.sum(0) == pytest.approx(-force, abs=1e-6)


def test_a_stage_in_python_equals_one_in_c():
    worlds = []
    for mine in (False, True):
        mesh, tissue, world = block()
        force = np.zeros((mesh.vertex_count, 3))
        force[-1, 2] = -0.05
        if mine:
            def push(w, force=force):
                w.force_N[:] += force
            world.add_stage("push", push)
        else:
            world.add_load(force)
        world.step(300)
        worlds.append(world)
    assert worlds[0].hash == worlds[1].hash
    assert [s.name for s in worlds[1].stages if s.phase == "load"] == ["push"]


@pytest.mark.parametrize("phase", ["begin", "force", "load", "integrate", "constrain", "end"])
def test_a_stage_that_raises_gives_back(phase):
    _, _, world = block()
    world.add_gravity()
    world.step(20)
    before, steps = world.hash, world.steps

    def fail(w):
        if w.steps >= steps + 3:
            raise ZeroDivisionError(phase)

    world.add_stage("fails", fail, phase)
    with pytest.raises(ZeroDivisionError, match=phase):
        world.step(10)
    assert world.hash == before and world.steps == steps
    world.remove_stage("fails")
    world.step(10)
    assert world.steps == steps + 10


def test_unstable_is_as_before():
    _, _, world = block()

    def blow(w):
        w.force_N[:] = np.inf

    world.step(5)
    before = world.hash
    world.add_stage("blow", blow)
    with pytest.raises(tm.UnstableError, match="as before"):
        world.step(5)
    assert world.hash == before


def bar(rotation, volume=False):
    """A bar of 20 x 20 x 80 mm, prescribed at both ends."""
    mesh = tm.Mesh.block((0.02, 0.02, 0.08), (2, 2, 8))
    world = tm.World(tm.Tissue(mesh, LIVER, rotation=rotation, strain_smoothing=volume))
    if rotation:
        world.add_rotation()
    ends = np.flatnonzero((mesh.rest_m[:, 2] == 0) | (mesh.rest_m[:, 2] > 0.0799))
    world.add_support(ends)
    return mesh, world, ends


def turn(mesh, world, ends, about_x, angle=0.0):
    """Rotates both ends about x, the far one about z as well."""
    x = mesh.rest_m[ends] - [0.01, 0.01, 0]
    c, s = np.cos(angle), np.sin(angle)
    y = np.where(x[:, 2:] > 0, np.stack([c * x[:, 0] - s * x[:, 1], s * x[:, 0] + c * x[:, 1], x[:, 2]], 1), x)
    c, s = np.cos(about_x), np.sin(about_x)
    y = np.stack([y[:, 0], c * y[:, 1] - s * y[:, 2], s * y[:, 1] + c * y[:, 2]], 1)
    for component, value in enumerate((y - x).ravel()):
        world.move_support(component, value)


@pytest.mark.parametrize("volume", [False, True])
def test_settling_leads_turned_ends_round(volume, recwarn):
    mesh, world, ends = bar(0.02, volume)
    turn(mesh, world, ends, np.pi / 2)
    settled = world.settle(1e-8)
    assert abs(settled.energy_J) < 1e-12 and settled.deformation.min_det == pytest.approx(1) and settled.deformation.doubt == ""
    turn(mesh, world, ends, np.pi / 2, np.pi)
    settled = world.settle(1e-8)
    assert settled.load_steps > 1 and settled.deformation.inverted == 0 and settled.deformation.min_det > 0.8
    assert not recwarn.list
    with pytest.raises(tm.ConvergenceError, match="allow a tolerance of"):
        turn(mesh, world, ends, 0.3)
        world.settle(1e-15)


def test_linear_tissue_that_turned_is_warned_of():
    mesh, world, ends = bar(0.0)
    turn(mesh, world, ends, np.pi / 2)
    with pytest.warns(tm.DeformationWarning, match="'rotation'"):
        settled = world.settle(1e-9)
    assert settled.deformation.nonlinear_share > 0.9 and settled.deformation == world.tissue.deformation(world.u_m)


def test_ctrl_c_and_what_a_stage_raises_end_settling():
    """Also without `progress`."""
    _, _, world = block((16, 16, 8))  # 20,000 relaxed steps and more: seconds
    contact = world.add_contact([tm.Instrument(trocar_m=(0.02, 0.02, 0.15), tip_m=(0.02, 0.02, 0.035))])
    world.add_gravity()
    before = world.hash
    threading.Timer(0.1, lambda: signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        world.settle(1e-18)  # below any rounding
    assert contact and world.hash == before

    def fail(w):
        raise ZeroDivisionError("in a stage")

    world.add_stage("fails", fail)
    with pytest.raises(ZeroDivisionError, match="in a stage"):
        world.settle(1e-3)


def test_a_stiff_stage_has_a_step_limit():
    """5,000 N/m on every vertex: with its limit it is stable; without, the state after a failure is bounded by the body's size."""
    mesh, tissue, world = block()
    mass, guaranteed = tissue.mass_kg, tissue.critical_step()[0]
    limit = (1 / guaranteed ** 2 + (5000 / (4 * mass)).max()) ** -0.5
    world.u_m[:] = world.u_prev_m[:] = 1e-3 * np.sin(np.arange(world.u_m.size)).reshape(-1, 3)

    def spring(w):
        w.force_N[:] -= 5000 * w.u_m

    with pytest.raises(tm.StepError, match="spring"):
        world.add_stage("spring", spring, step_limit_s=limit)
    start = world.snapshot()
    world.add_stage("spring", spring)
    with pytest.raises(tm.UnstableError, match="step_limit_s"):
        for _ in range(500):
            world.step(10)
    assert np.abs(world.u_m).max() <= 1000 * np.linalg.norm([0.04, 0.04, 0.02])
    world.remove_stage("spring")
    world.restore(start)
    world.dt_s = limit
    world.add_stage("spring", spring, step_limit_s=limit)
    world.step(2000)
    assert np.abs(world.u_m).max() < 2e-3


def test_snapshots_go_on_with_the_same_bits():
    _, _, world = block()
    world.add_gravity()
    world.step(50)
    kept = world.snapshot()
    assert len(kept) <= world.snapshot_bytes_max
    world.step(50)
    after = world.hash
    world.restore(kept)
    assert world.steps == 50
    world.step(50)
    assert world.hash == after
    with pytest.raises(tm.FileError):
        world.restore(kept[:-1])
    broken = bytearray(kept)
    broken[len(broken) // 2] ^= 1
    with pytest.raises(tm.FileError):
        world.restore(bytes(broken))
    assert world.hash == after


def test_energy_closes():
    _, _, world = block()
    world.add_gravity()
    world.add_energy()
    world.step(500)
    e = world.energy
    assert e.damping_J > 0 and abs(e.residual_J) < 1e-9 * abs(e.gravity_J)


def test_critical_steps():
    _, tissue, world = block()
    guaranteed, tet = tissue.critical_step()
    assert 0 <= tet < tissue.mesh.tet_count and world.dt_s == pytest.approx(0.9 * guaranteed)
    assert tissue.critical_step_estimate(world.support_mask) >= guaranteed


@pytest.mark.filterwarnings("ignore::tensormass.DeformationWarning")
def test_volume_and_rotation():
    """A cantilever near Poisson's ratio 0.5 is less stiff without locking; rotated as a whole, tissue with rotation has no stress."""
    mesh = tm.Mesh.block((0.06, 0.01, 0.01), (12, 2, 2))
    material = tm.Material.young(5e4, 0.49, density_kg_m3=1000, damping_1_s=40)
    sag = []
    for volume in (False, True):
        world = tm.World(tm.Tissue(mesh, material, strain_smoothing=volume))
        world.add_support(mesh.near((0, 0, 0), (1, 0, 0)))
        world.add_gravity()
        world.settle(1e-7)
        sag.append(-world.u_m[:, 2].min())
    assert sag[1] > 1.1 * sag[0]
    world = tm.World(tm.Tissue(mesh, material, rotation=0.02))
    world.add_rotation()
    angle = 0.5
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    world.u_m[:] = world.u_prev_m[:] = mesh.rest_m @ turn.T - mesh.rest_m
    before = world.u_m.copy()
    world.step(10)
    assert np.abs(world.u_m - before).max() < 1e-9
    with pytest.raises(tm.Error, match="rotation"):
        tm.World(tm.Tissue(mesh, material)).add_rotation()


@pytest.mark.filterwarnings("ignore::tensormass.DeformationWarning")
def test_viscosity():
    """Tissue that relaxes to half its moduli sags twice as far in the end."""
    mesh, sag = tm.Mesh.block((0.06, 0.01, 0.01), (12, 2, 2)), []
    for terms in ([], [(0.1, 0.2, 0.2), (1.0, 0.3, 0.3)]):
        world = tm.World(tm.Tissue(mesh, tm.Material.young(5e4, 0.4, density_kg_m3=1000, damping_1_s=40)))
        world.add_support(mesh.near((0, 0, 0), (1, 0, 0)))
        world.add_gravity()
        if terms:
            world.add_viscosity(terms)
        world.settle(1e-9)
        sag.append(-world.u_m[:, 2].min())
    assert sag[1] == pytest.approx(2 * sag[0], rel=1e-6)
    with pytest.raises(tm.Error, match="1 to 3"):
        world.add_viscosity([(1.0, 0.1, 0.1)] * 4)


def test_cut_equals_a_fresh_build():
    mesh, tissue, _ = block(cuttable=True)
    removed = tissue.cut([0, 1, 2])
    fresh = tm.Tissue(mesh, LIVER, form="plain", cuttable=True, alive=tissue.alive)
    assert set(removed) >= {0, 1, 2} and tissue.alive_count == mesh.tet_count - len(removed)
    u = 1e-3 * np.random.default_rng(1).standard_normal((mesh.vertex_count, 3))
    assert np.array_equal(tissue.force(u), fresh.force(u))


def test_the_interpreter_runs_while_a_world_steps():
    _, _, world = block((8, 8, 8))
    counted, done = [0], threading.Event()

    def count():
        while not done.is_set():
            counted[0] += 1
            time.sleep(0)

    other = threading.Thread(target=count)
    other.start()
    while counted[0] == 0:
        time.sleep(0)
    most = 0
    for _ in range(10):  # on a busy machine the other thread may wait for one call
        before = counted[0]
        world.step(2000)  # one call: if it held the lock, no other thread would count before it returned
        most = max(most, counted[0] - before)
        if most > 10:
            break
    done.set()
    other.join()
    assert most > 10


def test_a_nonlinear_law_stiffens_and_settles():
    """Pressed by 40 %, sides free: the force of neo-Hooke's closed form (tests/physics/test_hyperelastic.c); the linear law's is E A times the
    strain."""
    mesh, force = tm.Mesh.block((0.02, 0.02, 0.02), (3, 3, 3)), {}
    rest = mesh.rest_m
    low, top = np.argwhere(np.isclose(rest, 0)), np.flatnonzero(np.isclose(rest[:, 0], 0.02))
    for law in ("linear", "neo-hooke"):
        material = tm.Material.young(5e3, 0.45).with_law(law, 0 if law == "linear" else 2)
        assert material.law == law and (law in repr(material)) == (law != "linear")
        world = tm.World(tm.Tissue(mesh, material))
        world.add_support_components(np.concatenate([3 * low[:, 0] + low[:, 1], 3 * top]), np.concatenate([np.zeros(len(low)), np.full(len(top), -0.008)]))
        world.settle(1e-9)
        force[law] = -world.support_reaction_N[top, 0].sum()
    assert force["linear"] == pytest.approx(0.8, rel=1e-6) and force["neo-hooke"] == pytest.approx(1.40686, rel=1e-5)
