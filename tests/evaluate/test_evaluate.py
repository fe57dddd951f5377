"""tm-evaluate: its logs, its study in the short form, and what must hold whatever the figures are."""
import json
import subprocess
import sys

import pytest

NAMES = ["hold", "time", "position", "broyden", "tangent", "contact", "paper_position"]


@pytest.fixture(scope="module")
def logs(bin, root, once):
    def make(out):
        subprocess.run([bin / "tm-evaluate", "--generate", out, "--model", "precomputed"], cwd=root, check=True, timeout=300)

    return once("evaluate-logs", make)


@pytest.fixture(scope="module")
def page(bin, root, once):
    def make(out):
        subprocess.run([bin / "tm-evaluate", "--study", "--quick", "--model", "precomputed", "--json", out / "figures.json"], cwd=root, check=True, timeout=900)
        subprocess.run([sys.executable, root / "apps/evaluate/page.py", out / "figures.json", "-o", out], check=True, timeout=300)

    out = once("evaluate-study", make)
    return out, json.loads((out / "evaluate.json").read_text())


def figures(bin, root, tmp_path, *arguments):
    subprocess.run([bin / "tm-evaluate", *arguments, "--json", tmp_path / "e.json"], cwd=root, check=True, timeout=120)
    return json.loads((tmp_path / "e.json").read_text())["logs"]


def test_logs_hold_samples_patches_and_truth(bin, root, logs, tmp_path):
    one, = figures(bin, root, tmp_path, logs / "precomputed-tour.lcm")
    assert one["truth"] == "recorded" and one["samples"] > 100
    rms = {r["extrapolator"]: r["rms"] for r in one["rows"]}
    assert list(rms) == NAMES
    assert rms["contact"] < rms["tangent"] < rms["position"] < rms["hold"]
    assert rms["contact"] < rms["position"] / 10


def test_latency_is_felt_by_hold_and_not_by_contact(bin, root, logs, tmp_path):
    now, = figures(bin, root, tmp_path, logs / "precomputed-tour.lcm")
    late, = figures(bin, root, tmp_path, "--latency", "1", logs / "precomputed-tour.lcm")
    rms = [{r["extrapolator"]: r["rms"] for r in x["rows"]} for x in (now, late)]
    assert rms[1]["hold"] > 1.5 * rms[0]["hold"]
    assert rms[1]["contact"] < 1.5 * rms[0]["contact"]
    assert rms[1]["contact"] < rms[1]["position"] / 30


def test_signed_beats_unsigned_on_reversals(bin, root, logs, tmp_path):
    one, = figures(bin, root, tmp_path, logs / "precomputed-reversals.lcm")
    rms = {r["extrapolator"]: r["rms"] for r in one["rows"]}
    assert rms["position"] < rms["paper_position"]


def test_the_page_is_complete(page):
    out, data = page
    html = (out / "index.html").read_text()
    for name in ("roughness", "figure5", "rates_precomputed", "jitter", "loss", "loop"):
        assert f'alt="{name}"' in html and (out / f"{name}.png").stat().st_size > 5000
    rows = data["rows"]
    for key, values in {"latency_frames": {0, 1, 2, 3}, "truth": {"model", "interpolated"}, "encoders": {True, False}, "path": {"tour", "reversals"}}.items():
        assert {r[key] for r in rows} == values, key
    assert {round(r["loss"], 3) for r in rows} == {0, 0.1, 0.2, 0.3}
    assert {r["extrapolator"] for r in rows} == set(NAMES)
    assert json.loads((out / "rates.json").read_text())["rows"]


def test_roughness_stays_within_the_aim(page):
    """The force itself: 0.5 % of its peak a tick is the aim; measured 0.4 % and below."""
    for row in page[1]["roughness"]:
        assert row["p99"] < 0.005, row


def test_the_loop_is_stable_where_theory_says_so_and_further(page):
    rows = [r for r in page[1]["loop"]["rows"] if not r["passivity"]]
    hold, = (r for r in rows if r["extrapolator"] == "hold")
    assert 0.5 < hold["stiffness_N_m"] / hold["theory_N_m"] < 2
    assert max(r["stiffness_N_m"] for r in rows) > 8 * hold["stiffness_N_m"]


@pytest.mark.parametrize("arguments, says", [
    ([], "name logs, or --study"),
    (["--study"], "--study wants --json"),
    (["--model", "jelly", "--study"], "no model 'jelly'"),
    (["nowhere.lcm"], "nowhere.lcm: "),
    (["--loss", "2", "x.lcm"], "--loss 2"),
    (["--latency", "-1", "x.lcm"], "--latency -1"),
    (["--frobnicate"], "unknown or incomplete option"),
])
def test_bad_use(bin, tmp_path, arguments, says):
    run = subprocess.run([bin / "tm-evaluate", *arguments], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert run.returncode == 2 and says in run.stderr, run
    assert not list(tmp_path.iterdir())


def test_a_log_without_samples_is_refused(bin, tmp_path):
    (tmp_path / "empty.lcm").write_bytes(b"")
    run = subprocess.run([bin / "tm-evaluate", tmp_path / "empty.lcm"], capture_output=True, text=True, timeout=60)
    assert run.returncode == 2 and "TOOL_0" in run.stderr
