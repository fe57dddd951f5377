"""Fibres between two groups of the mesh, and from files per vertex or tetrahedron, against known rules."""
import json
import math
import subprocess
import sys

import pytest

sys.path.insert(0, "tests/mesh")
import meshlib  # noqa: E402

SCENE = """tissue:
  mesh: arc.msh
  materials: {{"*": {{E_L: 40 kPa, E_T: 4 kPa, nu_LT: 0.3, nu_TT: 0.4, G_L: 2 kPa}}}}
anisotropy: {{{fibres}}}
supports: [{{group: begin}}]
loads: [{{group: end, force: [1 mN, 1 mN, 2 mN]}}]
"""
CIRCULAR = "rule: circular, direction: [0, 0, 1]"


def arc(n=6):
    """A quarter of a ring about z, 50 to 100 mm, with its two ends as groups: between them the potential is the angle."""
    m = meshlib.block(n)
    for p in m.points:
        r, a = 0.05 + p[1] * 0.5, math.pi / 2 * p[0] / 0.1
        p[:] = [r * math.sin(a), r * math.cos(a), p[2] * 0.3]
    m.names = {(0, 1): "begin", (0, 2): "end", (3, 9): "muscle"}
    m.region = [9] * len(m.tets)
    m.dots = [(v, 1 if v % (n + 1) == 0 else 2) for v in range(len(m.points)) if v % (n + 1) in (0, n)]
    return m


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fibres")
    (folder / "arc.msh").write_text(meshlib.msh2(arc()))
    return folder


def run(bin, folder, fibres, code=0):
    (folder / "arc.yaml").write_text(SCENE.format(fibres=fibres))
    out = subprocess.run([bin / "tm-sim", folder / "arc.yaml", "--settle", "1e-10", "--json", folder / "rest.json"], capture_output=True, text=True, timeout=300)
    assert out.returncode == code, out.stdout + out.stderr
    return json.loads((folder / "rest.json").read_text())["energy_J"] if code == 0 else out.stderr


def test_fibres_between_two_ends_follow_the_arc(bin, folder):
    round_it, laplace = run(bin, folder, CIRCULAR), run(bin, folder, "rule: laplace, from: begin, to: end")
    assert laplace == pytest.approx(round_it, rel=0.03)  # a six-part mesh's gradient
    assert run(bin, folder, "rule: laplace, from: end, to: begin") == pytest.approx(laplace, rel=1e-6)
    assert run(bin, folder, "rule: radial, direction: [0, 0, 1]") > 1.2 * round_it  # the check can fail


def write(path, word, vectors):
    path.write_text(f"{word},ax,ay,az\n" + "".join("%d,%r,%r,%r\n" % (i, *v) for i, v in enumerate(vectors)))


def test_vectors_per_vertex_may_have_either_sign(bin, folder):
    m = arc()
    write(folder / "vertex.csv", "vertex", [(s * p[1], -s * p[0], 0) for p, s in zip(m.points, [1, -1, 1, 1, -1] * 99)])
    assert run(bin, folder, "file: vertex.csv") == pytest.approx(run(bin, folder, CIRCULAR), rel=0.01)


def test_smoothing_takes_noise_away(bin, folder):
    m, seed, rows = arc(), 7, []
    for t in m.tets:
        c = [sum(m.points[v][a] for v in t) / 4 for a in range(3)]
        noise = []
        for _ in range(3):
            seed = (1103515245 * seed + 12345) % 2**31
            noise.append(1.4 * (seed / 2**31 - 0.5))
        r = math.hypot(c[0], c[1])
        rows.append((c[1] / r + noise[0], -c[0] / r + noise[1], noise[2]))
    write(folder / "tet.csv", "tet", rows)
    clean, rough, smooth = run(bin, folder, CIRCULAR), run(bin, folder, "file: tet.csv"), run(bin, folder, "file: tet.csv, smooth: 5")
    assert abs(smooth - clean) < 0.3 * abs(rough - clean) and abs(rough - clean) > 0.02 * clean


@pytest.mark.parametrize("fibres,said", [
    ("rule: laplace, from: begin", "give from: and to:"), ("rule: laplace, from: begin, to: begin", "are both 'begin'; name another group"), ("rule: laplace, from: begin, to: apex", "no group 'apex'"),
    ("rule: radial, from: begin", "apply only to rule laplace"), ("file: short.csv", "ends after 1 rows, the mesh has 343 vertices"), ("file: other.csv", "write tet,ax,ay,az or vertex,ax,ay,az"),
    ("file: row.csv", "a row is vertex,ax,ay,az"), ("rule: laplace, from: begin, to: end, smooth: -1", "outside 0 to 1000")])
def test_bad_input(bin, folder, fibres, said):
    write(folder / "short.csv", "vertex", [(1, 0, 0)])
    (folder / "other.csv").write_text("node,ax,ay,az\n")
    (folder / "row.csv").write_text("vertex,ax,ay,az\n0,1,0\n")
    assert said in run(bin, folder, fibres, code=2)


def test_component_without_an_end_is_named(bin, tmp_path):
    m, lone = arc(2), meshlib.block(1, 0.01)
    m.tets += [[v + len(m.points) for v in t] for t in lone.tets]
    m.region += [9] * len(lone.tets)
    m.points += lone.points
    m.vertex_tag = list(range(1, len(m.points) + 1))
    (tmp_path / "arc.msh").write_text(meshlib.msh2(m))
    assert "has no vertex of group 'from'" in run(bin, tmp_path, "rule: laplace, from: begin, to: end", code=2)
