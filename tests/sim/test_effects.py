"""Effects of scenes: cutting, grasping, breathing, snapshots, the three models."""
import json

import lcm
import numpy as np
import pytest
from simkit import block_scene, report, run

HOLD = ("hand[0].path=[{time: 0 s, tip: [50 mm, 50 mm, 60 mm]}, {time: 0.5 s, tip: [52 mm, 50 mm, 47 mm]}, "
        "{time: 3 s, tip: [52 mm, 50 mm, 47 mm]}]")


def columns(path):
    return np.genfromtxt(path, delimiter=",", names=True)


@pytest.fixture(scope="module")
def cut_session(bin, root, tmp_path_factory):
    tmp = tmp_path_factory.mktemp("cut")
    r = report(bin / "tm-sim", root / "apps/scenes/block-cut.yaml", "--lockstep", "--record", tmp / "log", "--csv", tmp / "t.csv",
               "--samples", tmp / "s.csv", "--set", "rendering=", tmp=tmp)
    return r, tmp


def test_cut_events_agree_with_the_tissue(cut_session, types):
    r, tmp = cut_session
    removed, revision, alive, open_faces = [], 0, r["tets"], 0
    for e in lcm.EventLog(str(tmp / "log")):
        if e.channel == "CUT":
            m = types.cut_event_t.decode(e.data)
            assert m.removed_count == len(m.removed_tet) > 0 and m.instrument in (1, -1) and m.topology_revision > revision
            removed += m.removed_tet
            alive -= m.removed_count
            assert m.alive_count == alive
            revision = m.topology_revision
        elif e.channel == "TISSUE":
            m = types.tissue_t.decode(e.data)
            assert m.topology_revision == revision  # a late subscriber needs only this message
            open_faces = sum(m.triangle_kind)
            edges = {}
            for a, b, c in m.triangle:
                for k in ((a, b), (b, c), (c, a)):
                    edges[k] = edges.get(k, 0) + 1
            assert all(n == 1 and edges.get((b, a)) == 1 for (a, b), n in edges.items())  # closed and manifold
        elif e.channel == "SIM_STATUS":
            assert types.sim_status_t.decode(e.data).tets_alive == alive
    assert len(removed) == len(set(removed)) == r["tets_removed"] == r["tets"] - r["tets_alive"] > 5
    assert open_faces > 10


def test_grasper_pulls_and_releases(cut_session):
    _, tmp = cut_session
    s = columns(tmp / "s.csv")
    s = s[s["instrument"] == 0]
    pulled = (s["time_s"] > 1.5) & (s["time_s"] < 2.4)
    assert (s["fz_N"][pulled] < -0.3).all()  # the tissue pulls the tool back down
    after = s["fz_N"][s["time_s"] > 2.6]
    assert (np.diff(np.abs(after)) <= 1e-12).all() and np.abs(after[-5:]).max() == 0


def test_each_device_feels_its_own_instrument(cut_session):
    _, tmp = cut_session
    t = columns(tmp / "t.csv")
    at = (t["time_s"] > 1.6) & (t["time_s"] < 2.3)
    grasper, cautery = (t["fz_N"][at & (t["instrument"] == i)] for i in (0, 1))
    assert (grasper < -0.3).all() and np.median(cautery) > -0.1
    pressed = (t["time_s"] > 0.6) & (t["time_s"] < 0.9)
    assert t["fz_N"][pressed & (t["instrument"] == 0)].max() > 0.1
    assert np.abs(t["fz_N"][pressed & (t["instrument"] == 1)]).max() == 0


def test_a_snapshot_goes_on_with_the_same_bits(bin, root, tmp_path):
    scene = [bin / "tm-sim", root / "apps/scenes/block-cut.yaml", "--lockstep", "--unset", "haptics"]
    state = tmp_path / "state.tms"
    whole = report(*scene, "--samples", tmp_path / "whole.csv", tmp=tmp_path)
    report(*scene, "--duration", "1.8 s", "--snapshot-at", "1.72 s", "--snapshot", state, tmp=tmp_path)
    rest = report(*scene, "--restore", state, "--samples", tmp_path / "rest.csv", tmp=tmp_path)
    assert rest["state_hash"] == whole["state_hash"] and rest["tets_alive"] == whole["tets_alive"] and rest["frames"] == 80 - 43
    assert (tmp_path / "whole.csv").read_text().endswith((tmp_path / "rest.csv").read_text().split("\n", 1)[1])
    good = state.read_bytes()
    for name, bad in {"cut short": good[:-9], "empty": b"", "foreign": b"PK" + good, "one bit": good[:700] + bytes([good[700] ^ 4]) + good[701:],
                      "longer": good + b"\0", "header": good[:20] + bytes([good[20] ^ 1]) + good[21:]}.items():
        state.write_bytes(bad)
        _, said = run(*scene, "--restore", state, "--json", tmp_path / "no.json", code=2)
        assert said.startswith(str(state)) and ";" in said and not (tmp_path / "no.json").exists(), name
    state.write_bytes(good)
    run(*scene, "--restore", state, "--set", "tissue.mesh=" + str(root / "meshes/cylinder_1k.msh"), "--set", "supports=[{group: end_0}]", code=2)
    _, said = run(*scene[:-2], "--restore", state, code=2)
    assert "haptics" in said


def test_a_snapshot_of_a_hybrid_goes_on_with_the_same_bits(bin, root, tmp_path):
    scene = [bin / "tm-sim", root / "apps/scenes/block-cut.yaml", "--lockstep", "--unset", "haptics", "--set", "model=hybrid",
             "--set", "hybrid.box={min: [-1, -1, 20 mm], max: [1, 1, 1]}", "--duration", "2 s"]
    state, keys = tmp_path / "state.tms", dict(tmp=tmp_path, env={"TM_CACHE_DIR": str(tmp_path)})
    whole = report(*scene, "--samples", tmp_path / "whole.csv", **keys)
    for at in (1.2, 1.72):
        report(*scene, "--snapshot-at", f"{at} s", "--snapshot", state, **keys)
        rest = report(*scene, "--restore", state, "--samples", tmp_path / "rest.csv", **keys)
        assert rest["state_hash"] == whole["state_hash"] and rest["tets_alive"] == whole["tets_alive"] < whole["tets"]
        assert (tmp_path / "whole.csv").read_text().endswith((tmp_path / "rest.csv").read_text().split("\n", 1)[1])


@pytest.mark.parametrize("friction", [[], ["--set", "friction="]], ids=["", "friction"])
def test_a_precomputed_snapshot_goes_on_with_the_same_bits(bin, root, tmp_path, friction):
    scene = [bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", "--unset", "haptics", "--set", "model=precomputed", *friction]
    state, keys = tmp_path / "state.tms", dict(tmp=tmp_path, env={"TM_CACHE_DIR": str(tmp_path)})
    whole = report(*scene, "--samples", tmp_path / "whole.csv", **keys)
    report(*scene, "--snapshot-at", "1.2 s", "--snapshot", state, **keys)
    rest = report(*scene, "--restore", state, "--samples", tmp_path / "rest.csv", **keys)
    assert rest["state_hash"] == whole["state_hash"] and rest["frames"] == 20
    assert (tmp_path / "whole.csv").read_text().endswith((tmp_path / "rest.csv").read_text().split("\n", 1)[1])
    state.write_bytes(state.read_bytes()[:-9])
    _, said = run(*scene, "--restore", state, code=2, env=keys["env"])
    assert said.startswith(str(state)) and ";" in said


def test_three_models_agree_at_rest(bin, root, tmp_path):
    force = {}
    for model in ("dynamic", "precomputed", "hybrid"):
        run(bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", "--unset", "haptics", "--duration", "3 s", "--set", HOLD,
            "--set", "damping.rate=150 /s", "--set", "hybrid.box={min: [-1, -1, 20 mm], max: [1, 1, 1]}",
            "--set", f"model={model}", "--samples", tmp_path / "s.csv", env={"TM_CACHE_DIR": str(tmp_path)})
        last = columns(tmp_path / "s.csv")[-1]
        force[model] = np.array([last["fx_N"], last["fy_N"], last["fz_N"]])
    assert np.linalg.norm(force["dynamic"]) > 0.3
    for model in ("precomputed", "hybrid"):
        assert np.linalg.norm(force[model] - force["dynamic"]) < 1e-5 * np.linalg.norm(force["dynamic"]), force


def test_precomputed_files_are_used_again_and_rebuilt_when_damaged(bin, root, tmp_path):
    scene = [bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", "--unset", "haptics", "--set", "model=precomputed"]
    env = {"TM_CACHE_DIR": str(tmp_path / "cache")}
    first = report(*scene, tmp=tmp_path, env=env)
    out, said = run(*scene, env=env)
    assert "computed" not in said and first["state_hash"] in out
    (file,) = (tmp_path / "cache").glob("precomputed-*.tms")
    good = file.read_bytes()
    file.write_bytes(good[:len(good) // 2])
    out, said = run(*scene, env=env)
    assert "computed" in said and first["state_hash"] in out and file.read_bytes() == good


def test_excluded_effects_are_refused_with_both_lines(bin, root, tmp_path):
    scene = block_scene(tmp_path, root, "model: precomputed\ninstruments:\n  - trocar: [50 mm, 50 mm, 18 cm]\ncontact:\ncut:\n")
    _, said = run(bin / "tm-sim", scene, "--check", code=2)
    assert said.startswith(f"{scene}:8: precomputed and cut ({scene}:12) exclude each other") and "hybrid" in said
    run(bin / "tm-sim", scene, "--check", "--unset", "cut")
    run(bin / "tm-sim", scene, "--check", "--set", "model=dynamic")
    _, said = run(bin / "tm-sim", scene, "--check", "--set", "model=hybrid", "--unset", "cut", code=2)
    assert "either a region or a box" in said
    _, said = run(bin / "tm-sim", scene, "--check", "--set", "model=hybrid", "--unset", "cut", "--set", "hybrid.region=spleen", code=2)
    assert "no tetrahedron" in said


def test_explain_says_how_long_a_cut_fades(bin, root):
    said, _ = run(bin / "tm-sim", root / "apps/scenes/block-cut.yaml", "--explain", "--set", "cut.fade=40 ms")
    assert "cut.fade: the force from a removed tetrahedron falls to 0 within 40 ms (" in said and "block-cut.yaml:" in said, said
    said, _ = run(bin / "tm-sim", root / "apps/scenes/block-cut.yaml", "--explain")
    assert "cut.fade" not in said


def test_friction_is_refused_by_the_hybrid_model_with_both_lines(bin, root, tmp_path):
    scene = block_scene(tmp_path, root, "model: hybrid\nhybrid:\n  box: {min: [-1, -1, 0], max: [1, 1, 20 mm]}\ninstruments:\n  - trocar: [50 mm, 50 mm, 18 cm]\ncontact:\nfriction:\n")
    _, said = run(bin / "tm-sim", scene, "--check", code=2)
    assert said.startswith(f"{scene}:14: friction and hybrid ({scene}:8) exclude each other") and "write 'model: dynamic' or 'model: precomputed'" in said, said
    run(bin / "tm-sim", scene, "--check", "--unset", "friction")
    for model in ("dynamic", "precomputed"):
        run(bin / "tm-sim", scene, "--check", "--set", f"model={model}", "--unset", "hybrid")


def test_volume_is_refused_where_it_cannot_be_with_both_lines(bin, root, tmp_path):
    scene = block_scene(tmp_path, root, "gravity:\nstrain_smoothing:\n  shear_share: 0.5\n")
    run(bin / "tm-sim", scene, "--check")
    _, said = run(bin / "tm-sim", scene, "--check", "--set", "model=hybrid", "--set", "hybrid.box={min: [-1, -1, 0], max: [1, 1, 20 mm]}", code=2)
    assert said.startswith(f"{scene}:9: strain_smoothing and hybrid (--set model=hybrid) exclude each other") and "dynamic" in said
    _, said = run(bin / "tm-sim", scene, "--check", "--set", "tissue.precision=single", code=2)
    assert said.startswith(f"{scene}:9: strain_smoothing and tissue.precision = single (--set tissue.precision=single) exclude each other") and "double" in said
    _, said = run(bin / "tm-sim", scene, "--check", "--set", "strain_smoothing.shear_share=1.5", code=2)
    assert "strain_smoothing.shear_share = 1.5 is outside 0 to 1" in said


def test_volume_is_pressed_by_both_models_and_cut_with_its_patch(bin, root, tmp_path):
    """Precomputed and dynamic tissue agree at rest and differ from linear tetrahedra; a cutting session of two hands with patches runs."""
    force = {}
    for name, more in (("linear", []), ("dynamic", ["--set", "strain_smoothing="]), ("precomputed", ["--set", "strain_smoothing=", "--set", "model=precomputed"])):
        run(bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", "--unset", "haptics", "--duration", "3 s", "--set", HOLD,
            "--set", "damping.rate=150 /s", *more, "--samples", tmp_path / "s.csv", env={"TM_CACHE_DIR": str(tmp_path)})
        last = columns(tmp_path / "s.csv")[-1]
        force[name] = np.array([last["fx_N"], last["fy_N"], last["fz_N"]])
    peak = np.linalg.norm(force["dynamic"])
    assert peak > 0.3 and np.linalg.norm(force["dynamic"] - force["linear"]) > 0.01 * peak
    assert np.linalg.norm(force["precomputed"] - force["dynamic"]) < 1e-5 * peak, force
    r = report(bin / "tm-sim", root / "apps/scenes/block-cut.yaml", "--lockstep", "--set", "strain_smoothing=", "--duration", "4 s",
               "--set", "haptics.extrapolator=local_model", tmp=tmp_path)
    assert r["tets"] - r["tets_alive"] > 5, r



def test_breathing_moves_its_support_and_nothing_else_holds_still(bin, root, tmp_path, types):
    scene = block_scene(tmp_path, root, "breathing: {support: bottom, amplitude: [0, 0, 4 mm], period: 1 s}\ndamping: {rate: 100 /s}\nrendering:\n")
    run(bin / "tm-sim", scene, "--lockstep", "--duration", "1 s", "--record", tmp_path / "log")
    heights = {}
    for e in lcm.EventLog(str(tmp_path / "log")):
        if e.channel == "TISSUE":
            m = types.tissue_t.decode(e.data)
            heights[m.sim_utime] = np.array(m.vertex_m)[:, 2]
    rest = heights[min(heights)]
    bottom = rest < 1e-3
    for utime, z in heights.items():
        expected = 0.004 * 0.5 * (1 - np.cos(2 * np.pi * utime * 1e-6))
        assert np.abs(z[bottom] - expected).max() < 1e-6
    assert (heights[520000] - rest)[~bottom].min() > 0.002  # carries the remaining terms along
    _, said = run(bin / "tm-sim", scene, "--check", "--set", "breathing.support=diaphragm", code=2)
    assert "does not name" in said
    _, said = run(bin / "tm-sim", scene, "--check", "--set", "supports[0].axes=x", code=2)
    assert "leaves free" in said


@pytest.mark.parametrize("model,compliance,kind", [("dynamic", "iterations", 1), ("dynamic", "factor", 2), ("precomputed", "factor", 2)])
def test_stiffness_and_patch_go_out_only_when_the_extrapolator_asks(bin, root, tmp_path, types, model, compliance, kind):
    for extrapolator in ("position", "tangent", "local_model"):
        run(bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", "--set", f"model={model}", "--set", f"haptics.extrapolator={extrapolator}",
            "--set", f"haptics.compliance={compliance}", "--set", "haptics.rate=25 Hz", "--record", tmp_path / "log", env={"TM_CACHE_DIR": str(tmp_path)})
        forces, patches = {}, {}
        for e in lcm.EventLog(str(tmp_path / "log")):
            if e.channel == "FORCE_0":
                m = types.force_sample_t.decode(e.data)
                forces[m.seq] = m
                assert bool(m.flags & 8) == (m.seq in patches)  # the patch arrives directly before its sample
            elif e.channel == "PATCH_0":
                m = types.contact_patch_t.decode(e.data)
                patches[m.seq] = m
        touching = [f for f in forces.values() if np.linalg.norm(f.force_N) > 0.1]
        assert len(touching) > 10
        if extrapolator == "position":
            assert not patches and all(f.stiffness_kind == 0 for f in forces.values())
            continue
        known = [f for f in touching if f.stiffness_kind]
        assert len(known) > 0.8 * len(touching) and all(f.stiffness_kind == kind for f in known)
        for f in known:  # a deeper press has a larger reaction
            K = np.array(f.stiffness_N_m).reshape(3, 3)
            assert K[2, 2] < -5
        if extrapolator == "tangent":
            assert not patches
            continue
        assert len(patches) > 0.8 * len(touching)
        for p in patches.values():
            n = 3 * p.vertex_count
            C = np.zeros((n, n))
            C[np.triu_indices(n)] = p.compliance_m_N[:n * (n + 1) // 2]
            C = C + np.triu(C, 1).T
            assert p.kind == kind and np.isfinite(C).all() and np.linalg.eigvalsh(C)[0] > -1e-5 * np.abs(C).max()
            assert max(p.triangle[:3 * p.triangle_count]) < p.vertex_count and list(p.trocar_m) == [0.05, 0.05, 0.18]


def test_only_what_may_be_sent_takes_memory(bin, root, tmp_path):
    scene = [bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--explain", "--set"]
    rows = {}
    for extrapolator in ("position", "tangent", "local_model"):
        r = report(*scene, f"haptics.extrapolator={extrapolator}", tmp=tmp_path)
        rows[extrapolator] = {s["name"]: s for s in r["stages"]}, r["memory_bytes"]
    assert "patch" not in rows["position"][0] and rows["position"][0]["haptics"]["bytes"] == 0
    for e in ("tangent", "local_model"):
        stages, memory = rows[e]
        assert stages["patch"]["line"] == 23 and stages["patch"]["bytes"] == memory - rows["position"][1] > 0
        assert stages["patch"]["phase"] == "on demand" and not stages["patch"]["in_step"] and stages["patch"]["us_per_step"] > 0


def test_the_hybrid_model_is_cut_and_grasped_like_the_whole(bin, root, tmp_path):
    """The same pull before and after the same cut, held until it is at rest."""
    force, told = {}, {}
    for model in ("dynamic", "hybrid"):
        told[model] = report(bin / "tm-sim", root / "apps/scenes/block-cut.yaml", "--lockstep", "--unset", "haptics", "--set", "damping.rate=150",
                             "--set", "hybrid.box={min: [-1, -1, 20 mm], max: [1, 1, 1]}", "--set", f"model={model}",
                             "--samples", tmp_path / "s.csv", tmp=tmp_path, env={"TM_CACHE_DIR": str(tmp_path)})
        s = columns(tmp_path / "s.csv")
        s = s[s["instrument"] == 0]
        force[model] = np.array([[s[f"f{a}_N"][np.argmin(np.abs(s["time_s"] - t))] for a in "xyz"] for t in (1.48, 2.4)])
    assert told["dynamic"]["tets_removed"] == told["hybrid"]["tets_removed"] > 5
    assert told["dynamic"]["tets_alive"] == told["hybrid"]["tets_alive"]
    size = np.linalg.norm(force["dynamic"], axis=1)
    assert (size > 0.5).all() and abs(size[1] - size[0]) > 1e-3  # the cut changed the force
    assert np.linalg.norm(force["hybrid"] - force["dynamic"], axis=1).max() < 1e-3 * size.max(), force


def test_cutting_everything_away_ends_in_an_empty_tissue(bin, root, tmp_path, types):
    """A cautery of 10 cm thickness removes the complete block; frames continue after the last tetrahedron."""
    sweep = ("hand=[{instrument: 0, path: [{time: 0, tip: [50 mm, 50 mm, 120 mm]}, {time: 0.2, tip: [50 mm, 50 mm, 60 mm], active: yes}, "
             "{time: 0.6, tip: [50 mm, 50 mm, 10 mm], active: yes}, {time: 1, tip: [10 mm, 10 mm, 10 mm], active: yes}, {time: 1.4, tip: [90 mm, 10 mm, 10 mm], active: yes}, "
             "{time: 1.8, tip: [90 mm, 90 mm, 10 mm], active: yes}, {time: 2.2, tip: [10 mm, 90 mm, 10 mm], active: yes}]}]")
    r = report(bin / "tm-sim", root / "apps/scenes/block-cut.yaml", "--lockstep", "--unset", "haptics", "--unset", "grasp", "--duration", "3 s",
               "--set", "instruments=[{mode: cautery, trocar: [50 mm, 50 mm, 300 mm], radius: 50 mm}]", "--set", sweep, "--set", "cut.rate=1e6",
               "--set", "gravity=", "--set", "rendering=", "--record", tmp_path / "log", "--samples", tmp_path / "s.csv", tmp=tmp_path)
    assert r["tets_alive"] == 0 and r["tets_removed"] == r["tets"]
    assert np.isfinite([list(row) for row in columns(tmp_path / "s.csv").tolist()]).all()
    last = [types.tissue_t.decode(e.data) for e in lcm.EventLog(str(tmp_path / "log")) if e.channel == "TISSUE"][-1]
    assert last.vertex_count == last.triangle_count == 0 and last.topology_revision > 0


def test_the_account_of_energy_closes_in_a_cutting_session(bin, root, tmp_path):
    scene = root / "apps/scenes/block-cut.yaml"
    plain = report(bin / "tm-sim", scene, "--lockstep", tmp=tmp_path)
    r = report(bin / "tm-sim", scene, "--lockstep", "--set", "energy=", tmp=tmp_path)
    assert "energy" not in plain and r["state_hash"] == plain["state_hash"]  # it only observes
    e = r["energy"]
    put_in = e["start_J"] + sum(e["contact_J"]) + sum(e["grasp_J"]) + e["support_J"] + e["gravity_J"] + e["load_J"] + e["state_change_J"]
    left = put_in - e["damping_J"] - e["cut_J"] - e["kinetic_J"] - e["elastic_J"]
    turnover = sum(abs(x) for x in e["contact_J"] + e["grasp_J"]) + e["damping_J"] + abs(e["gravity_J"])
    assert turnover > 1e-6 and abs(left) < 1e-9 * turnover and abs(e["residual_J"]) < 1e-9 * turnover
    assert sum(e["tool_work_J"]) > 0 and e["cut_J"] > 0 and e["damping_J"] > 0
    assert e["generated_J"] < 0.01 * sum(e["tool_work_J"])


@pytest.mark.parametrize("model", ["precomputed", "hybrid"])
def test_models_without_motion_keep_no_account_of_energy(bin, root, tmp_path, model):
    scene = block_scene(tmp_path, root)
    part = ["--set", "hybrid={box: {min: [10 mm, 10 mm, 20 mm], max: [40 mm, 40 mm, 50 mm]}}"] if model == "hybrid" else []
    out = run(bin / "tm-sim", scene, "--check", "--set", f"model={model}", *part, "--set", "energy=", code=2)
    assert "energy" in out[1] and "write 'model: dynamic'" in out[1]


def test_the_hand_feels_friction(bin, root, tmp_path):
    """The probe of block-press slides by 8 mm: friction resists with the coefficient times the normal force, and no other bit changes."""
    scene, last = root / "apps/scenes/block-press.yaml", {}
    for name, more in {"none": [], "zero": ["--set", "friction={static: 0, kinetic: 0}"], "all": ["--set", "friction="],
                       "own": ["--set", "friction=", "--set", "instruments[0].friction={static: 0.6, kinetic: 0.5}"]}.items():
        r = report(bin / "tm-sim", scene, "--lockstep", "--samples", tmp_path / f"{name}.csv", *more, tmp=tmp_path)
        samples = columns(tmp_path / f"{name}.csv")
        at = np.argmin(abs(samples["time_s"] - 1.3))
        last[name] = r["state_hash"], samples["fx_N"][at], samples["fz_N"][at]
    assert last["zero"][0] == last["none"][0]
    assert abs(last["none"][1]) < 0.05 * last["none"][2]
    for name, sliding in {"all": 0.2, "own": 0.5}.items():
        assert last[name][1] == pytest.approx(last["none"][1] - sliding * last[name][2], abs=0.1 * sliding * last[name][2])


@pytest.mark.parametrize("more,says", [
    (["--set", "friction={static: 0.2, kinetic: 0.3}"], "coefficient 0.3 is above the static one, 0.2"),
    (["--set", "instruments[0].friction={static: 0.2}"], "add 'friction:'"),
    (["--set", "friction=", "--set", "instruments[0].friction={kinetic: 0.5}"], "coefficient 0.5 is above the static one, 0.3"),
    (["--set", "friction={static: 3}"], "friction.static"),
    (["--set", "friction=", "--unset", "contact", "--unset", "haptics"], "friction needs contact"),
])
def test_friction_that_cannot_be_is_refused(bin, root, tmp_path, more, says):
    assert says in run(bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--check", *more, code=2)[1]


TO_AND_FRO = ("hand[0].path=[{time: 0 s, tip: [45 mm, 50 mm, 56 mm]}, {time: 0.5 s, tip: [45 mm, 50 mm, 49 mm]}, {time: 1.1 s, tip: [55 mm, 50 mm, 49 mm]}, "
              "{time: 1.7 s, tip: [45 mm, 50 mm, 49 mm]}, {time: 2.3 s, tip: [55 mm, 50 mm, 49 mm]}, {time: 2.9 s, tip: [45 mm, 50 mm, 49 mm]}, "
              "{time: 3.3 s, tip: [45 mm, 50 mm, 56 mm]}]")


@pytest.mark.parametrize("extrapolator", ["hold", "local_model"])
def test_friction_in_the_closed_loop_takes_energy_from_the_hand(bin, root, tmp_path, extrapolator):
    """A hand slides to and fro through device and controller at 25 Hz, with passivity control off. With friction the loop never returns more energy
    than it received, and at the end it has dissipated the work of the slide."""
    given = {}
    for name, coefficients in {"none": "{static: 0, kinetic: 0}", "some": "{static: 0.3, kinetic: 0.2}", "much": "{static: 1, kinetic: 0.7}"}.items():
        report(bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", "--set", TO_AND_FRO, "--duration", "3.6 s", "--csv", tmp_path / f"{name}.csv",
               "--set", f"haptics.extrapolator={extrapolator}", "--set", "haptics.rate=25 Hz", "--set", "haptics.passivity=false", "--set", f"friction={coefficients}", tmp=tmp_path)
        ticks = np.genfromtxt(tmp_path / f"{name}.csv", delimiter=",", names=True, dtype=None, encoding=None)
        tip, force = (np.column_stack([ticks[column] for column in columns]) for columns in (("px_m", "py_m", "pz_m"), ("fx_N", "fy_N", "fz_N")))
        given[name] = np.cumsum((force[:-1] * np.diff(tip, axis=0)).sum(axis=1))  # to the hand
        assert np.abs(force).max() < 1
    slid_m = 3 * 0.009
    for name, sliding in {"some": 0.2, "much": 0.7}.items():
        assert given[name].max() < 1e-6
        assert given[name][-1] < given["none"][-1] - 0.4 * sliding * 0.2 * slid_m  # minimum press of 0.2 N


def test_precomputed_and_dynamic_feel_the_same_friction(bin, root, tmp_path):
    """At the reversal points both models are at rest and have the same force; the precomputed one stays within its cone, and every frame converges."""
    felt = {}
    for model in ("dynamic", "precomputed"):
        report(bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--lockstep", "--set", TO_AND_FRO, "--duration", "3.6 s", "--unset", "haptics",
               "--set", f"model={model}", "--set", "friction={static: 0.3, kinetic: 0.3}", "--samples", tmp_path / f"{model}.csv", tmp=tmp_path)
        felt[model] = columns(tmp_path / f"{model}.csv")
    still, own = felt["dynamic"], felt["precomputed"]
    assert not own["flags"].any()
    assert (abs(own["fx_N"]) <= 0.3 * own["fz_N"] + 0.01).all()
    for turn_s in (1.12, 1.72, 2.32):
        at = np.argmin(abs(own["time_s"] - turn_s))
        assert abs(own["fx_N"][at]) > 0.15
        assert own["fx_N"][at] == pytest.approx(still["fx_N"][at], rel=0.03) and own["fz_N"][at] == pytest.approx(still["fz_N"][at], rel=0.01)
