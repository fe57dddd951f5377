"""tm-sim --settle against solutions made by other programs."""
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
def test_oracle(bin, tmp_path, oracle, name, case, precision, tolerance):
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
    # The table's reactions are the same ones, vertex by vertex.
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


def test_nothing_holds_it(bin, tmp_path, root):
    scene = block_scene(tmp_path, root, "gravity:\n")
    _, said = run(bin / "tm-sim", scene, "--settle", "1e-8", "--unset", "supports", "--write", tmp_path / "no.csv", code=2)
    assert "support" in said and not (tmp_path / "no.csv").exists()


def test_a_pressed_tissue_at_rest_pushes_as_much_as_it_is_held(bin, root, tmp_path):
    """The settled contact, the support that holds it and the precomputed model's own solution: one force."""
    press = [bin / "tm-sim", root / "apps/scenes/block-press.yaml", "--unset", "haptics", "--set", "instruments[0].start={tip: [52 mm, 50 mm, 47 mm]}"]
    run(*press, "--settle", "1e-11", "--json", tmp_path / "rest.json")
    rest = json.loads((tmp_path / "rest.json").read_text())
    (tool,) = rest["instruments"]
    force, held = np.array(tool["force_N"]), np.array(rest["supports"][0]["reaction_N"])
    assert tool["rows"] >= 1 and not tool["inside"] and np.linalg.norm(held) > 0.5
    # A tip on the shaft's axis straight above: the equivalent tip force is the contact force itself.
    assert np.linalg.norm(force - held) < 1e-6 * np.linalg.norm(held)
    run(*press, "--lockstep", "--set", "model=precomputed", "--set", "hand[0].path=[{time: 0, tip: [50 mm, 50 mm, 60 mm]}, {time: 1, tip: [52 mm, 50 mm, 47 mm]}]",
        "--unset", "instruments[0].start", "--duration", "1.2 s", "--samples", tmp_path / "s.csv", env={"TM_CACHE_DIR": str(tmp_path)})
    last = np.genfromtxt(tmp_path / "s.csv", delimiter=",", names=True)[-1]
    assert np.linalg.norm(force - [last["fx_N"], last["fy_N"], last["fz_N"]]) < 1e-6 * np.linalg.norm(force)
