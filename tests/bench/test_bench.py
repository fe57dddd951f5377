"""The benchmark runs completely and its JSON is complete. Asserts nothing about speed."""
import json
import math
import re
import subprocess
import sys

import pytest


def compare(root, baseline, out):
    return subprocess.run([sys.executable, root / "tests/bench/compare.py", baseline, out], capture_output=True, text=True)


def test_quick_benchmark_is_complete(build, root, tmp_path):
    program = build / "tests" / "bench" / "bench"
    out = tmp_path / "bench.json"
    run = subprocess.run([program, "--quick", "--json", out], cwd=root, capture_output=True, text=True, timeout=400)
    assert run.returncode == 0, run.stderr
    figures = json.loads(out.read_text())
    assert {"commit", "compiler", "flags", "machine", "when", "bandwidth_GB_s", "force", "step", "cut", "capacity", "numbering", "hybrid", "effects", "touch"} <= figures.keys()
    wide = {"naive wide"} & {r["form"] for r in figures["force"]}  # where the processor has AVX2
    assert len(figures["force"]) == 2 * 2 * (3 + len(wide)) and len(figures["step"]) == 2 and len(figures["cut"]) == 4
    assert {(r["precision"], r["form"]) for r in figures["force"]} == {(p, f) for p in ("double", "single") for f in {"best", "plain", "naive"} | wide}
    for row in figures["force"]:
        assert row["ns_per_edge"] > 0 and row["share_of_bandwidth"] > 0
        assert row["over_naive"] > 0 and row["over_naive_double"] > 0 and (row["form"] != "naive" or row["over_naive"] == 1)
        assert row["difference"] < (1e-13 if row["precision"] == "double" else 1e-5), "the yardstick computes another force"
    for row in figures["step"]:
        assert row["sim_seconds_per_wall_second"] > 0 and row["step_over_force"] > 0 and row["speedup"] > 0 and row["threads"] >= 1
    assert len(figures["numbering"]) == 4 and all(row["shuffled_over_ordered"] > 0 and row["renumbered_over_ordered"] > 0 for row in figures["numbering"])
    assert len(figures["effects"]) == 9 and all(row["over_linear"] > 0 and row["speedup"] > 0 for row in figures["effects"])
    assert len(figures["touch"]) == 2 and all(row["rows"] > 0 and row["over_without"] > 0 for row in figures["touch"])
    assert len(figures["hybrid"]) == 2
    for row in figures["hybrid"]:
        assert 0 < row["share"] < 1 and row["border"] > 0 and row["hybrid_over_dynamic"] > 0
    assert [row["cores"] for row in figures["capacity"]] == [0.5, 1, 2]
    assert compare(root, out, out).returncode == 0
    for row in figures["force"]:
        row["us_per_pass"] = {q: v * (0.5 if row["form"] == "best" else 1) for q, v in row["us_per_pass"].items()}
    (tmp_path / "older.json").write_text(json.dumps(figures))
    slower = compare(root, tmp_path / "older.json", out)
    assert slower.returncode == 1 and slower.stdout.count("slower") == 4
    for row in figures["cut"]:
        assert row["removed"] >= row["calls"] > 0 and math.isfinite(row["equivalent_bytes_per_tet"])
        q = row["us_per_tet_of_a_call"]
        assert 0 < q["p50"] <= q["p99"] <= q["max"]


@pytest.mark.parametrize("args,said", [(["--no-such"], "usage"), (["--row", "none"], "no row 'none'")])
def test_bad_option_is_refused(args, said, build, root):
    run = subprocess.run([build / "tests" / "bench" / "bench", *args], cwd=root, capture_output=True, text=True)
    assert run.returncode == 2 and said in run.stderr


def test_one_row_can_be_run_alone(build, tmp_path):
    subprocess.run([build / "tests" / "bench" / "bench", "--quick", "--row", "numbering", "--json", tmp_path / "b.json"], check=True, capture_output=True, timeout=120)
    rows = json.loads((tmp_path / "b.json").read_text())
    assert len(rows["numbering"]) == 4 and "force" not in rows


def test_saving_of_local_steps_is_that_counted_by_hand(bin, root):
    """The shortest step equals that of a scene that cuts. Regular tetrahedra together with some of half the size save what can be counted by hand."""
    sys.path.insert(0, str(root / "tests/bench"))
    import local_steps
    import numpy as np
    told = subprocess.run([bin / "tm-sim", root / "apps/scenes/block-cut.yaml", "--explain"], capture_output=True, text=True).stdout
    x, tet = local_steps.read(root / "meshes/block_1k.msh")
    step = float(re.search(r"guaranteed critical step (\S+) s", told).group(1))
    assert abs(local_steps.own_steps(x, tet, 5e3, 0.4, 1000).min() / step - 1) < 1e-3
    apart = np.arange(16).reshape(4, 4)  # four tetrahedra without common vertices
    assert local_steps.ceiling(apart, np.array([1.0, 2.1, 4.5, 1.9]), 2) == (1.0, 0.75)
    assert local_steps.ceiling(apart, np.array([1.0, 2.1, 4.5, 1.9]), 3) == (1.0, 0.6875)
    joined = np.array([[0, 1, 2, 3], [3, 4, 5, 6]])  # by the fast vertex of the slow one
    assert local_steps.ceiling(joined, np.array([1.0, 4.0]), 3)[1] == 0.8 * 1 + 0.2 * (4 + 3 / 4) / 7


def test_models_are_compared_on_a_scene_with_its_patches(bin, root):
    run = subprocess.run([sys.executable, root / "tests/bench/models.py", "apps/scenes/liver-press.yaml", "--runs", "1", "--duration", "0.2 s", "--bin", bin], cwd=root, capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr
    rows = [line.strip("|").split("|") for line in run.stdout.splitlines()[2:]]
    assert [r[0].strip() for r in rows] == ["dynamic", "hybrid", "precomputed"] and all(float(c) > 0 for r in rows for c in r[1:5])
    assert rows[0][2].strip() == rows[0][4].strip() == "1"
