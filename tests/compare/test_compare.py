"""`make compare`: the case is as documented. Programs that are missing, stop, give no numbers or take too long are reported without losing the
others. A table is formed from recorded results. The programs themselves run only with TM_LONG, where they can be installed."""
import csv
import importlib
import json
import subprocess
import sys

import numpy as np
import pytest

MINE = "tests/compare"


@pytest.fixture
def modules(root, monkeypatch):
    """Returns (compare, table, case) of this folder; other folders have programs of these names."""
    monkeypatch.syspath_prepend(str(root / MINE))
    for name in ("compare", "table", "case"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    yield [importlib.import_module(name) for name in ("compare", "table", "case")]
    for name in ("compare", "table", "case"):
        sys.modules.pop(name, None)


@pytest.fixture
def run(modules, tmp_path, monkeypatch, capsys):
    """run(OPTION..., PROGRAM=HOW): runs the harness with stand-ins for the programs: 1 % and 10 % off, missing, slow, without numbers or stopped by
    hand."""
    compare, table, case = modules
    monkeypatch.setattr(table, "draw", lambda found, path: path.write_text("drawn"))

    def call(*options, **how):
        class StandIn(compare.Bench):
            def run(self, program, path, asked):
                what = how.get(program, "well")
                if asked.get("do") == "mesh":
                    x = np.stack(np.meshgrid(*[np.linspace(0, s, n + 1) for s, n in zip(case.SIZE_M, case.cells(asked["k"]))], indexing="ij"), -1).reshape(-1, 3)
                    np.savez(path, **case.make(x, [[0, 1, 2, 3]], asked["press"]))
                    return None
                if what == "stopped":
                    raise KeyboardInterrupt
                if what not in ("well", "nan"):
                    raise compare.Failed(what, f"it is {what}")
                rests = asked.get("do") == "static"
                u = np.load(path)["rest_m"][:, 2:] * np.array([0, 0, -0.1]) * (1 if rests else 1.01)
                u[0] *= np.nan if what == "nan" else 1
                return ({"force_N": 2.0 if rests else 2.2, "dt_s": 0.002, "step_s": 1e-4, "prepare_s": 0.1, "critical_s": 1e-3, "version": "1", "note": "; a note"},
                        {"u_m": u, "known": np.ones(len(u), bool)})

        status = compare.main(["--out", str(tmp_path / "out"), "--meshes", "1", "--reference", "2", *map(str, options)], StandIn)
        said = capsys.readouterr()
        return status, said.out, said.err

    call.out = tmp_path / "out"
    return call


def rows(out):
    return json.loads((out / "compare.json").read_text())["rows"]


def kinds(out):
    return {(r["program"], r["kind"]) for r in rows(out)}


def test_all_programs_fill_the_table(run):
    status, said, _ = run("--only", "tensormass,MuJoCo")
    assert status == 0 and kinds(run.out) == {("tensormass", "ran"), ("MuJoCo", "ran")} and len(rows(run.out)) == 8
    for row in rows(run.out):
        assert row["displacement_error"] == pytest.approx(0.01, rel=1e-6) and row["force_error"] == pytest.approx(0.1) and row["from_own"] == pytest.approx(0.01)
        assert row["per_second"] == pytest.approx(0.05)
    assert said.count("10.0%") >= 16
    assert all(row["differs"].endswith("; a note") for row in rows(run.out))
    with open(run.out / "compare.csv") as file:
        assert [r["setting"] for r in csv.DictReader(file)] == [r["setting"] for r in rows(run.out)]
    assert (run.out / "compare.png").exists()


def test_failures_are_reported_and_other_rows_stay(run):
    status, said, _ = run(MuJoCo="missing", Newton="nan")
    assert status == 1 and kinds(run.out) == {("tensormass", "ran"), ("MuJoCo", "missing"), ("Newton", "not finite")}
    assert "MuJoCo: missing: it is missing" in said and "not a number" in said
    status, said, _ = run("--only", "tensormass,Newton", Newton="too slow")
    assert status == 1 and kinds(run.out) == {("tensormass", "ran"), ("Newton", "too slow")} and "Newton: too slow" in said


def test_missing_reference_ends_the_comparison(run):
    status, _, said = run(tensormass="failed")
    assert status == 2 and "tensormass itself: failed" in said


def test_stopped_comparison_keeps_finished_rows(run):
    status, _, said = run("--only", "tensormass,MuJoCo", MuJoCo="stopped")
    assert status == 130 and "5 runs are in" in said and kinds(run.out) == {("tensormass", "ran")}


@pytest.mark.parametrize("wrong, said", [(["--meshes", "a"], "whole numbers"), (["--only", "SOFA"], "no program 'SOFA'"), (["--press", "0.5"], "between 0 and 0.2"),
                                         (["--meshes", "2"], "coarser than --reference")])
def test_wrong_options(run, wrong, said, capsys):
    with pytest.raises(SystemExit) as stop:
        run(*wrong)
    assert stop.value.code == 2 and said in capsys.readouterr().err


@pytest.mark.parametrize("runner, limit, kind, said", [
    ("import no_such_module", 60, "missing", "No module named 'no_such_module'"),
    ("import sys; sys.exit('something is wrong')", 60, "failed", "something is wrong"),
    ("import time; time.sleep(60)", 0.1, "too slow", "more than 1 s by the clock"),
    ("import os, signal; os.kill(os.getpid(), signal.SIGXCPU)", 60, "too slow", "more than 60 s of processor"),
    ("import resource, sys; sys.exit(str(resource.getrlimit(resource.RLIMIT_CPU)[0]))", 60, "failed", "60"),
    (None, 60, "missing", "was it installed?"),
])
def test_runner_without_result_is_reported(modules, tmp_path, runner, limit, kind, said):
    """Runs in a process of its own, like the programs."""
    compare, _, _ = modules
    (tmp_path / "run_mujoco.py").write_text(runner or "")
    peers = sys.executable if runner else str(tmp_path / "none/bin/python")
    given = compare.arguments(["--out", str(tmp_path / "out"), "--runners", str(tmp_path), "--peers", peers, "--limit", str(limit)])
    with pytest.raises(compare.Failed) as failed:
        compare.Bench(given).run("MuJoCo", tmp_path / "case.npz", {"integrator": "Euler"})
    assert failed.value.args[0] == kind and said in failed.value.args[1]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # modules on which matplotlib depends
def test_table_is_formed_from_recorded_results(modules, tmp_path, capsys):
    recorded = tmp_path / "then.json"
    row = {"program": "tensormass", "setting": "dynamic", "tets": 1536, "version": "9", "differs": "a word", "dt_s": 1e-3, "step_s": 1e-5, "per_second": 0.01, "prepare_s": 1,
           "force_N": 0.03, "kind": "ran", "why": "", "displacement_error": 0.25, "force_error": 0.123, "from_own": 1e-3, "force_from_own": 0.02}
    lost = {"program": "Newton", "setting": "VBD", "tets": 1536, "kind": "too slow", "why": "took more than 120 s"}
    recorded.write_text(json.dumps({"rows": [row, lost], "machine": {}, "reference": {"tets": 98304, "press": 0.02, "force_N": 0.0338,
                                                                                     "from_the_next": {"displacement": 0.01, "force": 0.002}}}))
    assert modules[0].main(["--from", str(recorded), "--out", str(tmp_path)]) == 1
    said = capsys.readouterr().out
    line, = (text for text in said.splitlines() if text.startswith("tensormass dynamic"))
    assert line.split() == ["tensormass", "dynamic", "1536", "1.000", "10.0", "0.0100", "25.0%", "12.3%", "0.10%", "2.00%", "a", "word"]
    assert "Newton: too slow: took more than 120 s" in said and "0.03380 N" in said and "tensormass 9" in said
    assert (tmp_path / "compare.png").read_bytes().startswith(b"\x89PNG")
    assert modules[0].main(["--from", str(tmp_path / "no.json")]) == 2 and "no.json" in capsys.readouterr().err


def test_case_is_as_documented(modules):
    c = modules[2]
    x = np.array([[0.03, 0.03, 0.03], [0.015, 0.03, 0.03], [0.05, 0.03, 0.03], [0.03, 0.03, 0], [0.0225, 0.03, 0.03]])
    made = c.make(x, [[0, 1, 2, 3]], 0.02)
    assert made["held"].tolist() == [True, True, False, True, True] and made["patch"].tolist() == [True, True, False, False, True]
    assert made["value_m"][:, 2] == pytest.approx([-0.0006, 0, 0, 0, -0.0003]), "2 % of 30 mm, half of it half way to the edge, none at it"
    volume = abs(np.linalg.det(x[1:4] - x[0])) / 6
    assert c.mass_kg(made) == pytest.approx([c.DENSITY * volume / 4] * 4 + [0])
    assert c.ramp(0) == 0 and c.ramp(c.RAMP_S) == c.ramp(1) == 1
    came, rested = [], []
    step_s, found = c.march(0.04, came.append, rested.append, lambda: {"rested": sum(rested)})
    assert step_s >= 0 and came == pytest.approx([0.04, 0.08, 0.1])
    assert found == {"rested": 13} and sum(rested) > 13, "what is read is of the case's end, however long its steps are timed"


@pytest.mark.long
def test_programs_agree_on_a_small_mesh(root, build, tmp_path):
    """On a small mesh each program is at rest at the solution of its law on that mesh; with a press ten times smaller the laws agree."""
    made = subprocess.run(["make", "--no-print-directory", "compare", f"ARGS=--meshes 1 --reference 2 --press 0.002 --out {tmp_path / 'out'}"], cwd=root, capture_output=True, text=True,
                          timeout=1800)
    found = rows(tmp_path / "out")
    gone = {r["program"]: r["why"] for r in found if r["kind"] == "missing"}
    assert "tensormass" not in gone and all(r["kind"] in ("ran", "missing") for r in found), made.stdout
    for row in found:
        if row["kind"] == "ran" and "volume" not in row["setting"]:
            ours = row["program"] == "tensormass"
            assert row["from_own"] < (1e-6 if ours else 0.05) and row["force_from_own"] < (1e-6 if ours else 0.05), row
    if gone:
        pytest.skip(f"compared without {gone}")
