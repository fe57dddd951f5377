/* Releasing while a second tool presses on the grasped tissue or grasps it too: the tissue is not accelerated
 * excessively. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "../long.h"
#include "contact_scene.h"

static const double TOP_M = 0.036;

typedef enum second { NOTHING, PROBE, GRASPER, CAUTERY } second;
static const char *const SECOND[] = {"nothing", "a probe", "a grasper", "a cautery"};
static const tm_tool_mode MODE[] = {TM_TOOL_PROBE, TM_TOOL_PROBE, TM_TOOL_GRASPER, TM_TOOL_CAUTERY};

typedef struct release {
    scene s;
    tm_tool_pose at[2];
    double most_J, most_m;
    int overflowed; /* frames */
} release;

static tm_energy energy(const release *r) {
    tm_energy e;
    assert_int_equal(tm_world_energy(r->s.world, &e, NULL), TM_OK);
    return e;
}

static void frame(release *r) {
    const int32_t n = (int32_t)ceil(0.005 / tm_world_step_s(r->s.world));
    tm_contact_begin_frame(r->s.contact, n, n);
    for (int t = 0; t < 2; t++) tm_contact_set_target(r->s.contact, t, r->at + t, n);
    assert_int_equal(tm_world_step(r->s.world, n), TM_OK);
    const double *u = tm_world_state(r->s.world)->u_m;
    for (int32_t i = 0; i < 3 * r->s.mesh->vertex_count; i++) r->most_m = fmax(r->most_m, fabs(u[i]));
    const tm_energy e = energy(r);
    r->most_J = fmax(r->most_J, e.kinetic_J + e.elastic_J);
    for (int t = 0; t < 2; t++)
        r->overflowed += (tm_contact_reaction(r->s.contact, t).flags & TM_REACTION_OVERFLOWED) != 0;
}

static release open_release(second other, double damping_1_s, double fade_s) {
    scene_def d = scene_def_default();
    d.cells[0] = d.cells[1] = 12, d.cells[2] = 5;
    d.size_m[2] = TOP_M;
    d.young_Pa = 6000, d.damping_1_s = damping_1_s, d.tools = 2;
    memcpy(d.trocar_m, (double[2][3]){{0.1, 0, 0.2}, {-0.1, 0, 0.2}}, sizeof d.trocar_m);
    memcpy(d.tip_m, (double[2][3]){{0, 0, TOP_M + 0.0035}, {-0.003, 0, TOP_M + 0.02}}, sizeof d.tip_m);
    release r = {.s = scene_create_full(&d, other == CAUTERY, (tm_tool_mode[2]){TM_TOOL_GRASPER, MODE[other]})};
    for (int t = 0; t < 2; t++) r.at[t] = scene_pose(d.tip_m[t][0], d.tip_m[t][1], d.tip_m[t][2]);
    tm_grasp *grasp;
    tm_error error;
    tm_grasp_def how = tm_grasp_def_default();
    how.release_time_s = fade_s;
    scene_must(tm_stage_grasp(r.s.world, r.s.contact, &how, &grasp, &error), &error);
    tm_cut_def cut = tm_cut_def_default();
    if (other == CAUTERY) scene_must(tm_stage_cut(r.s.world, r.s.contact, &cut, &error), &error);
    scene_must(tm_stage_energy(r.s.world, &error), &error);
    return r;
}

/* The first tool grasps the top and lifts it by 5 mm; the second comes `press_m` deep into the grasped tissue, or
 * grasps it too and moves down by as much. */
static void hold(release *r, second other, double press_m) {
    r->at[1].active = other == PROBE || other == GRASPER;
    for (int k = 1; k <= 20; k++) r->at[0].tip_m[2] = TOP_M + 0.0035 - 0.003 * fmin(1, k / 10.0), frame(r);
    r->at[0].grip = 1;
    if (other == GRASPER) {
        r->at[1].tip_m[2] = TOP_M + 0.0005;
        for (int k = 0; k < 10; k++) frame(r);
        r->at[1].grip = 1;
    }
    frame(r);
    for (int k = 1; k <= 40; k++) {
        r->at[0].tip_m[2] = TOP_M + 0.0005 + 0.005 * fmin(1, k / 30.0);
        if (other == GRASPER) r->at[1].tip_m[2] = TOP_M + 0.0005 - press_m * fmin(1, k / 30.0);
        frame(r);
    }
    for (int k = 1; k <= 45 && (other == PROBE || other == CAUTERY); k++)
        r->at[1].tip_m[2] = TOP_M + 0.011 - (0.006 + press_m) * fmin(1, k / 40.0), frame(r);
}

static void let_go(second other, double damping_1_s, double press_m, double fade_s, bool say) {
    release r = open_release(other, damping_1_s, fade_s);
    hold(&r, other, press_m);
    const tm_energy before = energy(&r);
    const double before_J = before.kinetic_J + before.elastic_J, before_m = r.most_m;
    r.most_J = 0, r.overflowed = 0;
    r.at[0].grip = 0;
    r.at[1].active = other != NOTHING;
    for (int k = 0; k < 100; k++) {
        if (other == GRASPER && k == 8) r.at[1].grip = 0;
        if (k == 60) r.overflowed = 0;
        frame(&r);
    }
    if (say)
        print_message("%-9s %3.0f 1/s, %.0f mm, fade %3.0f ms: %.2e J and %.2e J in springs before, at most %.2e J "
                      "after, %.1f mm, then %.1f mm\n",
                      SECOND[other], damping_1_s, 1e3 * press_m, 1e3 * fade_s, before_J, before.contact_stored_J,
                      r.most_J, 1e3 * before_m, 1e3 * r.most_m);
    /* No tool moves: the tissue's energy comes from the springs of jaws and contact compliance, and most of that is
     * dissipated. A frozen force that fades made 25 to 5,000 times the energy, and 50 to 430 mm. */
    assert_true(r.most_J < before_J + before.contact_stored_J + 1e-5);
    if (other != CAUTERY && fade_s > 0) assert_true(r.most_J < before_J + 0.1 * before.contact_stored_J + 1e-5);
    assert_true(energy(&r).generated_J - energy(&r).drag_J < before.generated_J - before.drag_J + 1e-5);
    assert_true(r.most_m < before_m + 0.005);
    assert_int_equal(r.overflowed, 0); /* in the last 0.2 s */
    scene_destroy(&r.s);
}

static void test_release_is_gentle_for_every_second_tool(void **unused) {
    (void)unused;
    const double fade_s[] = {0, 0.1, 0.3};
    for (second other = NOTHING; other <= CAUTERY; other++)
        for (int f = test_is_sanitized() ? 2 : 0; f < 3; f++)
            for (int p = 0; p < (other == NOTHING ? 1 : 2); p++) let_go(other, 20, p ? 0.004 : 0.001, fade_s[f], true);
}

static void test_release_is_gentle_at_every_depth(void **unused) {
    (void)unused;
    const bool all = test_is_long(), few = test_is_sanitized();
    for (second other = PROBE; other <= GRASPER; other++)
        for (int damping = 20; damping <= 100; damping += all ? 40 : few ? 100 : 80)
            for (int p = 0; p <= 6; p += all ? 1 : few ? 6 : 3) let_go(other, damping, 1e-3 * p, 0.1, true);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_release_is_gentle_for_every_second_tool),
        cmocka_unit_test(test_release_is_gentle_at_every_depth),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
