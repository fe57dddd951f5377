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
    double cursor_m[3], last_m[3], wall_N_m, orientation[4];
    float force_N[3], torque_Nm[3]; /* at the cursor */
    double turned_rad[3];           /* by turn_handle since the last tick, about the user's axes */
    double turned_J, push_N;        /* work of the torque; a force across the wall */
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
    config.pose.is_free = config.params.device->tilts;
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
    s.force_N[0] = b.push_N;
    s.force_N[2] = -b.wall_N_m * fmax(b.tool.tip_m[2] - 0.1, 0.0);
    hrt_node_post_sample(&b.node, &s);
}

static void tick(void) {
    hrt_drive_state state = {.time_us = b.now_us, .trigger = -1.0};
    memcpy(state.cursor_m, b.cursor_m, sizeof state.cursor_m);
    memcpy(state.button, b.button, sizeof state.button);
    memcpy(state.orientation, b.orientation, sizeof state.orientation);
    if (!b.dead) hrt_drive_post(&b.drive, &state);
    const hrt_result was = b.node.result;
    hrt_node_tick(&b.node, b.now_us, &b.tool);
    const float *f = was.force_N;
    for (int i = 0; i < 3; i++) { /* work on the hand, and by the tip's force */
        b.cursor_J += (double)b.force_N[i] * (b.cursor_m[i] - b.last_m[i]);
        b.turned_J += (double)b.torque_Nm[i] * b.turned_rad[i];
        b.turned_rad[i] = 0.0;
        b.tip_J += (double)f[i] * (b.tool.tip_m[i] - b.last_tip_m[i]);
        b.last_tip_m[i] = b.tool.tip_m[i];
    }
    memcpy(b.last_m, b.cursor_m, sizeof b.last_m);
    hrt_drive_wrench(&b.drive, b.now_us, b.force_N, b.torque_Nm);
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

/* Turns the handle by `angle` about a user axis, after its present orientation if `own`, else before it. */
static void turn_handle(int axis, double angle, bool own) {
    if (!own) b.turned_rad[axis] += angle;
    const double *a = b.orientation;
    double r[4] = {0, 0, 0, cos(0.5 * angle)}, c[4];
    r[axis] = sin(0.5 * angle);
    const double *l = own ? a : r, *q = own ? r : a;
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        c[i] = l[3] * q[i] + q[3] * l[i] + l[j] * q[k] - l[k] * q[j];
    }
    c[3] = l[3] * q[3] - l[0] * q[0] - l[1] * q[1] - l[2] * q[2];
    memcpy(b.orientation, c, sizeof c);
}

static void start_free(double scale, const char *device) {
    start(scale, device);
    b.orientation[3] = 1.0;
    run(0.3, REST);
    assert_int_equal(b.tool.state, HRT_ENGAGED);
}

/* Upright the shaft is straight; leant away and to the right, the tilt is towards y and -x of the tip's axes. */
static void the_handle_gives_the_direction_of_a_free_shaft(void **state) {
    (void)state;
    for (int axis = 0; axis < 3; axis++)
        for (int side = -1; side < 2; side += 2) {
            start_free(1.0, "inverse3_versegrip");
            for (int k = 0; k < 100; k++) turn_handle(axis, 0.01 * side, false), tick();
            run(0.01, REST);
            const double *joint = b.tool.joint,
                         wanted[3] = {axis == 1 ? side : 0, axis == 0 ? side : 0, axis == 2 ? side : 0};
            assert_true(fabs(joint[HRT_TILT] - wanted[0]) < 2e-4 && fabs(joint[HRT_TILT + 1] - wanted[1]) < 2e-4);
            assert_true(fabs(joint[3] - wanted[2]) < 2e-3 && b.node.result.fault == HRT_FAULT_NONE);
            float e[3];
            hrt_direction(&b.node.controller.axes, b.node.result.joint, e);
            assert_true(fabs((double)e[2] - (axis == 2 ? 1 : cos(1.0))) < 1e-3);
        }
}

/* While the clutch is pressed the handle turns freely; on release shaft and roll continue, and follow the same turns.
 */
static void the_clutch_does_not_turn_the_shaft(void **state) {
    (void)state;
    start_free(1.0, "touch_stylus");
    for (int k = 0; k < 50; k++) turn_handle(0, 0.01, false), tick();
    b.button[0] = true;
    run(0.2, REST); /* the force fades */
    double held[HRT_JOINTS];
    memcpy(held, b.tool.joint, sizeof held);
    for (int k = 0; k < 100; k++) {
        turn_handle(k % 3, 0.02, true), tick();
        assert_true(!memcmp(b.tool.joint + 3, held + 3, sizeof held - 3 * sizeof *held));
    }
    b.button[0] = false;
    tick();
    for (int j = 3; j < HRT_JOINTS; j++) assert_true(fabs(b.tool.joint[j] - held[j]) < 2e-3);
    for (int k = 0; k < 50; k++) turn_handle(0, -0.01, false), tick();
    run(0.01, REST);
    assert_true(fabs(b.tool.joint[HRT_TILT]) < 2e-3 && fabs(b.tool.joint[HRT_TILT + 1]) < 2e-3);
    assert_true(b.node.result.fault == HRT_FAULT_NONE);
}

/* A handle that spins, also through half a turn from the axis: no fault, bounded tilt, and no work but the tip's. */
static void turning_amplifies_no_power_and_raises_no_fault(void **state) {
    (void)state;
    start_free(0.5, "inverse3_versegrip");
    const double up[3] = {0, 0, 0.02};
    double worked_J = 0;
    for (int k = 0; k < 3000; k++) {
        turn_handle(k / 300 % 3, 0.03, k / 900 % 2);
        const double last[2] = {b.tool.joint[HRT_TILT], b.tool.joint[HRT_TILT + 1]};
        const double tip_J = b.tip_J, cursor_J = b.cursor_J;
        run(0.002, k / 200 % 2 ? up : DOWN);
        assert_true(hypot(b.tool.joint[HRT_TILT] - last[0], b.tool.joint[HRT_TILT + 1] - last[1]) < 0.121);
        assert_true(hypot(b.tool.joint[HRT_TILT], b.tool.joint[HRT_TILT + 1]) < 2.501);
        assert_true(b.cursor_J - cursor_J <= fabs(b.tip_J - tip_J) * (1.0 + 1e-3) + 1e-6);
        assert_int_equal(b.node.result.fault, HRT_FAULT_NONE);
        worked_J += fabs(b.cursor_J - cursor_J);
    }
    assert_true(worked_J > 1e-3);
    const double before = b.tool.joint[HRT_TILT];
    memset(b.orientation, 0, sizeof b.orientation); /* the handle is lost: the shaft stays */
    run(0.1, REST);
    assert_true(fabs(b.tool.joint[HRT_TILT] - before) < 0.13 && b.node.result.fault == HRT_FAULT_NONE);
}

/* A handle upright, 1 N to the left at the tip, 0.1 m below: 0.1 N m about the user's y axis. */
static void a_free_handle_gets_the_torque_of_the_tips_force(void **state) {
    (void)state;
    start_free(1.0, "crtk_handle");
    b.push_N = 1.0; /* along the tip's x axis: left */
    run(0.5, REST);
    assert_true(fabs((double)b.force_N[0] + 1.0) < 1e-3 && fabs((double)b.torque_Nm[1] - 0.1) < 1e-4);
    assert_true(fabsf(b.torque_Nm[0]) < 1e-5f && fabsf(b.torque_Nm[2]) < 1e-5f);
    for (int k = 0; k < 100; k++) turn_handle(1, 0.005, false), tick(); /* lean: the arm across the force is shorter */
    run(0.3, REST);
    assert_true(fabs(b.tool.tip_m[0] - 0.1 * sin(0.5)) < 1e-5);
    assert_true(fabs((double)b.torque_Nm[1] - 0.1 * cos(0.5)) < 5e-3);
    start_free(1.0, "touch_stylus"); /* no torque, and the tip stays at the cursor */
    b.push_N = 1.0;
    for (int k = 0; k < 100; k++) turn_handle(1, 0.005, false), tick();
    assert_true(fabs(b.tool.tip_m[0]) < 1e-6 && b.torque_Nm[1] == 0.0f);
}

/* Too large a torque scales force and torque, so that both keep the power of one force at the tip. */
static void the_torque_limit_scales_the_force_too(void **state) {
    (void)state;
    start_free(1.0, "crtk_handle");
    b.push_N = 4.0; /* 0.4 N m; the limit is 0.2 */
    run(0.5, REST);
    assert_true(fabs((double)b.force_N[0] + 2.0) < 1e-3 && (double)b.torque_Nm[1] < 0.2 &&
                (double)b.torque_Nm[1] > 0.1999);
    assert_true((b.node.result.limits & HRT_LIMIT_AXIS) != 0);
    b.drive.type = hrt_device_types[hrt_device_type_find("inverse3_versegrip")]; /* the driver's own limit */
    tick();
    assert_true(b.torque_Nm[1] == 0.0f);
}

/* Force and torque at the handle do the work of the tip's force, however handle and cursor move, times min(1, 1/scale).
 */
static void force_and_torque_do_the_work_of_the_tips_force(void **state) {
    (void)state;
    const double scales[] = {0.5, 1.0, 2.0}, up[3] = {0.01, 0.02, 0.02};
    for (size_t s = 0; s < sizeof scales / sizeof *scales; s++) {
        start_free(scales[s], "crtk_handle");
        b.push_N = 0.5;
        run(0.4, REST);
        const double tip_J = b.tip_J, handle_J = b.cursor_J + b.turned_J;
        double most_J = 0.0, worked_J = 0.0, turned_J = 0.0;
        for (int k = 0; k < 1000; k++) {
            turn_handle(k / 150 % 3, k / 450 % 2 ? 0.002 : -0.002, false);
            const double tip = b.tip_J, hand = b.cursor_J + b.turned_J, turned = b.turned_J;
            run(0.002, k / 200 % 2 ? up : DOWN);
            turned_J += fabs(b.turned_J - turned);
            worked_J += fabs(b.cursor_J + b.turned_J - hand);
            most_J = fmax(most_J, fabs(b.cursor_J + b.turned_J - hand - fmin(1.0, 1.0 / scales[s]) * (b.tip_J - tip)));
        }
        const double off_J = b.cursor_J + b.turned_J - handle_J - fmin(1.0, 1.0 / scales[s]) * (b.tip_J - tip_J);
        assert_int_equal(b.node.result.fault, HRT_FAULT_NONE);
        assert_true(worked_J > 0.005 && turned_J > 0.005);
        if (fabs(off_J) > 0.01 * worked_J || most_J > 6e-6 /* 3 N at a count of 2 um */)
            fail_msg("scale %g: off by %g J of %g, %g J in a tick", scales[s], off_J, worked_J, most_J);
    }
}

/* While the tip does not follow the handle, 2.5 rad away or turned faster than the tip may move, no torque acts. */
static void the_force_fades_where_the_tip_cannot_follow(void **state) {
    (void)state;
    start_free(1.0, "crtk_handle");
    b.push_N = 1.0;
    run(0.4, REST);
    for (int k = 0; k < 280; k++) turn_handle(0, 0.01, false), tick();
    run(0.1, REST);
    assert_true(b.torque_Nm[0] == 0.0f && b.torque_Nm[1] == 0.0f && b.force_N[0] == 0.0f);
    for (int k = 0; k < 100; k++) turn_handle(0, -0.01, false), tick();
    run(0.4, REST);
    assert_true(b.force_N[0] < -0.9f && b.node.result.fault == HRT_FAULT_NONE);
    turn_handle(1, 1.5, false);
    for (int k = 0; k < 30; k++) {
        const double last = b.tool.tip_m[0];
        tick();
        assert_true(fabs(b.tool.tip_m[0] - last) < 0.0041);
    }
    assert_int_equal(b.node.result.fault, HRT_FAULT_NONE);
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

/* A service answers late while the hand moves at 0.6 m/s: the state has the time of its request, and is no jump. */
static void a_late_state_is_no_jump(void **state) {
    (void)state;
    start(1.0, "inverse3");
    run(0.3, REST);
    assert_int_equal(b.tool.state, HRT_ENGAGED);
    const double before = b.tool.tip_m[0];
    b.dead = true;
    for (int k = 0; k < 7; k++) b.cursor_m[0] += 0.0012, tick();
    hrt_drive_state late = {.time_us = b.now_us - 14000, .trigger = -1.0};
    memcpy(late.cursor_m, b.cursor_m, sizeof late.cursor_m);
    hrt_drive_post(&b.drive, &late);
    tick();
    assert_true(fabs(b.tool.tip_m[0] - before + 0.0084) < 1e-5 && b.node.result.fault == HRT_FAULT_NONE);
    b.dead = false;
    run(0.02, REST);
    b.cursor_m[0] += 0.02; /* and a jump is one still */
    tick();
    assert_int_equal(b.node.result.fault, HRT_FAULT_ENCODER_JUMP);
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
                                       cmocka_unit_test(the_handle_gives_the_direction_of_a_free_shaft),
                                       cmocka_unit_test(the_clutch_does_not_turn_the_shaft),
                                       cmocka_unit_test(turning_amplifies_no_power_and_raises_no_fault),
                                       cmocka_unit_test(a_free_handle_gets_the_torque_of_the_tips_force),
                                       cmocka_unit_test(the_torque_limit_scales_the_force_too),
                                       cmocka_unit_test(force_and_torque_do_the_work_of_the_tips_force),
                                       cmocka_unit_test(the_force_fades_where_the_tip_cannot_follow),
                                       cmocka_unit_test(a_button_closes_the_grip),
                                       cmocka_unit_test(silence_of_either_side_is_zero_force),
                                       cmocka_unit_test(a_late_state_is_no_jump),
                                       cmocka_unit_test(invalid_input_is_rejected_and_ten_in_a_row_are_a_fault),
                                       cmocka_unit_test(last_force_limit_keeps_the_direction)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
