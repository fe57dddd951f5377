"""Run by test_package.py with the wheel's Python: instruments, models, patches, the controller."""
import gc

import numpy as np
import pytest
import tensormass as tm

LIVER = tm.Material.young(5e3, 0.45, density_kg_m3=1060, damping_1_s=40)
MESH = tm.Mesh.block((0.06, 0.06, 0.03), (6, 6, 3))
FLOOR = MESH.near((0, 0, 0), (0, 0, 1))
NEAR = np.linalg.norm(MESH.rest_m[MESH.tets].mean(1) - [0.03, 0.03, 0.03], axis=1) < 0.02


def tool(**options):
    return tm.Instrument(trocar_m=(0.03, 0.03, 0.15), tip_m=(0.03, 0.03, 0.034), **options)


def model(kind, **options):
    return tm.Model(MESH, LIVER, kind, supports=[(FLOOR, 0.0)], instruments=[tool()], dynamic=NEAR if kind == "hybrid" else None, **options)


@pytest.mark.parametrize("kind", ["dynamic", "precomputed", "hybrid"])
def test_models_agree_on_a_press(kind):
    before = tm.memory_in_use()
    organ, exact = model(kind), model("precomputed")
    for z in np.linspace(0.034, 0.028, 20):
        organ.frame([tm.Pose((0.03, 0.03, z))])
    for _ in range(30):
        reaction, = organ.frame([tm.Pose((0.03, 0.03, 0.028))])
    for z in np.linspace(0.034, 0.028, 20):
        wanted, = exact.frame([tm.Pose((0.03, 0.03, z))])
    assert wanted.force_N[2] > 0.2
    assert np.linalg.norm(reaction.force_N - wanted.force_N) < 0.02 * wanted.force_N[2]
    assert np.abs(organ.u_m[organ.surface.triangles] - exact.u_m[organ.surface.triangles]).max() < 0.1 * np.abs(exact.u_m).max()
    assert organ.alive_count == MESH.tet_count
    del organ, exact
    gc.collect()
    assert tm.memory_in_use() == before


@pytest.mark.parametrize("kind", ["precomputed", "hybrid", "dynamic"])
def test_stiffness_is_the_slope_of_the_force(kind):
    organ = model(kind)
    organ.allow_patches()
    for z in [*np.linspace(0.034, 0.029, 20), *[0.029] * 60]:
        organ.frame([tm.Pose((0.03, 0.03, z))])
        patch = organ.patch()
    told = organ.reaction()
    assert patch is not None and told.stiffness_kind > 0
    C = patch.compliance_m_N
    assert np.allclose(C, C.T) and np.linalg.eigvalsh(C).min() > -1e-6 * np.linalg.eigvalsh(C).max()
    for _ in range(60):
        after, = organ.frame([tm.Pose((0.03, 0.03, 0.0288))])
    slope = (after.force_N[2] - told.force_N[2]) / -0.0002
    assert told.stiffness_N_m[2, 2] == pytest.approx(slope, rel=0.05)


def test_a_patch_knows_the_force():
    organ = model("precomputed")
    organ.allow_patches()
    for z in np.linspace(0.034, 0.029, 20):
        reaction, = organ.frame([tm.Pose((0.03, 0.03, z))])
    force, _ = tm.PatchSolver().force(organ.patch(), (0.03, 0.03, 0.029))
    assert force[2] == pytest.approx(reaction.force_N[2], rel=0.02)


def test_exact_compliance_in_a_world_of_ones_own():
    tissue = tm.Tissue(MESH, LIVER)
    world = tm.World(tissue)
    world.add_support(FLOOR)
    contact = world.add_contact([tool()])
    source = tm.ComplianceFactor(tissue, world.support_mask)
    maker = world.add_patch(contact, source)
    del source
    gc.collect()  # the world keeps it alive
    for z in [*np.linspace(0.034, 0.029, 15), 0.029, 0.029]:
        contact.frame([tm.Pose((0.03, 0.03, z))], 60)
        patch = maker.compute()
    assert patch is not None and patch.kind == 2 and maker.pending == 0 and patch.age == 0
    assert contact.reaction().stiffness_kind == 2


def test_what_a_model_cannot_do_is_refused():
    with pytest.raises(tm.ArgumentError, match="kind"):
        model("liquid")
    with pytest.raises(tm.ArgumentError, match="poses"):
        model("dynamic").frame([])
    with pytest.raises(tm.ArgumentError, match="option"):
        model("dynamic", contact={"colour": 1})


@pytest.mark.parametrize("kind", ["dynamic", "precomputed", "hybrid"])
def test_a_models_snapshot(kind):
    organ = model(kind)
    organ.frame([tm.Pose((0.03, 0.03, 0.03))])
    kept = organ.snapshot()
    organ.frame([tm.Pose((0.03, 0.03, 0.029))])
    after = organ.hash
    organ.restore(kept)
    organ.frame([tm.Pose((0.03, 0.03, 0.029))])
    assert organ.hash == after


def test_imposed_displacements():
    tissue = tm.Tissue(MESH, LIVER)
    fixed = np.zeros((MESH.vertex_count, 3), bool)
    fixed[FLOOR] = True
    organ = tm.Precomputed(tm.Problem(tissue, fixed))
    vertex = int(np.argmin(np.linalg.norm(MESH.rest_m - [0.03, 0.03, 0.03], axis=1)))
    organ.impose([vertex], [(0, 0, -0.003)])
    organ.update([])
    assert organ.u_m[vertex] == pytest.approx((0, 0, -0.003), abs=1e-12)
    value = np.zeros((MESH.vertex_count, 3))
    value[vertex] = (0, 0, -0.003)
    fixed[vertex] = True
    u, reaction, _ = tm.solve_static(tissue, fixed, value)
    assert organ.imposed_force(0) == pytest.approx(reaction[vertex], rel=1e-6, abs=1e-9)


def test_a_cautery_cuts_and_a_grasper_holds():
    cautery, grasper = tool(mode="cautery", active=False), tm.Instrument((0.05, 0.05, 0.15), (0.05, 0.05, 0.034), "grasper")
    world = tm.World(tm.Tissue(MESH, LIVER, cuttable=True))
    world.add_support(FLOOR)
    contact = world.add_contact([cautery, grasper])
    cut, grasp = world.add_cut(contact), world.add_grasp(contact)
    for k in range(15):
        z = 0.034 - 0.0005 * k
        contact.frame([tm.Pose((0.03, 0.03, z)), tm.Pose((0.05, 0.05, z), grip=0.0 if k < 12 else 1.0)], 60)
    held, state = grasp.vertices(1)
    tets, who = cut.fetch_removed()
    assert state == "holding" and len(held) > 0
    assert len(tets) > 0 and set(who) == {0} and not world.tissue.alive[tets].any()
    assert len(cut.fetch_removed()[0]) == 0
    for k in range(15):
        reactions = contact.frame([tm.Pose((0.03, 0.03, 0.034), active=False), tm.Pose((0.05, 0.05, 0.027 + 0.0006 * k), grip=1.0)], 60)
    assert reactions[1].force_N[2] < 0, "held tissue pulls the tool back"


def test_rows_of_contact():
    world = tm.World(tm.Tissue(MESH, LIVER))
    world.add_support(FLOOR)
    contact = world.add_contact([tool()])
    reaction, = contact.frame([tm.Pose((0.03, 0.03, 0.03))], 600)
    rows = contact.rows
    assert (rows["lambda_N"] > 0).sum() == reaction.row_count > 0
    assert (rows["lambda_N"] >= 0).all() and np.allclose(rows["weight"].sum(1), 1)
    assert reaction.flag_names == []
    assert tm.tip_force((0, 0, 0.1), (0, 0, 0), (0, 0, 0), (1, 2, 3)) == pytest.approx((1, 2, 3))


def test_the_controller_renders_what_a_model_says():
    """Co-simulation: 500 Hz ticks of the controller, a frame of the model every 20 ticks, a pressing hand."""
    trocar = np.array((0.03, 0.03, 0.15))
    organ = model("precomputed")
    organ.allow_patches()
    controller = tm.Controller(axis=(0, 0, -1), up=(0, 1, 0))
    newest = patch = None
    seen = set()
    for k in range(1500):
        t_us = 10**6 + 2000 * k
        z = 0.034 - 0.006 * np.clip((k - 600) / 600, 0, 1)
        joints = controller.joints(np.array((0.03, 0.03, z)) - trocar)
        out = controller.tick(t_us, joints, newest, patch)
        newest = patch = None
        seen.add(controller.state)
        if k % 20 == 19:
            reaction, = organ.frame([tm.Pose(trocar + np.array(out.tip_m))])
            found = organ.patch()
            newest = tm.sample(organ.reaction()._replace(tip_m=trocar + np.array(out.tip_m)), t_us, trocar, seq=k)
            patch = None if found is None else tm.controller_patch(found, trocar, seq=k)
    assert seen >= {"idle", "engaged"} and controller.fault == ""
    assert out.force_N[2] == pytest.approx(reaction.force_N[2], rel=0.03) and out.force_N[2] > 0.2
    assert np.linalg.norm(out.force_N) <= controller.params.force_max_N
    assert controller.counters["samples_received"] == 74 and controller.counters["samples_rejected"] == 0


def test_parameters_and_extrapolators_are_checked():
    with pytest.raises(tm.ArgumentError, match="force_max_N"):
        tm.parameters(force_max_N=-1.0)
    with pytest.raises(tm.ArgumentError, match="known"):
        tm.parameters(speed=1)
    with pytest.raises(tm.ArgumentError, match="known"):
        tm.Extrapolator("magic")
    reaction = tm.Reaction(0, np.zeros(3), np.array([np.nan, 0, 0]), np.zeros(3), np.zeros((3, 3)), 0, 0, 0)
    with pytest.raises(tm.ArgumentError, match="finite"):
        tm.sample(reaction, 1)
    law = tm.Extrapolator("tangent")
    law.take(tm.sample(reaction._replace(force_N=np.array((0, 0, 1.0)), stiffness_N_m=np.diag((0, 0, -100.0)), stiffness_kind=2), 1000))
    assert law.force(3000, (0, 0, -0.002)) == pytest.approx((0, 0, 1.2), rel=1e-3)


def test_the_controller_knows_devices_by_name():
    assert tm.controller.devices()["desk"] == ["x_m", "y_m", "z_m"] and len(tm.controller.devices()["impulse_engine"]) == 5
    desk = tm.Controller(params=tm.controller.parameters(device="desk"))
    tip = np.array((0.01, -0.02, -0.1))
    joints = desk.joints(tip)
    assert joints.shape == (3,) and np.allclose(desk.tip(joints), tip, atol=1e-7)
    assert desk.tick(10**6, joints).joint[2] == pytest.approx(0.1, abs=1e-4)
    for device, count in (("desk", 3), ("impulse_engine", 5)):
        controller = tm.Controller(params=tm.controller.parameters(device=device))
        for given in (count + 1, 8):
            for call in (controller.tip, lambda joints: controller.tick(10**6, joints)):
                with pytest.raises(tm.ArgumentError, match=f"joints: {given} of them; a {device} has {count}"):
                    call([0.1] * given)
    with pytest.raises(tm.ArgumentError, match="torque_max': 9 values; it has 3 at most"):
        tm.controller.parameters(torque_max=[1.0] * 9)
    with pytest.raises(tm.ArgumentError, match="use one of impulse_engine, desk"):
        tm.controller.parameters(device="stylus")
