"""examples/engine: the library in an engine's loop, with the engine's memory and jobs. Bit-identical for any number of workers; a frame allocates
nothing; all memory is freed."""
import re
import subprocess

import pytest


@pytest.mark.parametrize("sanitizer", [[], ["-fsanitize=address,undefined"]], ids=["plain", "sanitized"])
def test_engine_example_runs_with_its_own_memory_and_jobs(root, build, tmp_path, sanitizer):
    program = tmp_path / "engine"
    subprocess.run(["gcc", "-std=c11", "-Wall", "-Wextra", "-Werror", "-O2", *sanitizer, f"-I{root}/libtensormass/include", f"-I{root}/libtensormass/io/include", root / "examples/engine/engine.c",
                    build / "lib/libtensormass_io.a", build / "lib/libtensormass.a", "-lpthread", "-lm", "-o", program], check=True, timeout=400)

    def engine(mesh, workers, code=0):
        run = subprocess.run([program, mesh, str(workers)], capture_output=True, text=True, timeout=400)
        assert run.returncode == code, run.stderr  # 0 only if everything was returned to the arena
        return run.stdout + run.stderr
    alone, three = (engine(root / "meshes/liver_1k.msh", workers) for workers in (1, 3))
    assert alone == three == engine(root / "meshes/liver_1k.msh", 4)  # four: each step is divided among them
    felt = [float(f) for f in re.findall(r"at most ([0-9.]+) N, \d{3} triangles", alone)]
    assert len(felt) == 3 and 0.1 < felt[0] < felt[1] < felt[2] < 10
    assert re.search(r"nowhere.msh: cannot open: ", engine("nowhere.msh", 2, code=1))
    assert "usage: " in engine("nowhere.msh", 0, code=2)
