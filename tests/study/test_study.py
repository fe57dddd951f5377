"""tm-study: a sweep over two scenes in one table, continued after an interruption, on cores and in Slurm's array; invalid input is reported before any
run."""
import csv
import os
import subprocess

import pytest

SCENE = """tissue:
  mesh: {mesh}
  materials:
    "*": {{young: 10 kPa, poisson: 0.4}}
gravity:
supports:
  - {{name: bottom, group: z_min}}
"""
SWEEP = ["--vary", "tissue.materials.*.young=5..10kPa:2", "--vary", "time.frame_rate=25,50", "--frames", "2"]


@pytest.fixture
def folder(root, tmp_path):
    (tmp_path / "scenes").mkdir()
    for name in ("a", "b"):
        (tmp_path / "scenes" / f"{name}.yaml").write_text(SCENE.format(mesh=root / "meshes/block_1k.msh"))
    return tmp_path


def study(bin, *words, code=0, env=None):
    out = subprocess.run([str(bin / "tm-study"), *map(str, words)], capture_output=True, text=True, timeout=400, env=dict(os.environ, **(env or {})))
    assert out.returncode == code, out.stdout + out.stderr
    return out.stdout + out.stderr


def table(folder):
    with open(folder / "out/results.csv", newline="") as file:
        return list(csv.DictReader(file))


def test_sweep_is_one_table_and_continues(bin, folder):
    words = [folder / "scenes", "-o", folder / "out", *SWEEP, "--local"]
    assert "8 runs, 0 done before" in study(bin, *words)
    rows = table(folder)
    assert len(rows) == 8 and len({r["hash"] for r in rows}) == 4  # the two scenes have the same text
    assert [(r["tissue.materials.*.young"], r["time.frame_rate"]) for r in rows[:4]] == [("5 kPa", "25"), ("5 kPa", "50"), ("10 kPa", "25"), ("10 kPa", "50")]
    assert all(r["error"] == "" and r["frames"] == "2" and len(r["state_hash"]) == 16 for r in rows)
    assert float(rows[0]["frame_s"]) == 0.04 and float(rows[0]["critical_step.guaranteed_s"]) > float(rows[2]["critical_step.guaranteed_s"])
    # Finished runs stay; lost or changed ones are repeated.
    kept = {p: p.stat().st_mtime_ns for p in (folder / "out/runs").glob("*.json")}
    lost = next(iter(kept))
    lost.unlink()
    text = (folder / "scenes/b.yaml").read_text()
    (folder / "scenes/b.yaml").write_text(text.replace("10 kPa, poisson: 0.4", "10 kPa, poisson: 0.3"))
    assert "8 runs, 3 done before" in study(bin, *words)
    assert all(p.stat().st_mtime_ns == t for p, t in kept.items() if p != lost) and lost.exists()
    assert len({r["hash"] for r in table(folder)}) == 8
    assert "8 runs, 8 done before" in study(bin, *words)


def test_slurm_gets_one_array(bin, folder):
    """A stand-in for sbatch that runs the array's tasks one after another, as Slurm calls them."""
    fake = folder / "fake"
    fake.mkdir()
    (fake / "sbatch").write_text(f"""#!/bin/bash
echo "$@" >> {folder}/asked
for word in "$@"; do case $word in --array=*) array=${{word#--array=}};; esac; done
for span in ${{array//,/ }}; do for i in $(seq ${{span%-*}} ${{span#*-}}); do SLURM_ARRAY_TASK_ID=$i sh "${{@: -1}}"; done; done
""")
    (fake / "sbatch").chmod(0o755)
    said = study(bin, folder / "scenes/a.yaml", "-o", folder / "out", *SWEEP, "--sbatch=--partition=long", env={"PATH": f"{fake}:{os.environ['PATH']}"})
    assert "Slurm" in said and all(r["error"] == "" and r["frames"] == "2" for r in table(folder))
    asked = (folder / "asked").read_text().split()
    assert "--array=0-3" in asked and "--wait" in asked and "--partition=long" in asked


@pytest.mark.parametrize("words, said", [
    (["--vary", "tissue.materials.*.yuong=3..9kPa:4"], "tissue.materials.*.yuong"),
    (["--vary", "time.frame_rate=20..30"], "20..30:4"),
    (["--vary", "time.frame_rate"], "no values"),
    (["--vary", "time.frame_rate=20,,30"], "a value is empty"),
    (["--vary", "time.frame_rate=20", "--vary", "time.frame_rate=30"], "varied twice"),
    (["--jobs", "0"], "--jobs 0"),
])
def test_bad_words(bin, folder, words, said):
    assert said in study(bin, folder / "scenes/a.yaml", "-o", folder / "out", *words, "--local", code=2)
    assert not (folder / "out").exists()


def test_a_bad_key_is_told_with_its_line_and_a_failed_run_with_its_row(bin, folder):
    with open(folder / "scenes/b.yaml", "a") as file:
        file.write("tempo: {}\n")
    said = study(bin, folder / "scenes", "-o", folder / "out", *SWEEP, "--local", code=2)
    assert "b.yaml:8: " in said and not (folder / "out").exists()
    # Valid, but it cannot finish: its output's disk is full.
    os.unlink(folder / "scenes/b.yaml")
    said = study(bin, folder / "scenes", "-o", folder / "out", "--set", "recording.file=/dev/full", "--frames", "3", "--local", code=1)
    assert table(folder)[0]["error"] in said and table(folder)[0]["error"]
