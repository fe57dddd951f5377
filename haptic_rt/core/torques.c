/* The last stage: limits the force and computes the torques. Each step only reduces the force or its change. */
#include "internal.h"

/* Relative thresholds of a limit: applied above FROM, reduced to HELD, so that rounding never exceeds it. */
static const float FROM = 0.999999f, HELD = 0.999998f;
static const float DEBT_PER_S = 250.0f; /* rate at which energy beyond the power limit is compensated */

#if HRT_WITH_FREE
/* Computes the torque of a force at the tip about the handle's point, world axes. Force and torque together have the
 * power of the tip's force at the tip, so the limits of power and the energy account hold for both. Returns false if
 * the device renders none. */
static bool find_handle_torque(const hrt_controller *c, const float force[3], float torque[3]) {
    float d[3];
    if (!(c->params.handle_torque_max_Nm > 0.0f) || !c->axes.is_free) return false;
    hrt_direction(&c->axes, c->joint, d);
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        torque[i] = c->params.arm_m * (d[j] * force[k] - d[k] * force[j]);
    }
    return true;
}
#endif

/* Returns the share of `force` that the motors and the force limit allow. */
static float allowed_share(hrt_controller *c, const float jacobian[9], const float force[3]) {
    float torque[3], share = 1.0f;
    hrt_apply_transposed(jacobian, force, torque);
    for (int j = 0; j < HRT_MOTORS; j++) {
        const float size = fabsf(torque[j]);
        if (size > FROM * c->params.torque_max[j]) {
            share = fminf(share, HELD * c->params.torque_max[j] / size);
            c->limits |= HRT_LIMIT_AXIS;
        }
    }
    const float size = vnorm(force);
    if (size > FROM * c->params.force_max_N) {
        share = fminf(share, HELD * c->params.force_max_N / size);
        c->limits |= HRT_LIMIT_FORCE;
    }
#if HRT_WITH_FREE
    if (find_handle_torque(c, force, torque) && vnorm(torque) > FROM * c->params.handle_torque_max_Nm) {
        share = fminf(share, HELD * c->params.handle_torque_max_Nm / vnorm(torque));
        c->limits |= HRT_LIMIT_AXIS;
    }
#endif
    return share;
}

/* Returns the share of the force change that the slew limits allow; a late tick allows no larger step. */
static float slew_share(hrt_controller *c, float dt_s, const float change[3]) {
    const float dt = fminf(dt_s, 0.004f);
    float share = 1.0f;
    const float most = c->params.slew_max_N_s * dt, axis_most = c->params.axis_slew_max_N_s * dt;
    const float size = vnorm(change);
    if (size > most) share = most / size;
    for (int i = 0; i < 3; i++) {
        const float axis = fabsf(change[i]);
        if (axis > axis_most) share = fminf(share, axis_most / axis);
    }
    if (share < 1.0f) c->limits |= HRT_LIMIT_SLEW;
    return share;
}

/* Returns the share that keeps the power delivered to the hand within its limits, per joint and in total. Uses the
 * filtered velocity and the predicted one: a light hand accelerates faster than the filter. Energy delivered beyond the
 * limit nevertheless (exact work of the observer) is compensated. */
static float power_share(hrt_controller *c, const float torque[3]) {
    const float most_W = fmaxf(0.0f, c->params.power_max_W - DEBT_PER_S * c->debt_J);
    float share = 1.0f, sum = 0.0f;
    for (int j = 0; j < HRT_MOTORS; j++) {
        const float power = fmaxf(torque[j] * c->joint_velocity[j], torque[j] * c->joint_next[j]);
        sum += power;
        if (power > FROM * c->params.axis_power_max_W) share = fminf(share, HELD * c->params.axis_power_max_W / power);
    }
    if (sum > FROM * most_W) share = fminf(share, HELD * most_W / sum);
    if (share < 1.0f) c->limits |= HRT_LIMIT_POWER;
    return share;
}

void hrt_limit_force(hrt_controller *c, float dt_s, const float wanted_N[3]) {
    float jacobian[9], force[3], change[3];
    hrt_jacobian(&c->axes, c->joint, jacobian);
    /* A finite but huge force would overflow when squared. */
    for (int i = 0; i < 3; i++) force[i] = hrt_clamp(wanted_N[i], -1.0e6f, 1.0e6f);
    vscale(allowed_share(c, jacobian, force), force, force);
    vsub(force, c->force_N, change);
    const float share = slew_share(c, dt_s, change);
    vset(c->force_N, force);
    vadd(force, share, change);
    vscale(allowed_share(c, jacobian, force), force, force); /* the joints have moved under the last force */
    hrt_apply_transposed(jacobian, force, c->torque);
    const float power = power_share(c, c->torque);
    for (int i = 0; i < 3; i++) {
        c->force_N[i] = power * force[i];
        c->torque[i] = hrt_clamp(power * c->torque[i], -c->params.torque_max[i], c->params.torque_max[i]);
    }
#if HRT_WITH_FREE
    find_handle_torque(c, c->force_N, c->handle_torque_Nm);
#endif
}
