/* Sender and order of samples are checked before the mailbox: only a later sample of the same simulation replaces a
 * waiting one. No other sender's sample reaches the tick while force is rendered. */
#include "loop.h"

static loop l;

/* Makes a good sample of the present simulation, with a sideways force instead. */
static tensormass_force_sample_t forged(void) {
    tensormass_force_sample_t s = loop_sample(&l, &l.tool);
    s.seq = (int32_t)l.seq + 1;
    s.force_N[0] = 8.0;
    return s;
}

/* Each of these once replaced an unread sample. */
static void unread_sample_is_kept_against_foreign_ones(void **state) {
    (void)state;
    for (int kind = 0; kind < 6; kind++) {
        loop_press(&l, HRT_LOCAL_MODEL);
        l.seq++;
        const tensormass_force_sample_t good = loop_sample(&l, &l.tool);
        assert_int_equal(hrt_node_post_sample(&l.node, &good), HRT_ACCEPT);
        tensormass_force_sample_t bad = forged();
        if (kind == 0) bad.session++;
        if (kind == 1) bad.seq = (int32_t)l.seq;
        if (kind == 2) bad.seq = (int32_t)l.seq - 5;
        if (kind == 3) bad.tool_utime += 1000000;
        if (kind == 4) bad.tool_utime -= 80000;
        if (kind == 5) bad.tool_session++;
        assert_int_not_equal(hrt_node_post_sample(&l.node, &bad), HRT_ACCEPT);
        l.next_frame_us = l.now_us + l.frame_us;
        loop_tick(&l);
        assert_int_equal(l.node.controller.sample_seq, good.seq);
        assert_true(l.node.controller.extrapolation.now.force_N[0] == 0.0f);
    }
}

static void foreign_patch_uses_no_buffer(void **state) {
    (void)state;
    loop_press(&l, HRT_LOCAL_MODEL);
    l.seq++;
    const tensormass_contact_patch_t own = loop_patch(l.session, l.seq, 0.003f),
                                     foreign = loop_patch(l.session + 1, l.seq, 0.003f);
    tensormass_force_sample_t sample = loop_sample(&l, &l.tool);
    assert_int_equal(hrt_node_post_patch(&l.node, &own), HRT_ACCEPT);
    assert_int_equal(hrt_node_post_patch(&l.node, &foreign), HRT_REJECT_FOREIGN);
    assert_int_equal(hrt_node_post_sample(&l.node, &sample), HRT_ACCEPT);
    l.next_frame_us = l.now_us + l.frame_us;
    loop_tick(&l);
    assert_non_null(l.node.controller.extrapolation.patch);
}

/* Samples of a simulation that has received no tool state yet are not accepted, and not counted as rejected. */
static void sample_without_tool_state_is_ignored_and_not_reported(void **state) {
    (void)state;
    loop_press(&l, HRT_HOLD);
    tensormass_force_sample_t s = forged();
    const uint32_t rejected = atomic_load(&l.node.rejected);
    s.tool_session = 0;
    assert_int_equal(hrt_node_post_sample(&l.node, &s), HRT_REJECT_FOREIGN);
    assert_int_equal(atomic_load(&l.node.rejected), rejected);
    s.tool_session = l.node.config.session + 1;
    assert_int_equal(hrt_node_post_sample(&l.node, &s), HRT_REJECT_FOREIGN);
    assert_int_equal(atomic_load(&l.node.rejected), rejected + 1);
}

/* Not while its force is rendered, however long it is silent; then after a second of silence. */
static void another_simulation_is_accepted_after_a_second_of_silence(void **state) {
    (void)state;
    loop_press(&l, HRT_LOCAL_MODEL);
    tensormass_force_sample_t s = forged();
    s.session++;
    for (int k = 0; k < 1000; k++) { /* a flood of foreign samples together with the real ones */
        s.seq++;
        s.tool_utime = l.tool.utime;
        assert_int_equal(hrt_node_post_sample(&l.node, &s), HRT_REJECT_FOREIGN);
        loop_tick(&l);
        assert_true(fabs((double)l.node.result.force_N[0]) < 0.05 && loop_force(&l) > 1.5);
    }
    l.sim_alive = false;
    const int64_t last_us = l.node.gate.heard_us;
    while (l.now_us - last_us < 990000) {
        s.seq++;
        s.tool_utime = l.tool.utime;
        hrt_node_post_sample(&l.node, &s);
        loop_tick(&l);
        assert_true(fabs((double)l.node.result.force_N[0]) < 0.05);
    }
    assert_true(loop_force(&l) == 0.0);
    loop_run(&l, 0.02);
    s.seq++;
    s.tool_utime = l.tool.utime;
    assert_int_equal(hrt_node_post_sample(&l.node, &s), HRT_ACCEPT);
}

/* t_n is this controller's own clock: a recorded sample is older than the newest one, however long the silence. */
static void recorded_samples_are_never_accepted(void **state) {
    (void)state;
    loop_press(&l, HRT_LOCAL_MODEL);
    tensormass_force_sample_t recorded[8];
    for (int k = 0; k < 8; k++) {
        loop_run(&l, 0.04);
        recorded[k] = loop_sample(&l, &l.tool);
        recorded[k].tool_utime -= 40000;
    }
    for (int silent = 0; silent < 2; silent++) {
        if (silent) {
            l.sim_alive = false;
            loop_run(&l, 1.5);
        }
        for (int k = 0; k < 8; k++) {
            if (silent) recorded[k].seq = l.seq + 100u + (uint32_t)k; /* and even with a later seq */
            assert_int_equal(hrt_node_post_sample(&l.node, &recorded[k]), HRT_REJECT_OLD);
            loop_tick(&l);
        }
    }
    assert_true(loop_force(&l) == 0.0);
}

static void no_reset_while_it_is_felt(void **state) {
    (void)state;
    const hrt_command reset = {.extrapolator = -1, .passivity = -1, .coupling = -1, .enable = -1, .reset = true};
    loop_press(&l, HRT_LOCAL_MODEL);
    for (int k = 0; k < 100; k++) {
        hrt_node_post_command(&l.node, &reset);
        loop_tick(&l);
        assert_false(l.node.input.reset);
        assert_int_equal(l.tool.state, HRT_ENGAGED);
        assert_true(hrt_node_in_use(&l.node));
    }
}

/* The load of a patch's row is bounded, like every other quantity. */
static void patch_with_an_unbounded_row_load_is_rejected(void **state) {
    (void)state;
    loop_press(&l, HRT_LOCAL_MODEL);
    const float cap[] = {50.0f, 1000.0f, 1001.0f, 3.0e38f};
    for (size_t k = 0; k < sizeof cap / sizeof *cap; k++) {
        tensormass_contact_patch_t m = loop_patch(l.session, l.seq + 1, 0.003f);
        m.force_cap_N = cap[k];
        assert_int_equal(hrt_node_post_patch(&l.node, &m), cap[k] > 1000.0f ? HRT_REJECT_HUGE : HRT_ACCEPT);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(unread_sample_is_kept_against_foreign_ones),
                                       cmocka_unit_test(foreign_patch_uses_no_buffer),
                                       cmocka_unit_test(sample_without_tool_state_is_ignored_and_not_reported),
                                       cmocka_unit_test(another_simulation_is_accepted_after_a_second_of_silence),
                                       cmocka_unit_test(recorded_samples_are_never_accepted),
                                       cmocka_unit_test(no_reset_while_it_is_felt),
                                       cmocka_unit_test(patch_with_an_unbounded_row_load_is_rejected)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
