/* All threads search close pairs, and one finds rows while the others compute the force: the same bits for any number
 * of threads, with the linear law, where the force pass has the work, and with rotation, whose own job has it. */
#include "touch_blocks.h"

static uint64_t collide(bool rotation, int32_t threads) {
    setup s = plain();
    s.gravity_m_s2 = 9.81, s.is_held = at_base, s.threads = threads, s.cuttable = true, s.mu = 0.3,
    s.rotation = rotation;
    const part p[] = {{{12, 12, 5}, {0.06, 0.06, 0.025}, {0, 0, 0}, 0},
                      {{6, 6, 4}, {0.03, 0.03, 0.02}, {0.03, 0.005, 0.026}, 0.5}};
    bodies b = make(p, 2, &s);
    assert_int_equal(b.world->partition_count, threads);
    throw_body(&b, 1, 0.1, 0, -0.4);
    uint64_t hash = TM_HASH_SEED;
    for (int k = 0; k < 4; k++) {
        assert_int_equal(tm_world_step(b.world, 20), TM_OK);
        const tm_touching_row *row;
        const int32_t n = tm_touching_rows(b.touching, &row);
        if (k > 0) assert_true(n > 0);
        hash = hash_of_rows(row, n, hash);
        assert_int_equal(b.world->overlap_count, threads > 1);
        const int32_t gone[] = {5 + k, 90 + k, 400 + k};
        tm_cut_remove(b.tissue, gone, 3, NULL, 0);
    }
    hash ^= tm_world_hash(b.world);
    drop(&b);
    return hash;
}

static void rows_are_found_during_the_force_pass(void **state) {
    (void)state;
    for (int rotation = 0; rotation < 2; rotation++) {
        const uint64_t one = collide(rotation, 1);
        assert_true(one == collide(rotation, 2));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(rows_are_found_during_the_force_pass)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
