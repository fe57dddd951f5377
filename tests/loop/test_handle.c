/* The virtual device's handle turns under the torque that it is sent (device/handle.h): against the hand's hold, with
 * the work of the tip's force, and without gaining energy. A wall across the shaft takes the simulation's place. */
#include "loop.h"

static loop l;
static double push_N, wall_N_m; /* at the tip along x; a wall from x = 0 */

static void start(float torque_max_Nm, double damping, bool passivity) {
    const int32_t type = hrt_device_type_find("crtk_handle");
    hrt_device_config d = hrt_device_config_of(hrt_device_types[type], 0);
    hrt_node_config n = loop_node_config();
    for (int j = 0; j < HRT_MOTORS; j++) {
        d.coulomb[j] = 0.0;
        d.hand_damping[j] *= damping;
    }
    d.turning.coulomb_Nm = 0.0;
    d.turning.hand_damping_Nm_s *= damping;
    d.profile.handle_torque_max_Nm = torque_max_Nm;
    n.params = d.profile;
    n.pose.is_free = true;
    n.extrapolator = HRT_HOLD;
    n.passivity = passivity;
    loop_start(&l, &d, &n);
    push_N = wall_N_m = 0.0;
}

static void tick(void) {
    hrt_device_step(&l.device, l.now_us);
    hrt_node_tick(&l.node, l.now_us, &l.tool);
    if (l.now_us >= l.next_frame_us && l.tool.state >= HRT_IDLE) {
        l.seq++;
        tensormass_force_sample_t s = loop_sample(&l, &l.tool);
        s.force_N[0] = push_N - wall_N_m * fmax(l.tool.tip_m[0], 0.0);
        s.force_N[2] = 0.0;
        hrt_node_post_sample(&l.node, &s);
        l.next_frame_us += l.frame_us;
    }
    l.now_us += l.period_us;
}

static void run(double seconds) {
    for (int64_t until = l.now_us + (int64_t)(seconds * 1e6); l.now_us < until;) tick();
}

/* Makes the hand hold the tip at `tip_m` of x, the handle upright or leant towards x. */
static void hold(double tip_m, double tilt_rad) {
    const double joint[HRT_JOINTS] = {tip_m, 0.0, 0.1, 0.0, 0.0, tilt_rad, 0.0};
    hrt_device_hand(&l.device, joint, false);
}

/* 1 N at the tip, an arm of 0.1 m, 3 N m/rad: 0.0333 rad. The tip gives way by 3.3 mm of the slides, and as much. */
static void torque_turns_the_handle_against_the_hand(void **state) {
    (void)state;
    start(0.2f, 1.0, true);
    hold(0.0, 0.0);
    push_N = 1.0;
    run(3.0);
    assert_int_equal(l.tool.state, HRT_ENGAGED);
    const double tilt = l.device.joint[HRT_TILT];
    assert_true(fabs(l.device.handle_Nm[1] - 0.1 * cos(tilt)) < 3e-4 && fabs(l.device.handle_Nm[0]) < 3e-4);
    assert_true(fabs(tilt - l.device.handle_Nm[1] / 3.0) < 1e-4 && fabs(l.device.joint[HRT_TILT + 1]) < 1e-4);
    assert_true(fabs(l.device.joint[0] - (1.0 / 300.0 + 0.1 * sin(tilt))) < 2e-5);
    push_N = -1.0; /* and back */
    run(3.0);
    assert_true(fabs(l.device.joint[HRT_TILT] + tilt) < 1e-4);
    start(0.0f, 1.0, true); /* no torque: the handle stays, and only the slides give way */
    hold(0.0, 0.0);
    push_N = 1.0;
    run(3.0);
    assert_true(l.device.joint[HRT_TILT] == 0.0 && fabs(l.device.joint[0] - 1.0 / 300.0) < 2e-5);
}

/* A torque without its command, or after the watchdog, does not act. */
static void torque_ends_with_its_commands(void **state) {
    (void)state;
    start(0.2f, 1.0, true);
    hold(0.0, 0.0);
    push_N = 1.0;
    run(2.0);
    assert_true(l.device.handle_Nm[1] > 0.09);
    for (int k = 0; k < 15; k++) hrt_device_step(&l.device, l.now_us += 2000);
    assert_true(l.device.fault == HRT_DEVICE_WATCHDOG && l.device.handle_Nm[1] == 0.0 && l.device.torque[0] == 0.0);
}

/* The hand sways and leans in a wall: force at the point and torque do together the work that the observer counts. */
static void force_and_torque_do_the_observers_work(void **state) {
    (void)state;
    start(0.2f, 1.0, false);
    wall_N_m = 200.0;
    l.frame_us = 4000;
    hold(0.004, 0.0);
    run(1.0);
    double work_J = 0.0, turned_J = 0.0, off_J = 0.0;
    const double before_J = (double)l.node.result.passivity_J;
    for (int k = 0; k < 1500; k++) {
        const double time_s = 0.002 * k, was[3] = {l.device.joint[0], l.device.joint[1], l.device.joint[2]};
        double point[3], from[3], to[3], turned[3];
        hold(0.005 + 0.003 * sin(5.0 * time_s), 0.05 * sin(8.0 * time_s));
        memcpy(from, l.device.handle.direction, sizeof from);
        tick();
        memcpy(to, l.device.handle.direction, sizeof to);
        for (int i = 0; i < 3; i++) {
            const int j = (i + 1) % 3, m = (i + 2) % 3;
            point[i] = l.device.joint[i] - was[i] - 0.1 * (to[i] - from[i]);
            turned[i] = from[j] * to[m] - from[m] * to[j];
        }
        for (int i = 0; i < 3; i++) {
            work_J += l.device.torque[i] * point[i];
            turned_J += l.device.handle_Nm[i] * turned[i];
        }
        off_J = fmax(off_J, fabs(work_J + turned_J - ((double)l.node.result.passivity_J - before_J)));
    }
    print_message("force %.3f mJ, torque %.3f mJ, together off the observer by %.3f mJ at most\n", 1e3 * work_J,
                  1e3 * turned_J, 1e3 * off_J);
    assert_true(fabs(work_J) > 3e-3 && fabs(turned_J) > 3e-3 && off_J < 1e-4);
}

/* Returns the tip's remaining way along x in two seconds, m. */
static double swing(void) {
    double low = 1.0, high = -1.0;
    for (int i = 0; i < 1000; i++) {
        tick();
        low = fmin(low, l.device.joint[0]);
        high = fmax(high, l.device.joint[0]);
    }
    return high - low;
}

/* Returns the swing at a wall, the hand light, with passivity control of this largest damping (0: off). */
static double shake(double wall, float damping_N_s_m) {
    start(0.2f, 0.3, damping_N_s_m > 0.0f);
    l.node.controller.params.passivity_damping_max_N_s_m = damping_N_s_m;
    wall_N_m = wall;
    hold(0.004, 0.0);
    run(4.0);
    const double left_m = swing();
    assert_int_equal(l.tool.state, HRT_ENGAGED);
    assert_true(fabs(l.device.joint[HRT_TILT]) > 0.001);
    return left_m;
}

/* A stiff wall at 25 samples a second shakes slides and handle. Passivity control damps them; its usual damping of 20
 * N s/m is too little at 1000 N/m. */
static void passivity_control_damps_a_shaking_handle(void **state) {
    (void)state;
    const struct {
        double wall;
        float damping_N_s_m;
        double most_m;
    } at[] = {{300.0, 20.0f, 0.0002}, {600.0, 20.0f, 0.0002}, {1000.0, 20.0f, 0.002}, {1000.0, 30.0f, 0.0002}};
    for (size_t i = 0; i < sizeof at / sizeof *at; i++) {
        const double without_m = shake(at[i].wall, 0.0f), with_m = shake(at[i].wall, at[i].damping_N_s_m);
        print_message(
            "wall across the shaft %.0f N/m: swings %.2f mm without passivity control, %.2f mm with %.0f N s/m\n",
            at[i].wall, 1e3 * without_m, 1e3 * with_m, (double)at[i].damping_N_s_m);
        assert_true(without_m > 0.005 && with_m < at[i].most_m);
        if (at[i].most_m < 0.001) assert_true(l.node.result.passivity_J < 0.01f);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(torque_turns_the_handle_against_the_hand),
                                       cmocka_unit_test(torque_ends_with_its_commands),
                                       cmocka_unit_test(force_and_torque_do_the_observers_work),
                                       cmocka_unit_test(passivity_control_damps_a_shaking_handle)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
