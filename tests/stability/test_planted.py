"""Planted faults: each known fault, written into a copy of the sources, must fail the named tests."""
import os
import re
import shutil
import subprocess

import pytest
from paths import BUILD, ROOT

H_MIN_OVER_C = """*step_s = HUGE_VAL;
    for (int32_t t = 0; t < tissue->mesh->tet_count; t++) {
        const tm_material *m = tm_tissue_tet_material(tissue, t);
        *step_s = fmin(*step_s, tm_mesh_tet_quality(tissue->mesh, t).min_altitude_m / sqrt((m->lambda_Pa + 2 * m->mu_Pa) / m->density_kg_m3));
    }"""
ONE_SIGN = """    for (int32_t i = 0; i < edges && i < 1 && tissue->precision == TM_DOUBLE; i++)
        if (tissue->edge_index[edge[0]] >= 0) ((double *)tissue->graph.edge_tensor)[9 * (int64_t)tissue->edge_index[edge[0]]] *= -1;
"""
REPAIR_EDGES = "    for (int32_t i = 0; !tissue->smoothed && i < edges; i++) tm_tissue_assemble_edge(tissue, edge[i]);\n"
RATIO = "vdot(m->moved_m, m->step_m) / guarded_square(m->params, m->step_m)"
POSITION = f"    vadd(force, capped_ratio(m, {RATIO}), m->change_N);\n"
# fault: (file, code that occurs there once, the faulty code, test program, test in it that must fail)
FAULTS = {
    "one block's sign on removal": ("libtensormass/src/tissue/assemble.c", REPAIR_EDGES, REPAIR_EDGES + ONE_SIGN, "physics/test_cut", "cuts_in_twenty_orders_equal_a_fresh_build"),
    "the unsigned ratio of `position`, which may pull": ("haptic_rt/core/extrapolate.c", POSITION + "    only_push(x, true, force);\n",
                                                         POSITION.replace(RATIO, RATIO.replace("vdot(m->moved_m, m->step_m)", "fabsf(vdot(m->moved_m, m->step_m))")),
                                                         "loop/test_extrapolate", "force_after_a_reversal_is_that_of_the_earlier_place"),
    "the sign of gamma": ("libtensormass/src/world/stage_integrate.c", "world->damped ? world->tissue->damping_kg_s[v]", "world->damped ? -world->tissue->damping_kg_s[v]",
                          "physics/test_motion", "free_vertex_follows_the_closed_form"),
    "eq. 12's factor": ("libtensormass/src/material/material.c", "lambda = m->lambda_Pa * volume_m3, mu = m->mu_Pa * volume_m3,", "lambda = 2 * m->lambda_Pa * volume_m3, mu = 2 * m->mu_Pa * volume_m3,",
                        "physics/test_oracle", "isotropic_law_agrees_with_reference"),
    "contact of tissue that pushes one side": ("libtensormass/src/touch/touch_solve.c", "u_next[3 * t->row[i].vertex[j] + c] += t->solver", "if (j > 0) u_next[3 * t->row[i].vertex[j] + c] += t->solver", "cut/test_touch",
                                               "colliding_blocks_keep_their_momentum"),
    "contact of tissue that keeps its force when tools lose theirs": ("libtensormass/src/touch/touch_passivity.c", "if (!(account_J(t) > may)) return k > 0;", "if (!(account_J(t) > may + 1)) return k > 0;",
                                                                      "cut/test_touch_sessions", "random_sessions_on_two_bodies_stay_within_bounds"),
    "folds that push at rest": ("libtensormass/src/touch/touch_pairs.c", "same_body ? 0.5 * rest_m : rest_m", "same_body ? 2 * rest_m : rest_m", "cut/test_touch_rows", "rows_are_those_of_a_slow_reference"),
    "h_min/c as the step": ("libtensormass/src/tissue/critical_step.c", "*step_s = worst < 0 ? HUGE_VAL : step_of(tissue, most);", H_MIN_OVER_C, "physics/test_tissue", "critical_steps_name_the_element_that_sets_them"),
}
# One session that fails suffices: the others take half a minute.
SETTINGS = {"contact of tissue that keeps its force when tools lose theirs": {"TM_SESSIONS_FROM": "1000", "TM_SESSIONS": "1"}}
SOURCES = ("libtensormass", "contact_law", "haptic_rt", "apps", "lcm_types", "tests", "tools", "meshes")


def plant(copy, file, sound, fault):
    """A copy of the sources with one fault, and the objects of the faultless build: file times are kept, so that only the fault is compiled."""
    copy.mkdir()
    for folder in SOURCES:
        shutil.copytree(ROOT / folder, copy / folder, ignore=shutil.ignore_patterns("__pycache__", "*.msh", "*.json"))
    shutil.copy2(ROOT / "Makefile", copy)
    for folder in ("obj", "gen", "lib"):
        shutil.copytree(BUILD / folder, copy / "build" / folder, symlinks=True)
    text = (copy / file).read_text()
    (copy / file).write_text(text.replace(sound, fault))


@pytest.mark.parametrize("fault", FAULTS)
def test_sound_code_occurs_once(fault):
    file, sound = FAULTS[fault][:2]
    held = (ROOT / file).read_text().count(sound)
    assert held == 1, f"{file} holds {held} times, not once: {sound}"


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_is_caught(fault, once):
    file, sound, wrong, program, name = FAULTS[fault]

    def build(folder):
        copy = folder / "sources"
        plant(copy, file, sound, wrong)
        run = subprocess.run(["make", "--no-print-directory", "config=release", "BUILD=build", f"VENV={BUILD / 'venv'}", "CASES=tests/sanitize/cases.c", f"build/tests/{program}"], cwd=copy,
                             capture_output=True, text=True, timeout=600)
        assert run.returncode == 0, run.stdout + run.stderr
        assert run.stdout.count("  CC ") < 10, "more was compiled than the fault: " + run.stdout

    folder = once("planted-" + name, build)
    others = set(re.findall(r"cmocka_unit_test\w*\((\w+)", (ROOT / f"tests/{program}.c").read_text())) - {name}
    env = dict(os.environ, TM_ROOT=str(ROOT), TM_OUT=str(BUILD), TM_LEAVE_OUT=",".join(others), **SETTINGS.get(fault, {}))
    run = subprocess.run([folder / "sources/build/tests" / program], cwd=ROOT, env=env, capture_output=True, text=True, timeout=600)
    assert run.returncode not in (0, 77), f"{program} did not notice: {fault}"
    failed = {line.split("]", 1)[1].split()[0] for line in (run.stdout + run.stderr).splitlines() if line.startswith("[  FAILED  ]") and "test(s)" not in line}
    assert name in failed, failed
