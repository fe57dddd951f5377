/* The Impulse Engine's geometry: a gimbal at the trocar (pitch outside, yaw inside) and a sliding shaft. The Jacobian's columns are orthogonal. */
#include "internal.h"

bool hrt_frame_from_axis(hrt_frame *frame, const float axis[3], const float up[3]) {
    static const hrt_frame identity = {{1.0f, 0.0f, 0.0f, 0.0f, 1.0f, 0.0f, 0.0f, 0.0f, 1.0f}};
    *frame = identity;
    if (!hrt_finite_n(axis, 3) || !hrt_finite_n(up, 3)) return false;
    const float za = hrt_length(axis), ua = hrt_length(up);
    if (!(za > 1.0e-6f) || !(za < 1.0e6f) || !(ua > 1.0e-6f) || !(ua < 1.0e6f)) return false;
    float z[3], y[3], x[3];
    hrt_copy(z, axis);
    hrt_scale(z, 1.0f / za);
    hrt_copy(y, up);
    hrt_scale(y, 1.0f / ua);
    hrt_add_scaled(y, -hrt_dot(y, z), z);
    const float ya = hrt_length(y);
    if (!(ya > 1.0e-3f)) return false;
    hrt_scale(y, 1.0f / ya);
    hrt_cross(y, z, x);
    for (int i = 0; i < 3; i++) {
        frame->r[3 * i] = x[i];
        frame->r[3 * i + 1] = y[i];
        frame->r[3 * i + 2] = z[i];
    }
    return true;
}

void hrt_tip(const hrt_frame *frame, const float joint[HRT_JOINTS], float tip_m[3]) {
    const float cy = cosf(joint[HRT_YAW]), d = joint[HRT_INSERTION];
    const float p[3] = {d * sinf(joint[HRT_YAW]), d * sinf(joint[HRT_PITCH]) * cy, d * cosf(joint[HRT_PITCH]) * cy};
    hrt_apply(frame->r, p, tip_m);
}

void hrt_jacobian(const hrt_frame *frame, const float joint[HRT_JOINTS], float jacobian[9]) {
    const float sp = sinf(joint[HRT_PITCH]), cp = cosf(joint[HRT_PITCH]);
    const float sy = sinf(joint[HRT_YAW]), cy = cosf(joint[HRT_YAW]), d = joint[HRT_INSERTION];
    const float column[3][3] = {{0.0f, d * cp * cy, -d * sp * cy}, {d * cy, -d * sp * sy, -d * cp * sy}, {sy, sp * cy, cp * cy}};
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
    for (int j = 0; j < HRT_JOINTS; j++) joint[j] = ((float)count[j] - params->count_zero[j]) / params->counts_per_unit[j];
}
