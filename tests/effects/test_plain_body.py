"""A body that names no effect costs its tetrahedra and nothing more beside a body that does: bytes, and instructions counted by callgrind."""
import functools
import re
import shutil
import subprocess

import pytest

ROTATION, SMOOTHING, VISCOSITY = 1, 2, 4


@pytest.fixture(scope="module")
def program(build):
    return build / "tests" / "effects" / "body_effects"


@functools.cache
def counted(program, folder, mode, effects):
    """Returns bytes, and the instructions of ten substeps."""
    size = int(subprocess.run([program, mode, str(effects), "0"], capture_output=True, text=True, check=True).stdout)
    run = subprocess.run(["valgrind", "--tool=callgrind", f"--callgrind-out-file={folder}/{mode}-{effects}", "--toggle-collect=tm_world_step", program, mode,
                          str(effects), "1"], capture_output=True, text=True, timeout=600, check=True)
    return size, int(re.search(r"Collected : (\d+)", run.stderr)[1])


@pytest.mark.parametrize("effects", [ROTATION, SMOOTHING, VISCOSITY, ROTATION + VISCOSITY], ids=["rotation", "smoothing", "viscosity", "both"])
def test_body_without_effects_costs_its_tetrahedra(program, tmp_path_factory, effects):
    if not shutil.which("valgrind"):
        pytest.skip("valgrind is not installed; tools/setup.sh check")
    folder = tmp_path_factory.getbasetemp()
    (size, cost), (all_size, all_cost) = (counted(program, folder, mode, effects) for mode in ("with", "both"))
    its_size, its_cost = counted(program, folder, "without", 0)
    print(f"with effects {size} bytes, {cost} instructions; without {its_size}, {its_cost}; together {all_size}, {all_cost}")
    assert its_cost > 2e6 and cost > its_cost
    assert all_size <= 1.002 * (size + its_size)
    assert all_cost <= 1.002 * (cost + its_cost)
