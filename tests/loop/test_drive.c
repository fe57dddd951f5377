/* A desk device through the node (haptic_rt/io/drive.h), on a virtual clock: a minimal driver posts a cursor and
 * reads its force. Mapping, clutch, grip, silence, limits. */
// clang-format off
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>
// clang-format on

#include "io/drive.h"
#include "io/node.h"

typedef struct bench {
    hrt_bus none;
    hrt_drive drive;
    hrt_node node;
    tensormass_tool_state_t tool;
    int64_t now_us;
    uint32_t seq;
    double cursor_m[3], last_m[3], wall_N_m;
    float force_N[3]; /* at the cursor */
    double tip_J, cursor_J, last_tip_m[3];
    bool button[HRT_DRIVE_BUTTONS], dead, sim_dead;
} bench;

static bench b;

static void start(double scale, const char *device) {
    memset(&b, 0, sizeof b);
    hrt_node_config config = hrt_node_config_default(0);
    hrt_params_of_device(&config.params, hrt_device_types[hrt_device_type_find(device)]);
    for (int j = 0; j < 3; j++) config.params.counts_per_unit[j] = 500000.0f;
    config.pose_known = true;
    config.extrapolator = HRT_HOLD;
    b.drive.workspace = hrt_workspace_default();
    b.drive.workspace.scale = scale;
    hrt_drive_start(&b.drive, config.params.device);
    hrt_drive_up(&b.drive, true, NULL);
    hrt_node_init(&b.node, &config, &b.none);
    b.node.drive = &b.drive;
    b.now_us = 1000000;
    b.wall_N_m = 200.0;
}

/* A wall at the start's depth: it pushes the tip out of the body. */
static void sample(void) {
    tensormass_force_sample_t s = {
        .session = 7, .tool_session = b.tool.session, .tool_utime = b.now_us, .seq = (int32_t)++b.seq};
    for (int i = 0; i < 3; i++) s.tip_m[i] = b.tool.tip_m[i];
    s.force_N[2] = -b.wall_N_m * fmax(b.tool.tip_m[2] - 0.1, 0.0);
    hrt_node_post_sample(&b.node, &s);
}

static void tick(void) {
    hrt_drive_state state = {.time_us = b.now_us, .trigger = -1.0};
    memcpy(state.cursor_m, b.cursor_m, sizeof state.cursor_m);
    memcpy(state.button, b.button, sizeof state.button);
    if (!b.dead) hrt_drive_post(&b.drive, &state);
    const hrt_result was = b.node.result;
    hrt_node_tick(&b.node, b.now_us, &b.tool);
    const float *f = was.force_N;
    for (int i = 0; i < 3; i++) { /* work on the hand, and by the tip's force */
        b.cursor_J += (double)b.force_N[i] * (b.cursor_m[i] - b.last_m[i]);
        b.tip_J += (double)f[i] * (b.tool.tip_m[i] - b.last_tip_m[i]);
        b.last_tip_m[i] = b.tool.tip_m[i];
    }
    memcpy(b.last_m, b.cursor_m, sizeof b.last_m);
    hrt_drive_force(&b.drive, b.now_us, b.force_N);
    if (!b.sim_dead && b.now_us % 4000 == 0) sample();
    b.now_us += 2000;
}

static void run(double seconds, const double speed_m_s[3]) {
    for (int k = 0; k < (int)(seconds * 500.0); k++) {
        for (int i = 0; i < 3; i++) b.cursor_m[i] += 0.002 * speed_m_s[i];
        tick();
    }
}

static const double REST[3] = {0, 0, 0}, DOWN[3] = {0, 0, -0.02}, RIGHT[3] = {0.05, 0, 0}, AWAY[3] = {0, 0.05, 0};

static void axes_and_signs_agree_with_the_device(void **state) {
    (void)state;
    start(1.0, "inverse3");
    run(0.3, REST);
    assert_int_equal(b.tool.state, HRT_ENGAGED);
    assert_true(fabs(b.tool.tip_m[2] - 0.1) < 1e-5);
    run(1.0, RIGHT);
    run(1.0, AWAY);
    run(1.0, DOWN);
    run(0.3, REST);
    assert_true(fabs(b.tool.tip_m[0] + 0.05) < 1e-5 && fabs(b.tool.tip_m[1] - 0.05) < 1e-5);
    assert_true(fabs(b.tool.tip_m[2] - 0.12) < 1e-5);
    /* 200 N/m, 20 mm deep: the hand is pushed up with 4 N. */
    assert_true(fabs((double)b.force_N[2] - 4.0) < 0.05 && fabsf(b.force_N[0]) < 1e-3f);
}

/* For each scale: the cursor's force is the tip's times min(scale, 1); its work never exceeds the tip's. */
static void power_is_never_amplified(void **state) {
    (void)state;
    const double scales[] = {0.25, 0.5, 1.0, 2.0};
    for (size_t k = 0; k < sizeof scales / sizeof *scales; k++) {
        start(scales[k], "inverse3");
        run(0.6, REST);
        for (int turn = 0; turn < 4; turn++) {
            const double up[3] = {0, 0, 0.02};
            run(0.4, DOWN);
            const double tip_N = (double)b.node.result.force_N[2], cursor_N = (double)b.force_N[2];
            assert_true(tip_N < -0.1 && fabs(cursor_N + fmin(scales[k], 1.0) * tip_N) < 1e-5);
            const double tip_before = b.tip_J, cursor_before = b.cursor_J;
            run(0.4, up); /* the wall returns its energy to the hand */
            assert_true(b.cursor_J - cursor_before > 0.0);
            assert_true(b.cursor_J - cursor_before <= (b.tip_J - tip_before) * (1.0 + 1e-3) + 1e-6);
        }
    }
}

static void the_clutch_recentres_without_a_jump(void **state) {
    (void)state;
    start(1.0, "inverse3");
    run(0.3, REST);
    run(0.5, DOWN);
    assert_true((double)b.force_N[2] > 1.5);
    b.button[0] = true;
    float last = b.force_N[2];
    double tip = 0.0;
    for (int k = 0; k < 250; k++) {
        const double before_m = b.tool.tip_m[2];
        b.cursor_m[2] += 0.002 * 0.1; /* up by 5 cm */
        tick();
        if (k > 0 && b.force_N[2] > 0.0f)
            assert_true(fabs(b.tool.tip_m[2] - before_m + 0.0002) < 1e-5); /* the force follows */
        assert_true(b.force_N[2] <= last + 1e-6f);                         /* it fades */
        assert_true(last - b.force_N[2] < 1.3f);                           /* gradually */
        last = b.force_N[2];
        if (k == 60) tip = b.tool.tip_m[2];
        if (k > 30) assert_true(b.force_N[2] == 0.0f); /* 40 ms and two ticks */
        if (k > 60) assert_true(b.tool.tip_m[2] == tip);
    }
    b.button[0] = false;
    tick();
    assert_true(fabs(b.tool.tip_m[2] - tip) < 1e-5); /* the tip continues where it was */
    assert_true(b.force_N[2] < 0.05f);               /* and the force ramps up */
    run(0.3, DOWN);
    assert_int_equal(b.tool.state, HRT_ENGAGED);
    assert_true(b.tool.tip_m[2] > tip + 0.005 && b.node.result.fault == HRT_FAULT_NONE);
}

static void a_button_closes_the_grip(void **state) {
    (void)state;
    start(1.0, "touch");
    run(0.3, REST);
    const int grip = b.node.config.params.device->grip;
    b.button[1] = true;
    double last = b.tool.joint[grip];
    for (int k = 0; k < 100; k++) {
        tick();
        assert_true(b.tool.joint[grip] - last < 0.02);
        last = b.tool.joint[grip];
    }
    assert_true(last > 0.99 && b.tool.active && b.node.result.fault == HRT_FAULT_NONE);
}

static void silence_of_either_side_is_zero_force(void **state) {
    (void)state;
    for (int who = 0; who < 3; who++) {
        start(1.0, "inverse3");
        run(0.3, REST);
        run(0.5, DOWN);
        assert_true(b.force_N[2] > 1.5f);
        if (who == 0) b.dead = true; /* the device */
        if (who == 1) hrt_drive_up(&b.drive, false, NULL);
        if (who < 2) {
            run(who == 0 ? 0.016 : 0.002, REST);
            assert_true(b.node.result.force_N[2] == 0.0f && b.force_N[2] == 0.0f);
        } else { /* the tick: no commands any more */
            hrt_drive_state state_now = {.trigger = -1.0};
            memcpy(state_now.cursor_m, b.cursor_m, sizeof state_now.cursor_m);
            state_now.time_us = b.now_us + 17000;
            hrt_drive_post(&b.drive, &state_now);
            hrt_drive_force(&b.drive, b.now_us + 17000, b.force_N);
            const bool was = b.force_N[2] > 1.5f;
            hrt_drive_force(&b.drive, b.now_us + 19000, b.force_N);
            assert_true(was && b.force_N[2] == 0.0f && atomic_load(&b.drive.withheld) > 0);
        }
    }
}

/* Input that no device can send; ten in a row are a fault, which a reset clears. */
static void invalid_input_is_rejected_and_ten_in_a_row_are_a_fault(void **state) {
    (void)state;
    const double bad[] = {NAN, INFINITY, -INFINITY, 1.5, -1e300};
    start(1.0, "inverse3");
    run(0.3, REST);
    run(0.5, DOWN);
    for (int k = 0; k < 20; k++) {
        hrt_drive_state s = {.time_us = b.now_us, .trigger = -1.0};
        s.cursor_m[k % 3] = bad[k % 5];
        assert_false(hrt_drive_post(&b.drive, &s));
        if (k == 8) assert_int_equal(atomic_load(&b.drive.fault), HRT_DRIVE_FINE);
    }
    hrt_drive_force(&b.drive, b.now_us, b.force_N);
    assert_true(b.force_N[2] == 0.0f);
    tick();
    assert_int_equal(b.node.result.fault, HRT_FAULT_DEVICE_REPORTED);
    assert_int_equal(b.node.result.fault_detail, HRT_DRIVE_NONSENSE);
    const hrt_command reset = {.extrapolator = -1, .passivity = -1, .coupling = -1, .enable = -1, .reset = true};
    hrt_node_post_command(&b.node, &reset);
    run(1.0, REST);
    assert_int_equal(b.tool.state, HRT_ENGAGED);
}

/* The last limit reduces a force that the core would never send, and keeps its direction. */
static void last_force_limit_keeps_the_direction(void **state) {
    (void)state;
    start(1.0, "touch");
    const hrt_result push = {.motors_on = true, .torque = {-6.0f, 8.0f, 0.0f}};
    const hrt_drive_state here = {.time_us = b.now_us, .trigger = -1.0};
    hrt_drive_post(&b.drive, &here);
    hrt_drive_give(&b.drive, b.now_us, &push, false);
    hrt_drive_force(&b.drive, b.now_us, b.force_N);
    assert_true(fabsf(b.force_N[0] - 0.6f * 3.3f) < 1e-5f && fabsf(b.force_N[1] - 0.8f * 3.3f) < 1e-5f);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(axes_and_signs_agree_with_the_device),
                                       cmocka_unit_test(power_is_never_amplified),
                                       cmocka_unit_test(the_clutch_recentres_without_a_jump),
                                       cmocka_unit_test(a_button_closes_the_grip),
                                       cmocka_unit_test(silence_of_either_side_is_zero_force),
                                       cmocka_unit_test(invalid_input_is_rejected_and_ten_in_a_row_are_a_fault),
                                       cmocka_unit_test(last_force_limit_keeps_the_direction)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
