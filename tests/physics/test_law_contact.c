/* Nonlinear laws under tools: a probe that slides with friction, a grasper that grasps and pulls, and a cut between
 * them, with an energy account. One law without fibres, with strain smoothing and viscosity; and one with fibres.
 * Bit-identical for any number of threads and through a snapshot. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "../long.h"
#include "contact_scene.h"

typedef struct operation {
    scene s;
    tm_friction *friction;
    tm_grasp *grasp;
} operation;

static operation open_operation(tm_law_kind law, bool effects, int32_t threads) {
    static const tm_tool_mode mode[2] = {TM_TOOL_PROBE, TM_TOOL_GRASPER};
    scene_def d = scene_def_default();
    d.cells[0] = d.cells[1] = 10, d.cells[2] = 4, d.tools = 2, d.threads = threads;
    d.law = law, d.averaged = effects;
    memcpy(d.tip_m, (double[2][3]){{0.012, 0.004, 0.0447}, {-0.012, 0.004, 0.0447}}, sizeof d.tip_m);
    operation o = {.s = scene_create_full(&d, true, mode)};
    tm_error error;
    if (effects) {
        tm_viscosity_def relaxing = tm_viscosity_def_default();
        relaxing.count = 1, relaxing.term[0] = (tm_viscosity_term){.time_s = 0.05, .shear = 0.3, .bulk = 0.1};
        scene_must(tm_stage_viscosity(o.s.world, &relaxing, &error), &error);
    }
    tm_friction_def rub = tm_friction_def_default();
    for (int t = 0; t < 2; t++) rub.instrument[t] = (tm_friction_coefficient){0.4, 0.3};
    scene_must(tm_stage_friction(o.s.world, o.s.contact, &rub, &o.friction, &error), &error);
    tm_grasp_def grasp = tm_grasp_def_default();
    scene_must(tm_stage_grasp(o.s.world, o.s.contact, &grasp, &o.grasp, &error), &error);
    scene_must(tm_stage_energy(o.s.world, &error), &error);
    return o;
}

/* Both tools press, the jaw closes, the probe moves aside and the grasper up. */
static void frame(operation *o, int k, double force_N[2][3]) {
    const double in = fmin(k / 20.0, 1), closed = fmin(fmax(k - 20, 0) / 10.0, 1), away = fmax(k - 30, 0) / 30.0;
    tm_tool_pose to[2] = {scene_pose(0.012 + 0.006 * away, 0.004, 0.0447 - 0.004 * in),
                          scene_pose(-0.012, 0.004, 0.0447 - 0.001 * in + 0.004 * away)};
    to[1].grip = closed;
    const int32_t n = (int32_t)ceil(0.002 / tm_world_step_s(o->s.world));
    tm_contact_begin_frame(o->s.contact, n, n);
    for (int t = 0; t < 2; t++) tm_contact_set_target(o->s.contact, t, to + t, n);
    assert_int_equal(tm_world_step(o->s.world, n), TM_OK);
    for (int t = 0; t < 2; t++) memcpy(force_N[t], tm_contact_reaction(o->s.contact, t).force_N, sizeof force_N[t]);
}

static void through_a_snapshot(operation *o, int k) {
    double force_N[2][3];
    tm_error error;
    const int64_t bytes = tm_snapshot_bytes(o->s.world);
    void *kept = malloc((size_t)bytes);
    scene_must(tm_snapshot_save(o->s.world, kept, bytes, &error), &error);
    frame(o, k, force_N);
    scene_must(tm_snapshot_restore(o->s.world, kept, bytes, &error), &error);
    free(kept);
}

/* Removes the tetrahedra of a column between the tools. */
static void cut_between(operation *o) {
    const tm_mesh *mesh = o->s.mesh;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        double x[3] = {0};
        for (int i = 0; i < 12; i++) x[i % 3] += 0.25 * mesh->rest_m[3 * mesh->tet[4 * t + i / 3] + i % 3];
        if (fabs(x[0]) < 0.003 && fabs(x[1] - 0.004) < 0.008 && x[2] > 0.03) tm_cut_remove(o->s.tissue, &t, 1, NULL, 0);
    }
}

static uint64_t story(tm_law_kind law, bool effects, int32_t threads, int snapshot_at) {
    enum { FRAMES = 60, CUT = 45 };
    operation o = open_operation(law, effects, threads);
    double force_N[2][3], rubbed = 0, pulled = 0, work_J = 0;
    tm_error error;
    tm_energy e;
    for (int k = 1; k <= FRAMES; k++) {
        if (k == CUT) cut_between(&o);
        if (k == snapshot_at) through_a_snapshot(&o, k);
        frame(&o, k, force_N);
        if (k > 30) rubbed = fmin(rubbed, force_N[0][0]);
        pulled = fmin(pulled, force_N[1][2]);
    }
    tm_grasp_state held;
    assert_true(tm_grasp_vertices(o.grasp, 1, NULL, &held) >= 3 && held == TM_GRASP_HOLDING);
    scene_must(tm_world_energy(o.s.world, &e, &error), &error);
    for (int t = 0; t < 2; t++) work_J += fabs(e.tool_work_J[t]);
    if (threads == 1)
        print_message("%s%s: rubbed %.3f N, pulled %.3f N; friction lost %.1e of %.1e J, residual %.1e\n",
                      tm_law_name(law), effects ? ", averaged, relaxing" : "", rubbed, pulled, e.friction_J, work_J,
                      e.residual_J / work_J);
    assert_true(rubbed < -0.01 && pulled < -0.02 && e.friction_J > 0.01 * work_J);
    assert_true(fabs(e.residual_J) < 0.005 * work_J);
    const uint64_t hash = tm_world_hash(o.s.world);
    scene_destroy(&o.s);
    return hash;
}

static void laws_with_friction_grasp_and_cut_keep_bits_and_energy(void **state) {
    (void)state;
    const uint64_t hash = story(TM_LAW_NEO_HOOKE, true, 2, 40);
    if (test_is_sanitized()) return; /* all of its code has run */
    assert_true(story(TM_LAW_NEO_HOOKE, true, 1, -1) == hash);
    assert_true(story(TM_LAW_HOLZAPFEL, false, 1, -1) == story(TM_LAW_HOLZAPFEL, false, 2, 40));
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(laws_with_friction_grasp_and_cut_keep_bits_and_energy)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
