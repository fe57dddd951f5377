/* Random inputs, mostly plausible, some extreme: no limit is exceeded, nothing is NaN, every transition is in the state
 * diagram. 1e6 ticks; TM_LONG=1: 1e8. */
#include "../long.h"
#include "rig.h"

#include <stdio.h>

static const bool legal[HRT_STATE_COUNT][HRT_STATE_COUNT] = {
    [HRT_BOOT] = {[HRT_SELF_TEST] = true, [HRT_FAULT] = true},
    [HRT_SELF_TEST] = {[HRT_IDLE] = true, [HRT_FAULT] = true},
    [HRT_IDLE] = {[HRT_ENGAGED] = true, [HRT_BOOT] = true, [HRT_FAULT] = true},
    [HRT_ENGAGED] = {[HRT_STALE] = true, [HRT_IDLE] = true, [HRT_FAULT] = true},
    [HRT_STALE] = {[HRT_ENGAGED] = true, [HRT_IDLE] = true, [HRT_FAULT] = true},
    [HRT_FAULT] = {[HRT_BOOT] = true},
};

typedef struct wild {
    hrt_controller c;
    hrt_input in;
    hrt_result out;
    hrt_sample sample;
    hrt_patch patch[2];
    int turn;
    int64_t now_us, next_us, period_us;
    uint64_t seed;
    uint32_t seq;
    float speed[HRT_JOINTS], exact[HRT_JOINTS];
    int mood; /* 0: all inputs are valid */
    int64_t visits[HRT_STATE_COUNT], faults[HRT_FAULT_COUNT], limits[16];
} wild;

static float scratch[HRT_PATCH_COMPLIANCE];

static bool chance(wild *w, uint32_t in) { return rig_random(&w->seed) % in == 0; }

/* As chance, by time: a chance of one in `in` every 2 ms. */
static bool chance_of_time(wild *w, uint32_t in) { return chance(w, in * 2000u / (uint32_t)w->period_us); }

static float any_float(wild *w) {
    switch (rig_random(&w->seed) % 8) {
    case 0: return NAN;
    case 1: return INFINITY;
    case 2: return -3.4e38f;
    case 3: return 1e-42f;
    case 4: return 1e30f;
    default: return rig_uniform(&w->seed, -20.0f, 20.0f);
    }
}

static void begin(wild *w, const hrt_device_type *device) {
    hrt_params params;
    hrt_axes axes;
    hrt_params_of_device(&params, device);
    params.period_us = (float)w->period_us;
    const float axis[3] = {rig_uniform(&w->seed, -1, 1), rig_uniform(&w->seed, -1, 1), -1.1f}, up[3] = {0, 1, 0.1f};
    hrt_axes_along(&axes, device, axis, up);
    axes.is_free = device->tilts;
    hrt_init(&w->c, &params, &axes, SESSION);
    w->in = (hrt_input){.bus_ok = true, .enable = true, .device_session = 1};
    for (int j = 0; j < device->joints; j++) /* mid-way, so that nothing is out of range at once */
        w->exact[j] = 0.5f * device->joint[j].counts_per_unit * (device->joint[j].min + device->joint[j].max);
    for (int j = 0; j < device->joints; j++) w->in.count[j] = (int32_t)lrintf(w->exact[j]);
    w->out.state = HRT_BOOT;
}

/* Counts that wander within the workspace and are occasionally invalid. */
static void move(wild *w) {
    for (int j = 0; j < w->c.params.device->joints; j++) {
        const hrt_joint_type *type = &w->c.params.device->joint[j];
        const float edge = 0.04f * (type->max - type->min), low = type->counts_per_unit * (type->min + edge),
                    high = type->counts_per_unit * (type->max - edge);
        const float push = w->now_us % 8000000 < 1000000 ? 4.0f : 1.0f; /* occasionally too fast */
        w->speed[j] = 0.995f * w->speed[j] + push * rig_uniform(&w->seed, -1.5f, 1.5f);
        w->exact[j] += w->speed[j] * (float)w->period_us / 2000.0f;
        if (w->exact[j] < low || w->exact[j] > high) {
            w->exact[j] = fminf(fmaxf(w->exact[j], low), high);
            w->speed[j] = -w->speed[j];
        }
        w->in.count[j] = (int32_t)lrintf(w->exact[j]);
        if (w->mood && chance_of_time(w, 3000)) w->in.count[j] = (int32_t)rig_random(&w->seed);
    }
}

static void make_patch(wild *w) {
    hrt_patch *p = &w->patch[w->turn ^= 1];
    memset(p, 0, sizeof *p);
    p->vertex_count = 4;
    p->triangle_count = 2;
    const uint8_t corner[6] = {0, 1, 2, 2, 1, 3};
    memcpy(p->triangle, corner, sizeof corner);
    for (int v = 0; v < 4; v++)
        for (int i = 0; i < 3; i++) p->vertex_m[3 * v + i] = w->c.tip_m[i] + rig_uniform(&w->seed, -0.01f, 0.01f);
    for (int i = 0, at = 0; i < 12; i++)
        for (int j = i; j < 12; j++, at++) p->compliance_m_N[at] = i == j ? rig_uniform(&w->seed, 0.0f, 0.01f) : 0.0f;
    p->radius_m = 0.0025f;
    p->contact_length_m = 0.1f;
    p->contact_compliance_m_N = chance(w, 3) ? 0.0f : 0.0005f;
    if (w->mood && chance(w, 20)) p->vertex_m[rig_random(&w->seed) % 12] = any_float(w);
    if (hrt_patch_prepare(p, scratch) == HRT_ACCEPT) w->sample.patch = p;
}

static const hrt_sample *next_sample(wild *w) {
    if (w->now_us < w->next_us) return NULL;
    w->next_us = w->now_us + (chance(w, 40) ? 300000 : (int64_t)(1000 + rig_random(&w->seed) % 60000));
    hrt_sample *s = &w->sample;
    s->session = chance(w, 500) ? 8 : 7;
    s->tool_session = chance(w, 200) ? 1 : SESSION;
    s->t_us = w->now_us -
              (chance(w, 10) ? (int64_t)(rig_random(&w->seed) % 400000) : (int64_t)(rig_random(&w->seed) % 40000));
    if (chance(w, 300)) s->t_us = w->now_us + 5000;
    w->seq += chance(w, 20) ? rig_random(&w->seed) % 5 : 1;
    s->seq = chance(w, 100) ? rig_random(&w->seed) : w->seq;
    s->stiffness_kind = (int32_t)(rig_random(&w->seed) % 3);
    s->unilateral = !chance(w, 3);
    for (int i = 0; i < 3; i++) {
        s->tip_m[i] = w->c.tip_m[i] + rig_uniform(&w->seed, -0.002f, 0.002f);
        s->force_N[i] = chance(w, 4) ? 0.0f : rig_uniform(&w->seed, -12.0f, 12.0f);
    }
    for (int i = 0; i < 9; i++) s->stiffness_N_m[i] = rig_uniform(&w->seed, -2500.0f, 2500.0f);
    if (w->mood && chance(w, 30)) s->force_N[rig_random(&w->seed) % 3] = any_float(w);
    if (w->mood && chance(w, 30)) s->stiffness_N_m[rig_random(&w->seed) % 9] = any_float(w);
    if (w->mood && chance(w, 30)) s->tip_m[rig_random(&w->seed) % 3] = any_float(w);
    s->patch = NULL;
    if (chance(w, 2)) make_patch(w);
    return hrt_sample_check(s, &w->c.params) == HRT_ACCEPT ? s : NULL;
}

static void spoil(wild *w) {
    w->in.bus_ok = !(w->mood && chance(w, 20000));
    w->in.device_fault = w->mood && chance(w, 20000) ? 2 : 0;
    w->in.device_watchdog = w->mood && chance_of_time(w, 5000);
    if (w->mood && chance(w, 50000)) w->in.bus_conflict_us = w->now_us;
    w->in.reset = chance(w, 300);
    if (chance(w, 3000))
        w->in.enable = !w->in.enable;
    else if (chance(w, 300))
        w->in.enable = true;
    if (w->mood && chance(w, 50000)) w->in.device_session++;
    if (chance(w, 700)) w->in.extrapolator = (hrt_extrapolator)(rig_random(&w->seed) % (HRT_EXTRAPOLATOR_COUNT + 1));
    if (chance(w, 1000)) w->in.passivity = !w->in.passivity;
    if (chance(w, 1000)) w->in.coupling = !w->in.coupling;
    w->now_us += w->mood && chance(w, 20000) ? (int64_t)(rig_random(&w->seed) % 600000)
                 : chance(w, 50)             ? w->period_us + 600
                                             : w->period_us;
    if (w->mood && chance(w, 100000)) w->now_us -= 3000;
    if (!(w->mood && chance(w, 30)) && !(w->mood && w->now_us % 1000000 < 20000)) w->in.encoder_us = w->now_us;
}

/* The torque at the handle is arm x force, within its limit, for devices that render it; the direction is computed here
 * from the joints, in the device's axes. */
static void check_handle(const wild *w) {
    const hrt_params *p = &w->c.params;
    const double x = (double)w->out.joint[HRT_TILT], y = (double)w->out.joint[HRT_TILT + 1], angle = hypot(x, y);
    const double across = angle > 0.0 ? sin(angle) / angle : 1.0, d[3] = {across * x, across * y, cos(angle)};
    double size2 = 0.0;
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        const double t = (double)w->out.handle_torque_Nm[i];
        size2 += t * t;
        if (p->handle_torque_max_Nm > 0.0f)
            assert_true(fabs(t - (double)p->arm_m *
                                     (d[j] * (double)w->out.torque[k] - d[k] * (double)w->out.torque[j])) < 2e-6);
        else
            assert_true(w->out.handle_torque_Nm[i] == 0.0f);
    }
    assert_true(sqrt(size2) <= (double)p->handle_torque_max_Nm);
}

static void check_force(const wild *w, const float before[3], float dt_s) {
    const hrt_params *p = &w->c.params;
    double size2 = 0.0, power = 0.0; /* rounding must not exceed a limit */
    float change2 = 0.0f;
    for (int i = 0; i < 3; i++) {
        const float f = w->out.force_N[i], t = w->out.torque[i];
        assert_true(isfinite(f) && isfinite(t));
        assert_true(fabsf(t) <= p->torque_max[i]);
        size2 += (double)f * (double)f;
        change2 += (f - before[i]) * (f - before[i]);
        const double joint_power = (double)t * (double)w->c.joint_velocity[i];
        assert_true(joint_power <= (double)p->axis_power_max_W);
        power += joint_power;
        if (w->out.motors_on && !(w->out.limits & (HRT_LIMIT_POWER | HRT_LIMIT_AXIS)))
            assert_true(fabsf(f - before[i]) <= p->axis_slew_max_N_s * dt_s * 1.001f + 1e-5f);
    }
    assert_true(sqrt(size2) <= (double)p->force_max_N);
    check_handle(w);
    assert_true(power <= (double)p->power_max_W);
    if (w->out.motors_on && !(w->out.limits & (HRT_LIMIT_POWER | HRT_LIMIT_AXIS)))
        assert_true(sqrtf(change2) <= p->slew_max_N_s * dt_s * 1.001f + 1e-5f);
}

static void one_tick(wild *w) {
    const hrt_state state = w->out.state;
    const hrt_fault fault = w->out.fault;
    const int64_t last_us = w->c.last_tick_us;
    float before[3];
    memcpy(before, w->c.force_N, sizeof before);
    move(w);
    spoil(w);
    const hrt_sample *s = next_sample(w);
    hrt_tick(&w->c, w->now_us, &w->in, s, &w->out);
    assert_in_range(w->out.state, 0, HRT_STATE_COUNT - 1);
    if (w->out.state != state && !legal[state][w->out.state])
        fail_msg("%s to %s", hrt_state_name(state), hrt_state_name(w->out.state));
    if (state == HRT_FAULT && w->out.state == HRT_FAULT) assert_int_equal(w->out.fault, fault);
    if (state == HRT_FAULT && w->out.state != HRT_FAULT) assert_true(w->in.reset);
    assert_int_equal(w->out.state == HRT_FAULT, w->out.fault != HRT_FAULT_NONE);
    const bool may_push = w->out.state == HRT_ENGAGED || w->out.state == HRT_STALE;
    assert_int_equal(w->out.motors_on, may_push);
    check_force(w, before, fminf(1e-6f * (float)(w->now_us - last_us), 0.004f));
    for (int i = 0; i < 3 && !may_push; i++) assert_true(w->out.force_N[i] == 0.0f && w->out.torque[i] == 0.0f);
    if (may_push && w->out.sample_age_us > 150000) assert_true(w->out.gain < 1e-3f);
    w->visits[w->out.state]++;
    if (w->out.state != state && w->out.state == HRT_FAULT) w->faults[w->out.fault]++;
    for (int b = 0; b < 16; b++) w->limits[b] += (w->out.limits >> b) & 1u;
}

/* Returns how often the power was limited: on a weak device the force's limit leaves that to rare ticks. */
static int64_t run_device(const hrt_device_type *device, int64_t period_us, int64_t ticks) {
    static wild w;
    memset(&w, 0, sizeof w);
    w.seed = 20000;
    w.now_us = 1000;
    w.period_us = period_us;
    begin(&w, device);
    for (int64_t t = 0; t < ticks; t++) {
        w.mood = t / 20000 % 3 != 0;
        one_tick(&w);
    }
    printf("%s, %lld ticks of %lld us:", device->name, (long long)ticks, (long long)period_us);
    for (int s = 0; s < HRT_STATE_COUNT; s++) printf(" %s %lld", hrt_state_name((hrt_state)s), (long long)w.visits[s]);
    printf("\nfaults:");
    for (int f = 1; f < HRT_FAULT_COUNT; f++) printf(" %s %lld", hrt_fault_name((hrt_fault)f), (long long)w.faults[f]);
    printf("\nlimits:");
    for (int b = 0; b < 11; b++) printf(" %lld", (long long)w.limits[b]);
    printf("\n");
    /* The test is only useful if it reached all states. */
    for (int s = 0; s < HRT_STATE_COUNT; s++) assert_true(w.visits[s] > ticks / 4000000 * period_us);
    assert_true(w.visits[HRT_ENGAGED] > ticks / 5);
    for (int b = 0; b < 11; b++) assert_true(w.limits[b] > 0 || 1 << b == HRT_LIMIT_POWER);
    const hrt_fault seen[] = {HRT_FAULT_DEVICE_REPORTED, HRT_FAULT_BUS_OFF, HRT_FAULT_ENCODER_JUMP, HRT_FAULT_CLOCK,
                              HRT_FAULT_TICK_LATE};
    for (size_t i = 0; i < sizeof seen / sizeof *seen; i++) assert_true(w.faults[seen[i]] > 0);
    int b = 0;
    while (1 << b != HRT_LIMIT_POWER) b++;
    return w.limits[b];
}

/* TM_DEVICE=NAME: this device alone. */
static bool is_asked(int32_t device) {
    const char *only = getenv("TM_DEVICE");
    return !only || strcmp(only, hrt_device_types[device]->name) == 0;
}

static void random_inputs_exceed_no_limit(void **state) {
    (void)state;
    const int64_t ticks = test_is_long() ? 100000000 : 1000000;
    int32_t limited = 0; /* devices */
    for (int32_t t = 0; t < hrt_device_type_count; t++)
        limited += is_asked(t) && run_device(hrt_device_types[t], TICK_US, ticks) > 0;
    assert_true(getenv("TM_DEVICE") || limited >= hrt_device_type_count / 2);
}

static void random_inputs_exceed_no_limit_at_4000_Hz(void **state) {
    (void)state;
    const int64_t ticks = test_is_long() ? 100000000 : 1000000;
    for (int32_t t = 0; t < (test_is_long() ? hrt_device_type_count : 2); t++)
        if (is_asked(t)) run_device(hrt_device_types[t], 250, ticks);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(random_inputs_exceed_no_limit),
                                       cmocka_unit_test(random_inputs_exceed_no_limit_at_4000_Hz)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
