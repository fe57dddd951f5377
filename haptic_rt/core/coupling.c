/* Virtual coupling, for scenes stiffer than the device can render. The hand feels a spring and a damper to a proxy that
 * touches the scene. The proxy has no mass: k (P - x) + F(x) = 0, solved by one Newton step per tick, implicit in the
 * scene's stiffness. */
#include "internal.h"

/* Solves (k I - K) d = r by Cramer's rule; it is well conditioned if K is negative semidefinite to rounding. Returns
 * false if not: the proxy stays where it is. */
static bool newton(const float stiffness[9], float k, const float r[3], float d[3]) {
    float m[9];
    for (int i = 0; i < 9; i++) m[i] = (i % 4 == 0 ? k : 0.0f) - stiffness[i];
    const float c0 = m[4] * m[8] - m[5] * m[7], c1 = m[5] * m[6] - m[3] * m[8], c2 = m[3] * m[7] - m[4] * m[6];
    const float determinant = m[0] * c0 + m[1] * c1 + m[2] * c2;
    if (!(determinant > 0.1f * k * k * k)) return false;
    d[0] = (r[0] * c0 + r[1] * (m[2] * m[7] - m[1] * m[8]) + r[2] * (m[1] * m[5] - m[2] * m[4])) / determinant;
    d[1] = (r[0] * c1 + r[1] * (m[0] * m[8] - m[2] * m[6]) + r[2] * (m[2] * m[3] - m[0] * m[5])) / determinant;
    d[2] = (r[0] * c2 + r[1] * (m[1] * m[6] - m[0] * m[7]) + r[2] * (m[0] * m[4] - m[1] * m[3])) / determinant;
    return true;
}

static const float *scene_stiffness(const hrt_controller *c) {
    return c->extrapolation.now.stiffness_kind != 0 ? c->extrapolation.now.stiffness_N_m : c->extrapolation.broyden_N_m;
}

void hrt_render(hrt_controller *c, int64_t now_us, bool coupling, float force_N[3]) {
    const float k = c->params.coupling_N_m;
    const float *stiffness = scene_stiffness(c);
    const bool couple = coupling && hrt_norm9(stiffness) > k;
    if (!couple) {
        c->proxy_valid = false;
        hrt_extrapolation_force(&c->extrapolation, &c->params, now_us, c->tip_m, force_N);
        c->limits |= c->extrapolation.limits;
        return;
    }
    if (!c->proxy_valid) vset(c->tip_m, c->proxy_m);
    float scene[3], pull[3], residual[3], step[3];
    hrt_extrapolation_force(&c->extrapolation, &c->params, now_us, c->proxy_m, scene);
    c->limits |= c->extrapolation.limits | HRT_LIMIT_COUPLING;
    vsub(c->tip_m, c->proxy_m, pull);
    vset(scene, residual);
    vadd(residual, k, pull);
    if (newton(stiffness, k, residual, step)) vadd(c->proxy_m, 1.0f, step);
    /* Limits the distance to twice that of the maximum force. */
    vsub(c->proxy_m, c->tip_m, pull);
    const float far = vnorm(pull), most = 2.0f * c->params.force_max_N / k;
    if (far > most) {
        vscale(most / far, pull, pull);
        for (int i = 0; i < 3; i++) c->proxy_m[i] = c->tip_m[i] + pull[i];
    }
    for (int i = 0; i < 3; i++) force_N[i] = k * pull[i];
    if (vnorm(force_N) > 0.0f) vadd(force_N, -c->params.coupling_N_s_m, c->velocity_m_s);
    c->proxy_valid = true;
}
