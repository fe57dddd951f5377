"""tm-sim --settle against solutions of other programs."""
import json

import numpy as np
import pytest
from simkit import Oracle, block_scene, run

CASES = [(name, case) for name in ("iso", "fibre", "muscle") for case in ("gravity", "press", "poke")]


@pytest.fixture(scope="module")
def oracle(root):
    return {name: Oracle(root / "tests" / "physics" / "oracle" / f"{name}.txt") for name in ("iso", "fibre", "muscle")}


def solve(bin, tmp_path, oracle, name, case, *options):
    o = oracle[name]
    o.write_mesh(tmp_path / "block.msh")
    scene = tmp_path / "scene.yaml"
    scene.write_text(o.scene(name, case, "block.msh"))
    run(bin / "tm-sim", scene, "--settle", "1e-11", "--write", tmp_path / "out.csv", "--json", tmp_path / "out.json", *options)
    table = np.loadtxt(tmp_path / "out.csv", delimiter=",", skiprows=1)
    return o, table, json.loads((tmp_path / "out.json").read_text())


@pytest.mark.parametrize("precision,tolerance", [("double", 1e-7), ("single", 1e-4)])
@pytest.mark.parametrize("name,case", CASES)
def test_settled_tissue_agrees_with_the_reference(bin, tmp_path, oracle, name, case, precision, tolerance):
    o, table, report = solve(bin, tmp_path, oracle, name, case, "--set", f"tissue.precision={precision}")
    assert np.array_equal(table[:, 0], np.arange(len(o.vertex)))
    assert np.allclose(table[:, 1:4], o.vertex, rtol=0, atol=1e-15)
    u = table[:, 4:7]
    largest = np.linalg.norm(o.u[case], axis=1).max()
    assert np.linalg.norm(u - o.u[case], axis=1).max() < tolerance * largest
    supports = {s["name"]: np.array(s["reaction_N"]) for s in report["supports"]}
    scale = np.linalg.norm(o.clamp[case])
    assert np.linalg.norm(supports["clamp"] - o.clamp[case]) < tolerance * scale
    if case == "press":
        assert np.linalg.norm(supports["tip"] - o.tip[case]) < tolerance * scale
    # The table's reactions are the same, vertex by vertex.
    assert np.allclose(table[:, 7:10].sum(axis=0), sum(supports.values()), rtol=0, atol=1e-9 * scale)
    assert abs(report["energy_J"] - o.energy[case]) < 2 * tolerance * o.energy[case]


def test_vtk_holds_the_same(bin, tmp_path, oracle):
    o, table, _ = solve(bin, tmp_path, oracle, "iso", "press")
    run(bin / "tm-sim", tmp_path / "scene.yaml", "--settle", "1e-11", "--write", tmp_path / "out.vtk")
    lines = (tmp_path / "out.vtk").read_text().splitlines()
    at = lines.index("VECTORS displacement_m double") + 1
    u = np.array([list(map(float, line.split())) for line in lines[at:at + len(o.vertex)]])
    assert np.array_equal(u, table[:, 4:7])


def test_traction_by_box_is_balanced_by_the_support(bin, tmp_path, root):
    scene = block_scene(tmp_path, root, "loads:\n  - {group: z_max, traction: [0, 0, -1 kPa]}\n")
    run(bin / "tm-sim", scene, "--settle", "1e-10", "--json", tmp_path / "out.json")
    reaction = json.loads((tmp_path / "out.json").read_text())["supports"][0]["reaction_N"]
    assert np.allclose(reaction, [0, 0, 1000 * 0.1 * 0.1], rtol=0, atol=1e-6)  # kPa on 100 x 100 mm
    scene = block_scene(tmp_path, root, "loads:\n  - {box: {min: [-1, -1, 49.9 mm], max: [1, 1, 50.1 mm]}, traction: [0, 0, -1 kPa]}\n")
    run(bin / "tm-sim", scene, "--settle", "1e-10", "--json", tmp_path / "box.json")
    assert np.allclose(json.loads((tmp_path / "box.json").read_text())["supports"][0]["reaction_N"], reaction, atol=1e-12)


def test_tissue_without_supports_is_refused(bin, tmp_path, root):
    scene = block_scene(tmp_path, root, "gravity:\n")
    _, said = run(bin / "tm-sim", scene, "--settle", "1e-8", "--unset", "supports", "--write", tmp_path / "no.csv", code=2)
    assert "support" in said and not (tmp_path / "no.csv").exists()


def test_a_pressed_tissue_at_rest_pushes_as_much_as_it_is_held(bin, root, tmp_path):
    """The settled contact, its support and the precomputed model's own solution have one force."""
    press = [bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--unset", "haptics", "--set", "instruments[0].start={tip: [52 mm, 50 mm, 47 mm]}"]
    run(*press, "--settle", "1e-11", "--json", tmp_path / "rest.json")
    rest = json.loads((tmp_path / "rest.json").read_text())
    (tool,) = rest["instruments"]
    force, held = np.array(tool["force_N"]), np.array(rest["supports"][0]["reaction_N"])
    assert tool["rows"] >= 1 and not tool["inside"] and np.linalg.norm(held) > 0.5
    # With the tip straight above on the shaft's axis, the equivalent tip force is the contact force itself.
    assert np.linalg.norm(force - held) < 1e-6 * np.linalg.norm(held)
    run(*press, "--lockstep", "--set", "model=precomputed", "--set", "hand[0].path=[{time: 0, tip: [50 mm, 50 mm, 60 mm]}, {time: 1, tip: [52 mm, 50 mm, 47 mm]}]",
        "--unset", "instruments[0].start", "--duration", "1.2 s", "--samples", tmp_path / "s.csv", env={"TM_CACHE_DIR": str(tmp_path)})
    last = np.genfromtxt(tmp_path / "s.csv", delimiter=",", names=True)[-1]
    assert np.linalg.norm(force - [last["fx_N"], last["fy_N"], last["fz_N"]]) < 1e-6 * np.linalg.norm(force)


TURNING = "rotation:\n"


def bar(tmp_path, cells, size_m, move, more="", law="{young: 5 kPa, poisson: 0.45}"):
    """A bar of boxes along z; move(x, y, z): the prescribed position of an end's vertex, m. Scenes name every vertex of an end."""
    n = [c + 1 for c in cells]
    at = [(i * size_m[0] / cells[0], j * size_m[1] / cells[1], k * size_m[2] / cells[2]) for k in range(n[2]) for j in range(n[1]) for i in range(n[0])]
    tets = []
    for k, j, i in np.ndindex(*cells[::-1]):
        for order in ((0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (1, 0, 2), (2, 1, 0)):
            corner, tet = [i, j, k], []
            for axis in (None, *order):
                if axis is not None:
                    corner[axis] += 1
                tet.append((corner[2] * n[1] + corner[1]) * n[0] + corner[0] + 1)
            x = np.array([at[v - 1] for v in tet])
            tets.append(tet if np.linalg.det(x[1:] - x[0]) > 0 else [tet[0], tet[2], tet[1], tet[3]])
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", str(len(at)), *(f"{v + 1} {x[0]} {x[1]} {x[2]}" for v, x in enumerate(at)), "$EndNodes", "$Elements",
             str(len(tets)), *(f"{t + 1} 4 2 1 1 {' '.join(map(str, tet))}" for t, tet in enumerate(tets)), "$EndElements"]
    (tmp_path / "bar.msh").write_text("\n".join(lines) + "\n")
    held = [(v, move(*x) - np.array(x)) for v, x in enumerate(at) if move(*x) is not None]
    supports = "".join(f"  - {{vertex: {v}, displace: [{', '.join(f'{d:.17g}' for d in u)}]}}\n" for v, u in held)
    scene = tmp_path / "bar.yaml"
    scene.write_text(f'tissue:\n  mesh: bar.msh\n  materials:\n    "*": {law}\nsupports:\n{supports}{more}')
    return scene


def settled(bin, tmp_path, scene, *options):
    _, said = run(bin / "tm-sim", scene, "--settle", "1e-9", "--json", tmp_path / "out.json", *options)
    return said, json.loads((tmp_path / "out.json").read_text())


BAR = (2, 2, 8), (0.02, 0.02, 0.08)


@pytest.mark.parametrize("volume", ["", "strain_smoothing:\n"])
def test_ends_that_turn_or_twist_lead_the_bar_along(bin, tmp_path, volume):
    """Both ends rotated by a quarter turn store no energy. One end twisted by half a turn, in load steps, stays straight."""
    quarter = bar(tmp_path, *BAR, lambda x, y, z: np.array([x, -z, y]) if z in (0, 0.08) else None, TURNING + volume)
    said, report = settled(bin, tmp_path, quarter)
    assert said == "" and abs(report["energy_J"]) < 1e-12 and abs(report["deformation"]["min_det"] - 1) < 1e-9
    half = bar(tmp_path, *BAR, lambda x, y, z: np.array([x, y, z]) if z == 0 else np.array([0.02 - x, 0.02 - y, z]) if z == 0.08 else None, TURNING + volume)
    said, report = settled(bin, tmp_path, half)
    assert said == "" and report["load_steps"] > 1 and 0.005 < report["energy_J"] < 0.006
    assert report["deformation"]["inverted"] == 0 and report["deformation"]["min_det"] > 0.8


def test_unreliable_equilibrium_is_reported(bin, tmp_path):
    """Linear tissue that sags beyond its range, and tissue pressed through itself, give a warning with place and remedy."""
    sags = bar(tmp_path, *BAR, lambda x, y, z: np.array([x, y, z]) if z == 0 else None, "gravity: {acceleration: [6 m/s2, 0, 0]}\n")
    said, report = settled(bin, tmp_path, sags)
    assert said.startswith(f"{sags}:4: warning: at rest linear tissue far outside its range: in ") and "'rotation'" in said and said.count("\n") == 1, said
    assert report["deformation"]["nonlinear_share"] > 0.2
    sags.write_text(sags.read_text() + TURNING)
    assert settled(bin, tmp_path, sags)[0] == ""
    through = bar(tmp_path, *BAR, lambda x, y, z: np.array([x, y, z]) if z == 0 else np.array([x, y, -0.02]) if z == 0.08 else None, TURNING)
    said, report = settled(bin, tmp_path, through, "--settle", "1e-6")
    assert "tetrahedra are inverted (smallest det F -" in said and report["deformation"]["inverted"] > 0


def test_a_run_tells_at_its_end_that_linear_tissue_was_far_outside_its_range(bin, tmp_path):
    sags = bar(tmp_path, *BAR, lambda x, y, z: np.array([x, y, z]) if z == 0 else None, "gravity: {acceleration: [6 m/s2, 0, 0]}\ndamping: {rate: 40 /s}\n")
    _, said = run(bin / "tm-sim", sags, "--lockstep", "--duration", "0.6 s", "--json", tmp_path / "run.json")
    assert " linear tissue far outside its range" in said and "'rotation'" in said, said
    assert json.loads((tmp_path / "run.json").read_text())["deformation"]["nonlinear_share"] > 0.2
    assert "range" not in run(bin / "tm-sim", sags, "--lockstep", "--duration", "0.6 s", "--set", "rotation=")[1]


@pytest.mark.parametrize("threads", (1, 2))
def test_rotation_in_single_precision_settles_among_contact_as_double(bin, root, tmp_path, threads):
    """With contact the stages run; in single precision their forces would stay above the tolerance."""
    energy = {}
    for precision in ("double", "single"):
        run(bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--settle", "1e-9", "--json", tmp_path / "out.json", "--set", "rotation=", "--set", "gravity=",
            "--set", f"threads={threads}", "--set", f"tissue.precision={precision}")
        energy[precision] = json.loads((tmp_path / "out.json").read_text())["energy_J"]
    assert energy["single"] != energy["double"] and abs(energy["single"] / energy["double"] - 1) < 1e-6, energy
