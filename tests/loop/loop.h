/* A closed control loop in one process on a virtual clock: virtual device, loopback bus, node, and springs in place of
 * the simulation. */
#ifndef TEST_LOOP_H
#define TEST_LOOP_H

// clang-format off
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>
// clang-format on

#include "device/device.h"
#include "io/node.h"

typedef struct loop {
    hrt_loopback wires;
    hrt_bus device_bus, node_bus;
    hrt_device device;
    hrt_node node;
    tensormass_tool_state_t tool, delayed[64];
    int64_t now_us, frame_us, next_frame_us;
    int64_t period_us;      /* of the ticks and of the device's frames */
    int32_t latency_frames; /* the sample's tool state is this many frames old */
    uint32_t seq;
    int64_t session;
    bool sim_alive, send_stiffness;
    int32_t flags;                 /* flags of the simulation's samples; if "unstable", their force is 50 N */
    double wall_N_m, wall_depth_m; /* a wall pushes against +z below this depth under the trocar */
    uint32_t frames;
    double peak_N;
} loop;

static inline void loop_start(loop *l, const hrt_device_config *device, const hrt_node_config *node) {
    memset(l, 0, sizeof *l);
    hrt_loopback_init(&l->wires);
    hrt_bus_open_loopback(&l->device_bus, &l->wires);
    hrt_bus_open_loopback(&l->node_bus, &l->wires);
    hrt_device_init(&l->device, device, &l->device_bus);
    hrt_node_init(&l->node, node, &l->node_bus);
    l->period_us = (int64_t)node->params.period_us;
    l->device.config.period_us = node->params.period_us;
    l->now_us = 1000000;
    l->frame_us = 40000;
    l->session = 77;
    l->sim_alive = true;
    l->wall_N_m = 300.0;
    l->wall_depth_m = 0.12;
    l->next_frame_us = l->now_us;
}

static inline tensormass_force_sample_t loop_sample(const loop *l, const tensormass_tool_state_t *tool) {
    tensormass_force_sample_t s = {.utime = l->now_us,
                                   .session = l->session,
                                   .tool_session = tool->session,
                                   .tool_utime = tool->utime,
                                   .seq = (int32_t)l->seq,
                                   .instrument = tool->instrument};
    const double depth = tool->tip_m[2] - l->wall_depth_m;
    for (int i = 0; i < 3; i++) s.tip_m[i] = tool->tip_m[i];
    s.force_N[2] = depth > 0.0 ? -l->wall_N_m * depth : 0.0;
    s.flags = l->flags;
    if (l->flags & HRT_FLAG_UNSTABLE) s.force_N[0] = s.force_N[2] = 50.0;
    if (l->send_stiffness) {
        s.stiffness_kind = 2;
        s.stiffness_N_m[8] = depth > 0.0 ? -l->wall_N_m : 0.0;
    }
    return s;
}

static inline void loop_frame(loop *l) {
    if (!l->sim_alive || l->tool.state < HRT_IDLE) return;
    l->delayed[l->frames % 64] = l->tool;
    l->frames++;
    if ((int32_t)l->frames <= l->latency_frames) return;
    l->seq++;
    const tensormass_force_sample_t s =
        loop_sample(l, &l->delayed[(l->frames - 1u - (uint32_t)l->latency_frames) % 64]);
    hrt_node_post_sample(&l->node, &s);
}

/* Runs one tick. */
static inline void loop_tick(loop *l) {
    hrt_device_step(&l->device, l->now_us);
    hrt_node_tick(&l->node, l->now_us, &l->tool);
    if (l->now_us >= l->next_frame_us) {
        loop_frame(l);
        l->next_frame_us += l->frame_us;
    }
    l->now_us += l->period_us;
}

static inline void loop_run(loop *l, double seconds) {
    for (int64_t until = l->now_us + (int64_t)(seconds * 1e6); l->now_us < until;) loop_tick(l);
}

static inline hrt_node_config loop_node_config(void) {
    hrt_node_config c = hrt_node_config_default(0);
    c.pose_known = true;
    return c;
}

/* Makes a device whose hand pushes straight into the wall, to 0.135 m, and holds. */
static inline hrt_device_config loop_device_config(void) {
    static const hrt_keyframe press[] = {{.time_s = 0.0, .joint = {0.0, 0.0, 0.10, 0.0, 0.0}},
                                         {.time_s = 0.6, .joint = {0.0, 0.0, 0.10, 0.0, 0.0}},
                                         {.time_s = 1.2, .joint = {0.0, 0.0, 0.135, 0.0, 0.0}}};
    hrt_device_config c = hrt_device_config_default(0);
    c.hand.key = press;
    c.hand.key_count = 3;
    return c;
}

/* Force rendered by the controller and applied by the motor, along the insertion. */
static inline double loop_force(const loop *l) { return fabs((double)l->node.result.force_N[2]); }
static inline double loop_motor(const loop *l) { return fabs(l->device.torque[HRT_INSERTION]); }

/* Runs two seconds: the hand is then pressed into the wall and feels it. */
static inline void loop_press(loop *l, hrt_extrapolator extrapolator) {
    const hrt_device_config device = loop_device_config();
    hrt_node_config node = loop_node_config();
    node.extrapolator = extrapolator;
    loop_start(l, &device, &node);
    l->send_stiffness = true;
    loop_run(l, 2.0);
    assert_int_equal(l->tool.state, HRT_ENGAGED);
    assert_true(loop_force(l) > 2.0 && loop_motor(l) > 2.0);
}

/* Makes one triangle across the hand's path at the wall, equally compliant in all directions. */
static inline tensormass_contact_patch_t loop_patch(int64_t session, uint32_t seq, float compliance_m_N) {
    tensormass_contact_patch_t m = {.session = session,
                                    .seq = (int32_t)seq,
                                    .vertex_count = 3,
                                    .triangle_count = 1,
                                    .vertex_m = {-0.05f, -0.05f, 0.12f, 0.05f, -0.05f, 0.12f, 0.0f, 0.05f, 0.12f},
                                    .triangle = {0, 2, 1},
                                    .radius_m = 0.0025f,
                                    .contact_length_m = 0.02f};
    for (int i = 0, at = 0; i < 9; at += 9 - i, i++) m.compliance_m_N[at] = compliance_m_N;
    return m;
}

#endif
