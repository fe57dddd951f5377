/* Every transition of docs/controller.md and every fault. */
#include "rig.h"

static rig r;

static void from_boot_to_engaged(void **state) {
    (void)state;
    rig_start(&r);
    r.device = r.sim = false;
    rig_run(&r, 0.5);
    assert_int_equal(r.out.state, HRT_BOOT); /* waits for ever */
    r.device = true;
    rig_tick(&r);
    assert_int_equal(r.out.state, HRT_SELF_TEST);
    assert_no_force(&r);
    const int64_t tested_us = rig_until(&r, HRT_IDLE, 1.0);
    assert_in_range(tested_us, 100000, 104000 + TICK_US);
    rig_run(&r, 0.5);
    assert_int_equal(r.out.state, HRT_IDLE); /* no sample, no force */
    assert_no_force(&r);
    r.sim = true;
    rig_until(&r, HRT_ENGAGED, 0.1);
}

static void engaging_ramps_in(void **state) {
    (void)state;
    rig_start(&r);
    rig_until(&r, HRT_ENGAGED, 1.0);
    double last = 0.0;
    for (int64_t begin = r.now_us; r.now_us - begin < 190000;) {
        rig_tick(&r);
        assert_true(rig_force(&r) <= 2.0 * ((double)(r.now_us - begin) + 4000.0) / 200000.0);
        assert_true(rig_force(&r) >= last);
        last = rig_force(&r);
        assert_true((r.out.limits & HRT_LIMIT_RAMP) != 0);
    }
    rig_run(&r, 0.03);
    assert_true(fabs(rig_force(&r) - 2.0) < 1e-5);
}

static void no_force_without_permission(void **state) {
    (void)state;
    rig_start(&r);
    r.in.enable = false;
    rig_run(&r, 1.0);
    assert_int_equal(r.out.state, HRT_IDLE);
    r.in.enable = true;
    rig_until(&r, HRT_ENGAGED, 0.1);
    rig_run(&r, 0.3);
    r.in.enable = false; /* permission withdrawn: fades, then idle */
    rig_tick(&r);
    assert_int_equal(r.out.state, HRT_STALE);
    assert_true(rig_force(&r) > 1.0);
    assert_in_range(rig_until(&r, HRT_IDLE, 0.1), 30000, 46000);
    assert_no_force(&r);
}

/* Silence of the simulation: the force is exactly zero within 150 ms of t_n of the last valid sample. */
static void stale_fades_to_zero(void **state) {
    (void)state;
    for (int64_t latency_us = 0; latency_us <= 60000; latency_us += 20000) {
        rig_start(&r);
        r.latency_us = latency_us;
        rig_run(&r, 1.0);
        assert_int_equal(r.out.state, HRT_ENGAGED);
        r.sim = false;
        const int64_t last_us = r.c.sample_us;
        double last = rig_force(&r);
        bool stale = false;
        while (r.now_us - last_us <= 150000) {
            rig_tick(&r);
            stale = stale || r.out.state == HRT_STALE;
            assert_true(rig_force(&r) <= last + 1e-6);
            last = rig_force(&r);
        }
        assert_true(stale);
        assert_no_force(&r);
        rig_tick(&r);
        assert_int_equal(r.out.state, HRT_IDLE);
    }
}

static void stale_returns_to_engaged(void **state) {
    (void)state;
    rig_engage(&r);
    r.sim = false;
    rig_until(&r, HRT_STALE, 0.2);
    rig_run(&r, 0.02);
    const double faded = rig_force(&r);
    assert_true(faded < 1.5 && faded > 0.2);
    r.sim = true;
    rig_tick(&r);
    rig_tick(&r);
    assert_int_equal(r.out.state, HRT_ENGAGED);
    assert_true(rig_force(&r) < faded + 0.1); /* grows again from its last value */
    rig_run(&r, 0.3);
    assert_true(fabs(rig_force(&r) - 2.0) < 1e-5);
}

static void a_late_tick_pauses(void **state) {
    (void)state;
    rig_engage(&r);
    r.now_us += 30000;
    rig_tick(&r);
    assert_int_equal(r.out.state, HRT_IDLE);
    assert_true((r.out.limits & HRT_LIMIT_PAUSE) != 0);
    assert_no_force(&r);
    rig_until(&r, HRT_ENGAGED, 0.1);
    assert_true(rig_force(&r) < 0.1); /* and ramps in anew */
}

static void a_silent_device_pauses_then_faults(void **state) {
    (void)state;
    rig_engage(&r);
    r.device = false;
    const int64_t silent_us = r.now_us;
    rig_until(&r, HRT_IDLE, 0.1);
    assert_true(r.now_us - silent_us <= 14000 + TICK_US);
    assert_no_force(&r);
    rig_until(&r, HRT_BOOT, 0.2); /* nothing was in use any more: it waits for the device again */
    r.device = true;
    rig_until(&r, HRT_ENGAGED, 0.5);
    rig_run(&r, 0.3);
    r.params.device_pause_us = r.c.params.device_pause_us = 500000.0f;
    r.device = false;
    rig_until(&r, HRT_FAULT, 0.2);
    assert_int_equal(r.out.fault, HRT_FAULT_DEVICE_SILENT);
    assert_no_force(&r);
}

static void the_device_watchdog_pauses(void **state) {
    (void)state;
    rig_engage(&r);
    r.in.device_watchdog = true;
    rig_tick(&r);
    assert_int_equal(r.out.state, HRT_IDLE);
    rig_run(&r, 0.2);
    assert_int_equal(r.out.state, HRT_IDLE);
    r.in.device_watchdog = false;
    rig_until(&r, HRT_ENGAGED, 0.1);
}

static void another_simulation_waits_for_the_end_of_a_touch(void **state) {
    (void)state;
    rig_engage(&r);
    r.sample.session = SIM + 1; /* the first one is gone */
    r.sample.seq = 5;
    rig_run(&r, 0.06);
    assert_int_equal(r.out.state, HRT_ENGAGED);
    assert_int_equal(r.c.sim_session, SIM);
    rig_until(&r, HRT_STALE, 0.1);
    rig_until(&r, HRT_IDLE, 0.1);
    rig_until(&r, HRT_ENGAGED, 0.1);
    assert_int_equal(r.c.sim_session, SIM + 1);
}

/* ---------------------------------------------------------------------------------------------- faults */

static void expect_fault(hrt_fault fault) {
    assert_int_equal(r.out.state, HRT_FAULT);
    assert_int_equal(r.out.fault, fault);
    assert_no_force(&r);
    assert_true(strlen(hrt_fault_text(fault)) > 20);
    /* Latched: only a reset ends it, and a later fault does not replace it. */
    r.device = r.sim = true;
    r.in.bus_ok = true;
    r.in.device_fault = 5;
    rig_run(&r, 0.5);
    assert_int_equal(r.out.fault, fault);
    assert_int_equal(r.out.state, HRT_FAULT);
    r.in.device_fault = 0;
    r.in.reset = true;
    rig_tick(&r);
    assert_int_equal(r.out.state, HRT_BOOT);
    assert_int_equal(r.out.fault, HRT_FAULT_NONE);
}

static void fault_of_the_device(void **state) {
    (void)state;
    rig_engage(&r);
    r.in.device_fault = 2;
    rig_tick(&r);
    assert_int_equal(r.out.fault_detail, 2);
    expect_fault(HRT_FAULT_DEVICE_REPORTED);
    rig_until(&r, HRT_ENGAGED, 1.0);
}

static void fault_when_the_device_restarts_in_use(void **state) {
    (void)state;
    rig_engage(&r);
    r.in.device_session++;
    rig_tick(&r);
    expect_fault(HRT_FAULT_DEVICE_RESTARTED);
    rig_start(&r);
    r.sim = false;
    rig_until(&r, HRT_IDLE, 1.0);
    r.in.device_session++; /* not in use: no fault at first */
    rig_tick(&r);
    assert_int_equal(r.out.state, HRT_BOOT);
}

static void fault_bus_off(void **state) {
    (void)state;
    rig_engage(&r);
    r.in.bus_ok = false;
    rig_tick(&r);
    assert_int_equal(r.out.fault, HRT_FAULT_BUS_OFF);
    r.in.reset = true; /* not in use while the bus is off */
    rig_tick(&r);
    expect_fault(HRT_FAULT_BUS_OFF);
}

static void fault_encoder_range(void **state) {
    (void)state;
    rig_start(&r);
    r.sim = false;
    rig_until(&r, HRT_IDLE, 1.0);
    for (int i = 0; i < 2000 && r.out.state == HRT_IDLE; i++) {
        r.in.count[HRT_YAW] += 20;
        rig_tick(&r);
    }
    assert_int_equal(r.out.fault_detail, HRT_YAW);
    assert_true(r.out.joint[HRT_YAW] > 0.8f && r.out.joint[HRT_YAW] < 0.85f);
    r.in.count[HRT_YAW] = 0;
    expect_fault(HRT_FAULT_ENCODER_RANGE);
}

static void fault_encoder_jump(void **state) {
    (void)state;
    rig_engage(&r);
    r.in.count[HRT_INSERTION] += 500; /* 12.5 mm within a tick */
    rig_tick(&r);
    assert_int_equal(r.out.fault_detail, HRT_INSERTION);
    expect_fault(HRT_FAULT_ENCODER_JUMP);
    rig_engage(&r);
    r.in.count[HRT_INSERTION] += TICK_US / 20; /* 1.25 m/s is fast but no fault */
    rig_tick(&r);
    assert_int_equal(r.out.state, HRT_ENGAGED);
}

static void fault_encoder_stuck(void **state) {
    (void)state;
    rig_engage(&r);
    rig_run(&r, 2.0);
    assert_int_equal(r.out.state, HRT_ENGAGED); /* a constant force may be held indefinitely */
    r.force_N[2] = -7.0f;
    rig_run(&r, 0.5);
    assert_int_equal(r.out.fault_detail, HRT_INSERTION);
    expect_fault(HRT_FAULT_ENCODER_STUCK);
}

static void fault_clock(void **state) {
    (void)state;
    rig_engage(&r);
    r.now_us -= 50000;
    rig_tick(&r);
    expect_fault(HRT_FAULT_CLOCK);
}

static void fault_tick_late(void **state) {
    (void)state;
    rig_engage(&r);
    r.now_us += 400000;
    rig_tick(&r);
    expect_fault(HRT_FAULT_TICK_LATE);
}

static void fault_self_test(void **state) {
    (void)state;
    rig_start(&r);
    r.sim = false;
    for (int64_t begin = r.now_us; r.now_us - begin < 4000000 && r.out.state != HRT_FAULT;) {
        r.device = r.now_us % 60000 < 4000; /* intermittent */
        rig_tick(&r);
    }
    expect_fault(HRT_FAULT_SELF_TEST);
}

static void fault_parameter(void **state) {
    (void)state;
    rig_start(&r);
    r.c.params.force_max_N = NAN;
    rig_tick(&r);
    assert_int_equal(r.out.state, HRT_FAULT);
    assert_int_equal(r.out.fault, HRT_FAULT_PARAMETER);
    assert_string_equal(hrt_param_text[r.out.fault_detail].name, "force_max_N");
    r.in.reset = true; /* returns at once as long as it is not repaired */
    rig_tick(&r);
    rig_tick(&r);
    assert_int_equal(r.out.fault, HRT_FAULT_PARAMETER);
    r.c.params.force_max_N = 8.9f;
    r.in.reset = true;
    rig_tick(&r);
    assert_int_equal(r.out.state, HRT_BOOT);
    for (int32_t row = 0; row < hrt_param_count; row++) { /* every one of them is checked */
        hrt_params p = r.params;
        ((float *)(void *)((char *)&p + hrt_param_table[row].offset))[hrt_param_values(&p, &hrt_param_table[row]) - 1] =
            hrt_param_table[row].max * 2.0f + 1.0f;
        assert_int_equal(hrt_params_check(&p), row);
        assert_int_equal(hrt_params_check(&r.params), -1);
    }
}

static void fault_bus_conflict(void **state) {
    (void)state;
    rig_start(&r);
    r.in.bus_conflict_us = r.now_us; /* a predecessor's last messages, before any other */
    rig_until(&r, HRT_ENGAGED, 1.0);
    r.in.bus_conflict_us = r.now_us + 2000;
    rig_tick(&r);
    expect_fault(HRT_FAULT_BUS_CONFLICT);
    rig_until(&r, HRT_SELF_TEST, 1.0);
    rig_tick(&r);
    r.in.bus_conflict_us = r.now_us + 2000; /* still there: again */
    rig_tick(&r);
    expect_fault(HRT_FAULT_BUS_CONFLICT);
    rig_until(&r, HRT_ENGAGED, 1.0);
}

static void fault_internal(void **state) {
    (void)state;
    rig_engage(&r);
    r.c.extrapolation.now.force_N[0] = NAN; /* as corrupted memory would */
    rig_tick(&r);
    expect_fault(HRT_FAULT_INTERNAL);
}

static void every_state_and_fault_has_a_name(void **state) {
    (void)state;
    for (int f = 0; f < HRT_FAULT_COUNT; f++) {
        assert_string_not_equal(hrt_fault_name((hrt_fault)f), "unknown");
        const char *text = hrt_fault_text((hrt_fault)f);
        assert_true(text[strlen(text) - 1] == '.');
    }
    for (int s = 0; s < HRT_STATE_COUNT; s++) assert_string_not_equal(hrt_state_name((hrt_state)s), "unknown");
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(from_boot_to_engaged),
                                       cmocka_unit_test(engaging_ramps_in),
                                       cmocka_unit_test(no_force_without_permission),
                                       cmocka_unit_test(stale_fades_to_zero),
                                       cmocka_unit_test(stale_returns_to_engaged),
                                       cmocka_unit_test(a_late_tick_pauses),
                                       cmocka_unit_test(a_silent_device_pauses_then_faults),
                                       cmocka_unit_test(the_device_watchdog_pauses),
                                       cmocka_unit_test(another_simulation_waits_for_the_end_of_a_touch),
                                       cmocka_unit_test(fault_of_the_device),
                                       cmocka_unit_test(fault_when_the_device_restarts_in_use),
                                       cmocka_unit_test(fault_bus_off),
                                       cmocka_unit_test(fault_encoder_range),
                                       cmocka_unit_test(fault_encoder_jump),
                                       cmocka_unit_test(fault_encoder_stuck),
                                       cmocka_unit_test(fault_clock),
                                       cmocka_unit_test(fault_tick_late),
                                       cmocka_unit_test(fault_self_test),
                                       cmocka_unit_test(fault_parameter),
                                       cmocka_unit_test(fault_bus_conflict),
                                       cmocka_unit_test(fault_internal),
                                       cmocka_unit_test(every_state_and_fault_has_a_name)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
