"""Run by test_package.py with the wheel's Python: scenes, mesh files, logs. Arguments by environment: TM_BIN, TM_ROOT, TM_LOG."""
import os
import pathlib
import re
import subprocess
import sys

import numpy as np
import pytest
import tensormass as tm

BIN, ROOT, LOG = pathlib.Path(os.environ["TM_BIN"]), pathlib.Path(os.environ["TM_ROOT"]), os.environ["TM_LOG"]
SCENES = ROOT / "apps/scenes"


def lockstep(scene, *options):
    out = subprocess.run([BIN / "tm-sim", SCENES / scene, "--lockstep", "--force", "plain", *options], capture_output=True, text=True, check=True).stdout
    return int(re.search(r"state ([0-9a-f]{16})", out)[1], 16)


@pytest.mark.parametrize("scene, sets, seconds", [
    ("liver-press.yaml", {"haptics": None}, 3),
    ("block-cut.yaml", {"haptics": None}, 2),
    ("block-gravity.yaml", {}, 0.5),
])
def test_bits_are_those_of_tm_sim(scene, sets, seconds):
    unset = [x for k, v in sets.items() if v is None for x in ("--unset", k)]
    wanted = lockstep(scene, "--duration", f"{seconds} s", *unset)
    made = tm.Scene(SCENES / scene, {**sets, "tissue.force": "plain"}).run(seconds)
    assert made.hash == wanted and made.frames == int(seconds / made.frame_s + 0.5)


@pytest.mark.parametrize("scene, model", [("evaluate-precomputed.yaml", "precomputed"), ("evaluate-hybrid.yaml", "hybrid")])
def test_other_models(scene, model):
    made = tm.Scene(next(ROOT.glob(f"apps/**/{scene}")), {"haptics": None})
    assert made.model == model
    made.step()
    assert np.isfinite(made.u_m).all() and made.surface.triangles.max() < made.mesh.vertex_count
    assert (made.world is None) == (model == "precomputed")


def test_hands_of_ones_own():
    scene = tm.Scene(SCENES / "liver-press.yaml", {"haptics": None})
    first = np.array(scene.instruments[0].tip_m)
    axis = first - scene.instruments[0].trocar_m
    axis /= np.linalg.norm(axis)
    for k in range(60):
        reaction, = scene.step([tm.Pose(first + 0.001 * k * axis)])
        if reaction.row_count > 2 and np.linalg.norm(reaction.force_N) > 0.2:
            break
    assert reaction.force_N @ axis < -0.15
    rows = scene.rows
    assert len(rows) > 2 and np.linalg.norm(rows["normal"], axis=1) == pytest.approx(1)
    assert -rows["lambda_N"] @ rows["normal"] == pytest.approx(reaction.resultant_N, abs=0.2 * np.linalg.norm(reaction.resultant_N))
    assert scene.pose().tip_m == pytest.approx(first + 0.001 * k * axis)
    with pytest.raises(tm.ArgumentError):
        scene.step([])
    with pytest.raises(IndexError):
        scene.reaction(1)
    assert scene.pose_of_joints(0, [0, 0, 0.1]).tip_m == pytest.approx(scene.pose_of_joints(0, [0, 0, 0.1, 0, 0, 0, 0]).tip_m)
    with pytest.raises(tm.ArgumentError, match="8 of them"):
        scene.pose_of_joints(0, [0.0] * 8)


def test_a_patch_of_a_scene():
    scene = tm.Scene(SCENES / "liver-press.yaml").run(3)
    patch = scene.patch()
    assert patch is not None and patch.vertex_count >= 3 and scene.reaction().stiffness_kind > 0


def test_what_is_wrong_has_its_line(tmp_path):
    text = (SCENES / "liver-press.yaml").read_text()
    bad = tmp_path / "bad.yaml"
    bad.write_text(text + "\nnonsense: 1\n")
    with pytest.raises(tm.ArgumentError, match=rf"bad.yaml:{text.count(chr(10)) + 2}: .*nonsense.*;"):
        tm.Scene(bad)
    with pytest.raises(tm.Error, match="nowhere.yaml.*cannot be read"):
        tm.Scene(tmp_path / "nowhere.yaml")
    with pytest.raises(tm.Error, match="--set time.frame_rate"):
        tm.Scene(SCENES / "liver-press.yaml", {"time.frame_rate": "often"})


def test_snapshots_are_those_of_tm_sim(tmp_path):
    kept = tmp_path / "kept"
    sets = {"haptics": None, "tissue.force": "plain"}
    scene = tm.Scene(SCENES / "liver-press.yaml", sets).run(2.4)
    scene.save(kept)
    scene.run(0.4)
    again = tm.Scene(SCENES / "liver-press.yaml", sets)
    again.restore(kept)
    assert again.run(0.4).hash == scene.hash
    assert lockstep("liver-press.yaml", "--unset", "haptics", "--restore", kept, "--duration", "2.8 s") == scene.hash
    kept.write_bytes(kept.read_bytes()[:-9])
    before = again.hash
    with pytest.raises(tm.FileError, match="damaged"):
        again.restore(kept)
    assert again.hash == before


def test_a_stage_in_a_scene():
    scene = tm.Scene(SCENES / "block-gravity.yaml")
    seen = []
    scene.world.add_stage("watch", lambda world: seen.append(world.time_s), "end")
    scene.step()
    assert len(seen) == scene.substeps

    def fail(world):
        raise KeyError("mine")

    scene.world.add_stage("fail", fail)
    before = scene.hash
    with pytest.raises(KeyError):
        scene.step()
    assert scene.hash == before


def test_mesh_files():
    mesh = tm.Mesh.read(ROOT / "meshes/cylinder_1k.msh")
    assert mesh.tet_count > 500 and mesh.groups and all(g.max() < mesh.vertex_count for g in mesh.groups.values())
    twice = tm.Mesh.read(ROOT / "meshes/cylinder_1k.msh", 2.0)
    assert np.array_equal(twice.rest_m, 2 * mesh.rest_m) and twice.volume_m3.sum() == pytest.approx(8 * mesh.volume_m3.sum())
    fibres = tm.read_fibres(ROOT / "meshes/cylinder_1k.fibres.csv", mesh.tet_count)
    assert np.allclose(np.linalg.norm(fibres, axis=1), 1)
    tissue = tm.Tissue(mesh, tm.Material.paper(8e3, 2e3, 10e3, 6e3), region_material=np.zeros(mesh.region_count), fibres=fibres)
    assert tissue.alive_count == mesh.tet_count
    with pytest.raises(tm.FileError):
        tm.Mesh.read(ROOT / "README.md")


def shuffle(path, to):
    """Writes a .msh 2.2 with its vertices in another order; was[v] is the original number of each."""
    lines = path.read_text().splitlines()
    begin, first = lines.index("$Nodes") + 2, lines.index("$Elements") + 2
    count = int(lines[begin - 1])
    was = np.random.default_rng(1).permutation(count)
    now, place = np.argsort(was), [line.split(maxsplit=1)[1] for line in lines[begin:begin + count]]
    lines[begin:begin + count] = [f"{v + 1} {place[w]}" for v, w in enumerate(was)]
    for i in range(first, lines.index("$EndElements")):
        word = lines[i].split()
        at = 3 + int(word[2])
        lines[i] = " ".join(word[:at] + [str(now[int(v) - 1] + 1) for v in word[at:]])
    to.write_text("\n".join(lines) + "\n")
    return was


def test_mesh_files_whose_numbers_jump(tmp_path):
    """Groups use the numbering of the mesh; a scene's arrays use the file's, unless it requests the one of tm-sim."""
    path = tmp_path / "block.msh"
    was = shuffle(ROOT / "meshes/block_10k.msh", path)
    plain, kept, mesh = tm.Mesh.read(ROOT / "meshes/block_10k.msh"), tm.Mesh.read(path), tm.Mesh.read(path, renumber=True)
    assert kept.original_vertex is None and mesh.original_vertex is not None
    for name, group in plain.groups.items():
        assert np.array_equal(kept.groups[name], np.sort(np.argsort(was)[group]))
        assert np.array_equal(mesh.groups[name], np.sort(mesh.groups[name])) and len(mesh.groups[name]) == len(group)
        assert {tuple(x) for x in mesh.rest_m[mesh.groups[name]]} == {tuple(x) for x in plain.rest_m[group]}
    sets = {"tissue.mesh": str(path), "tissue.force": "plain"}
    made = tm.Scene(SCENES / "block-gravity.yaml", sets).run(0.2)
    inside = tm.Scene(SCENES / "block-gravity.yaml", {**sets, "tissue.renumber": True}).run(0.2)
    assert made.mesh.original_vertex is None and np.array_equal(inside.mesh.original_vertex, mesh.original_vertex)
    assert inside.hash == lockstep("block-gravity.yaml", "--set", f"tissue.mesh={path}", "--duration", "0.2 s") != made.hash
    assert np.allclose(inside.mesh.to_original(inside.u_m), made.u_m, rtol=0, atol=1e-9 * np.abs(made.u_m).max())


def test_logs_are_what_lcm_reads():
    """Compared with the bindings that lcm-gen makes and the reader of the lcm package, in the Python that has it."""
    log = tm.read_log(LOG)
    assert set(log) >= {"TOOL_0", "FORCE_0", "TISSUE", "SIM_STATUS", "CONTROLLER_0"}
    code = ("import sys, lcm, numpy as np; sys.path.insert(0, sys.argv[2]); import tensormass_lcm as t\n"
            "kind = {'FORCE_0': t.force_sample_t, 'TISSUE': t.tissue_t, 'SIM_STATUS': t.sim_status_t, 'TOOL_0': t.tool_state_t, 'CONTROLLER_0': t.controller_status_t}\n"
            "got = {}\n"
            "for e in lcm.EventLog(sys.argv[1]):\n"
            "    if e.channel in kind: got.setdefault(e.channel, []).append((e.timestamp, kind[e.channel].decode(e.data)))\n"
            "out = {c: np.array([[u, m.utime, m.seq] for u, m in v]) for c, v in got.items()}\n"
            "out['force'] = np.array([m.force_N for u, m in got['FORCE_0']]); out['K'] = np.array([m.stiffness_N_m for u, m in got['FORCE_0']])\n"
            "out['tip'] = np.array([m.tip_m for u, m in got['TOOL_0']]); out['surface'] = np.array(got['TISSUE'][-1][1].vertex_m)\n"
            "out['trocar'] = np.array([m.trocar_m for u, m in got['SIM_STATUS']]); out['words'] = np.array([m.scene + m.model for u, m in got['SIM_STATUS']])\n"
            "np.savez(sys.argv[3], **out)\n")
    made = LOG + ".npz"
    subprocess.run([os.environ["TM_PYTHON"], "-c", code, LOG, os.environ["TM_LCM_TYPES"], made], check=True)
    with np.load(made) as wanted:
        for name in ("TOOL_0", "FORCE_0", "TISSUE", "SIM_STATUS", "CONTROLLER_0"):
            channel = log[name]
            assert np.array_equal(np.column_stack([channel.log_us, channel["utime"], channel["seq"]]), wanted[name]), name
        assert np.array_equal(log["FORCE_0"]["force_N"], wanted["force"]) and np.array_equal(log["FORCE_0"]["stiffness_N_m"], wanted["K"])
        assert np.array_equal(log["TOOL_0"]["tip_m"], wanted["tip"])
        assert np.array_equal(log["TISSUE"]["vertex_m"][-1], wanted["surface"].astype(np.float32))
        assert np.array_equal(log["SIM_STATUS"]["trocar_m"], wanted["trocar"])
        assert [a + b for a, b in zip(log["SIM_STATUS"]["scene"], log["SIM_STATUS"]["model"])] == list(wanted["words"])


def test_damaged_logs(tmp_path):
    whole = pathlib.Path(LOG).read_bytes()
    good = tm.read_log(LOG)
    cut = tmp_path / "cut.log"
    cut.write_bytes(whole[:len(whole) // 2 + 7])
    assert 0 < len(tm.read_log(cut)["TOOL_0"]) < len(good["TOOL_0"])
    rng = np.random.default_rng(0)
    for _ in range(20):
        spoiled = bytearray(whole[:200000])
        for at in rng.integers(0, len(spoiled), 50):
            spoiled[at] = rng.integers(0, 256)
        cut.write_bytes(spoiled)
        tm.read_log(cut)
    cut.write_bytes(b"nothing")
    with pytest.raises(tm.FileError, match="no event"):
        tm.read_log(cut)
    with pytest.raises(tm.FileError, match="cannot be read"):
        tm.read_log(tmp_path / "none")
    with pytest.raises(KeyError, match="it has"):
        good["TOOL_0"]["colour"]


def test_the_program():
    scene = SCENES / "liver-press.yaml"
    run = subprocess.run([sys.executable, "-m", "tensormass", scene, "--unset", "haptics", "--seconds", "0.2"], capture_output=True, text=True)
    assert run.returncode == 0 and len(run.stdout.splitlines()) == 6 and "probe [" in run.stdout, run.stderr
    bad = subprocess.run([sys.executable, "-m", "tensormass", "none.yaml"], capture_output=True, text=True)
    assert bad.returncode == 2 and bad.stderr.startswith("none.yaml: cannot be read"), bad.stderr
    shown = subprocess.run([sys.executable, "-m", "tensormass", scene, "--seconds", "0.1", "--picture", "x.png"], capture_output=True, text=True)
    assert shown.returncode == 0 or "tensormass[viz]" in shown.stderr


NO_MEMORY = """
import ctypes, sys
import tensormass as tm
fail = ctypes.CDLL(sys.argv[1]).fail_calloc
tm.Scene(sys.argv[2])  # opens the libraries
none = made = 0
for n in range(1, 200, 2):
    fail(n)
    try:
        tm.Scene(sys.argv[2], {"haptics": None, "tissue.damping": "40 1/s"})
        made += 1
    except tm.Error as e:
        none += isinstance(e, MemoryError)
    finally:
        fail(0)
print(none, "without memory,", made, "made")
assert none > 50
"""


def test_a_scene_without_memory_is_an_exception():
    failing = BIN.parent / "tests/sim/fail_calloc.so"
    out = subprocess.run([sys.executable, "-c", NO_MEMORY, failing, SCENES / "block-press.yaml"], capture_output=True, text=True, env=dict(os.environ, LD_PRELOAD=str(failing)), timeout=120)
    assert out.returncode == 0, out.stdout + out.stderr


def test_the_message_bindings_are_another_package():
    sys.path.append(os.environ["TM_LCM_TYPES"])
    import tensormass_lcm

    assert len(tensormass_lcm.force_sample_t().encode()) > 100 and tm.Scene.__module__.startswith("tensormass")


def test_bodies_have_ranges_of_vertices_and_tetrahedra(tmp_path):
    block = SCENES.parent.parent / "meshes/block_1k.msh"
    (tmp_path / "two.yaml").write_text(f"""
tissue: {{materials: {{"*": {{young: 5 kPa, poisson: 0.4}}}}}}
bodies:
  low: {{mesh: {block}}}
  high: {{mesh: {block}, move: [200 mm, 0, 0], turn: [0, 0, 90 deg]}}
supports: [{{group: low.z_min}}, {{group: high}}]
gravity:
damping: {{rate: 60 /s}}
""")
    scene = tm.Scene(tmp_path / "two.yaml")
    low, high = scene.bodies["low"], scene.bodies["high"]
    assert (low.tets.stop, high.tets.stop) == (high.tets.start, scene.mesh.tet_count) and len(low.vertices) == len(high.vertices)
    a, b = (scene.mesh.rest_m[r.vertices.start:r.vertices.stop] for r in (low, high))
    np.testing.assert_allclose(b, np.stack([0.2 - a[:, 1], a[:, 0], a[:, 2]], 1), atol=1e-15)
    scene.run(0.08)
    moved = abs(scene.u_m)
    assert moved[low.vertices.start:low.vertices.stop].max() > 1e-5 and moved[high.vertices.start:].max() == 0  # all of it is fixed
    assert tm.Scene(SCENES / "block-gravity.yaml").bodies == {}
