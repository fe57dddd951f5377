/* The controller's core with valid inputs; tests spoil one input at a time. */
#ifndef TEST_RIG_H
#define TEST_RIG_H

// clang-format off
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>
// clang-format on

#include "hrt.h"
#include "libtensormass/numeric/random.h"

#ifndef RIG_PERIOD_US
#define RIG_PERIOD_US 2000
#endif
enum { TICK_US = RIG_PERIOD_US, SESSION = 42, SIM = 7 };

typedef struct rig {
    hrt_params params;
    hrt_controller c;
    hrt_input in;
    hrt_result out;
    hrt_sample sample;
    int64_t now_us;
    bool device, sim; /* counter that shows that the device is alive */
    int64_t frame_us; /* time between samples */
    int64_t next_us;
    int64_t latency_us; /* offset from t_n when posted */
    float force_N[3];
} rig;

static inline void rig_start(rig *r) {
    memset(r, 0, sizeof *r);
    hrt_params_default(&r->params);
    r->params.period_us = TICK_US;
    const hrt_axes axes = {.r = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .device = hrt_device_types[0]};
    hrt_init(&r->c, &r->params, &axes, SESSION);
    r->now_us = 1000000;
    r->device = r->sim = true;
    r->frame_us = 40000;
    r->force_N[2] = -2.0f;
    r->in = (hrt_input){.bus_ok = true, .enable = true, .device_session = 9, .extrapolator = HRT_HOLD};
    r->in.count[HRT_INSERTION] = 4000;
    r->sample = (hrt_sample){.session = SIM, .tool_session = SESSION, .seq = 100, .unilateral = true};
}

static inline void rig_tick(rig *r) {
    const hrt_sample *newest = NULL;
    if (r->device) r->in.encoder_us = r->now_us;
    if (r->sim && r->now_us >= r->next_us) {
        r->sample.seq++;
        r->sample.t_us = r->now_us - r->latency_us;
        memcpy(r->sample.tip_m, r->c.tip_m, sizeof r->sample.tip_m);
        memcpy(r->sample.force_N, r->force_N, sizeof r->sample.force_N);
        newest = &r->sample;
        r->next_us = r->now_us + r->frame_us;
    }
    hrt_tick(&r->c, r->now_us, &r->in, newest, &r->out);
    r->in.reset = false;
    r->now_us += TICK_US;
}

static inline void rig_run(rig *r, double seconds) {
    for (int64_t end = r->now_us + (int64_t)(seconds * 1e6); r->now_us < end;) rig_tick(r);
}

/* Ticks until the state is reached; fails after `seconds`. Returns microseconds. */
static inline int64_t rig_until(rig *r, hrt_state state, double seconds) {
    const int64_t start = r->now_us;
    while (r->out.state != state) {
        rig_tick(r);
        if (r->now_us - start > (int64_t)(seconds * 1e6))
            fail_msg("not in %s after %g s but in %s, fault %s", hrt_state_name(state), seconds,
                     hrt_state_name(r->out.state), hrt_fault_name(r->out.fault));
    }
    return r->now_us - start;
}

static inline void rig_engage(rig *r) {
    rig_start(r);
    rig_until(r, HRT_ENGAGED, 1.0);
    rig_run(r, 0.4);
    assert_int_equal(r->out.state, HRT_ENGAGED);
}

static inline double rig_force(const rig *r) {
    return sqrt((double)(r->out.force_N[0] * r->out.force_N[0] + r->out.force_N[1] * r->out.force_N[1] +
                         r->out.force_N[2] * r->out.force_N[2]));
}

static inline void assert_no_force(const rig *r) {
    for (int i = 0; i < 3; i++) {
        assert_true(r->out.force_N[i] == 0.0f);
        assert_true(r->out.torque[i] == 0.0f);
    }
    assert_false(r->out.motors_on);
}

/* Returns the next number of a seeded stream, the same on all platforms. */
static inline uint32_t rig_random(uint64_t *state) { return (uint32_t)(num_random64(state) >> 33); }
static inline float rig_uniform(uint64_t *state, float low, float high) {
    return low + (high - low) * (float)(rig_random(state) % 1000001u) / 1000000.0f;
}

#endif
