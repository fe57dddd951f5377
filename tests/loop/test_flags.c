/* What the simulation says of a sample, planted one by one between it and the hand: the rule of core/flags.c for each,
 * seen in the force that the device's motors get. */
// clang-format off
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <cmocka.h>
// clang-format on

#include "loop.h"

static loop l;
static int32_t planted;

static double force(void) { return fabs((double)l.node.output.force_N[2]); }
static double motor(void) { return fabs(l.device.torque[HRT_INSERTION]); }

/* As loop_tick, the frames' samples flagged. */
static void tick(void) {
    hrt_device_step(&l.device, l.now_us);
    hrt_node_tick(&l.node, l.now_us, &l.tool);
    if (l.now_us >= l.next_frame_us) {
        l.seq++;
        tensormass_force_sample_t s = loop_sample(&l, &l.tool);
        s.flags = planted;
        if (planted & HRT_FLAG_UNSTABLE) s.force_N[0] = s.force_N[2] = 50.0; /* what must never be felt */
        hrt_node_post_sample(&l.node, &s);
        l.next_frame_us += l.frame_us;
    }
    l.now_us += 2000;
}

static void run(double seconds) {
    for (int64_t until = l.now_us + (int64_t)(seconds * 1e6); l.now_us < until;) tick();
}

static void press(hrt_extrapolator which) {
    const hrt_device_config d = loop_device_config();
    hrt_node_config n = loop_node_config();
    n.extrapolator = which;
    planted = 0;
    loop_start(&l, &d, &n);
    l.send_stiffness = true;
    run(2.0);
    assert_int_equal(l.tool.state, HRT_ENGAGED);
    assert_true(force() > 2.0 && motor() > 2.0);
}

static const int32_t whole[] = {0, HRT_FLAG_CAPPED, HRT_FLAG_OVERRAN, HRT_FLAG_PATCH,
                                HRT_FLAG_CAPPED | HRT_FLAG_OVERRAN | HRT_FLAG_PATCH};
static const int32_t force_only[] = {HRT_FLAG_OVERFLOWED, HRT_FLAG_UNCONVERGED, HRT_FLAG_TOO_FAST,
                                     HRT_FLAG_INSIDE,     HRT_FLAG_LETTING_GO,  HRT_FLAG_INSIDE | HRT_FLAG_CAPPED};

static void taken_whole(void **state) {
    (void)state;
    for (size_t k = 0; k < sizeof whole / sizeof *whole; k++) {
        press(HRT_TANGENT);
        planted = whole[k];
        run(0.5);
        assert_int_equal(l.tool.state, HRT_ENGAGED);
        assert_true(force() > 2.0);
        assert_int_equal(l.node.controller.extrapolation.now.stiffness_kind, 2);
        assert_int_equal(l.node.output.limits & (HRT_LIMIT_DOUBT | HRT_LIMIT_HELD | HRT_LIMIT_UNSTABLE), 0);
    }
}

static void of_some_the_force_alone(void **state) {
    (void)state;
    for (size_t k = 0; k < sizeof force_only / sizeof *force_only; k++) {
        press(HRT_TANGENT);
        planted = force_only[k];
        run(0.5);
        assert_int_equal(l.tool.state, HRT_ENGAGED);
        assert_true(force() > 2.0 && motor() > 2.0);
        assert_int_equal(l.node.controller.extrapolation.now.stiffness_kind, 0);
        assert_null(l.node.controller.extrapolation.patch);
        assert_true(l.node.output.limits & HRT_LIMIT_DOUBT);
        planted = 0;
        run(0.1);
        assert_int_equal(l.node.controller.extrapolation.now.stiffness_kind, 2);
        assert_int_equal(l.node.output.limits & HRT_LIMIT_DOUBT, 0);
    }
}

/* A patch that comes with a doubtful sample is not used either. */
static void nor_its_patch(void **state) {
    (void)state;
    for (int doubt = 0; doubt < 2; doubt++) {
        press(HRT_CONTACT);
        l.seq++;
        tensormass_contact_patch_t patch = {
            .session = l.session,
            .seq = (int32_t)l.seq,
            .vertex_count = 3,
            .triangle_count = 1,
            .vertex_m = {-0.05f, -0.05f, 0.12f, 0.05f, -0.05f, 0.12f, 0.0f, 0.05f, 0.12f},
            .triangle = {0, 2, 1},
            .radius_m = 0.0025f,
            .contact_length_m = 0.02f};
        for (int i = 0, at = 0; i < 9; at += 9 - i, i++) patch.compliance_m_N[at] = 0.003f;
        assert_int_equal(hrt_node_post_patch(&l.node, &patch), HRT_ACCEPT);
        tensormass_force_sample_t s = loop_sample(&l, &l.tool);
        s.flags = HRT_FLAG_PATCH | (doubt ? HRT_FLAG_INSIDE : 0);
        assert_int_equal(hrt_node_post_sample(&l.node, &s), HRT_ACCEPT);
        l.next_frame_us = l.now_us + l.frame_us;
        tick();
        assert_true((l.node.controller.extrapolation.patch == NULL) == (doubt == 1));
    }
}

/* A reaction given again is no news: a frame of it is bridged, many are silence. */
static void held_over_grows_old(void **state) {
    (void)state;
    press(HRT_POSITION);
    const int64_t good_us = l.node.controller.sample_us;
    planted = HRT_FLAG_HELD_OVER;
    run(0.06);
    assert_int_equal(l.tool.state, HRT_ENGAGED);
    assert_true(l.node.output.limits & HRT_LIMIT_HELD);
    assert_int_equal(l.node.controller.sample_us, good_us);
    while (l.now_us - good_us <= 150000) tick();
    assert_true(force() == 0.0 && motor() == 0.0);
    run(1.0);
    assert_int_equal(l.tool.state, HRT_IDLE); /* nor does it let engage */
    planted = 0;
    run(1.0);
    assert_int_equal(l.tool.state, HRT_ENGAGED);
    assert_true(force() > 2.0);
}

/* Never rendered, and what was before it fades at once, within fade_us. */
static void unstable_fades_at_once(void **state) {
    (void)state;
    press(HRT_POSITION);
    const double before = force();
    planted = HRT_FLAG_UNSTABLE;
    l.next_frame_us = l.now_us;
    tick();
    const int64_t told_us = l.now_us;
    while (l.now_us - told_us <= 46000) {
        tick();
        assert_true(force() <= before * 1.05);
        assert_true(fabs((double)l.node.output.force_N[0]) < 0.05);
        assert_true(l.node.output.limits & HRT_LIMIT_UNSTABLE);
    }
    assert_true(force() == 0.0 && motor() == 0.0);
    planted = HRT_FLAG_HELD_OVER; /* which is no good news either */
    run(1.0);
    assert_int_equal(l.tool.state, HRT_IDLE);
    assert_true(force() == 0.0);
    planted = 0;
    run(1.0);
    assert_int_equal(l.tool.state, HRT_ENGAGED);
    assert_true(force() > 2.0);
}

/* One unstable frame among good ones: it dips and comes back, never above. */
static void one_unstable_frame(void **state) {
    (void)state;
    press(HRT_POSITION);
    const double before = force();
    double least = before, most = 0.0;
    planted = HRT_FLAG_UNSTABLE;
    l.next_frame_us = l.now_us;
    tick();
    planted = 0;
    for (int i = 0; i < 250; i++) {
        tick();
        least = fmin(least, force());
        most = fmax(most, force());
    }
    assert_true(least < 0.5 * before && most < 1.2 * before);
    assert_int_equal(l.tool.state, HRT_ENGAGED);
    assert_true(force() > 2.0);
}

static void unknown_flags_are_no_sample(void **state) {
    (void)state;
    press(HRT_POSITION);
    for (int bit = 10; bit < 32; bit++) {
        tensormass_force_sample_t s = loop_sample(&l, &l.tool);
        s.seq += 1;
        s.flags = (int32_t)(1u << bit);
        assert_int_equal(hrt_node_post_sample(&l.node, &s), HRT_REJECT_INDEX);
    }
    assert_int_equal(hrt_flags_rule(0), HRT_RULE_TAKE);
    assert_int_equal(hrt_flags_rule(511), HRT_RULE_FADE);
    assert_int_equal(hrt_flags_rule(1024), HRT_RULE_REFUSE);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(taken_whole),
                                       cmocka_unit_test(of_some_the_force_alone),
                                       cmocka_unit_test(nor_its_patch),
                                       cmocka_unit_test(held_over_grows_old),
                                       cmocka_unit_test(unstable_fades_at_once),
                                       cmocka_unit_test(one_unstable_frame),
                                       cmocka_unit_test(unknown_flags_are_no_sample)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
