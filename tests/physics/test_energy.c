/* Energy account: closes to rounding in all cases, attributes every source and sink, and costs nothing unless
 * requested. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "contact_scene.h"

static tm_energy account(const scene *s) {
    tm_energy e;
    assert_int_equal(tm_world_energy(s->world, &e, NULL), TM_OK);
    return e;
}

/* Sum of all absolute contributions: the scale for rounding. */
static double throughput(const tm_energy *e) {
    double sum = e->start_J + fabs(e->support_J) + fabs(e->gravity_J) + fabs(e->load_J) + fabs(e->state_change_J) +
                 e->damping_J + fabs(e->cut_J);
    for (int t = 0; t < TM_MAX_INSTRUMENTS; t++) sum += fabs(e->contact_J[t]) + fabs(e->grasp_J[t]);
    return sum;
}

static scene open_scene(double damping_1_s, bool cuttable, int tools) {
    scene_def d = scene_def_default();
    d.cells[0] = d.cells[1] = 6, d.cells[2] = 4;
    d.damping_1_s = damping_1_s;
    d.tools = tools;
    memcpy(d.tip_m, (double[2][3]){{0.008, 0.004, 0.0447}, {-0.012, 0.004, 0.0447}}, sizeof d.tip_m);
    scene s = scene_create_full(&d, cuttable, (tm_tool_mode[2]){TM_TOOL_GRASPER, TM_TOOL_PROBE});
    tm_error error;
    scene_must(tm_stage_energy(s.world, &error), &error);
    return s;
}

static void shake(scene *s, double speed_m_s) {
    tm_state *state = tm_world_state(s->world);
    uint8_t *held = calloc(3 * (size_t)s->mesh->vertex_count, 1);
    tm_support_mask(s->world, held);
    for (int32_t i = 0; i < 3 * s->mesh->vertex_count; i++)
        state->u_prev_m[i] = state->u_m[i] - (held[i] ? 0 : speed_m_s * state->dt_s * (2 * scene_random() - 1));
    free(held);
}

static void assert_closed(const char *what, const scene *s) {
    const tm_energy e = account(s);
    print_message("%-22s stored %.3e J, lost %.3e J, residual %.1e of %.3e J\n", what, e.kinetic_J + e.elastic_J,
                  e.damping_J, e.residual_J, throughput(&e));
    assert_true(throughput(&e) > 1e-7);
    assert_true(fabs(e.residual_J) < 1e-11 * throughput(&e));
}

/* Undamped and damped oscillations: only damping removes energy, and the account states how much. */
static void test_account_of_oscillations_closes(void **unused) {
    (void)unused;
    for (int damping = 0; damping <= 200; damping += 100) {
        scene s = open_scene(damping, false, 1);
        shake(&s, 0.1);
        for (int i = 0; i < 50; i++) assert_int_equal(tm_world_step(s.world, 100), TM_OK);
        assert_closed(damping ? "damped" : "undamped", &s);
        const tm_energy e = account(&s);
        assert_true(damping ? e.damping_J > 0.9 * e.start_J : e.damping_J == 0);
        assert_true(fabs(e.state_change_J) < 1e-11 * e.start_J && e.support_J == 0 && e.gravity_J == 0 &&
                    e.load_J == 0);
        assert_true(e.tool_work_J[0] == 0 && e.contact_J[0] == 0 && e.generated_J == 0);
        scene_destroy(&s);
    }
}

/* Gravity, a load, a moving support: their works by quadrature of the same run, and at rest by the static
 * solution's. */
static void test_each_source_is_attributed(void **unused) {
    (void)unused;
    scene s = open_scene(60, false, 1);
    tm_error error;
    double *load = calloc(3 * (size_t)s.mesh->vertex_count, sizeof *load);
    load[3 * (s.mesh->vertex_count - 1)] = 0.02;
    scene_must(tm_stage_gravity(s.world, (double[3]){0.5, 0, -9.81}, &error), &error);
    scene_must(tm_stage_load(s.world, load, &error), &error);
    for (int i = 0; i < 400; i++) assert_int_equal(tm_world_step(s.world, 100), TM_OK);
    assert_closed("weight and a load", &s);
    tm_energy e = account(&s);
    const tm_state *state = tm_world_state(s.world);
    double weight = 0;
    for (int32_t i = 0; i < 3 * s.mesh->vertex_count; i++)
        weight += (const double[]){0.5, 0, -9.81}[i % 3] * tm_tissue_mass_kg(s.tissue)[i / 3] * state->u_m[i];
    const double pulled = 0.02 * state->u_m[3 * (s.mesh->vertex_count - 1)];
    assert_true(fabs(e.gravity_J - weight) < 1e-9 * fabs(weight)); /* constant forces: force times distance */
    assert_true(fabs(e.load_J - pulled) < 1e-9 * fabs(pulled));
    assert_true(fabs(2 * e.elastic_J - weight - pulled) < 1e-6 * (weight + pulled)); /* Clapeyron's theorem */
    int32_t held = 0;
    uint8_t *mask = calloc(3 * (size_t)s.mesh->vertex_count, 1);
    tm_support_mask(s.world, mask);
    for (int32_t i = 0; i < 3 * s.mesh->vertex_count; i++) held += mask[i];
    for (int i = 0; i < 2000; i++) { /* to and fro by 3 mm, along x */
        for (int32_t k = 0; k < held; k += 3) tm_support_move(s.world, k, 0.003 * sin(0.02 * i));
        assert_int_equal(tm_world_step(s.world, 10), TM_OK);
    }
    assert_closed("a support moves", &s);
    e = account(&s);
    assert_true(e.support_J > 1e-4 && fabs(e.state_change_J) < 1e-11 * throughput(&e));
    free(mask);
    free(load);
    scene_destroy(&s);
}

static void test_account_closes_over_steps_cuts_and_states(void **unused) {
    (void)unused;
    scene s = open_scene(5, true, 1);
    tm_error error;
    shake(&s, 0.1);
    const double longest = tm_world_step_s(s.world);
    for (int i = 0; i < 60; i++) {
        scene_must(tm_world_set_step(s.world, longest * (0.5 + 0.5 * scene_random()), &error), &error);
        assert_int_equal(tm_world_step(s.world, 20), TM_OK);
    }
    assert_closed("new steps", &s);
    tm_energy e = account(&s), before = e;
    assert_true(e.state_change_J != 0 && fabs(e.state_change_J) < 0.2 * e.start_J);
    for (int i = 0; i < 20; i++) {
        int32_t tet = (int32_t)(scene_random() * s.mesh->tet_count);
        tm_cut_remove(s.tissue, &tet, 1, NULL, 0);
        assert_int_equal(tm_world_step(s.world, 20), TM_OK);
        e = account(&s);
        assert_true(e.cut_J >= before.cut_J - 1e-15);
    }
    assert_closed("cuts", &s);
    assert_true(e.cut_J > 0 && fabs(e.state_change_J - before.state_change_J) < 1e-11 * throughput(&e));
    /* All effects at once; a removed tetrahedron takes its stored energy with it. */
    int32_t *all = malloc(sizeof *all * (size_t)s.mesh->tet_count);
    for (int32_t t = 0; t < s.mesh->tet_count; t++) all[t] = t;
    const double stored = e.kinetic_J + e.elastic_J, cut = e.cut_J;
    tm_cut_remove(s.tissue, all, s.mesh->tet_count, NULL, 0);
    assert_int_equal(tm_world_step(s.world, 5), TM_OK);
    e = account(&s);
    assert_true(e.kinetic_J == 0 && e.elastic_J == 0 && fabs(e.cut_J - cut - stored) < 1e-11 * throughput(&e));
    free(all);
    scene_destroy(&s);
}

/* A probe and a grasper press and pull: the tissue's side closes to rounding, and no energy is generated between
 * hand and tissue. */
static void test_account_of_tools_closes(void **unused) {
    (void)unused;
    scene s = open_scene(60, false, 2);
    tm_error error;
    tm_grasp *grasp;
    tm_grasp_def how = tm_grasp_def_default();
    scene_must(tm_stage_grasp(s.world, s.contact, &how, &grasp, &error), &error);
    double worst = -HUGE_VAL, hands = 0;
    tm_tool_pose at[2] = {scene_pose(0.008, 0.004, 0.0445), scene_pose(-0.012, 0.004, 0.0447)};
    for (int i = 0; i < 400; i++) {
        at[0].grip = i > 40 && i < 250;
        at[0].tip_m[2] = i < 40 ? 0.0445 - 2e-5 * i : 0.0437 + 0.006 * fmin(1, fmax(0, (i - 60) / 100.0));
        at[1].tip_m[2] = 0.0447 - 0.003 * sin(0.03 * i) * sin(0.03 * i);
        const int32_t n = (int32_t)ceil(0.005 / tm_world_step_s(s.world));
        tm_contact_begin_frame(s.contact, n, n);
        for (int t = 0; t < 2; t++) tm_contact_set_target(s.contact, t, at + t, n);
        assert_int_equal(tm_world_step(s.world, n), TM_OK);
        const tm_energy e = account(&s);
        worst = fmax(worst, e.generated_J);
        hands = e.tool_work_J[0] + e.tool_work_J[1];
        if (i == 240) /* grasped and lifted slowly: the hand's work is stored in tissue and springs, or dissipated */
            assert_true(e.tool_work_J[0] > 1e-4 &&
                        fabs(e.grasp_J[0] + e.contact_stored_J - e.tool_work_J[0]) < 0.05 * e.tool_work_J[0]);
    }
    assert_closed("two hands", &s);
    const tm_energy e = account(&s);
    print_message("hands put in %.3e J; film %.1e J; made at most %.1e J\n", hands, e.drag_J, worst);
    assert_true(e.drag_J > 0 && worst < 5e-3 * hands);
    scene_destroy(&s);
}

/* Costs nothing if not requested, exact memory if requested, and a failed step restores its entries. */
static void test_costs_nothing_unless_named(void **unused) {
    (void)unused;
    scene_def d = scene_def_default();
    d.cells[0] = d.cells[1] = d.cells[2] = 3;
    scene s = scene_create(&d);
    tm_energy e;
    tm_error error;
    assert_int_equal(tm_world_energy(s.world, &e, &error), TM_ERR_ARGUMENT);
    const int64_t without = tm_memory_in_use();
    scene_must(tm_stage_energy(s.world, &error), &error);
    assert_int_equal(tm_stage_energy(s.world, &error), TM_ERR_ARGUMENT);
    shake(&s, 0.1);
    assert_int_equal(tm_world_step(s.world, 50), TM_OK);
    const tm_energy before = account(&s);
    tm_world_state(s.world)->u_m[3 * s.mesh->vertex_count - 1] = NAN;
    assert_int_equal(tm_world_step(s.world, 3), TM_ERR_UNSTABLE);
    e = account(&s);
    assert_memory_equal(&e, &before, sizeof e);
    scene_must(tm_world_remove_stage(s.world, "energy", &error), &error);
    assert_true(tm_memory_in_use() == without);
    tm_world_state(s.world)->u_m[3 * s.mesh->vertex_count - 1] = 0;
    assert_int_equal(tm_world_step(s.world, 3), TM_OK);
    scene_destroy(&s);
    assert_true(tm_memory_in_use() == 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_account_of_oscillations_closes),
        cmocka_unit_test(test_each_source_is_attributed),
        cmocka_unit_test(test_account_closes_over_steps_cuts_and_states),
        cmocka_unit_test(test_account_of_tools_closes),
        cmocka_unit_test(test_costs_nothing_unless_named),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
