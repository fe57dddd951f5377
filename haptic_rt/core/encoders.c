/* Converts encoder counts to joints, tip and velocity, and checks their plausibility. */
#include "internal.h"

static void start_from(hrt_controller *c, int64_t now_us, const hrt_input *in) {
    c->device_seen = true;
    c->device_session = in->device_session;
    for (int j = 0; j < HRT_JOINTS; j++) {
        c->count[j] = in->count[j];
        c->count_changed_us[j] = now_us;
        c->joint_velocity[j] = 0.0f;
    }
    for (int j = 0; j < HRT_MOTORS; j++) c->torque_low[j] = c->torque_high[j] = 0.0f;
}

static void check_range(hrt_controller *c, int64_t now_us) {
    for (int j = 0; j < hrt_joints(&c->params); j++) {
        const float margin = 0.02f * (c->params.joint_max[j] - c->params.joint_min[j]);
        if (c->joint[j] < c->params.joint_min[j] - margin || c->joint[j] > c->params.joint_max[j] + margin)
            hrt_latch(c, now_us, HRT_FAULT_ENCODER_RANGE, j);
    }
}

static void check_jump(hrt_controller *c, int64_t now_us, const hrt_input *in, float dt_s) {
    for (int j = 0; j < hrt_joints(&c->params); j++) {
        /* Three counts: quantisation at both ends and one of noise. */
        const float most = c->params.speed_max[j] * c->params.counts_per_unit[j] * dt_s + 3.0f;
        const float step = (float)in->count[j] - (float)c->count[j];
        if (step > most || step < -most) hrt_latch(c, now_us, HRT_FAULT_ENCODER_JUMP, j);
    }
}

/* Detects a stuck encoder: the count stays constant although the torque varied by a large share of its maximum.
 * Friction and a firm hand withstand far less than that within one count. A stop at the end of the workspace may
 * withstand it, so joints there are exempt. */
static void check_stuck(hrt_controller *c, int64_t now_us, const hrt_input *in) {
    for (int j = 0; j < hrt_motors(&c->params); j++) {
        const float margin = 0.01f * (c->params.joint_max[j] - c->params.joint_min[j]);
        const bool at_stop =
            c->joint[j] < c->params.joint_min[j] + margin || c->joint[j] > c->params.joint_max[j] - margin;
        if (in->count[j] != c->count[j] || at_stop || c->state != HRT_ENGAGED) {
            c->count_changed_us[j] = now_us;
            c->torque_low[j] = c->torque_high[j] = c->torque[j];
            continue;
        }
        c->torque_low[j] = fminf(c->torque_low[j], c->torque[j]);
        c->torque_high[j] = fmaxf(c->torque_high[j], c->torque[j]);
        if (hrt_older(now_us - c->count_changed_us[j], c->params.stuck_us) &&
            c->torque_high[j] - c->torque_low[j] > c->params.stuck_torque * c->params.torque_max[j])
            hrt_latch(c, now_us, HRT_FAULT_ENCODER_STUCK, j);
    }
}

static void take_counts(hrt_controller *c, const hrt_input *in, float dt_s) {
    const float tau = (1.0e-6f * c->params.velocity_filter_us);
    const float share = dt_s / (dt_s + tau);
    for (int j = 0; j < hrt_joints(&c->params); j++) {
        const float rate = ((float)in->count[j] - (float)c->count[j]) / (c->params.counts_per_unit[j] * dt_s);
        c->joint_velocity[j] += share * (rate - c->joint_velocity[j]);
        c->joint_next[j] = rate + (rate - c->joint_rate[j]);
        c->joint_rate[j] = rate;
        c->count[j] = in->count[j];
    }
}

void hrt_read_device(hrt_controller *c, int64_t now_us, const hrt_input *in) {
    if (!in->bus_ok && c->state != HRT_BOOT) hrt_latch(c, now_us, HRT_FAULT_BUS_OFF, 0);
    if (in->encoder_us == 0 || in->encoder_us == c->encoder_us || in->encoder_us > now_us) return;
    const bool first = !c->device_seen || c->state == HRT_BOOT || c->state == HRT_FAULT;
    const float least_s = hrt_dt_min_s(&c->params), past_s = hrt_seconds(in->encoder_us - c->encoder_us);
    const float dt_s = first ? 1.0e-6f * c->params.period_us : hrt_clamp(past_s, least_s, 0.05f);
#ifdef HRT_ONE_DEVICE /* firmware: encoder_us is now */
    const float longest_s = dt_s;
#else /* a driver's encoder_us bounds a state's age: a late one may have been measured as late as now */
    const float longest_s = first ? dt_s : hrt_clamp(hrt_seconds(now_us - c->encoder_us), least_s, 0.05f);
#endif
    c->encoder_us = in->encoder_us;
    if (first) start_from(c, now_us, in);
    check_jump(c, now_us, in, longest_s);
    check_stuck(c, now_us, in);
    take_counts(c, in, dt_s);
    hrt_counts_to_joint(&c->params, c->count, c->joint);
    hrt_tip(&c->axes, c->joint, c->tip_m);
    check_range(c, now_us);
    float jacobian[9];
    hrt_jacobian(&c->axes, c->joint, jacobian);
    hrt_apply(jacobian, c->joint_velocity, c->velocity_m_s);
}
