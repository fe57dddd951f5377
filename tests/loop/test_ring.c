/* Node and virtual device in one process on a virtual clock: the closed control loop, and the loss of each of its
 * parts. */
// clang-format off
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <cmocka.h>
// clang-format on

#include "loop.h"

static loop l;

static double force(void) {
    const float *f = l.node.result.force_N;
    return sqrt((double)(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]));
}

static double torque(void) { return fabs(l.device.torque[0]) + fabs(l.device.torque[1]) + fabs(l.device.torque[2]); }

static void start(hrt_extrapolator which) {
    const hrt_device_config d = loop_device_config();
    hrt_node_config n = loop_node_config();
    n.extrapolator = which;
    loop_start(&l, &d, &n);
    l.send_stiffness = which == HRT_TANGENT;
}

static void press(hrt_extrapolator which) {
    start(which);
    loop_run(&l, 2.0);
    assert_int_equal(l.tool.state, HRT_ENGAGED);
    assert_true(force() > 1.0);
}

/* At rest the hand's spring and the wall's share the displacement, for any extrapolator. */
static void loop_settles_between_hand_and_wall(void **state) {
    (void)state;
    for (int w = 0; w < HRT_EXTRAPOLATOR_COUNT; w++) {
        start((hrt_extrapolator)w);
        loop_run(&l, 4.0);
        assert_int_equal(l.tool.state, HRT_ENGAGED);
        double low = 1.0, high = 0.0;
        for (int i = 0; i < 500; i++) {
            loop_tick(&l);
            low = fmin(low, l.device.joint[HRT_INSERTION]);
            high = fmax(high, l.device.joint[HRT_INSERTION]);
        }
        /* 300 N/m against 300 N/m, within friction and an encoder count. */
        const double count = 1.0 / 40000.0;
        assert_true(fabs(l.device.joint[HRT_INSERTION] - 0.1275) < 0.06 / 300.0 + 2 * count);
        assert_true(fabs(force() - 2.25) < 0.1);
        if (w != HRT_PAPER_POSITION) assert_true(high - low < count);
    }
}

static void seeded_noise_stays_bounded(void **state) {
    (void)state;
    for (int w = 0; w < HRT_PAPER_POSITION; w++) {
        hrt_device_config d = loop_device_config();
        hrt_node_config n = loop_node_config();
        n.extrapolator = (hrt_extrapolator)w;
        d.noise_counts = 0.7;
        d.seed = 5;
        d.hand.tremor_m = 40e-6;
        loop_start(&l, &d, &n);
        l.send_stiffness = w == HRT_TANGENT;
        loop_run(&l, 2.0);
        double low = 1.0, high = 0.0;
        for (int i = 0; i < 1000; i++) {
            loop_tick(&l);
            low = fmin(low, l.device.joint[HRT_INSERTION]);
            high = fmax(high, l.device.joint[HRT_INSERTION]);
        }
        assert_int_equal(l.tool.state, HRT_ENGAGED);
        assert_true(high - low < 0.0004);
    }
    assert_int_equal(l.node.exchange.can.lost + l.node.exchange.can.repeated + l.node.exchange.can.corrupt, 0);
}

static void the_same_bits_every_time(void **state) {
    (void)state;
    static loop first;
    press(HRT_POSITION);
    first = l;
    press(HRT_POSITION);
    assert_memory_equal(l.device.joint, first.device.joint, sizeof l.device.joint);
    assert_memory_equal(l.node.result.force_N, first.node.result.force_N, sizeof l.node.result.force_N);
}

/* The simulation is killed in contact: 150 ms after t_n of the last valid sample the force is zero. */
static void force_ends_when_the_simulation_is_killed(void **state) {
    (void)state;
    for (int32_t frames = 0; frames < 2; frames++) {
        start(HRT_POSITION);
        l.latency_frames = frames;
        loop_run(&l, 2.0);
        assert_true(force() > 1.0);
        l.sim_alive = false;
        const int64_t last_us = l.node.controller.sample_us;
        while (l.now_us - last_us <= 150000) loop_tick(&l);
        assert_true(force() == 0.0 && torque() == 0.0);
        assert_false(l.device.motors_on);
        assert_int_equal(l.node.result.fault, HRT_FAULT_NONE);
        /* A new simulation starts: engaged again. */
        l.sim_alive = true;
        l.session++;
        l.seq = 0;
        loop_run(&l, 1.0);
        assert_int_equal(l.tool.state, HRT_ENGAGED);
        assert_true(force() > 1.0);
    }
}

static void force_ends_when_the_controller_is_killed(void **state) {
    (void)state;
    press(HRT_HOLD);
    assert_true(torque() > 1.0);
    const int64_t last_us = l.now_us;
    for (int i = 0; i < 12; i++) {
        hrt_device_step(&l.device, l.now_us);
        l.now_us += 2000;
        if (torque() == 0.0) break;
    }
    assert_true(torque() == 0.0);
    assert_true(l.device.command_us + 20000 <= l.now_us && l.now_us - last_us <= 24000);
    assert_int_equal(l.device.fault, HRT_DEVICE_WATCHDOG);
    /* Only the message "motors off" ends it; a new controller sends that while it boots. */
    hrt_node_config n = loop_node_config();
    n.session = 4711;
    hrt_node_init(&l.node, &n, &l.node_bus);
    loop_run(&l, 1.0);
    assert_int_equal(l.device.fault, HRT_DEVICE_FINE);
    assert_int_equal(l.tool.state, HRT_ENGAGED);
}

static void force_ends_when_the_device_is_unplugged(void **state) {
    (void)state;
    press(HRT_HOLD);
    l.device.unplugged = true;
    const int64_t gone_us = l.now_us;
    while (force() > 0.0) loop_tick(&l);
    assert_true(l.now_us - gone_us <= 18000);
    while (torque() > 0.0) loop_tick(&l); /* the device's own watchdog */
    assert_true(l.now_us - gone_us <= 26000);
    loop_run(&l, 0.2);
    assert_int_equal(l.tool.state, HRT_BOOT);
    l.device.unplugged = false;
    loop_run(&l, 1.0);
    assert_int_equal(l.tool.state, HRT_ENGAGED);
}

static void restarted_device_is_a_fault_until_reset(void **state) {
    (void)state;
    press(HRT_HOLD);
    hrt_device_config d = loop_device_config();
    d.session = 2;
    d.hand.key = NULL;
    for (int j = 0; j < HRT_JOINTS; j++) d.rest[j] = l.device.joint[j];
    const uint8_t counter = l.device.encoder_counter;
    hrt_device_init(&l.device, &d, &l.device_bus);
    l.device.encoder_counter = counter;
    loop_run(&l, 0.1);
    assert_int_equal(l.tool.state, HRT_FAULT);
    assert_int_equal(l.node.result.fault, HRT_FAULT_DEVICE_RESTARTED);
    assert_true(force() == 0.0 && torque() == 0.0);
    const hrt_command reset = {.extrapolator = -1, .passivity = -1, .coupling = -1, .enable = -1, .reset = true};
    hrt_node_post_command(&l.node, &reset);
    loop_run(&l, 1.0);
    assert_int_equal(l.tool.state, HRT_ENGAGED);
}

static void force_ends_when_the_bus_is_off(void **state) {
    (void)state;
    press(HRT_HOLD);
    l.wires.off = true;
    loop_tick(&l);
    loop_tick(&l);
    assert_true(force() == 0.0 && torque() == 0.0);
    assert_int_equal(l.node.result.fault, HRT_FAULT_BUS_OFF);
    loop_run(&l, 0.3);
    l.wires.off = false;
    loop_run(&l, 0.3);
    assert_int_equal(l.tool.state, HRT_FAULT); /* the bus is back, the fault stays */
    const hrt_command reset = {.extrapolator = -1, .passivity = -1, .coupling = -1, .enable = -1, .reset = true};
    hrt_node_post_command(&l.node, &reset);
    loop_run(&l, 1.0);
    assert_int_equal(l.tool.state, HRT_ENGAGED);
    assert_int_equal(l.device.fault, HRT_DEVICE_FINE);
}

static void no_pose_no_force(void **state) {
    (void)state;
    const hrt_device_config d = loop_device_config();
    const hrt_node_config n = hrt_node_config_default(0);
    loop_start(&l, &d, &n);
    loop_run(&l, 1.0);
    assert_int_equal(l.tool.state, HRT_IDLE);
    const hrt_pose pose = {.trocar_m = {5.0, 6.0, 7.0}, .axis = {0, 0, -1}, .up = {0, 1, 0}};
    hrt_node_post_pose(&l.node, &pose);
    loop_tick(&l);
    assert_true(fabs(l.tool.tip_m[0] - 5.0) < 1e-6);
    assert_true(fabs(l.tool.tip_m[2] - (7.0 - l.tool.joint[HRT_INSERTION])) < 1e-6);
    l.wall_depth_m = 100.0;
    loop_run(&l, 0.3);
    assert_int_equal(l.tool.state, HRT_ENGAGED);
}

/* Two devices on one bus feel their own forces and never each other's. */
static void two_devices_feel_only_their_own_forces(void **state) {
    (void)state;
    static hrt_loopback wires;
    static hrt_bus bus[4];
    static hrt_device device[2];
    static hrt_node node[2];
    tensormass_tool_state_t tool[2];
    memset(tool, 0, sizeof tool);
    hrt_loopback_init(&wires);
    for (int i = 0; i < 4; i++) assert_true(hrt_bus_open_loopback(&bus[i], &wires));
    for (int i = 0; i < 2; i++) {
        hrt_device_config d = hrt_device_config_default(i);
        hrt_node_config n = hrt_node_config_default(i);
        n.pose_known = true;
        n.extrapolator = HRT_HOLD;
        hrt_device_init(&device[i], &d, &bus[2 * i]);
        hrt_node_init(&node[i], &n, &bus[2 * i + 1]);
    }
    uint32_t seq = 0;
    for (int64_t t = 1000000; t < 3000000; t += 2000)
        for (int i = 0; i < 2; i++) {
            hrt_device_step(&device[i], t);
            hrt_node_tick(&node[i], t, &tool[i]);
            if (t % 40000 != 0) continue;
            tensormass_force_sample_t s = {.session = 1,
                                           .tool_session = tool[i].session,
                                           .tool_utime = t,
                                           .seq = (int32_t)++seq,
                                           .instrument = (int8_t)i};
            for (int a = 0; a < 3; a++) s.tip_m[a] = tool[i].tip_m[a];
            s.force_N[2] = i == 0 ? -1.5 : 0.75;
            hrt_node_post_sample(&node[i], &s);
            assert_int_equal(hrt_node_post_sample(&node[1 - i], &s), HRT_REJECT_FOREIGN);
        }
    assert_true(fabs(device[0].torque[HRT_INSERTION] + 1.5) < 1e-3);
    assert_true(fabs(device[1].torque[HRT_INSERTION] - 0.75) < 1e-3);
    assert_true(fabs((double)node[0].result.joint[HRT_INSERTION] - device[0].joint[HRT_INSERTION]) < 2.0 / 40000);
    assert_true(fabs((double)node[1].result.joint[HRT_INSERTION] - device[1].joint[HRT_INSERTION]) < 2.0 / 40000);
    /* Four endpoints receive everything: 3 frames per 2 ms and device, two heartbeats per 50 ms. Below 60 % of 1
     * Mbit/s with worst-case stuffing. */
    const double load = (double)bus[0].bits / 2.0e6;
    print_message("bus load, two devices at 500 Hz: %.1f %%\n", 100.0 * load);
    assert_true(load > 0.3 && load < 0.6);
}

/* ---------------------------------------------------------------------------------------------- invalid frames */

static void device_rejects_invalid_commands(void **state) {
    (void)state;
    press(HRT_HOLD);
    hrt_bus intruder;
    assert_true(hrt_bus_open_loopback(&intruder, &l.wires));
    hrt_can_frame frame = {.id = 0x100, .length = 8, .data = {0xFF, 0x7F, 0xFF, 0x7F, 0xFF, 0x7F, 0x80, 0x00}};
    const uint32_t good = l.device.commands;
    for (int i = 0; i < 9; i++) hrt_bus_send(&intruder, &frame);
    loop_tick(&l); /* corrupt in a row, then a good one */
    assert_int_equal(l.device.can.corrupt, 9);
    assert_int_equal(l.device.fault, HRT_DEVICE_FINE);
    assert_int_equal(l.device.commands, good + 1);
    frame.id = 0x7FF; /* foreign */
    hrt_bus_send(&intruder, &frame);
    frame.id = 0x100;
    frame.flags = HRT_CAN_EXTENDED;
    hrt_bus_send(&intruder, &frame);
    frame.flags = HRT_CAN_ERROR;
    hrt_bus_send(&intruder, &frame);
    const uint32_t foreign = l.device.can.foreign;
    loop_tick(&l);
    assert_int_equal(l.device.can.foreign - foreign, 2);
    assert_int_equal(l.device.can.error, 1);
    assert_int_equal(l.node.exchange.can.error, 1);
    frame.flags = 0;
    for (int i = 0; i < 10; i++) hrt_bus_send(&intruder, &frame);
    loop_tick(&l);
    assert_true(torque() == 0.0);
    loop_run(&l, 0.2);
    assert_int_equal(l.node.result.fault, HRT_FAULT_DEVICE_REPORTED);
}

/* A transmitter that repeats a frame does not feed the watchdog; a gap is counted. */
static void repeated_commands_feed_no_watchdog_and_gaps_are_counted(void **state) {
    (void)state;
    press(HRT_HOLD);
    hrt_bus intruder;
    assert_true(hrt_bus_open_loopback(&intruder, &l.wires));
    hrt_device_step(&l.device, l.now_us);
    hrt_can_message m = {
        .kind = HRT_CAN_COMMAND, .counter = l.device.command_counter, .motors_on = true, .torque = {0.1f, 0.1f, 1.0f}};
    hrt_can_frame frame;
    const uint32_t repeated = l.device.can.repeated, lost = l.device.can.lost;
    for (int i = 0; i < 12; i++) {
        hrt_can_pack(&m, &frame);
        hrt_bus_send(&intruder, &frame);
        hrt_device_step(&l.device, l.now_us);
        l.now_us += 2000;
    }
    assert_true(l.device.can.repeated - repeated >= 10);
    assert_int_equal(l.device.fault, HRT_DEVICE_WATCHDOG);
    m.counter = (uint8_t)(l.device.command_counter + 6);
    m.motors_on = false;
    hrt_can_pack(&m, &frame);
    hrt_bus_send(&intruder, &frame);
    hrt_device_step(&l.device, l.now_us);
    assert_int_equal(l.device.can.lost - lost, 5);
}

/* As the controller accepts encoders: an overtaken frame is no command, until the bus was silent for a watchdog's
 * time. */
static void old_commands_are_refused(void **state) {
    (void)state;
    start(HRT_HOLD);
    hrt_bus sender;
    assert_true(hrt_bus_open_loopback(&sender, &l.wires));
    const hrt_device_config config = loop_device_config();
    int64_t now_us = 1000000;
    for (int back = 1; back < 128; back++) {
        hrt_can_message m = {.kind = HRT_CAN_COMMAND, .counter = 0, .motors_on = true, .torque = {0.1f, 0.1f, 1.0f}};
        hrt_can_frame frame;
        now_us += 50000;
        hrt_device_init(&l.device, &config, &l.device_bus);
        hrt_device_step(&l.device, now_us);
        const int wanted[3] = {0, 128 - back, back > 64 ? 128 - back + 1 : 1};
        for (int i = 0; i < 3; i++) {
            m.counter = (uint8_t)(wanted[i] & 0x7f);
            m.torque[2] = (float)(i + 1);
            hrt_can_pack(&m, &frame);
            hrt_bus_send(&sender, &frame);
            hrt_device_step(&l.device, now_us += 2000);
            const bool old = i == 1 && back <= 64;
            assert_true(fabs(l.device.torque[2] - (old ? 1.0 : i + 1.0)) < 1e-6);
        }
        assert_int_equal(l.device.can.repeated, back <= 64);
        assert_int_equal(l.device.can.lost, back <= 64 ? 0 : 128 - back - 1);
        /* A controller that restarts may begin at any count. */
        now_us += 25000;
        hrt_device_step(&l.device, now_us);
        assert_int_equal(l.device.fault, HRT_DEVICE_WATCHDOG);
        m.counter = (uint8_t)((l.device.command_counter - 10) & 0x7f);
        m.motors_on = false;
        hrt_can_pack(&m, &frame);
        hrt_bus_send(&sender, &frame);
        hrt_device_step(&l.device, now_us);
        assert_int_equal(l.device.fault, HRT_DEVICE_FINE);
    }
}

static void gaps_reported_by_the_device_are_counted(void **state) {
    (void)state;
    press(HRT_HOLD);
    assert_int_equal(l.node.exchange.can.command_gaps, 0);
    l.node.exchange.command_counter = (uint8_t)(l.node.exchange.command_counter + 7);
    loop_run(&l, 0.2);
    assert_int_equal(l.node.exchange.can.command_gaps, 7);
    /* A controller that takes over may begin at any count; this is not counted as a gap. */
    for (int begin = 0; begin < 128; begin += 9) {
        const hrt_node_config config = l.node.config;
        hrt_node_init(&l.node, &config, &l.node_bus);
        l.node.exchange.command_counter = (uint8_t)begin;
        loop_run(&l, 1.5);
        assert_int_equal(l.tool.state, HRT_ENGAGED);
        assert_int_equal(l.node.exchange.can.command_gaps, 0);
    }
}

/* Another controller on the same bus is detected by its frames, or by the gaps that the device counts. */
static void second_controller_is_a_bus_conflict(void **state) {
    (void)state;
    const hrt_can_kind kinds[] = {HRT_CAN_COMMAND, HRT_CAN_CONTROLLER_BEAT, HRT_CAN_RESET, HRT_CAN_DEVICE_BEAT};
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++) {
        press(HRT_HOLD);
        hrt_bus rival;
        assert_true(hrt_bus_open_loopback(&rival, &l.wires));
        hrt_can_message m = {.kind = kinds[k], .instrument = 1, .session = l.device.config.session, .state = 1};
        m.gaps = (uint16_t)(l.device.can.lost + 200);
        hrt_can_frame frame;
        hrt_can_pack(&m, &frame);
        hrt_bus_send(&rival, &frame); /* of the other instrument: not a conflict */
        loop_tick(&l);
        loop_tick(&l);
        assert_int_equal(l.tool.state, HRT_ENGAGED);
        m.instrument = 0;
        hrt_can_pack(&m, &frame);
        hrt_bus_send(&rival, &frame);
        hrt_node_tick(&l.node, l.now_us += 2000, &l.tool);
        assert_int_equal(l.node.result.fault, HRT_FAULT_BUS_CONFLICT);
        assert_true(force() == 0.0);
        hrt_bus_close(&rival);
        loop_run(&l, 0.1); /* the device's own heartbeats again */
        const hrt_command reset = {.extrapolator = -1, .passivity = -1, .coupling = -1, .enable = -1, .reset = true};
        hrt_node_post_command(&l.node, &reset);
        loop_run(&l, 1.0);
        assert_int_equal(l.tool.state, HRT_ENGAGED);
    }
}

/* Every single bit of every frame is flipped: neither side ever accepts it as good. */
static void flipped_bits_are_refused(void **state) {
    (void)state;
    const hrt_can_kind kinds[] = {HRT_CAN_COMMAND,         HRT_CAN_ENCODER_A,    HRT_CAN_ENCODER_B, HRT_CAN_DEVICE_BEAT,
                                  HRT_CAN_CONTROLLER_BEAT, HRT_CAN_DEVICE_FAULT, HRT_CAN_RESET,     HRT_CAN_ENCODER_C};
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++)
        for (int instrument = 0; instrument < 2; instrument++) {
            const hrt_can_message m = {.kind = kinds[k],
                                       .instrument = instrument,
                                       .counter = 93,
                                       .count = {-1234, 555, 4001, -7, 128},
                                       .pedal = true,
                                       .motors_on = true,
                                       .torque = {0.5f, -0.25f, 3.5f},
                                       .state = 2,
                                       .fault = 1,
                                       .session = 999,
                                       .gaps = 3,
                                       .detail = 77};
            hrt_can_frame frame, bad;
            hrt_can_message back;
            assert_true(hrt_can_pack(&m, &frame));
            hrt_can_unpack(&frame, &back);
            assert_int_equal(back.kind, kinds[k]);
            assert_int_equal(back.instrument, instrument);
            for (int bit = 0; bit < 8 * frame.length; bit++) {
                bad = frame;
                bad.data[bit / 8] = (uint8_t)(bad.data[bit / 8] ^ (1u << (bit % 8)));
                hrt_can_unpack(&bad, &back);
                assert_int_equal(back.kind, HRT_CAN_CORRUPT);
            }
            bad = frame;
            bad.id ^= 1; /* addressed to the other device */
            hrt_can_unpack(&bad, &back);
            assert_int_equal(back.kind, HRT_CAN_CORRUPT);
            bad = frame;
            bad.length--;
            hrt_can_unpack(&bad, &back);
            assert_int_equal(back.kind, HRT_CAN_CORRUPT);
        }
}

static void lost_and_repeated_encoder_frames_are_handled(void **state) {
    (void)state;
    press(HRT_HOLD);
    const uint32_t lost = l.node.exchange.can.lost, repeated = l.node.exchange.can.repeated;
    l.device.encoder_counter += 2; /* two sets were lost */
    loop_tick(&l);
    assert_int_equal(l.node.exchange.can.lost - lost, 2);
    l.device.encoder_counter--; /* the same once more */
    loop_tick(&l);
    assert_int_equal(l.node.exchange.can.repeated - repeated, 1);
    assert_int_equal(l.tool.state, HRT_ENGAGED); /* one is not enough */
    for (int i = 0; i < 8; i++) {
        l.device.encoder_counter--; /* a device that hangs and repeats counts as silent */
        loop_tick(&l);
    }
    assert_int_equal(l.tool.state, HRT_IDLE);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(loop_settles_between_hand_and_wall),
                                       cmocka_unit_test(seeded_noise_stays_bounded),
                                       cmocka_unit_test(the_same_bits_every_time),
                                       cmocka_unit_test(force_ends_when_the_simulation_is_killed),
                                       cmocka_unit_test(force_ends_when_the_controller_is_killed),
                                       cmocka_unit_test(force_ends_when_the_device_is_unplugged),
                                       cmocka_unit_test(restarted_device_is_a_fault_until_reset),
                                       cmocka_unit_test(force_ends_when_the_bus_is_off),
                                       cmocka_unit_test(no_pose_no_force),
                                       cmocka_unit_test(two_devices_feel_only_their_own_forces),
                                       cmocka_unit_test(device_rejects_invalid_commands),
                                       cmocka_unit_test(repeated_commands_feed_no_watchdog_and_gaps_are_counted),
                                       cmocka_unit_test(old_commands_are_refused),
                                       cmocka_unit_test(gaps_reported_by_the_device_are_counted),
                                       cmocka_unit_test(second_controller_is_a_bus_conflict),
                                       cmocka_unit_test(flipped_bits_are_refused),
                                       cmocka_unit_test(lost_and_repeated_encoder_frames_are_handled)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
