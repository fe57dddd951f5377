/* The tick, and the state machine of docs/controller.md. */
#include "internal.h"

void hrt_init(hrt_controller *controller, const hrt_params *params, const hrt_axes *axes, int64_t session) {
    static const hrt_controller zero = {.state = HRT_BOOT};
    *controller = zero;
    controller->params = *params;
    if (!controller->params.device) controller->params.device = axes->device;
    controller->axes = *axes;
    controller->axes.device = controller->params.device;
    controller->session = session;
    hrt_extrapolation_reset(&controller->extrapolation, HRT_HOLD);
}

static bool in_use(const hrt_controller *c) { return c->state == HRT_ENGAGED || c->state == HRT_STALE; }

static void enter(hrt_controller *c, int64_t now_us, hrt_state state) {
    if (state == HRT_BOOT) {
        c->device_seen = false; /* encoder_us stays: only a newer frame counts */
        c->sample_seen = false;
        c->sample_rule = HRT_RULE_TAKE;
        hrt_extrapolation_reset(&c->extrapolation, c->extrapolation.which);
    }
    if (state == HRT_ENGAGED && c->state == HRT_IDLE) {
        c->gain = 0.0f;
        c->energy_J = 0.0f;
        c->proxy_valid = false;
        c->force_free_since_us = now_us;
    }
    c->state = state;
    c->state_since_us = now_us;
    c->good_since_us = now_us;
}

/* Returns the time since the last tick, s; one period at the first. Checks the clock and late ticks. */
static float read_clock(hrt_controller *c, int64_t now_us) {
    const int64_t gap_us = c->ticked ? now_us - c->last_tick_us : (int32_t)c->params.period_us;
    if (gap_us < 0) hrt_latch(c, now_us, HRT_FAULT_CLOCK, 0);
    if (in_use(c) && hrt_older(gap_us, c->params.tick_timeout_us)) hrt_latch(c, now_us, HRT_FAULT_TICK_LATE, 0);
    if (in_use(c) && hrt_older(gap_us, c->params.tick_pause_us)) {
        c->limits |= HRT_LIMIT_PAUSE;
        enter(c, now_us, HRT_IDLE);
    }
    c->ticked = true;
    c->last_tick_us = now_us;
    return hrt_clamp(hrt_seconds(gap_us), 0.0f, 1.0f);
}

static int64_t sample_age(const hrt_controller *c, int64_t now_us) {
    return c->sample_seen ? now_us - c->sample_us : -1;
}

static bool sample_fresh(const hrt_controller *c, int64_t now_us) {
    return c->sample_seen && c->sample_rule < HRT_RULE_FADE && !hrt_older(now_us - c->sample_us, c->params.stale_us);
}

/* Checks order and origin of a sample that passed hrt_sample_check. Returns true if it is to be taken over. */
static bool sample_wanted(hrt_controller *c, int64_t now_us, const hrt_sample *s) {
    c->counters.samples_received++;
    if (s->tool_session != c->session || s->t_us > now_us) {
        c->counters.samples_rejected++;
        return false;
    }
    if (!c->sample_seen) return true;
    if (s->session != c->sim_session) {
        /* Another simulation may not take over during contact: it waits until the force of the first has ramped down.
         */
        if (in_use(c)) {
            c->counters.samples_rejected++;
            return false;
        }
        hrt_extrapolation_reset(&c->extrapolation, c->extrapolation.which);
        return true;
    }
    /* After a silence any later t_n is accepted: a corrupted seq must not block 2^31 samples. */
    const bool after_silence = !in_use(c) && !sample_fresh(c, now_us) && s->t_us > c->sample_us;
    if (!after_silence && (!hrt_seq_after(s->seq, c->sample_seq) || s->t_us < c->sample_us)) {
        c->counters.samples_late++;
        return false;
    }
    if (!after_silence) c->counters.samples_lost += s->seq - c->sample_seq - 1u;
    return true;
}

/* Takes over a sample by the rule of its flags (flags.c). */
static void take_over(hrt_controller *c, const hrt_sample *newest) {
    if (!c->sample_seen || c->sim_session != newest->session)
        c->sample_us = 0; /* no fresh sample of this session yet */
    c->sample_seen = true;
    c->sim_session = newest->session;
    c->sample_seq = newest->seq;
    const hrt_flag_rule rule = hrt_flags_rule(newest->flags);
    if (rule != HRT_RULE_NOT_FRESH || c->sample_rule < HRT_RULE_FADE)
        c->sample_rule = (uint8_t)rule; /* a repeated sample does not end a ramp down */
    if (rule >= HRT_RULE_NOT_FRESH) return;
    c->sample_us = newest->t_us;
    hrt_extrapolation_sample(&c->extrapolation, &c->params, newest);
}

static void read_simulation(hrt_controller *c, int64_t now_us, const hrt_input *in, const hrt_sample *newest) {
    if ((int)in->extrapolator >= 0 && in->extrapolator < HRT_EXTRAPOLATOR_COUNT)
        hrt_extrapolation_select(&c->extrapolation, in->extrapolator);
    if (newest && c->state != HRT_FAULT && sample_wanted(c, now_us, newest)) take_over(c, newest);
    /* The limit bits descend in the order of the rules. */
    if (c->sample_seen && c->sample_rule != HRT_RULE_TAKE) c->limits |= 2u * HRT_LIMIT_FORCE_ONLY >> c->sample_rule;
}

/* Raises a fault if another controller commands the same device. Frames from before this state are ignored: a blocked
 * bus may still deliver frames of a predecessor. */
static void check_bus_conflict(hrt_controller *c, int64_t now_us, const hrt_input *in) {
    if (c->state != HRT_BOOT && in->bus_conflict_us > c->state_since_us)
        hrt_latch(c, now_us, HRT_FAULT_BUS_CONFLICT, 0);
}

/* Checks the device in the states that use it. Returns false if it changed the state. */
static bool device_well(hrt_controller *c, int64_t now_us, const hrt_input *in) {
    const int64_t silent_us = now_us - c->encoder_us;
    if (in->device_fault) {
        hrt_latch(c, now_us, HRT_FAULT_DEVICE_REPORTED, in->device_fault);
        return false;
    }
    const bool restarted = in->device_session != 0 && c->device_session != 0 && in->device_session != c->device_session;
    if (c->device_session == 0) c->device_session = in->device_session;
    if (restarted || hrt_older(silent_us, c->params.device_timeout_us)) {
        if (in_use(c))
            hrt_latch(c, now_us, restarted ? HRT_FAULT_DEVICE_RESTARTED : HRT_FAULT_DEVICE_SILENT, 0);
        else
            enter(c, now_us, HRT_BOOT);
        return false;
    }
    if (in_use(c) && (in->device_watchdog || hrt_older(silent_us, c->params.device_pause_us))) {
        c->limits |= HRT_LIMIT_PAUSE;
        enter(c, now_us, HRT_IDLE);
        return false;
    }
    return true;
}

static void change_state(hrt_controller *c, int64_t now_us, const hrt_input *in, float dt_s) {
    const bool fresh = sample_fresh(c, now_us) && in->enable;
    const bool quiet = hrt_older(now_us - c->encoder_us, c->params.device_pause_us);
    switch (c->state) {
    case HRT_BOOT:
        if (c->device_seen && in->bus_ok) enter(c, now_us, HRT_SELF_TEST);
        break;
    case HRT_SELF_TEST:
        if (in->device_fault)
            hrt_latch(c, now_us, HRT_FAULT_DEVICE_REPORTED, in->device_fault);
        else if (hrt_older(now_us - c->state_since_us, c->params.self_test_timeout_us))
            hrt_latch(c, now_us, HRT_FAULT_SELF_TEST, 0);
        else if (quiet || in->device_watchdog)
            c->good_since_us = now_us;
        else if (hrt_older(now_us - c->good_since_us, c->params.self_test_us))
            enter(c, now_us, HRT_IDLE);
        break;
    case HRT_IDLE:
        /* t_n after entering: the simulation answers to this very visit. */
        if (device_well(c, now_us, in) && fresh && !quiet && !in->device_watchdog && c->sample_us > c->state_since_us)
            enter(c, now_us, HRT_ENGAGED);
        break;
    case HRT_ENGAGED:
        if (!device_well(c, now_us, in)) break;
        if (!fresh)
            enter(c, now_us, HRT_STALE);
        else
            c->gain = fminf(1.0f, c->gain + fminf(dt_s, 0.004f) / (1.0e-6f * c->params.ramp_us));
        break;
    case HRT_STALE:
        if (!device_well(c, now_us, in)) break;
        c->gain = fmaxf(0.0f, c->gain - dt_s / (1.0e-6f * c->params.fade_us));
        if (!(c->gain > 0.0f))
            enter(c, now_us, HRT_IDLE);
        else if (fresh)
            enter(c, now_us, HRT_ENGAGED);
        break;
    case HRT_FAULT:
        if (in->reset && in->bus_ok) {
            c->fault = HRT_FAULT_NONE;
            c->fault_detail = 0;
            enter(c, now_us, HRT_BOOT);
        }
        break;
    case HRT_STATE_COUNT: break;
    }
}

static void no_force(hrt_controller *c) {
    for (int i = 0; i < 3; i++) c->force_N[i] = c->torque[i] = 0.0f;
#if HRT_WITH_FREE
    for (int i = 0; i < 3; i++) c->handle_torque_Nm[i] = 0.0f;
#endif
    c->gain = 0.0f;
}

static void make_force(hrt_controller *c, int64_t now_us, const hrt_input *in, float dt_s) {
    float force[3];
#if HRT_WITH_FREE
    hrt_shaft *shaft = &c->extrapolation.touch.shaft;
    shaft->is_free = c->axes.is_free;
    if (shaft->is_free) hrt_direction(&c->axes, c->joint, shaft->direction);
#endif
    hrt_render(c, now_us, in->coupling, force);
    if (in->passivity) hrt_passivity_control(c, dt_s, force);
    if (!hrt_finite_n(force, 3)) {
        hrt_latch(c, now_us, HRT_FAULT_INTERNAL, 0);
        no_force(c);
        return;
    }
    if (c->gain < 1.0f) c->limits |= HRT_LIMIT_RAMP;
    vscale(c->gain, force, force);
    hrt_limit_force(c, dt_s, force);
}

static void report(const hrt_controller *c, int64_t now_us, const hrt_input *in, hrt_result *out) {
    out->state = c->state;
    out->fault = c->fault;
    out->fault_detail = c->fault_detail;
    out->limits = c->limits;
    out->motors_on = in_use(c);
    for (int i = 0; i < HRT_MOTORS; i++) {
        out->torque[i] = c->torque[i];
        out->force_N[i] = c->force_N[i];
        out->tip_m[i] = c->tip_m[i];
        out->velocity_m_s[i] = c->velocity_m_s[i];
    }
#if HRT_WITH_FREE
    hrt_apply_transposed(c->axes.r, c->handle_torque_Nm, out->handle_torque_Nm);
#endif
    for (int j = 0; j < HRT_JOINTS; j++) out->joint[j] = c->joint[j];
    out->gain = c->gain;
    out->passivity_J = -c->energy_J;
    out->sample_age_us = sample_age(c, now_us);
    out->extrapolator = c->extrapolation.which;
    out->pedal = in->pedal;
}

void hrt_tick(hrt_controller *c, int64_t now_us, const hrt_input *in, const hrt_sample *newest, hrt_result *out) {
    float before[3], moved[3];
    const hrt_state state = c->state;
    c->counters.ticks++;
    c->limits = 0;
    vset(c->tip_m, before);
    /* Parameters stay constant after this check; it is repeated whenever `boot` is passed. */
    if (c->state == HRT_BOOT && hrt_params_check(&c->params) >= 0)
        hrt_latch(c, now_us, HRT_FAULT_PARAMETER, hrt_params_check(&c->params));
    const float dt_s = read_clock(c, now_us);
    hrt_read_device(c, now_us, in);
    check_bus_conflict(c, now_us, in);
    vsub(c->tip_m, before, moved);
    if (in_use(c)) hrt_passivity_observe(c, now_us, dt_s, moved);
    read_simulation(c, now_us, in, newest);
    if (c->state == state) change_state(c, now_us, in, dt_s); /* one state change per tick */
    if (in_use(c))
        make_force(c, now_us, in, dt_s);
    else
        no_force(c);
    report(c, now_us, in, out);
}
