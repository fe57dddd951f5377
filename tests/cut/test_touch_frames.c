/* A body that flies as a whole crosses nothing of its own: its paths are followed only where another body is in its
 * way, or where it deforms fast. */
#include "overlap.h"
#include "touch_blocks.h"

static const part PARTS[] = {{{4, 4, 2}, {0.04, 0.04, 0.02}, {0, 0, 0}, 0},
                             {{4, 4, 2}, {0.04, 0.04, 0.02}, {0.004, 0.003, 0.06}, 0.3}};

static bodies throw_one(double speed_m_s) {
    setup s = plain();
    s.damping_1_s = 0, s.is_held = at_base;
    bodies b = make(PARTS, 2, &s);
    throw_body(&b, 1, 0, 0, -speed_m_s);
    return b;
}

static int32_t followed(const bodies *b) { return b->touching->quick[TM_TOUCH_VERTICES].count; }

static void paths_of_a_body_in_flight_are_not_followed(void **state) {
    (void)state;
    bodies b = throw_one(2);
    const double motion_m = 2 * tm_world_step_s(b.world);
    assert_true(motion_m > 2 * b.touching->def.thickness_m);
    const int flight = (int)(0.036 / motion_m);
    for (int k = 0; k < flight; k++) {
        assert_int_equal(tm_world_step(b.world, 1), TM_OK);
        assert_int_equal(followed(&b), 0);
    }
    int32_t most = 0;
    double deepest_m = 0;
    for (int k = 0; k < 12; k++) {
        assert_int_equal(tm_world_step(b.world, 1), TM_OK);
        if (followed(&b) > most) most = followed(&b);
        const overlap o = measure_overlap(b.tissue, tm_world_state(b.world)->u_m, b.touching->tet_body, 2, NULL);
        deepest_m = fmax(deepest_m, o.deepest_m);
    }
    print_message("%d vertices followed where they meet, deepest overlap %.2g mm\n", most, 1e3 * deepest_m);
    assert_true(most > 20 && deepest_m < 0.05e-3);
    drop(&b);
}

/* A vertex that leaves its body in flight is followed. */
static void a_vertex_that_leaves_its_body_is_followed(void **state) {
    (void)state;
    bodies b = throw_one(2);
    const int32_t v = b.mesh->vertex_count - 1;
    tm_state *s = tm_world_state(b.world);
    s->u_prev_m[3 * v] -= 4 * b.touching->def.thickness_m;
    assert_int_equal(tm_world_step(b.world, 1), TM_OK);
    assert_true(followed(&b) >= 1 && followed(&b) < 8);
    drop(&b);
}

/* Bodies that lie flush are pressed into each other by a micrometre of the rows' compliance: that is no surface inside
 * out, and its paths are not followed; only some at the upper block's corners are. */
static void paths_of_bodies_that_lie_flush_are_not_followed(void **state) {
    (void)state;
    setup s = plain();
    s.is_held = at_base, s.gravity_m_s2 = 9.81;
    const part flush[] = {PARTS[0], {{4, 4, 2}, {0.03, 0.03, 0.02}, {0.004, 0.003, 0.02}, 0}};
    bodies b = make(flush, 2, &s);
    int32_t most = 0;
    double deepest_m = 0;
    for (int k = 0; k < 200; k++) {
        assert_int_equal(tm_world_step(b.world, 1), TM_OK);
        if (followed(&b) > most) most = followed(&b);
        deepest_m = fmax(deepest_m, tm_touching_get_report(b.touching).deepest_m);
    }
    print_message("%d vertices followed where they lie flush, deepest overlap %.2g mm\n", most, 1e3 * deepest_m);
    assert_true(deepest_m > 0 && deepest_m < 0.02e-3);
    assert_true(most < 20);
    drop(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(paths_of_a_body_in_flight_are_not_followed),
                                       cmocka_unit_test(a_vertex_that_leaves_its_body_is_followed),
                                       cmocka_unit_test(paths_of_bodies_that_lie_flush_are_not_followed)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
