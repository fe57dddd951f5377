"""A mesh of large bandwidth is renumbered internally: input and output keep the file's numbers, with the same results as for the mesh in order."""
import json
import random
import re
import sys

import numpy as np
import pytest
from matplotlib.image import imread
from simkit import report, run
from test_series import read_series

SCENE = """
tissue:
  mesh: {mesh}
  scale: 0.6
  force: plain
  materials:
    tissue: {{lambda_T: 10 kPa, mu_T: 3 kPa, lambda_L: 12 kPa, mu_L: 9 kPa, density: 1050 kg/m3}}
anisotropy: {{file: {fibres}}}
damping: {{rate: 60 /s}}
contact:
rendering:
supports:
  - {{name: bottom, group: z_min}}
  - {{name: picked, vertex: {picked}, axes: xy}}
loads:
  - {{vertex: {pulled}, force: [0, 0, 5 mN]}}
instruments:
  - radius: 3.5 mm
    trocar: [30 mm, 30 mm, 150 mm]
hand:
  - instrument: 0
    path:
      - {{time: 0 s, tip: [30 mm, 30 mm, 36 mm]}}
      - {{time: 0.2 s, tip: [30 mm, 30 mm, 27 mm]}}
time: {{frame_rate: 25 Hz, duration: 0.2 s}}
"""
HYBRID = ["--set", "model=hybrid", "--set", "hybrid.box={min: [15 mm, 15 mm, 17 mm], max: [45 mm, 45 mm, 31 mm]}"]
PICKED, PULLED = [700, 1300, 1310], 2290


def write_scene(folder, root, was):
    """Writes the block of 10,000 tetrahedra with vertex was[v] as its v-th: the mesh, fibres per vertex, and a scene that names the same vertices."""
    lines = (root / "meshes/block_10k.msh").read_text().splitlines()
    at = lines.index("$Nodes") + 2
    now = {old + 1: new + 1 for new, old in enumerate(was)}
    place = [line.split()[1:] for line in lines[at:at + len(was)]]
    lines[at:at + len(was)] = [" ".join([str(v + 1), *place[old]]) for v, old in enumerate(was)]
    begin = lines.index("$Elements") + 2
    for i in range(begin, lines.index("$EndElements")):
        word = lines[i].split()
        first = 3 + int(word[2])
        lines[i] = " ".join(word[:first] + [str(now[int(v)]) for v in word[first:]])
    folder.mkdir()
    (folder / "block.msh").write_text("\n".join(lines) + "\n")
    point = np.array([place[old] for old in was], float)
    fibre = "".join("%d,1,%.9g,%.9g\n" % (v, 20 * x[1], 20 * x[2]) for v, x in enumerate(point))
    (folder / "fibres.csv").write_text("vertex,ax,ay,az\n" + fibre)
    (folder / "scene.yaml").write_text(SCENE.format(mesh="block.msh", fibres="fibres.csv", picked=[now[v + 1] - 1 for v in PICKED], pulled=now[PULLED + 1] - 1))
    return folder / "scene.yaml"


@pytest.fixture(scope="module")
def scenes(root, tmp_path_factory):
    """Makes the block in order, shuffled, and was[v] of the shuffled vertices."""
    folder, was = tmp_path_factory.mktemp("numbering"), list(range(2304))
    ordered = write_scene(folder / "ordered", root, was)
    random.Random(1).shuffle(was)
    return ordered, write_scene(folder / "shuffled", root, was), np.array(was)


def settled(bin, scene, folder):
    run(bin / "tm-sim", scene, "--settle", "1e-11", "--unset", "hand", "--write", folder / "rest.csv")
    run(bin / "tm-sim", scene, "--settle", "1e-11", "--unset", "hand", "--write", folder / "rest.vtk")
    words = (folder / "rest.vtk").read_text().split()

    def numbers(word, skip, count):
        begin = words.index(word) + skip
        return np.array(words[begin:begin + count], float)
    table = np.loadtxt(folder / "rest.csv", delimiter=",", skiprows=1)
    grid = [numbers("POINTS", 3, 3 * 2304).reshape(-1, 3), numbers("displacement_m", 2, 3 * 2304).reshape(-1, 3), numbers("reaction_N", 2, 3 * 2304).reshape(-1, 3)]
    tets = numbers("CELLS", 3, 5 * int(words[words.index("CELLS") + 1])).reshape(-1, 5)[:, 1:].astype(int)
    return table, np.hstack(grid), tets


def test_tables_at_rest_use_the_files_vertices(bin, scenes, tmp_path):
    """Groups, numbers and fibres of the file are found; displacements and reactions are in its rows."""
    ordered, shuffled, was = scenes
    (table, grid, tets), (other, other_grid, other_tets) = settled(bin, ordered, tmp_path), settled(bin, shuffled, tmp_path)
    assert np.array_equal(other[:, 0], np.arange(2304)) and np.array_equal(other[:, 1:], other_grid)
    assert np.array_equal(was[other_tets], tets)
    assert np.array_equal(other[:, 1:4], table[was, 1:4])
    assert np.abs(other[:, 4:7] - table[was, 4:7]).max() < 1e-8 * np.abs(table[:, 4:7]).max()
    assert np.abs(other[:, 7:] - table[was, 7:]).max() < 1e-7 * np.abs(table[:, 7:]).max()
    assert np.abs(table[PICKED, 4:6]).max() == 0 and np.abs(table[PULLED, 4:7]).max() > 1e-5


def pictures(build, log):
    """Returns {number in the mesh: place} of each TISSUE message, and its triangles by such numbers."""
    code = f"""
import sys, json, lcm
sys.path.insert(0, {str(build / 'python')!r})
import tensormass_lcm as t
out = []
for e in lcm.EventLog({str(log)!r}):
    if e.channel == 'TISSUE':
        m = t.tissue_t.decode(e.data)
        out.append([m.vertex_id, m.vertex_m, [[m.vertex_id[c] for c in f] for f in m.triangle]])
print(json.dumps(out))
"""
    return [(np.array(i), np.array(x), np.array(f)) for i, x, f in json.loads(run(sys.executable, "-c", code)[0])]


@pytest.mark.parametrize("model", ["dynamic", "hybrid", "precomputed"])
def test_series_and_pictures_use_the_files_vertices(bin, build, scenes, tmp_path, model):
    """For each model: every frame's displacements, and the messages that viewers get."""
    ordered, shuffled, was = scenes
    more = {"dynamic": [], "hybrid": HYBRID, "precomputed": ["--set", "model=precomputed"]}[model]
    share = {"dynamic": 1e-6, "hybrid": 5e-3, "precomputed": 1e-6}[model]  # the hybrid's iteration stops early, so any other order of sums is visible
    said, series, seen = [], [], []
    for name, scene in (("a", ordered), ("b", shuffled)):
        said.append(report(bin / "tm-sim", scene, *more, "--lockstep", "--record", tmp_path / f"{name}.lcm", "--paraview", tmp_path / name, tmp=tmp_path, env={"TM_CACHE_DIR": str(tmp_path / "cache")}))
        series.append(read_series(tmp_path / name))
        seen.append(pictures(build, tmp_path / f"{name}.lcm"))
    assert said[0]["state_hash"] != said[1]["state_hash"] and len(series[0]) == len(series[1]) == 6
    moved = np.abs(series[0][-1][1]["displacement_m"]).max()
    assert moved > 1e-3
    for (_, a), (_, b) in zip(*series):
        assert np.array_equal(b["Points"], a["Points"][was]) and np.array_equal(was[b["connectivity"]], a["connectivity"])
        assert np.abs(b["displacement_m"] - a["displacement_m"][was]).max() < share * moved
        assert np.array_equal(a["region"], b["region"]) and np.abs(a["fibre"] - b["fibre"]).max() < 1e-12
    for (i, x, f), (j, y, g) in zip(*seen):
        assert np.array_equal(was[g], f) and (np.diff(j) > 0).all()
        place = np.full((2304, 3), np.nan)
        place[i] = x
        assert np.abs(place[was[j]] - y).max() < 1e-6 + share * moved
    assert len(seen[0]) == len(seen[1]) == 5


def test_tm_view_finds_supports_and_fibres(bin, scenes, tmp_path):
    """The picture of a scene, and of a log with its scene, equals that of the mesh in order."""
    pixels = []
    for name, scene in (("a", scenes[0]), ("b", scenes[1])):
        log = tmp_path / f"{name}.lcm"
        run(bin / "tm-sim", scene, "--lockstep", "--record", log)
        for source in ([scene], [log, "--scene", scene]):
            run(bin / "tm-view", *source, "--png", tmp_path / "p.png", "--size", "320x200", "--fibres", "--no-words", "--quiet")
            pixels.append(imread(tmp_path / "p.png")[..., :3])
    for one, other in zip(pixels[:2], pixels[2:]):
        assert one.std() > 0.05 and (np.abs(one - other).max(axis=-1) > 0.1).mean() < 1e-3


def test_a_computed_file_is_found_again(bin, scenes, tmp_path):
    """tm-precompute and tm-sim number alike. A file of the same mesh in the file's numbers, as older versions wrote it, is reported and recomputed."""
    env = {"TM_CACHE_DIR": str(tmp_path / "cache")}
    sim = [bin / "tm-sim", scenes[1], "--set", "model=precomputed", "--lockstep", "--frames", 1]
    run(bin / "tm-precompute", scenes[1], env=env)
    file, = (tmp_path / "cache").iterdir()
    assert "computed in" not in "".join(run(*sim, env=env))
    run(bin / "tm-precompute", scenes[1], "--out", file, "--set", "tissue.renumber=no", env=env)
    said = "".join(run(*sim, env=env))
    assert "computed in" in said and "made for another mesh" in said
    assert "computed in" not in "".join(run(*sim, env=env))


def test_snapshots_go_on_and_other_numbers_are_refused(bin, scenes, tmp_path):
    args = [bin / "tm-sim", scenes[1], "--lockstep"]
    whole = report(*args, "--snapshot-at", "0.12 s", "--snapshot", tmp_path / "s.tms", tmp=tmp_path)
    rest = report(*args, "--restore", tmp_path / "s.tms", tmp=tmp_path)
    assert rest["state_hash"] == whole["state_hash"]
    _, err = run(*args, "--restore", tmp_path / "s.tms", "--set", "tissue.renumber=no", code=2)
    assert "another" in err or "not of this" in err, err


def test_the_scene_can_keep_the_files_numbers(bin, scenes, tmp_path):
    """The bits of a mesh in order are unaffected; --explain states what was done."""
    ordered, shuffled, _ = scenes
    keep = ["--set", "tissue.renumber=no"]
    runs = [report(bin / "tm-sim", scene, "--lockstep", *more, tmp=tmp_path)["state_hash"] for scene in (ordered, shuffled) for more in ([], keep)]
    assert runs[0] == runs[1] != runs[2] != runs[3]
    for more, inside, words in (([], True, r"scene\.yaml:3: large bandwidth: .* differ by \d+ on average; renumbered internally, by (\d+)"),
                                (keep, False, r"without tissue\.renumber: no it would be (\d+), and steps faster")):
        path = tmp_path / "explain.json"
        out, _ = run(bin / "tm-sim", shuffled, "--explain", *more, "--json", path)
        told = json.loads(path.read_text())["numbering"]
        assert told["poor"] and told["inside"] == inside and told["distance"] > 3 * told["renumbered"]
        assert round(told["renumbered"]) == int(re.search(words, out).group(1))


def test_errors_name_the_files_vertex(bin, scenes):
    """Errors of the scene's reader, and of the library."""
    twice = ["--set", "supports=[{group: z_min}, {vertex: 100, displace: [1 mm, 0, 0]}, {vertex: 100, displace: [2 mm, 0, 0]}]"]
    _, err = run(bin / "tm-sim", scenes[1], "--check", *twice, code=2)
    assert "vertex 100 is already fixed at 0.001 m along x" in err
