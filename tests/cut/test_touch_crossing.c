/* Fast surfaces do not cross: faces, ridges, folds of one body and lips of a cut, at 0.5 and at 4 m/s with the step at
 * hand. Judged by the true overlap after each substep. Without contact they cross. */
#include "overlap.h"
#include "touch_blocks.h"

static const double SPEED_M_S[] = {0.5, 4}, DEEPEST_M = 0.05e-3;
enum { SPEEDS = 2 };

static double true_overlap_m(const bodies *b) {
    return measure_overlap(b->tissue, tm_world_state(b->world)->u_m, b->touching->tet_body, b->touching->def.body_count,
                           NULL)
        .deepest_m;
}

static setup loose(bool touches) {
    static const uint8_t none[4];
    setup s = plain();
    s.damping_1_s = 5;
    if (!touches) s.touch.pair = none;
    return s;
}

/* Steps until both have met and parted, or passed. Returns the deepest overlap. */
static double meet(bodies *b, double way_m, double speed_m_s) {
    double deepest_m = 0;
    const int steps = (int)(2 * way_m / speed_m_s / tm_world_step_s(b->world)) + 8;
    for (int k = 0; k < steps; k++) {
        assert_int_equal(tm_world_step(b->world, 1), TM_OK);
        deepest_m = fmax(deepest_m, true_overlap_m(b));
    }
    assert_false(tm_touching_get_report(b->touching).overflowed);
    return deepest_m;
}

/* Meets two parts, with and without contact, and checks the bits against all pairs. */
static void check(const char *name, const part *p, bool one_body, double tilt_rad, double way_m) {
    for (int fast = 0; fast < SPEEDS; fast++) {
        double deepest_m[2];
        uint64_t hash[2];
        for (int run = 0; run < 3; run++) {
            setup s = loose(run > 0);
            s.one_body = one_body, s.tilt_rad = tilt_rad;
            bodies b = make(p, 2, &s);
            b.touching->all_pairs = run == 2;
            throw_body(&b, 1, 0, 0, -0.75 * SPEED_M_S[fast]), throw_body(&b, 0, 0, 0, 0.25 * SPEED_M_S[fast]);
            const double deepest = meet(&b, way_m, SPEED_M_S[fast]);
            if (run < 2) deepest_m[run] = deepest;
            if (run > 0) hash[run - 1] = tm_world_hash(b.world);
            drop(&b);
        }
        printf("%s at %.1f m/s: deepest overlap %.3g mm, without contact %.3g mm\n", name, SPEED_M_S[fast],
               1e3 * deepest_m[1], 1e3 * deepest_m[0]);
        assert_true(deepest_m[0] > 0.3e-3 && deepest_m[1] <= DEEPEST_M);
        assert_true(hash[0] == hash[1]);
    }
}

static const double QUARTER = 0.785398163397448;

/* Ridges that cross: no vertex meets a face. */
static part ridge(double low_m, double turn_rad) {
    return (part){{1, 3, 1}, {0.01, 0.04, 0.01}, {turn_rad > 0 ? 0.02 : 0, turn_rad > 0 ? 0 : -0.02, low_m}, turn_rad};
}

static void ridges_do_not_pass_through_each_other(void **state) {
    (void)state;
    for (int one_body = 0; one_body < 2; one_body++)
        for (int i = 0; i < 2; i++) {
            part p[] = {ridge(0, 0), ridge(0.0142 + 0.5e-3 * (1 + 3 * i), 2 * QUARTER - 0.3 * i)};
            p[1].at_m[1] += 2e-3 * i + 1.1e-3, p[0].at_m[0] = 1.3e-3;
            check(one_body ? "ridges of one body" : "ridges", p, one_body, QUARTER, 3e-3 + 1.5e-3 * i);
        }
}

static void folds_of_one_body_do_not_pass_through_each_other(void **state) {
    (void)state;
    for (int i = 0; i < 2; i++) {
        const part p[] = {{{5, 5, 2}, {0.05, 0.05, 0.02}, {0, 0, 0}, 0},
                          {{3, 3, 2}, {0.03, 0.03, 0.02}, {0.0132, 0.0071, 0.0205 + 1.5e-3 * i}, 0.3}};
        check("folds", p, true, 0, 2e-3 + 1.5e-3 * i);
    }
}

/* The upper lip of a mouth is thrown at the lower one. */
static void lips_do_not_pass_through_each_other(void **state) {
    (void)state;
    for (int fast = 0; fast < SPEEDS; fast++) {
        double deepest_m[2];
        for (int touches = 0; touches < 2; touches++) {
            setup s = loose(touches);
            s.cuttable = true, s.is_held = at_base, s.young_Pa = 1000;
            bodies b = mouth(&s);
            tm_state *now = tm_world_state(b.world);
            double speed = fmax(SPEED_M_S[fast], 1.5); /* slower, it does not get there */
            for (int32_t v = 0; v < b.mesh->vertex_count; v++)
                if (b.mesh->rest_m[3 * v + 2] > 0.0149 && b.mesh->rest_m[3 * v] > 0.02)
                    now->u_prev_m[3 * v + 2] += now->dt_s * speed;
            deepest_m[touches] = meet(&b, 20e-3, speed);
            drop(&b);
        }
        printf("lips: deepest overlap %.3g mm, without contact %.3g mm\n", 1e3 * deepest_m[1], 1e3 * deepest_m[0]);
        assert_true(deepest_m[0] > 0.3e-3 && deepest_m[1] <= DEEPEST_M);
    }
}

/* A plate whose top was pushed out through its bottom, like a funnel, in soft tissue that takes long to come back. Seen
 * from outside, the part below is inside out. */
static bodies funnel_and_block(bool touches, double turn_rad) {
    const part p[] = {{{1, 3, 1}, {0.02, 0.024, 0.01}, {-0.0245, turn_rad > 0 ? -0.0145 : -0.0125, -0.002}, turn_rad},
                      {{2, 2, 1}, {0.02, 0.02, 0.008}, {-0.01, -0.01, 0.01}, 0}};
    setup s = loose(touches);
    s.young_Pa = 50, s.step_s = 0.25e-3;
    bodies b = make(p, 2, &s);
    for (int32_t v = b.body_begin[1]; v < b.body_begin[2]; v++)
        if (fabs(b.mesh->rest_m[3 * v]) < 1e-9 && fabs(b.mesh->rest_m[3 * v + 1]) < 1e-9 &&
            b.mesh->rest_m[3 * v + 2] > 0.017)
            tm_world_state(b.world)->u_m[3 * v + 2] = tm_world_state(b.world)->u_prev_m[3 * v + 2] = -0.014;
    return b;
}

static void tissue_that_is_inside_out_is_not_entered_from_behind(void **state) {
    (void)state;
    for (int turned = 0; turned < 2; turned++) /* an edge meets an edge; a vertex meets a face */
        for (int fast = 0; fast < SPEEDS; fast++) {
            double deepest_m[2];
            for (int touches = 0; touches < 2; touches++) {
                bodies b = funnel_and_block(touches, turned ? 0.3 : 0);
                throw_body(&b, 0, SPEED_M_S[fast], 0, 0);
                deepest_m[touches] = meet(&b, 4e-3, SPEED_M_S[fast]);
                drop(&b);
            }
            printf("inside out, %s at %.1f m/s: deepest overlap %.3g mm, without contact %.3g mm\n",
                   turned ? "vertex" : "edge", SPEED_M_S[fast], 1e3 * deepest_m[1], 1e3 * deepest_m[0]);
            assert_true(deepest_m[0] > 0.3e-3 && deepest_m[1] <= DEEPEST_M);
        }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ridges_do_not_pass_through_each_other),
        cmocka_unit_test(folds_of_one_body_do_not_pass_through_each_other),
        cmocka_unit_test(lips_do_not_pass_through_each_other),
        cmocka_unit_test(tissue_that_is_inside_out_is_not_entered_from_behind),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
