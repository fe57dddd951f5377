"""A body that names no effect costs its tetrahedra and nothing more beside a body that does: bytes, and instructions counted by callgrind."""
import re
import shutil
import subprocess

import pytest

ROTATION, SMOOTHING, VISCOSITY = 1, 2, 4


@pytest.fixture(scope="module")
def program(build):
    return build / "tests" / "effects" / "body_effects"


def counted(program, tmp_path, mode, effects):
    """Returns bytes, and the instructions of a frame."""
    size = int(subprocess.run([program, mode, str(effects), "0"], capture_output=True, text=True, check=True).stdout)
    run = subprocess.run(["valgrind", "--tool=callgrind", f"--callgrind-out-file={tmp_path}/out", "--toggle-collect=tm_world_step", program, mode,
                          str(effects), "1"], capture_output=True, text=True, timeout=600, check=True)
    return size, int(re.search(r"Collected : (\d+)", run.stderr)[1])


@pytest.mark.parametrize("effects", [ROTATION, SMOOTHING, VISCOSITY, ROTATION + VISCOSITY], ids=["rotation", "smoothing", "viscosity", "both"])
def test_body_without_effects_costs_its_tetrahedra(program, tmp_path, effects):
    if not shutil.which("valgrind"):
        pytest.skip("valgrind is not installed; tools/setup.sh check")
    (size, cost), (its_size, its_cost), (all_size, all_cost) = (counted(program, tmp_path, mode, effects) for mode in ("with", "without", "both"))
    print(f"with effects {size} bytes, {cost} instructions; without {its_size}, {its_cost}; together {all_size}, {all_cost}")
    assert its_cost > 1e7 and cost > its_cost
    assert all_size <= 1.002 * (size + its_size)
    assert all_cost <= 1.002 * (cost + its_cost)
