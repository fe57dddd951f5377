"""tm-precompute as a user runs it: alone, over ranks, killed; and tm-sim with the three models by one line."""
import json
import os
import re
import resource
import shutil
import signal
import struct
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

SCENE = """\
tissue:
  mesh: {mesh}
  materials:
    tissue: {{young: 8 kPa, poisson: 0.4, density: 1000 kg/m3}}
model: {model}
damping: {{rate: 60 /s}}
gravity:
hybrid: {{box: {{min: [-1 m, -1 m, {z}], max: [1 m, 1 m, 1 m]}}}}
contact:
supports:
  - {{name: bottom, group: z_min}}
instruments:
  - mode: probe
    trocar: [50 mm, 50 mm, 250 mm]
    axis: [0, 0, -1]
    up: [0, 1, 0]
hand:
  - instrument: 0
    path:
      - {{time: 0 s, tip: [{x}, {y}, {top}]}}
      - {{time: 0.6 s, tip: [{x}, {y}, {deep}]}}
time: {{frame_rate: 25 Hz, duration: 2.4 s}}
"""


@pytest.fixture
def place(tmp_path):
    env = dict(os.environ, TM_CACHE_DIR=str(tmp_path / "cache"))
    return tmp_path, env


def run(command, env, code=0, timeout=400):
    done = subprocess.run([str(c) for c in command], env=env, capture_output=True, text=True, timeout=timeout)
    assert done.returncode == code, done.stdout + done.stderr
    return done


def block(root, bin, env):
    """Bounding box of the block mesh."""
    text = run([bin / "tm-mesh", "info", root / "meshes/block_1k.msh"], env).stdout
    low, high = re.search(r"box: ([-\d. e]+) to ([-\d. e]+) m", text).groups()
    return [float(x) for x in low.split()], [float(x) for x in high.split()]


def write_scene(folder, root, bin, env, mesh="block_1k", model="precomputed"):
    low, high = block(root, bin, env)
    path = folder / f"{model}-{mesh}.yaml"
    path.write_text(SCENE.format(mesh=root / f"meshes/{mesh}.msh", model=model, x=0.53 * (low[0] + high[0]), y=0.52 * (low[1] + high[1]),
                                 top=high[2] + 0.01, deep=high[2] + 0.0025 - 0.004, z=low[2] + 0.55 * (high[2] - low[2])))
    return path


def mpirun(bin, ranks):
    program = bin / "tm-precompute-mpi"
    if not program.exists() or not shutil.which("mpirun"):
        pytest.skip("no Open MPI: mpicc and mpirun (libopenmpi-dev, openmpi-bin)")
    return ["mpirun", "--allow-run-as-root", "--oversubscribe", "-n", ranks, program]


def test_ranks_write_the_same_file(bin, root, place):
    folder, env = place
    scene = write_scene(folder, root, bin, env)
    run([bin / "tm-precompute", scene, "--out", folder / "one.tms", "--json", folder / "one.json"], env)
    one = (folder / "one.tms").read_bytes()
    assert json.loads((folder / "one.json").read_text())["responses_bytes"] == len(one)
    for ranks in (2, 4):
        run([*mpirun(bin, ranks), scene, "--out", folder / "many.tms", "--threads", 1], env)
        assert (folder / "many.tms").read_bytes() == one
        (folder / "many.tms").unlink()


def head(path):
    """kept vertices, interface, precision, block, offset of the columns, bytes"""
    return struct.unpack_from("<iiiiqq", path.open("rb").read(64), 24)


def blocks(part):
    return -(-head(part)[0] // 64)


def blocks_done(part):
    """Returns how many checksums of a partial file, behind its end, are present."""
    try:
        kept = head(part)[0]
        data = part.open("rb").read()
    except (OSError, struct.error):
        return 0
    return sum(s != 0 for s in struct.unpack(f"<{-(-kept // 64)}Q", data[-8 * -(-kept // 64):])) if kept else 0


def responses(path):
    """Returns the columns of a response file, located by its header."""
    data = path.read_bytes()
    kept, interface, precision, _, column, size = struct.unpack_from("<iiiiqq", data, 24)
    assert size == len(data) and precision == 0
    return np.frombuffer(data, "<f8", offset=column).reshape(kept + interface, kept)


def test_ranks_share_one_factor(bin, root, place):
    """Each rank has a part of the factor; together they give the same as one, within rounding, in a file that tm-sim accepts."""
    folder, env = place
    job = mpirun(bin, 1)
    if run([job[-1], "--help"], env) and "libdmumps" not in run(["ldd", job[-1]], env).stdout:
        pytest.skip("built without MUMPS (libmumps-dev)")
    scene = write_scene(folder, root, bin, env)
    run([bin / "tm-precompute", scene, "--out", folder / "one.tms", "--json", folder / "one.json"], env)
    one, whole = responses(folder / "one.tms"), json.loads((folder / "one.json").read_text())["ranks"][0]["factor_bytes"]
    for ranks in (1, 3):
        said = run([*mpirun(bin, ranks), scene, "--factor", "distributed", "--threads", 1, "--json", folder / "many.json"], env).stdout
        made = re.search(r"(\S+\.tms): ", said).group(1)
        many = json.loads((folder / "many.json").read_text())["ranks"]
        assert len(many) == ranks and max(r["factor_bytes"] for r in many) < (1.2 if ranks == 1 else 0.7) * whole
        assert all(r["peak_bytes"] > r["factor_bytes"] > 0 for r in many)
        assert abs(responses(Path(made)) - one).max() < 1e-12 * abs(one).max()
    assert "computed" not in run([bin / "tm-sim", "--lockstep", scene, "--frames", 2], env).stderr
    loose = run([*mpirun(bin, 2), scene, "--factor", "distributed", "--set", "supports=[]", "--out", folder / "x.tms"], env, code=2, timeout=300)
    assert "support" in loose.stderr and not (folder / "x.tms").exists()
    for wrong, words in ((["--factor", "both"], "each or distributed"), (["--factor", "distributed", "--solver", "cg"], "no factor to distribute")):
        assert words in run([*mpirun(bin, 2), scene, *wrong, "--out", folder / "x.tms"], env, code=2).stderr
    assert "without MUMPS or without ranks" in run([bin / "tm-precompute", scene, "--factor", "distributed"], env, code=2).stderr


def descendants(pid):
    children = []
    for entry in os.listdir("/proc"):
        if entry.isdigit():
            try:
                fields = open(f"/proc/{entry}/stat").read().rsplit(")", 1)[1].split()
            except OSError:
                continue
            if int(fields[1]) == pid:
                children += [int(entry), *descendants(int(entry))]
    return children


def test_a_rank_that_dies_leaves_the_old_file(bin, root, place):
    folder, env = place
    scene = write_scene(folder, root, bin, env, mesh="block_10k")
    out = folder / "out.tms"
    out.write_bytes(b"the old file")
    job = subprocess.Popen([str(c) for c in [*mpirun(bin, 2), scene, "--out", out, "--threads", 1]], env=env,
                           stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    part, end, victim = folder / "out.tms.part", time.time() + 60, None
    while time.time() < end and not victim:
        if part.exists() and job.poll() is None:
            for pid in descendants(job.pid):
                try:
                    if b"OMPI_COMM_WORLD_RANK=1\0" in open(f"/proc/{pid}/environ", "rb").read() + b"\0":
                        victim = pid
                except OSError:
                    pass
        time.sleep(0.01)
    assert victim, "rank 1 was never seen at work"
    os.kill(victim, signal.SIGKILL)
    assert job.wait(timeout=300) != 0
    assert out.read_bytes() == b"the old file"
    # a partial file does not obstruct another scene's run
    run([bin / "tm-precompute", write_scene(folder, root, bin, env), "--out", out], env)
    assert out.read_bytes().startswith(b"TMRESP")
    assert not part.exists()


def test_killed_run_is_continued(bin, root, place):
    """Any number of ranks gives the same bits; a block damaged meanwhile is solved again."""
    folder, env = place
    scene, out = write_scene(folder, root, bin, env, mesh="block_10k"), folder / "out.tms"
    part = folder / "out.tms.part"
    for _ in range(5):  # repeated until it is caught in the middle: on a busy machine it may already have finished
        out.unlink(missing_ok=True)
        job = subprocess.Popen([str(c) for c in [bin / "tm-precompute", scene, "--out", out, "--threads", 1]], env=env, stdout=subprocess.DEVNULL,
                               stderr=subprocess.DEVNULL)
        while job.poll() is None and blocks_done(part) < 6:
            time.sleep(0.002)
        job.kill()
        if job.wait() == -signal.SIGKILL and part.exists() and blocks_done(part) < blocks(part):
            break
    done = blocks_done(part)
    assert not out.exists() and 6 <= done < blocks(part)
    with part.open("r+b") as file:  # one byte of the first block
        file.seek(head(part)[4] + 1000)
        byte = file.read(1)[0]
        file.seek(-1, os.SEEK_CUR)
        file.write(bytes([byte ^ 1]))
    many = shutil.which("mpirun") and (bin / "tm-precompute-mpi").exists()
    run([*(mpirun(bin, 2) if many else [bin / "tm-precompute"]), scene, "--out", out, "--threads", 1, "--json", folder / "rest.json"], env)
    assert json.loads((folder / "rest.json").read_text())["columns_found"] == 64 * (done - 1)
    run([bin / "tm-precompute", scene, "--out", folder / "whole.tms", "--json", folder / "whole.json"], env)
    assert json.loads((folder / "whole.json").read_text())["columns_found"] == 0
    assert out.read_bytes() == (folder / "whole.tms").read_bytes() and not part.exists()


def test_precomputed_file_is_found(bin, root, place):
    folder, env = place
    scene = write_scene(folder, root, bin, env)
    run([bin / "tm-precompute", scene], env)
    first = run([bin / "tm-sim", "--lockstep", scene], env)
    assert "computed" not in first.stderr
    other = run([bin / "tm-sim", "--lockstep", scene, "--set", "tissue.scale=0.9"], env)
    assert "the precomputed model computed in" in other.stderr
    for solver in ("cholesky", "cg"):
        told = run([bin / "tm-precompute", scene, "--solver", solver, "--keep"], env).stdout
        assert ("already there" in told) == (solver == "cholesky")


def test_bad_input(bin, root, place):
    folder, env = place
    scene = write_scene(folder, root, bin, env)
    for arguments, text in (
        ([], "scene is missing"), ([scene, "--solver", "qr"], "cholesky"), ([scene, "--threads", "none"], "whole number"),
        ([scene, "--memory", 1, "--out", folder / "x.tms"], "too large"), ([scene, "--out", folder / "absent/x.tms"], "absent/x.tms"),
        ([scene, "--set", "supports=[]", "--out", folder / "x.tms"], "support"), ([folder / "no.yaml"], "no.yaml"), ([scene, "--what"], "--what"),
    ):
        done = subprocess.run([str(c) for c in [bin / "tm-precompute", *arguments]], env=env, capture_output=True, text=True, timeout=300)
        assert done.returncode in (1, 2), (arguments, done.stdout, done.stderr)
        assert text in done.stderr, (arguments, done.stderr)
        assert not (folder / "x.tms").exists()
    assert "tm-precompute SCENE.yaml" in run([bin / "tm-precompute", "--help"], env).stdout


@pytest.mark.plain
def test_a_limit_on_memory_is_told_not_hung_on(bin, root, place):
    """OpenBLAS asks indefinitely where it can map nothing: every limit ends in a model or in a message about the limit."""
    folder, env = place
    scene = write_scene(folder, root, bin, env)
    ends = set()
    for program in ([bin / "tm-sim", "--lockstep", scene], [bin / "tm-precompute", scene, "--out", folder / "x.tms"]):
        for megabytes in (100, 250, 350, 450, 550, 100000):
            limit = [megabytes * 1000000] * 2
            for kept in (folder / "cache").glob("*.tms"):
                kept.unlink()
            done = subprocess.run([str(c) for c in program], env=env, capture_output=True, text=True, timeout=300,
                                  preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, limit))
            ends.add(done.returncode == 0)
            assert done.returncode == 0 or "ulimit -v" in done.stderr, (megabytes, done.stdout, done.stderr)
    assert ends == {True, False}


def test_several_users_of_one_cache(bin, root, place):
    """One computes; the others wait for it and use its file."""
    folder, env = place
    scene = write_scene(folder, root, bin, env)
    users = [subprocess.Popen([str(c) for c in [bin / "tm-sim", "--lockstep", scene, "--frames", 2]], env=env, stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE, text=True) for _ in range(4)]
    said = [user.communicate(timeout=400) for user in users]
    assert [user.returncode for user in users] == [0] * 4, said
    assert sum("computed in" in err for _, err in said) == 1, said


def last_force(path):
    rows = [line.split(",") for line in path.read_text().splitlines()]
    at = [rows[0].index(name) for name in ("fx_N", "fy_N", "fz_N")]
    return [float(rows[-1][i]) for i in at]


def test_three_models_by_one_line(bin, root, place):
    """Pressed and held, the three models have the same reaction."""
    folder, env = place
    force = {}
    for model in ("dynamic", "precomputed", "hybrid"):
        scene = write_scene(folder, root, bin, env, model=model)
        run([bin / "tm-sim", "--lockstep", scene, "--samples", folder / f"{model}.csv"], env)
        force[model] = last_force(folder / f"{model}.csv")
    size = max(abs(f) for f in force["precomputed"])
    assert size > 0.02
    for model in ("dynamic", "hybrid"):
        assert max(abs(a - b) for a, b in zip(force[model], force["precomputed"])) < 1e-5 * size, force


def test_a_grasper_holds_the_same_in_the_precomputed_model(bin, root, place):
    folder, env = place
    force = {}
    for model in ("dynamic", "precomputed"):
        scene = write_scene(folder, root, bin, env, model=model)
        text = scene.read_text().replace("contact:\n", "contact:\ngrasp:\n").replace("mode: probe", "mode: grasper")
        head, path = text.split("path:\n")
        at = re.search(r"0.6 s, tip: \[([^]]*)\]", path).group(1)
        up = ", ".join([*at.split(", ")[:2], str(float(at.split(", ")[2]) + 0.008)])
        path = path.replace("time: {", f"      - {{time: 0.8 s, tip: [{at}], grip: 1}}\n      - {{time: 1.4 s, tip: [{up}], grip: 1}}\ntime: {{")
        scene.write_text(head + "path:\n" + path.replace("2.4 s", "3 s"))
        run([bin / "tm-sim", "--lockstep", scene, "--samples", folder / f"{model}.csv"], env)
        force[model] = last_force(folder / f"{model}.csv")
    assert force["precomputed"][2] < -0.1, force  # the tissue pulls the tool down
    assert max(abs(a - b) for a, b in zip(force["dynamic"], force["precomputed"])) < 1e-4 * -force["precomputed"][2], force


def test_three_models_settle_alike(bin, root, place):
    folder, env = place
    rest = {}
    for model in ("dynamic", "precomputed", "hybrid"):
        scene = write_scene(folder, root, bin, env, model=model)
        said = run([bin / "tm-sim", "--settle", "1e-11", scene, "--json", folder / "rest.json"], env).stdout
        assert ("direct solver" in said) == (model != "dynamic"), said
        rest[model] = json.loads((folder / "rest.json").read_text())["largest_displacement_m"]
    assert rest["dynamic"] > 0 and all(abs(r / rest["dynamic"] - 1) < 1e-6 for r in rest.values()), rest
