"""The step of an isotropic, undamped, gravity-free scene calls no function of other effects and costs as much as force and integration. Effects that
were added and removed leave neither instructions nor bytes. Counted by callgrind."""
import re
import shutil
import subprocess

import pytest

# Functions of a plain step; static helpers may or may not be inlined.
ALLOWED = re.compile(r"^(tm_world_step|substep|rotate|are_bounded|check_all|check_range|flush_denormals|all_parts|run_part|tm_partitions_\w+|tm_max_increment_m|tm_vertex_is_bounded|tm_stage_force|tm_stage_integrate|tm_stage_integrate_freeze_removed|tm_world_changes_few|tm_world_few_are_bounded|tm_force_pass|tm_tissue_force|tm_force_plain_double|halo_plain_double"
                     r"|_*mem(cpy|set|move).*|0x.*|main|__libc_start.*|\(below main\))$")  # the last three only call it


def callgrind(program, tmp_path, mode, frames, *options):
    """Returns the instructions of each function itself, and the program's output."""
    if not shutil.which("valgrind"):
        pytest.skip("valgrind is not installed; tools/setup.sh check")
    out = tmp_path / f"{mode}-{frames}"
    run = subprocess.run(["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", *options, program, mode, str(frames)],
                         capture_output=True, text=True, timeout=900)
    assert run.returncode == 0, run.stderr[-3000:]
    names, cost, current, of_a_call = {}, {}, None, False
    for line in out.read_text().splitlines():
        if match := re.match(r"c?fn=\((\d+)\)(?: (.*))?$", line):
            if match[2]:
                names[match[1]] = match[2].split("'")[0]
            if line.startswith("fn="):
                current = names[match[1]]
                cost.setdefault(current, 0)
        elif line.startswith("calls="):
            of_a_call = True
        elif current and (match := re.match(r"[+*-]?\d* (\d+)$", line)):
            if not of_a_call:
                cost[current] += int(match[1])
            of_a_call = False
    return cost, run.stdout.strip()


@pytest.fixture(scope="module")
def program(build):
    return build / "tests" / "effects" / "plain_step"


def ten_frames(program, tmp_path, mode, *options):
    """Returns the instructions of ten frames: the difference of two runs, without set-up."""
    few, many = (callgrind(program, tmp_path, mode, frames, *options) for frames in (2, 12))
    return {name: many[0][name] - few[0].get(name, 0) for name in many[0]}, many[1]


def test_plain_step_calls_no_other_effect(program, tmp_path):
    cost, _ = callgrind(program, tmp_path, "library", 3, "--toggle-collect=tm_world_step")
    assert sum(cost.values()) > 1e6
    assert {"tm_world_step", "tm_force_plain_double"} <= cost.keys()
    assert not [name for name in cost if not ALLOWED.match(name)]


def test_plain_step_costs_within_half_a_percent_of_handwritten_code(program, tmp_path):
    library = sum(ten_frames(program, tmp_path, "library")[0].values())
    driver = sum(ten_frames(program, tmp_path, "driver")[0].values())
    print(f"{library} instructions by the library, {driver} by hand: {100 * (library / driver - 1):.3f} % more")
    assert driver > 1e7
    assert library <= 1.005 * driver


def test_effects_come_and_go_without_a_trace(program, tmp_path):
    step = "--toggle-collect=tm_world_step"
    library, _ = ten_frames(program, tmp_path, "library", step)
    returned, left = ten_frames(program, tmp_path, "returned", step)
    assert int(left.splitlines()[0]) == 0
    # memcpy selects its variant by address
    plain = {name: cost for name, cost in library.items() if "mem" not in name and cost}
    assert sum(plain.values()) > 1e7
    assert plain == {name: cost for name, cost in returned.items() if "mem" not in name and cost}


def test_scene_without_touch_and_ties_pays_nothing_for_them(program, tmp_path):
    """Contact, cutting and the energy account, which read the rows of touch and ties, run the same instructions after both were added and removed,
    and call none of their functions."""
    step = "--toggle-collect=tm_world_step"
    without, _ = ten_frames(program, tmp_path, "pressed", step)
    untouched, left = ten_frames(program, tmp_path, "untouched", step)
    assert int(left.splitlines()[0]) == 0
    plain = {name: cost for name, cost in without.items() if "mem" not in name and cost}
    assert sum(plain.values()) > 1e7 and {"sweep_own", "find_tool_rows"} <= plain.keys(), sorted(plain)
    assert plain == {name: cost for name, cost in untouched.items() if "mem" not in name and cost}
    assert not [name for name in plain if re.search("touch|tie", name)], sorted(plain)
