/* Passivity: the observer's account is exact, its controller stabilises an oscillating loop, the virtual coupling
 * bounds the rendered force; both can be disabled and monitored. */
// clang-format off
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <cmocka.h>
// clang-format on

#include "loop.h"

static loop l;

/* No dry friction and a soft hand: only the extrapolator and its damper damp the loop. */
static void start(hrt_extrapolator which, double wall_N_m, bool passivity, bool coupling) {
    hrt_device_config d = loop_device_config();
    hrt_node_config n = loop_node_config();
    n.extrapolator = which;
    n.passivity = passivity;
    n.coupling = coupling;
    n.params.coupling_N_m = 800.0f;
    for (int j = 0; j < HRT_MOTORS; j++) {
        d.hand_damping[j] *= 0.3;
        d.coulomb[j] = 0.0;
    }
    loop_start(&l, &d, &n);
    l.wall_N_m = wall_N_m;
    l.send_stiffness = true;
}

/* Returns the remaining amplitude of the device, m, during two seconds from now. */
static double swing(void) {
    double low = 1.0, high = 0.0;
    for (int i = 0; i < 1000; i++) {
        loop_tick(&l);
        low = fmin(low, l.device.joint[HRT_INSERTION]);
        high = fmax(high, l.device.joint[HRT_INSERTION]);
    }
    return high - low;
}

static void observer_account_equals_the_work(void **state) {
    (void)state;
    start(HRT_HOLD, 600.0, false, false);
    double work = 0.0, last_tip[3], last_force[3] = {0, 0, 0}, free_s = 0.0;
    bool engaged = false;
    for (int i = 0; i < 2000; i++) {
        for (int a = 0; a < 3; a++) last_tip[a] = l.tool.tip_m[a];
        loop_tick(&l);
        if (l.tool.state == HRT_ENGAGED && engaged)
            for (int a = 0; a < 3; a++) work += last_force[a] * (l.tool.tip_m[a] - last_tip[a]);
        engaged = l.tool.state == HRT_ENGAGED;
        double size = 0.0;
        for (int a = 0; a < 3; a++) size += fabs(last_force[a] = (double)l.node.result.force_N[a]);
        /* After 50 ms without contact the account is reset. */
        free_s = size > 0.0 ? 0.0 : free_s + 0.002;
        if (free_s > 0.06) work = 0.0;
        if (engaged && free_s == 0.0)
            assert_true(fabs(work - (double)l.node.result.passivity_J) < 2e-4 + 1e-3 * fabs(work));
    }
    assert_int_equal(l.tool.state, HRT_ENGAGED);
}

static void passivity_controller_damps_an_oscillating_loop(void **state) {
    (void)state;
    const double walls[] = {300.0, 600.0, 1000.0};
    for (int i = 0; i < 3; i++) {
        start(HRT_HOLD, walls[i], false, false);
        loop_run(&l, 4.0);
        const double without = swing();
        start(HRT_HOLD, walls[i], true, false);
        loop_run(&l, 4.0);
        const double with = swing();
        print_message("hold at 25 Hz, wall %.0f N/m: swings %.1f mm without passivity control, %.2f mm with\n",
                      walls[i], 1e3 * without, 1e3 * with);
        assert_true(without > 0.01 && with < 0.0005);
        assert_int_equal(l.tool.state, HRT_ENGAGED);
        assert_true(l.node.result.passivity_J < 0.01f);
    }
}

static void passivity_control_can_be_switched_while_running(void **state) {
    (void)state;
    start(HRT_HOLD, 600.0, false, false);
    loop_run(&l, 4.0);
    assert_true(swing() > 0.01);
    hrt_command command = {.extrapolator = -1, .passivity = 1, .coupling = -1, .enable = -1};
    hrt_node_post_command(&l.node, &command);
    tensormass_controller_status_t status;
    int active = 0;
    for (int i = 0; i < 1500; i++) {
        loop_tick(&l);
        active += (l.node.result.limits & HRT_LIMIT_PASSIVITY) != 0;
    }
    hrt_node_status(&l.node, &status);
    assert_int_equal(status.passivity_on, 1);
    assert_true(active > 10);
    assert_true(swing() < 0.001);
    command.passivity = 0;
    hrt_node_post_command(&l.node, &command);
    loop_run(&l, 0.1);
    hrt_node_status(&l.node, &status);
    assert_int_equal(status.passivity_on, 0);
    assert_int_equal(status.limits & HRT_LIMIT_PASSIVITY, 0);
}

/* Already passive: the controller does not intervene. */
static void passive_loop_is_not_changed(void **state) {
    (void)state;
    double swings[2], force[2];
    for (int on = 0; on < 2; on++) {
        start(HRT_TANGENT, 300.0, on == 1, false);
        loop_run(&l, 3.0);
        swings[on] = swing();
        force[on] = (double)l.node.result.force_N[2];
        assert_int_equal(l.node.result.limits & HRT_LIMIT_PASSIVITY, 0);
        assert_true(l.node.result.passivity_J < 0.0f); /* the spring stores the hand's work */
    }
    assert_true(swings[0] < 1e-5 && swings[1] < 1e-5);
    assert_true(fabs(force[0] - force[1]) < 0.02);
}

/* A wall too stiff for the loop is rendered as coupling and wall in series. */
static void the_coupling_bounds_the_stiffness(void **state) {
    (void)state;
    const double walls[] = {1000.0, 2000.0, 4000.0};
    for (int i = 0; i < 3; i++) {
        start(HRT_TANGENT, walls[i], false, false);
        loop_run(&l, 4.0);
        const double without = swing();
        start(HRT_TANGENT, walls[i], false, true);
        loop_run(&l, 4.0);
        const double with = swing();
        assert_true((l.node.result.limits & HRT_LIMIT_COUPLING) != 0);
        const double depth = l.device.joint[HRT_INSERTION] - l.wall_depth_m,
                     expected = depth / (1.0 / walls[i] + 1.0 / 800.0);
        print_message(
            "wall %.0f N/m: swings %.2f mm without coupling, %.3f mm with; %.2f N at %.2f mm, springs in a row give %.2f N\n",
            walls[i], 1e3 * without, 1e3 * with, -(double)l.node.result.force_N[2], 1e3 * depth, expected);
        assert_true(with < 1e-5);
        assert_true(fabs(-(double)l.node.result.force_N[2] - expected) < 0.03 * expected);
        if (walls[i] > 1500.0) assert_true(without > 0.005);
    }
    start(HRT_TANGENT, 300.0, false, true); /* already soft enough */
    loop_run(&l, 3.0);
    assert_int_equal(l.node.result.limits & HRT_LIMIT_COUPLING, 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(observer_account_equals_the_work),
                                       cmocka_unit_test(passivity_controller_damps_an_oscillating_loop),
                                       cmocka_unit_test(passivity_control_can_be_switched_while_running),
                                       cmocka_unit_test(passive_loop_is_not_changed),
                                       cmocka_unit_test(the_coupling_bounds_the_stiffness)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
