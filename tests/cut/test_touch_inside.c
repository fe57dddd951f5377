/* Vertices that are too fast for the rows within reach, and vertices that got inside another body. */
#include "../long.h"
#include "overlap.h"
#include "touch_blocks.h"

static const part table = {{5, 5, 2}, {0.05, 0.05, 0.02}, {0, 0, 0}, 0};
static part above(double gap_m) { return (part){{3, 3, 2}, {0.03, 0.03, 0.02}, {0.0132, 0.0071, 0.02 + gap_m}, 0.3}; }

static bodies two(double gap_m, int32_t threads) {
    setup s = plain();
    s.is_held = at_base, s.threads = threads, s.mu = 0.2;
    const part p[] = {table, above(gap_m)};
    return make(p, 2, &s);
}

/* Returns a vertex of the upper block's base, the `which`-th. */
static int32_t at_underside(const bodies *b, int which) {
    const double low_m = b->mesh->rest_m[3 * b->body_begin[1] + 2];
    for (int32_t v = b->body_begin[1]; v < b->body_begin[2]; v++)
        if (b->mesh->rest_m[3 * v + 2] < low_m + 1e-9 && which-- == 0) return v;
    fail();
    return -1;
}

/* Throws a vertex of the upper block down, or one of the table's top up. */
static void a_vertex_at_four_metres_a_second_is_stopped(void **state) {
    (void)state;
    for (int up = 0; up < 2; up++)
        for (int which = 0; which < (test_is_sanitized() ? 1 : 16); which += 3) {
            bodies b = two(2e-3, 1), all = two(2e-3, 1);
            all.touching->all_pairs = which % 2 == 0;
            tm_state *s[] = {tm_world_state(b.world), tm_world_state(all.world)};
            int32_t v = at_underside(&b, which);
            for (int32_t k = 0, n = 0; up && k < b.body_begin[1]; k++)
                if (b.mesh->rest_m[3 * k + 2] > 0.0199 && n++ == which + 10) v = k;
            for (int k = 0; k < 2; k++) s[k]->u_prev_m[3 * v + 2] += s[k]->dt_s * (up ? -4 : 4);
            for (int k = 0; k < 30; k++) {
                assert_int_equal(tm_world_step(b.world, 1), TM_OK);
                assert_int_equal(tm_world_step(all.world, 1), TM_OK);
                assert_true(tm_world_hash(b.world) == tm_world_hash(all.world));
                if (is_inside_another(&b))
                    fail_msg("thrown %s, vertex %d: inside after %d steps", up ? "up" : "down", v, k);
            }
            drop(&b), drop(&all);
        }
}

/* Moves the upper block 4 mm deep into the table. */
static bodies pressed_in(int32_t threads, bool all_pairs) {
    bodies b = two(0.6e-3, threads);
    b.touching->all_pairs = all_pairs;
    tm_state *s = tm_world_state(b.world);
    for (int32_t v = b.body_begin[1]; v < b.body_begin[2]; v++) s->u_m[3 * v + 2] = s->u_prev_m[3 * v + 2] = -4.6e-3;
    assert_true(is_inside_another(&b));
    return b;
}

static double true_overlap_m(const bodies *b) {
    return measure_overlap(b->tissue, tm_world_state(b->world)->u_m, b->tet_body, b->count, NULL).deepest_m;
}

/* The report is of the start of a substep. It never exceeds the true overlap, and reaches it once the deepest vertex is
 * listed. */
static void a_body_inside_another_comes_out(void **state) {
    (void)state;
    bodies b = pressed_in(1, false);
    double most = 0, true_m;
    int32_t steps = 0;
    for (; (true_m = true_overlap_m(&b)) > 0 && steps < 1000; steps++) {
        assert_int_equal(tm_world_step(b.world, 1), TM_OK);
        const double reported_m = tm_touching_get_report(b.touching).deepest_m;
        if (reported_m > true_m + 1e-9) fail_msg("%.6g mm reported of %.6g mm", 1e3 * reported_m, 1e3 * true_m);
        if (true_m > 1e-3) most = fmax(most, reported_m / true_m);
    }
    printf("out after %d steps of %.2g ms; reported up to %.3g of the overlap\n", steps, 1e3 * tm_world_step_s(b.world),
           most);
    assert_true(steps < 1000 && most > 0.9);
    run(&b, 0.3);
    assert_true(true_overlap_m(&b) == 0);
    assert_int_equal(b.touching->inside_count, 0);
    drop(&b);
}

static void pushing_out_has_the_same_bits_for_threads_all_pairs_and_snapshots(void **state) {
    (void)state;
    tm_error error;
    bodies b = pressed_in(1, false), other[] = {pressed_in(3, false), pressed_in(1, true)};
    for (int k = 0; k < 400 && b.touching->inside_count == 0; k++) {
        assert_int_equal(tm_world_step(b.world, 1), TM_OK);
        for (int i = 0; i < 2; i++) assert_int_equal(tm_world_step(other[i].world, 1), TM_OK);
    }
    assert_true(b.touching->inside_count > 0);
    const int64_t bytes = tm_snapshot_bytes(b.world);
    void *saved = malloc((size_t)bytes);
    fix_ok(tm_snapshot_save(b.world, saved, bytes, &error), &error);
    assert_int_equal(tm_world_step(b.world, 20), TM_OK);
    const uint64_t hash = tm_world_hash(b.world);
    for (int k = 0; k < 2; k++) {
        assert_int_equal(tm_world_step(other[k].world, 20), TM_OK);
        assert_true(hash == tm_world_hash(other[k].world));
    }
    fix_ok(tm_snapshot_restore(b.world, saved, bytes, &error), &error);
    assert_int_equal(tm_world_step(b.world, 20), TM_OK);
    assert_true(hash == tm_world_hash(b.world));
    free(saved);
    drop(&b), drop(other), drop(other + 1);
}

/* Images with labels give bodies that overlap by a little. */
static void bodies_that_overlap_at_rest_are_not_pushed_apart(void **state) {
    (void)state;
    bodies b = two(-2e-3, 1);
    assert_true(is_inside_another(&b));
    for (int k = 0; k < 600; k++) {
        assert_int_equal(tm_world_step(b.world, 1), TM_OK);
        assert_int_equal(b.touching->inside_count, 0);
    }
    assert_true(is_inside_another(&b));
    drop(&b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_vertex_at_four_metres_a_second_is_stopped),
        cmocka_unit_test(a_body_inside_another_comes_out),
        cmocka_unit_test(pushing_out_has_the_same_bits_for_threads_all_pairs_and_snapshots),
        cmocka_unit_test(bodies_that_overlap_at_rest_are_not_pushed_apart),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
