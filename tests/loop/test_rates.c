/* The closed loop at 500 to 4000 ticks a second: the same force and the same times, in seconds and not in ticks. */
#include "loop.h"

#include "core/internal.h"

static const int rates[] = {500, 1000, 2000, 4000};
enum { RATES = sizeof rates / sizeof rates[0] };

static loop l;

static void start_at(int rate, hrt_extrapolator which) {
    const hrt_device_config device = loop_device_config();
    hrt_node_config node = loop_node_config();
    node.extrapolator = which;
    node.params.period_us = 1.0e6f / (float)rate;
    loop_start(&l, &device, &node);
    l.send_stiffness = true;
}

static void the_hand_feels_the_same_wall_at_every_rate(void **state) {
    (void)state;
    double first = 0.0;
    for (int k = 0; k < RATES; k++) {
        start_at(rates[k], HRT_TANGENT);
        loop_run(&l, 3.0);
        if (k == 0) first = loop_force(&l);
        print_message("%d Hz: %.4f N\n", rates[k], loop_force(&l));
        assert_int_equal(l.tool.state, HRT_ENGAGED);
        assert_true(first > 2.0 && fabs(loop_force(&l) / first - 1.0) < 0.01);
    }
}

/* The tick's mean velocity is the way over the time: frames 0.25 ms apart do not count as 0.5 ms. */
static void the_velocity_is_that_of_the_hand_at_every_rate(void **state) {
    (void)state;
    for (int k = 0; k < RATES; k++) {
        double sum = 0.0, begin_m = 0.0;
        int ticks = 0;
        start_at(rates[k], HRT_HOLD);
        l.wall_depth_m = 1.0; /* no contact */
        for (loop_run(&l, 0.7); l.now_us < 2100000; loop_tick(&l), ticks++) {
            if (ticks == 0) begin_m = l.tool.tip_m[2];
            sum += (double)l.node.result.velocity_m_s[2];
        }
        const double way_m = l.tool.tip_m[2] - begin_m, mean_m_s = sum / ticks;
        print_message("%d Hz: %.4f m/s, %.4f m in %.3f s\n", rates[k], mean_m_s, way_m, ticks / (double)rates[k]);
        assert_true(way_m > 0.02 && fabs(mean_m_s * ticks / rates[k] / way_m - 1.0) < 0.03);
    }
}

static int64_t until_no_force_us(void) {
    const int64_t begin_us = l.now_us;
    while (loop_force(&l) > 0.0 && l.now_us - begin_us < 1000000) loop_tick(&l);
    return l.now_us - begin_us;
}

static void silence_ends_the_force_after_the_same_time_at_every_rate(void **state) {
    (void)state;
    for (int k = 0; k < RATES; k++) {
        start_at(rates[k], HRT_TANGENT);
        loop_run(&l, 2.0);
        assert_true(loop_force(&l) > 2.0);
        l.device.unplugged = true;
        const int64_t device_us = until_no_force_us();
        assert_in_range(device_us, 12000, 12000 + 2 * l.period_us);
        start_at(rates[k], HRT_TANGENT);
        loop_run(&l, 2.0);
        l.sim_alive = false;
        const int64_t samples_us = until_no_force_us();
        print_message("%d Hz: device %lld us, samples %lld us\n", rates[k], (long long)device_us,
                      (long long)samples_us);
        assert_in_range(samples_us, 90000, 150000);
    }
}

static void the_force_ramps_up_in_the_same_time_at_every_rate(void **state) {
    (void)state;
    for (int k = 0; k < RATES; k++) {
        start_at(rates[k], HRT_TANGENT);
        while (l.tool.state != HRT_ENGAGED) loop_tick(&l);
        const int64_t begin_us = l.now_us;
        assert_in_range(begin_us, 1100000, 1150000 + l.period_us);
        while (l.node.result.gain < 1.0f) loop_tick(&l);
        assert_in_range(l.now_us - begin_us, 198000, 202000);
    }
}

/* Loses the device's frames: with counters of 7 bits, 64 of them are half the range, which is 16 ms at 4000 Hz. */
static void lost_frames_do_not_block_the_next(void **state) {
    (void)state;
    for (int lost_us = 10000; lost_us <= 40000; lost_us += 2500)
        for (int k = 0; k < RATES; k++) {
            hrt_can_frame frame;
            start_at(rates[k], HRT_TANGENT);
            loop_run(&l, 2.0);
            for (const int64_t end_us = l.now_us + lost_us; l.now_us < end_us; l.now_us += l.period_us) {
                hrt_device_step(&l.device, l.now_us);
                while (hrt_bus_receive(&l.node_bus, &frame) > 0) {
                }
                hrt_node_tick(&l.node, l.now_us, &l.tool);
            }
            const int64_t most_us = (lost_us > 20000 ? 0 : 20000 - lost_us) + 2 * l.period_us, begin_us = l.now_us;
            while (l.node.input.encoder_us < begin_us && l.now_us < begin_us + 100000) loop_tick(&l);
            assert_true(l.now_us - begin_us <= most_us);
        }
}

static void an_old_frame_does_not_pass_for_a_new_one(void **state) {
    (void)state;
    start_at(4000, HRT_TANGENT);
    loop_run(&l, 2.0);
    hrt_can_message a = {.kind = HRT_CAN_ENCODER_A, .counter = (uint8_t)((l.device.encoder_counter - 5) & 0x7F)}, b = a;
    b.kind = HRT_CAN_ENCODER_B;
    hrt_can_exchange_take(&l.node.exchange, l.now_us, &a, &l.node.input);
    hrt_can_exchange_take(&l.node.exchange, l.now_us, &b, &l.node.input);
    assert_true(l.node.input.encoder_us < l.now_us && l.node.input.count[HRT_INSERTION] != 0);
}

/* The damper that recovers the energy of a tick is that of this tick's length. */
static void passivity_control_damps_alike_at_every_rate(void **state) {
    (void)state;
    for (int k = 0; k < RATES; k++) {
        hrt_device_config device = loop_device_config();
        hrt_node_config node = loop_node_config();
        double low = 1.0, high = 0.0;
        node.extrapolator = HRT_HOLD;
        node.params.period_us = 1.0e6f / (float)rates[k];
        for (int j = 0; j < HRT_MOTORS; j++) {
            device.hand_damping[j] *= 0.3;
            device.coulomb[j] = 0.0;
        }
        loop_start(&l, &device, &node);
        l.wall_N_m = 1000.0;
        loop_run(&l, 4.0);
        for (const int64_t end_us = l.now_us + 1000000; l.now_us < end_us; loop_tick(&l)) {
            low = fmin(low, l.device.joint[HRT_INSERTION]);
            high = fmax(high, l.device.joint[HRT_INSERTION]);
        }
        print_message("%d Hz: swings %.3f mm\n", rates[k], 1e3 * (high - low));
        assert_true(high - low < 0.0005 && l.tool.state == HRT_ENGAGED);
    }
}

/* One tick of the damper alone: a deficit is recovered within a tick of the period that the caller has set. */
static void a_deficit_is_recovered_within_one_tick(void **state) {
    (void)state;
    for (int k = 0; k < RATES; k++) {
        hrt_controller c = {.energy_J = -2.0e-6f, .velocity_m_s = {0.0f, 0.0f, 0.05f}};
        float force_N[3] = {0};
        hrt_params_default(&c.params);
        c.params.period_us = 1.0e6f / (float)rates[k];
        hrt_passivity_control(&c, 1.0f / (float)rates[k], force_N);
        const double took_J = -(double)force_N[2] * 0.05 / rates[k];
        assert_true(fabs(took_J / 2.0e-6 - 1.0) < 0.01);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(the_hand_feels_the_same_wall_at_every_rate),
                                       cmocka_unit_test(the_velocity_is_that_of_the_hand_at_every_rate),
                                       cmocka_unit_test(silence_ends_the_force_after_the_same_time_at_every_rate),
                                       cmocka_unit_test(the_force_ramps_up_in_the_same_time_at_every_rate),
                                       cmocka_unit_test(lost_frames_do_not_block_the_next),
                                       cmocka_unit_test(an_old_frame_does_not_pass_for_a_new_one),
                                       cmocka_unit_test(passivity_control_damps_alike_at_every_rate),
                                       cmocka_unit_test(a_deficit_is_recovered_within_one_tick)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
