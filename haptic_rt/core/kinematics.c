/* The Impulse Engine's geometry: a gimbal at the trocar (pitch outside, yaw inside) and a sliding shaft. The Jacobian's
 * columns are orthogonal. */
#include "internal.h"

bool hrt_frame_from_axis(hrt_frame *frame, const float axis[3], const float up[3]) {
    static const hrt_frame identity = {{1.0f, 0.0f, 0.0f, 0.0f, 1.0f, 0.0f, 0.0f, 0.0f, 1.0f}};
    *frame = identity;
    if (!hrt_finite_n(axis, 3) || !hrt_finite_n(up, 3)) return false;
    const float za = hrt_length(axis), ua = hrt_length(up);
    if (!(za > 1.0e-6f) || !(za < 1.0e6f) || !(ua > 1.0e-6f) || !(ua < 1.0e6f)) return false;
    float z[3], y[3], x[3], unit_up[3];
    hrt_copy(z, axis);
    hrt_scale(z, 1.0f / za);
    hrt_copy(unit_up, up);
    hrt_scale(unit_up, 1.0f / ua);
    hrt_cross(unit_up, z, x);
    const float xa = hrt_length(x);
    if (!(xa > 1.0e-3f)) return false;
    hrt_scale(x, 1.0f / xa);
    hrt_cross(z, x, y); /* last, so that all three are perpendicular to rounding however slanted `up` is */
    for (int i = 0; i < 3; i++) {
        frame->r[HRT_XYZ * i] = x[i];
        frame->r[HRT_XYZ * i + 1] = y[i];
        frame->r[HRT_XYZ * i + 2] = z[i];
    }
    return true;
}

/* Our own, so that every machine makes the same bits of it. Error below 1.5e-7 for |angle| < 1000; quarter turns are
 * taken off in three pieces, then Taylor's series economised on +-pi/4. */
static void sine_cosine(float angle, float *sine, float *cosine) {
    const float x = hrt_clamp(angle, -1000.0f, 1000.0f);
    const int32_t quarter = (int32_t)(0.636619772f * x + (x < 0.0f ? -0.5f : 0.5f));
    const float turns = (float)quarter;
    const float r = ((x - turns * 1.5703125f) - turns * 4.837512969970703125e-4f) - turns * 7.549790126404332e-8f;
    const float r2 = r * r;
    const float s = r + r * r2 * (-1.6666654611e-1f + r2 * (8.3321608736e-3f + r2 * -1.9515295891e-4f));
    const float c = 1.0f - 0.5f * r2 +
                    r2 * r2 * (4.166664568298827e-2f + r2 * (-1.388731625493765e-3f + r2 * 2.443315711809948e-5f));
    const bool swap = (quarter & 1) != 0;
    *sine = (swap ? c : s) * ((quarter & 2) != 0 ? -1.0f : 1.0f);
    *cosine = (swap ? s : c) * (((quarter + 1) & 2) != 0 ? -1.0f : 1.0f);
}

void hrt_tip(const hrt_frame *frame, const float joint[HRT_JOINTS], float tip_m[3]) {
    const float d = joint[HRT_INSERTION];
    float sp, cp, sy, cy;
    sine_cosine(joint[HRT_PITCH], &sp, &cp);
    sine_cosine(joint[HRT_YAW], &sy, &cy);
    const float p[3] = {d * sy, d * sp * cy, d * cp * cy};
    hrt_apply(frame->r, p, tip_m);
}

void hrt_jacobian(const hrt_frame *frame, const float joint[HRT_JOINTS], float jacobian[9]) {
    const float d = joint[HRT_INSERTION];
    float sp, cp, sy, cy;
    sine_cosine(joint[HRT_PITCH], &sp, &cp);
    sine_cosine(joint[HRT_YAW], &sy, &cy);
    const float column[3][3] = {
        {0.0f, d * cp * cy, -d * sp * cy}, {d * cy, -d * sp * sy, -d * cp * sy}, {sy, sp * cy, cp * cy}};
    for (int j = 0; j < 3; j++) {
        float world[3];
        hrt_apply(frame->r, column[j], world);
        for (int i = 0; i < 3; i++) jacobian[3 * i + j] = world[i];
    }
}

bool hrt_inverse(const hrt_frame *frame, const float tip_m[3], float joint3[3]) {
    float p[3];
    hrt_apply_transposed(frame->r, tip_m, p);
    const float d = hrt_length(p);
    if (!(d > 1.0e-6f) || !hrt_finite(d)) return false;
    joint3[HRT_PITCH] = atan2f(p[1], p[2]);
    joint3[HRT_YAW] = asinf(hrt_clamp(p[0] / d, -1.0f, 1.0f));
    joint3[HRT_INSERTION] = d;
    return true;
}

void hrt_counts_to_joint(const hrt_params *params, const int32_t count[HRT_JOINTS], float joint[HRT_JOINTS]) {
    for (int j = 0; j < HRT_JOINTS; j++)
        joint[j] = ((float)count[j] - params->count_zero[j]) / params->counts_per_unit[j];
}
