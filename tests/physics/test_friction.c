/* Friction between tools and tissue: sticks without creep, slides at its coefficient, stays in its cone, returns the
 * energy of its springs and generates none, restores from a snapshot bit-identically, and costs nothing unless
 * requested. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "../long.h"
#include "contact_scene.h"

static const double FRAME_S = 0.002, TOP_M = 0.042;

typedef struct friction_scene {
    scene s;
    tm_friction *friction;
    double frame_s;
} friction_scene;

static friction_scene open_scene(int tools, double at_rest, double sliding) {
    scene_def d = scene_def_default();
    d.cells[0] = d.cells[1] = 7, d.cells[2] = 4;
    d.tools = tools;
    memcpy(d.tip_m, (double[2][3]){{0.008, 0.004, TOP_M + 0.0027}, {-0.012, 0.004, TOP_M + 0.0027}}, sizeof d.tip_m);
    friction_scene r = {.s = scene_create_full(&d, false, (tm_tool_mode[2]){TM_TOOL_PROBE, TM_TOOL_PROBE}),
                        .frame_s = FRAME_S};
    tm_friction_def def = tm_friction_def_default();
    for (int t = 0; t < tools; t++) def.instrument[t] = (tm_friction_coefficient){at_rest, sliding};
    tm_error error;
    if (at_rest > 0) scene_must(tm_stage_friction(r.s.world, r.s.contact, &def, &r.friction, &error), &error);
    scene_must(tm_stage_energy(r.s.world, &error), &error);
    return r;
}

typedef struct pull {
    double normal_force_N, force_N[3],
        over_cone; /* sums over the stations of tool 0; the worst force over its cone, less 1 */
    bool slips;
    double rest;
} pull;

static pull grips(const friction_scene *r, int tool, double at_rest, double sliding) {
    tm_friction_station grip[32];
    pull p = {.over_cone = -1, .rest = 1};
    const int32_t n = tm_friction_stations(r->friction, tool, grip, 32);
    assert_true(n <= 32);
    for (int32_t i = 0; i < n; i++) {
        const double *f = grip[i].force_N, size = sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
        double along = 0;
        for (int c = 0; c < 3; c++) p.force_N[c] += f[c], along += f[c] * grip[i].normal[c];
        p.normal_force_N += grip[i].normal_force_N;
        p.over_cone = fmax(p.over_cone, size / (at_rest * grip[i].normal_force_N) - 1);
        assert_true(grip[i].coefficient >= sliding && grip[i].coefficient <= at_rest);
        assert_true(size <= (grip[i].coefficient + 1e-6) * grip[i].normal_force_N);
        assert_true(!grip[i].slips || size >= (grip[i].coefficient - 1e-6) * grip[i].normal_force_N);
        assert_true(fabs(along) < 1e-12);
        p.slips |= grip[i].slips;
        p.rest = fmin(p.rest, grip[i].stick_state);
    }
    return p;
}

static tm_tool_reaction go(friction_scene *r, int tool, double x, double y, double z) {
    return scene_frame(&r->s, tool, scene_pose(x, y, z), r->frame_s);
}

static tm_tool_reaction press_in(friction_scene *r, int tool, double x, double depth_m) {
    tm_tool_reaction f = {0};
    for (int i = 1; i <= 100; i++) f = go(r, tool, x, 0.004, TOP_M + 0.0027 - (depth_m + 0.0002) * i / 100);
    for (int i = 0; i < 50; i++) f = go(r, tool, x, 0.004, TOP_M + 0.0025 - depth_m);
    return f;
}

/* Pressed, pushed aside to most of its cone, and held there: the force stays constant. TM_LONG=1: for two minutes. */
static void test_sticking_force_does_not_creep(void **unused) {
    (void)unused;
    friction_scene r = open_scene(1, 0.4, 0.3);
    const double z = TOP_M + 0.0025 - 0.003;
    press_in(&r, 0, 0.008, 0.003);
    double x = 0.008;
    while (grips(&r, 0, 0.4, 0.3).over_cone < -0.25) x += 2e-5, go(&r, 0, x, 0.004, z);
    for (int i = 0; i < 250; i++) go(&r, 0, x, 0.004, z);
    const tm_tool_reaction before = go(&r, 0, x, 0.004, z);
    const pull was = grips(&r, 0, 0.4, 0.3);
    const double minutes = test_is_long() ? 2 : 0.1;
    for (int i = 0; i < (int)(60 * minutes / FRAME_S); i++) go(&r, 0, x, 0.004, z);
    const tm_tool_reaction after = go(&r, 0, x, 0.004, z);
    double changed = 0;
    for (int c = 0; c < 3; c++) changed = fmax(changed, fabs(after.force_N[c] - before.force_N[c]));
    print_message("held at %.2f of its cone with %.2f N: after %.1f min the force differs by %.1e N\n",
                  1 + was.over_cone, was.normal_force_N, minutes, changed);
    assert_true(was.over_cone > -0.4 && !was.slips && changed < 1e-6);
    scene_destroy(&r.s);
}

/* A tool of 40 g rests on a tilted block, with the tissue under gravity too, in the block's axes: downhill is x.
 * Apart from a little drag nothing guides the tool, so its position is the sum of all creep. Returns that position,
 * from `from_s` on. */
static double lie_on_slope(double tangent, double from_s, int32_t steps, pull *load_N, double *speed_m_s) {
    const double mass_kg = 0.04, drag_N_s_m = 2;
    const double down[3] = {tangent / hypot(1, tangent), 0, -1 / hypot(1, tangent)};
    friction_scene r = open_scene(1, 0.4, 0.3);
    const double g[3] = {9.81 * down[0], 0, 9.81 * down[2]}, dt = tm_world_step_s(r.s.world);
    double at[3] = {0.008, 0.004, TOP_M + 0.0027}, v[3] = {0}, was[3] = {0}, crept = 0;
    tm_error error;
    scene_must(tm_stage_gravity(r.s.world, g, &error), &error);
    for (int32_t i = 0; i < (int32_t)(from_s / dt) + steps; i++) {
        /* Pressed first, tilted after half a second: it does not arrive sliding. */
        const double tilt = fmin(fmax(2 * i * dt - 1, 0), 1);
        const tm_tool_reaction f = scene_frame(&r.s, 0, scene_pose(at[0], at[1], at[2]), dt);
        for (int c = 0; c < 3; c++) {
            const double weight = mass_kg * g[c] * (c == 0 ? tilt : 1);
            v[c] += dt / mass_kg * (weight + f.force_N[c] - drag_N_s_m * v[c]);
            at[c] += dt * v[c];
        }
        if (i * dt <= from_s) memcpy(was, at, sizeof was);
        if (at[0] > 0.025) break; /* off the block, nearly */
    }
    for (int c = 0; c < 3; c++) crept = fmax(crept, fabs(at[c] - was[c]));
    *load_N = grips(&r, 0, 0.4, 0.3), *speed_m_s = v[0];
    scene_destroy(&r.s);
    return crept;
}

/* Within the static cone, though beyond the kinetic one, it stays at rest; beyond the static cone it slides down.
 * TM_LONG=1: for a million steps. */
static void test_tool_stays_on_a_slope_within_the_static_cone(void **unused) {
    (void)unused;
    pull inside, outside;
    double still, slides;
    const int32_t steps = test_is_long() ? 1000000 : 10000;
    const double crept = lie_on_slope(0.34, 2, steps, &inside, &still),
                 slid = lie_on_slope(0.5, 0.5, 10000, &outside, &slides);
    print_message("slope 0.34: %.1e m in %d steps, at %.2f of its cone; 0.5: %.1f mm, at %.3f m/s\n", crept, steps,
                  1 + inside.over_cone, 1e3 * slid, slides);
    assert_true(crept < 1e-11 && !inside.slips && inside.rest == 1);
    assert_true(hypot(inside.force_N[0], inside.force_N[1]) > 0.3 * inside.normal_force_N);
    assert_true(slid > 0.005 && slides > 0.01 && outside.slips);
}

/* Slides at its coefficient to 1e-6 (checked by grips()), stops, reverses; in every frame no force is outside its
 * cone. */
static void test_slides_at_its_coefficient(void **unused) {
    (void)unused;
    friction_scene r = open_scene(1, 0.4, 0.3);
    const double z = TOP_M + 0.0025 - 0.003;
    press_in(&r, 0, 0.008, 0.003);
    double worst = -1, x = 0.008, peak = 0, slid = 0;
    for (int i = 0; i < 700; i++) {
        x += i < 400 ? -2e-5 : i < 450 ? 0 : 2e-5;
        go(&r, 0, x, 0.004, z);
        const pull p = grips(&r, 0, 0.4, 0.3);
        worst = fmax(worst, p.over_cone);
        const double ratio = hypot(p.force_N[0], p.force_N[1]) / p.normal_force_N;
        if (i < 400) peak = fmax(peak, ratio);
        if (i == 399) slid = ratio, assert_true(p.slips && p.rest == 0 && p.force_N[0] < 0);
        if (i == 449) assert_true(!p.slips);
        if (i == 699) assert_true(p.slips && p.force_N[0] > 0);
    }
    print_message("worst over its cone %.1e; at most %.3f, sliding %.3f of what it presses with\n", worst, peak, slid);
    assert_true(worst < 1e-6 && peak > 0.36 && slid < 0.31 && slid > 0.28);
    scene_destroy(&r.s);
}

/* Rest restores the static coefficient: the force at which it slides again grows with the time at rest. */
static void test_static_coefficient_returns_with_rest(void **unused) {
    (void)unused;
    double took[3];
    for (int k = 0; k < 3; k++) {
        friction_scene r = open_scene(1, 0.5, 0.2);
        const double z = TOP_M + 0.0025 - 0.003;
        press_in(&r, 0, 0.008, 0.003);
        double x = 0.008;
        for (int i = 0; i < 300; i++) x -= 2e-5, go(&r, 0, x, 0.004, z);
        x += 1e-5; /* it sticks */
        for (int i = 0; i < 1 + 20 * k; i++) go(&r, 0, x, 0.004, z);
        took[k] = 0;
        for (int i = 0; i < 100; i++) {
            x -= 1e-4;
            go(&r, 0, x, 0.004, z);
            const pull p = grips(&r, 0, 0.5, 0.2);
            took[k] = fmax(took[k], hypot(p.force_N[0], p.force_N[1]) / p.normal_force_N);
        }
        scene_destroy(&r.s);
    }
    print_message("took %.3f %.3f %.3f of what it presses with after 2, 42 and 82 ms\n", took[0], took[1], took[2]);
    assert_true(took[0] < 0.3 && took[1] > took[0] + 0.05 && took[2] > took[1] + 0.05 && took[2] < 0.5);
}

/* Moves two tools with friction; returns the largest energy that contact generated. */
static double rub(double at_rest, double sliding, tm_energy *e, double *hands) {
    friction_scene r = open_scene(2, at_rest, sliding);
    tm_energy was = {0};
    double worst = 0;
    *hands = 0;
    press_in(&r, 0, 0.008, 0.003);
    press_in(&r, 1, -0.012, 0.004);
    for (int i = 0; i < 400; i++) {
        const double turn = 0.03 * i;
        tm_tool_pose to[2] = {scene_pose(0.008 + 0.003 * sin(turn), 0.004 + 0.003 * (1 - cos(turn)), 0.0415),
                              scene_pose(-0.012 + 0.004 * sin(1.7 * turn), 0.004, 0.0405)};
        const int32_t substeps = (int32_t)ceil(FRAME_S / tm_world_step_s(r.s.world));
        for (int t = 0; t < 2; t++) tm_contact_set_target(r.s.contact, t, to + t, substeps);
        assert_int_equal(tm_world_step(r.s.world, substeps), TM_OK);
        assert_int_equal(tm_world_energy(r.s.world, e, NULL), TM_OK);
        assert_true(e->friction_J >= was.friction_J && e->drag_J >= was.drag_J - 1e-9);
        *hands = fmax(*hands, fabs(e->tool_work_J[0]) + fabs(e->tool_work_J[1]));
        worst = fmax(worst, e->generated_J);
        was = *e;
    }
    scene_destroy(&r.s);
    return worst;
}

/* The work of friction is never negative and is supplied by the hands. Contact returns energy only from what it
 * dissipated before (contact_passivity.c): no more than in absolute terms before it had an energy account, 2.1e-4
 * and 2.3e-4 J, and with friction no more than twice that without. */
static void test_friction_generates_no_energy(void **unused) {
    (void)unused;
    tm_energy plain, e;
    double plain_hands, hands;
    const double plain_worst = rub(0, 0, &plain, &plain_hands), worst = rub(0.4, 0.3, &e, &hands);
    print_message("hands put in %.2e J (%.2e without): friction took %.2e, film %.2e, damping %.2e; made at most %.1e "
                  "(%.1e without)\n",
                  hands, plain_hands, e.friction_J, e.drag_J, e.damping_J, worst, plain_worst);
    assert_true(plain.friction_J == 0 && e.friction_J > 0.5 * hands && fabs(e.residual_J) < 1e-10 * hands);
    assert_true(plain_worst < 1.5e-4 && worst < 2.4e-4 && worst < 2 * plain_worst && e.generated_J > -0.1 * hands);
}

static void wander(friction_scene *r, int from, int to) {
    for (int i = from; i < to; i++)
        go(r, 0, 0.008 + 0.002 * sin(0.05 * i), 0.004 + 0.001 * sin(0.08 * i), TOP_M - 0.001 * sin(0.03 * i));
}

static void test_friction_is_restored_from_a_snapshot(void **unused) {
    (void)unused;
    friction_scene r = open_scene(1, 0.4, 0.3);
    wander(&r, 0, 100);
    const int64_t bytes = tm_snapshot_bytes(r.s.world);
    void *kept = malloc((size_t)bytes);
    assert_int_equal(tm_snapshot_save(r.s.world, kept, bytes, NULL), TM_OK);
    wander(&r, 100, 200);
    const uint64_t hash = tm_world_hash(r.s.world);
    const pull was = grips(&r, 0, 0.4, 0.3);
    for (int other = 0; other < 2; other++) { /* the same world, and a fresh one */
        friction_scene to = other ? open_scene(1, 0.4, 0.3) : r;
        assert_int_equal(tm_snapshot_restore(to.s.world, kept, bytes, NULL), TM_OK);
        wander(&to, 100, 200);
        const pull p = grips(&to, 0, 0.4, 0.3);
        assert_true(tm_world_hash(to.s.world) == hash);
        assert_memory_equal(p.force_N, was.force_N, sizeof p.force_N);
        if (other) scene_destroy(&to.s);
    }
    free(kept);
    scene_destroy(&r.s);
}

/* A step of a world without friction is unchanged, and a removed stage returns all its memory. */
static void test_costs_nothing_unless_named(void **unused) {
    (void)unused;
    friction_scene plain = open_scene(1, 0, 0), none = open_scene(1, 0, 0);
    tm_friction_def def = tm_friction_def_default();
    tm_error error;
    tm_friction *friction;
    assert_int_equal(tm_stage_friction(none.s.world, none.s.contact, &def, &friction, &error), TM_OK);
    wander(&plain, 0, 60);
    wander(&none, 0, 60);
    assert_true(tm_world_hash(plain.s.world) == tm_world_hash(none.s.world)); /* coefficients 0 and 0: no bit changes */
    assert_int_equal(tm_stage_friction(none.s.world, none.s.contact, &def, &friction, &error), TM_ERR_ARGUMENT);
    scene_destroy(&plain.s);
    scene_destroy(&none.s);
    for (int k = 0; k < 4; k++) { /* invalid values are rejected with the instrument */
        friction_scene r = open_scene(1, 0, 0);
        def.instrument[0] = (tm_friction_coefficient[]){{0.2, 0.3}, {-0.1, -0.2}, {2.5, 1}, {NAN, 0}}[k];
        assert_int_equal(tm_stage_friction(r.s.world, r.s.contact, &def, &friction, &error), TM_ERR_ARGUMENT);
        assert_int_equal(error.entity, 0);
        scene_destroy(&r.s);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_sticking_force_does_not_creep),
                                       cmocka_unit_test(test_tool_stays_on_a_slope_within_the_static_cone),
                                       cmocka_unit_test(test_slides_at_its_coefficient),
                                       cmocka_unit_test(test_static_coefficient_returns_with_rest),
                                       cmocka_unit_test(test_friction_generates_no_energy),
                                       cmocka_unit_test(test_friction_is_restored_from_a_snapshot),
                                       cmocka_unit_test(test_costs_nothing_unless_named)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
