"""Run by test_package.py with the wheel's Python: several bodies in one mesh, contact of tissue and ties."""
import numpy as np
import pytest
import tensormass as tm

LIVER = tm.Material.young(5e3, 0.4, damping_1_s=60)


def two_blocks(gap_m, **options):
    """A block on the floor and a smaller one above it."""
    low, high = tm.Mesh.block((0.04, 0.04, 0.02), (4, 4, 2)), tm.Mesh.block((0.02, 0.02, 0.01), (2, 2, 1))
    body = np.repeat([0, 1], [low.tet_count, high.tet_count])
    mesh = tm.Mesh(np.vstack([low.rest_m, high.rest_m + (0.011, 0.009, 0.02 + gap_m)]), np.vstack([low.tets, high.tets + low.vertex_count]), body)
    world = tm.World(tm.Tissue(mesh, [LIVER, LIVER], form="plain"), **options)
    world.add_support(mesh.near((0, 0, 0), (0, 0, 1)))
    world.add_gravity()
    return mesh, world, body, np.arange(mesh.vertex_count) >= low.vertex_count


def test_contact_bears_the_weight_with_equal_and_opposite_forces():
    _, world, body, above = two_blocks(1e-3)
    assert world.touch is None
    touch = world.add_touch(body, friction=(0.2, 0.1))
    world.step(4000)
    weight_N = 9.81 * world.tissue.mass_kg[above].sum()
    force_N = touch.force_N
    assert force_N[above].sum(0) == pytest.approx([0, 0, weight_N], abs=1e-9) and np.abs(force_N.sum(0)).max() < 1e-16
    assert touch.report.rows == len(touch.rows) > 0 and not touch.report.overflowed and touch.report.deepest_m == 0
    assert np.array_equal(world.touch.rows, touch.rows) and touch.rows["weight"].sum(1) == pytest.approx(0, abs=1e-15)


def test_a_snapshot_amid_contact_is_restored_bit_for_bit_in_a_new_world():
    ends = []
    for threads in (1, 2):
        _, world, body, _ = two_blocks(1e-3, threads=threads)
        world.add_touch(body)
        if not ends:
            world.step(300)
            assert len(world.touch.rows)
            kept = world.snapshot()
        world.restore(kept)
        world.step(100)
        ends.append((world.hash, world.touch.rows))
    assert ends[0][0] == ends[1][0] and np.array_equal(ends[0][1], ends[1][1])


def test_only_the_named_pairs_touch():
    _, world, body, above = two_blocks(1e-3)
    touch = world.add_touch(body, pairs=[(0, 0), (1, 1)])
    world.step(400)
    assert not len(touch.rows) and not touch.force_N.any() and world.u_m[above, 2].max() < -1.1e-3
    with pytest.raises(tm.ArgumentError, match="names no two of 2 bodies"):
        two_blocks(1e-3)[1].add_touch(body, pairs=[(0, 2)])
    with pytest.raises(tm.ArgumentError, match="friction"):
        two_blocks(1e-3)[1].add_touch(body, friction=(0.1, 0.2))
    with pytest.raises(tm.ArgumentError, match="give bodies, pairs and friction instead"):
        two_blocks(1e-3)[1].add_touch(body, mu_static=0.1)
    with pytest.raises(tm.ArgumentError, match="'thick' is not known"):
        two_blocks(1e-3)[1].add_touch(body, thick=1)


def hung(break_N):
    """The smaller block is held by ties from its top to a frame that is fixed above it."""
    frame, block = tm.Mesh.block((0.02, 0.02, 0.01), (2, 2, 1)), tm.Mesh.block((0.02, 0.02, 0.01), (2, 2, 1))
    mesh = tm.Mesh(np.vstack([frame.rest_m + (0, 0, 0.02), block.rest_m]), np.vstack([frame.tets, block.tets + frame.vertex_count]))
    world = tm.World(tm.Tissue(mesh, LIVER, form="plain"))
    world.add_support(np.arange(frame.vertex_count))
    world.add_gravity()
    under = mesh.surface[np.all(np.isclose(mesh.rest_m[mesh.surface, 2], 0.02), axis=1)]
    top = [v for v in range(frame.vertex_count, mesh.vertex_count) if np.isclose(mesh.rest_m[v, 2], 0.01)]
    ties = [tm.Tie.to_nearest(mesh, v, under, 50.0, break_N) for v in top]
    assert [tie.rest_m for tie in ties] == pytest.approx([0.01] * 9) and tm.Tie.to_nearest(mesh, top[0], np.zeros((0, 3), int), 1.0) is None
    return world, world.add_ties(ties), top


def test_ties_bear_the_weight_and_stretch_by_their_stiffness():
    world, ties, top = hung(0)
    world.settle(1e-9)
    weight_N = 9.81 * world.tissue.mass_kg[len(world.tissue.mass_kg) // 2:].sum()
    ends = ties.ends_m
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    assert len(ties) == len(world.ties) == 9 and ties.whole.all()
    assert ties.force_N.sum() == pytest.approx(weight_N, rel=1e-3) and ties.force_N == pytest.approx(50 * (length - 0.01), rel=1e-6)
    assert ends[:, 0] == pytest.approx(world.position_m[top])
    world.remove_stage("ties")
    assert world.ties is None


def test_ties_that_break_are_reported_once():
    world, ties, _ = hung(1e-3)
    assert [len(part) for part in ties.fetch_cut()] == [0, 0]
    world.step(600)
    which, why = ties.fetch_cut()
    assert sorted(which) == list(range(9)) and set(why) == {-1} and not ties.whole.any() and not ties.force_N.any() and not len(ties.fetch_cut()[0])
    with pytest.raises(tm.ArgumentError, match="tie 0"):
        hung(0)[0].add_ties([tm.Tie(0, (1, 2, 10**6), (1, 0, 0), 0.01, 50.0)])
    with pytest.raises(tm.ArgumentError, match="outside 0 to"):
        tm.Tie.to_nearest(world.tissue.mesh, 10**6, world.tissue.mesh.surface, 50.0)


def test_a_scene_gives_its_contact_and_ties(tmp_path):
    import os
    block = os.environ["TM_ROOT"] + "/meshes/block_1k.msh"
    (tmp_path / "two.yaml").write_text(f"""\
tissue: {{force: plain, materials: {{"*": {{young: 5 kPa, poisson: 0.4}}}}}}
bodies: {{low: {{mesh: {block}}}, high: {{mesh: {block}, scale: 0.5, move: [20 mm, 20 mm, 50.6 mm]}}}}
damping: {{rate: 60 /s}}
gravity:
supports: [{{group: low.z_min}}]
touch:
ties: {{between: [{{from: high.z_min, to: low.z_max, stiffness: 30 N/m, spacing: 12 mm}}]}}
""")
    scene = tm.Scene(tmp_path / "two.yaml")
    scene.run(0.2)
    assert list(scene.bodies) == ["low", "high"] and len(scene.world.touch.rows) > 10 and len(scene.world.ties) == 16
    with pytest.raises(tm.ArgumentError, match="already"):
        scene.world.add_ties([])
