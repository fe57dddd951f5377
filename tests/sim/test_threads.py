"""`threads:` of a scene: bit-identical results, reported by --explain, rejected with its line if impossible."""
from simkit import report, run


def test_the_same_session_on_two_threads(build, root, tmp_path):
    program, scene = build / "bin" / "tm-sim", root / "apps/scenes/liver-press.yaml"
    said = [report(program, scene, "--lockstep", "--frames", "4", "--quiet", "--set", f"threads={n}", tmp=tmp_path) for n in (1, 2)]
    assert said[0]["state_hash"] == said[1]["state_hash"]


def test_explain_says_how_many(build, root, tmp_path):
    program = build / "bin" / "tm-sim"
    out, _ = run(program, root / "apps/scenes/liver-press.yaml", "--explain", "--set", "threads=8")
    assert "threads: 5 of 8 requested; the tissue is too small for more" in out


def test_no_thread_is_refused(build, root):
    _, err = run(build / "bin" / "tm-sim", root / "apps/scenes/liver-press.yaml", "--check", "--set", "threads=0", code=2)
    assert "threads = 0 is outside 1 to 64" in err
