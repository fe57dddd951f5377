/* Time-domain passivity control (Hannaford and Ryu, 2002): an account of energy absorbed from the hand, and a damper
 * that keeps it above zero. */
#include "internal.h"

/* Adds the work of the last tick, in which the force was constant while the tip moved by `moved_m`. The work is exact
 * and needs no velocity estimate. */
void hrt_passivity_observe(hrt_controller *c, int64_t now_us, float dt_s, const float moved_m[3]) {
    const float work_J = vdot(c->force_N, moved_m);
    c->energy_J -= work_J;
    c->debt_J = fmaxf(0.0f, c->debt_J + work_J - c->params.power_max_W * dt_s);
    if (vnorm(c->force_N) > 0.0f) c->force_free_since_us = now_us;
    /* Without contact the account restarts: energy absorbed in an earlier contact must not pay for a new one. */
    else if (hrt_older(now_us - c->force_free_since_us, c->params.passivity_reset_us))
        c->energy_J = 0.0f;
}

void hrt_passivity_control(hrt_controller *c, float dt_s, float force_N[3]) {
    const float speed2 = vdot(c->velocity_m_s, c->velocity_m_s);
    if (!(c->energy_J < 0.0f) || !(speed2 > 1.0e-8f)) return;
    /* The damper that would recover the deficit within one tick, limited for the stability of the sampled loop. */
    const float dt = fmaxf(dt_s, hrt_dt_min_s(&c->params));
    const float damping = fminf(c->params.passivity_damping_max_N_s_m, -c->energy_J / (dt * speed2));
    vadd(force_N, -damping, c->velocity_m_s);
    c->limits |= HRT_LIMIT_PASSIVITY;
}
