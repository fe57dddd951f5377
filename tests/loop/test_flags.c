/* Flags of a sample, planted one at a time between simulation and hand: checks the rule of core/flags.c for each
 * flag in the force of the device's motors. */
#include "loop.h"

static loop l;

static const int32_t whole[] = {0, HRT_FLAG_CAPPED, HRT_FLAG_OVERRAN, HRT_FLAG_PATCH,
                                HRT_FLAG_CAPPED | HRT_FLAG_OVERRAN | HRT_FLAG_PATCH};
static const int32_t force_only[] = {HRT_FLAG_OVERFLOWED, HRT_FLAG_UNCONVERGED, HRT_FLAG_TOO_FAST,
                                     HRT_FLAG_INSIDE,     HRT_FLAG_RELEASING,   HRT_FLAG_INSIDE | HRT_FLAG_CAPPED};

static void restricting_flags_keep_the_complete_sample(void **state) {
    (void)state;
    for (size_t k = 0; k < sizeof whole / sizeof *whole; k++) {
        loop_press(&l, HRT_TANGENT);
        l.flags = whole[k];
        loop_run(&l, 0.5);
        assert_int_equal(l.tool.state, HRT_ENGAGED);
        assert_true(loop_force(&l) > 2.0);
        assert_int_equal(l.node.controller.extrapolation.now.stiffness_kind, 2);
        assert_int_equal(l.node.result.limits & (HRT_LIMIT_FORCE_ONLY | HRT_LIMIT_REPEATED | HRT_LIMIT_UNSTABLE), 0);
    }
}

static void restricting_flags_drop_stiffness_and_patch(void **state) {
    (void)state;
    for (size_t k = 0; k < sizeof force_only / sizeof *force_only; k++) {
        loop_press(&l, HRT_TANGENT);
        l.flags = force_only[k];
        loop_run(&l, 0.5);
        assert_int_equal(l.tool.state, HRT_ENGAGED);
        assert_true(loop_force(&l) > 2.0 && loop_motor(&l) > 2.0);
        assert_int_equal(l.node.controller.extrapolation.now.stiffness_kind, 0);
        assert_null(l.node.controller.extrapolation.patch);
        assert_true(l.node.result.limits & HRT_LIMIT_FORCE_ONLY);
        l.flags = 0;
        loop_run(&l, 0.1);
        assert_int_equal(l.node.controller.extrapolation.now.stiffness_kind, 2);
        assert_int_equal(l.node.result.limits & HRT_LIMIT_FORCE_ONLY, 0);
    }
}

/* A patch that arrives with an unreliable sample is not used either. */
static void unreliable_samples_patch_is_not_used(void **state) {
    (void)state;
    for (int doubt = 0; doubt < 2; doubt++) {
        loop_press(&l, HRT_LOCAL_MODEL);
        l.seq++;
        const tensormass_contact_patch_t patch = loop_patch(l.session, l.seq, 0.003f);
        assert_int_equal(hrt_node_post_patch(&l.node, &patch), HRT_ACCEPT);
        tensormass_force_sample_t s = loop_sample(&l, &l.tool);
        s.flags = HRT_FLAG_PATCH | (doubt ? HRT_FLAG_INSIDE : 0);
        assert_int_equal(hrt_node_post_sample(&l.node, &s), HRT_ACCEPT);
        l.next_frame_us = l.now_us + l.frame_us;
        loop_tick(&l);
        assert_true((l.node.controller.extrapolation.patch == NULL) == (doubt == 1));
    }
}

/* A repeated reaction carries no new information: one frame of it is bridged, many count as silence. */
static void repeated_reaction_becomes_stale(void **state) {
    (void)state;
    loop_press(&l, HRT_POSITION);
    const int64_t good_us = l.node.controller.sample_us;
    l.flags = HRT_FLAG_REPEATED;
    loop_run(&l, 0.06);
    assert_int_equal(l.tool.state, HRT_ENGAGED);
    assert_true(l.node.result.limits & HRT_LIMIT_REPEATED);
    assert_int_equal(l.node.controller.sample_us, good_us);
    while (l.now_us - good_us <= 150000) loop_tick(&l);
    assert_true(loop_force(&l) == 0.0 && loop_motor(&l) == 0.0);
    loop_run(&l, 1.0);
    assert_int_equal(l.tool.state, HRT_IDLE); /* nor does it permit engaging */
    l.flags = 0;
    loop_run(&l, 1.0);
    assert_int_equal(l.tool.state, HRT_ENGAGED);
    assert_true(loop_force(&l) > 2.0);
}

/* An unstable frame is never rendered, and the force before it fades at once, within fade_us. */
static void unstable_fades_at_once(void **state) {
    (void)state;
    loop_press(&l, HRT_POSITION);
    const double before = loop_force(&l);
    l.flags = HRT_FLAG_UNSTABLE;
    l.next_frame_us = l.now_us;
    loop_tick(&l);
    const int64_t told_us = l.now_us;
    while (l.now_us - told_us <= 46000) {
        loop_tick(&l);
        assert_true(loop_force(&l) <= before * 1.05);
        assert_true(fabs((double)l.node.result.force_N[0]) < 0.05);
        assert_true(l.node.result.limits & HRT_LIMIT_UNSTABLE);
    }
    assert_true(loop_force(&l) == 0.0 && loop_motor(&l) == 0.0);
    l.flags = HRT_FLAG_REPEATED; /* which does not permit it either */
    loop_run(&l, 1.0);
    assert_int_equal(l.tool.state, HRT_IDLE);
    assert_true(loop_force(&l) == 0.0);
    l.flags = 0;
    loop_run(&l, 1.0);
    assert_int_equal(l.tool.state, HRT_ENGAGED);
    assert_true(loop_force(&l) > 2.0);
}

/* One unstable frame among good ones: the force dips and returns, never above. */
static void one_unstable_frame_dips_and_recovers(void **state) {
    (void)state;
    loop_press(&l, HRT_POSITION);
    const double before = loop_force(&l);
    double least = before, most = 0.0;
    l.flags = HRT_FLAG_UNSTABLE;
    l.next_frame_us = l.now_us;
    loop_tick(&l);
    l.flags = 0;
    for (int i = 0; i < 250; i++) {
        loop_tick(&l);
        least = fmin(least, loop_force(&l));
        most = fmax(most, loop_force(&l));
    }
    assert_true(least < 0.5 * before && most < 1.2 * before);
    assert_int_equal(l.tool.state, HRT_ENGAGED);
    assert_true(loop_force(&l) > 2.0);
}

static void unknown_flags_are_rejected(void **state) {
    (void)state;
    loop_press(&l, HRT_POSITION);
    for (int bit = 11; bit < 32; bit++) {
        tensormass_force_sample_t s = loop_sample(&l, &l.tool);
        s.seq += 1;
        s.flags = (int32_t)(1u << bit);
        assert_int_equal(hrt_node_post_sample(&l.node, &s), HRT_REJECT_INDEX);
    }
    assert_int_equal(hrt_flags_rule(0), HRT_RULE_TAKE);
    assert_int_equal(hrt_flags_rule(511), HRT_RULE_FADE);
    assert_int_equal(hrt_flags_rule(HRT_FLAG_CUTTING), HRT_RULE_TAKE);
    assert_int_equal(hrt_flags_rule(2048), HRT_RULE_REFUSE);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(restricting_flags_keep_the_complete_sample),
                                       cmocka_unit_test(restricting_flags_drop_stiffness_and_patch),
                                       cmocka_unit_test(unreliable_samples_patch_is_not_used),
                                       cmocka_unit_test(repeated_reaction_becomes_stale),
                                       cmocka_unit_test(unstable_fades_at_once),
                                       cmocka_unit_test(one_unstable_frame_dips_and_recovers),
                                       cmocka_unit_test(unknown_flags_are_rejected)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
