/* The devices for the tick: device_types.h in `float`. */
#include "internal.h"

/* Computes sine and cosine with identical bits on every machine. The error is below 1.5e-7 for |angle| < 1000.
 * Subtracts quarter turns in three parts, then uses Taylor series economised on +-pi/4. */
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

#define HRT_REAL float
#define HRT_AXES hrt_axes
#define HRT_DESCRIBE
#define HRT_SQRT sqrtf
#define HRT_ASIN asinf
#define HRT_ATAN2 atan2f
#define HRT_SINE_COSINE sine_cosine
#define HRT_SIZE_MIN 1.0e-6f
#define HRT_SIZE_MAX 1.0e6f
#include "device_types.h"

#include "device_axes.h" /* requires device_types.h */

/* With one device, call it directly instead of through the table. */
#ifdef HRT_ONE_DEVICE
#define CALL(axes, what) impulse_engine_##what
#else
#define CALL(axes, what) (axes)->device->what
#endif

#define TYPE_ROW(name) &name##_type,
const hrt_device_type *const hrt_device_types[] = {HRT_DEVICE_TYPES(TYPE_ROW)};
const int32_t hrt_device_type_count = (int32_t)(sizeof hrt_device_types / sizeof hrt_device_types[0]);

#if HRT_WITH_WORDS
int32_t hrt_device_type_find(const char *name) {
    for (int32_t t = 0; t < hrt_device_type_count; t++)
        if (hrt_same_name(hrt_device_types[t]->name, name)) return t;
    return -1;
}
#endif

int32_t hrt_device_type_number(const hrt_device_type *device) {
    for (int32_t t = 0; t < hrt_device_type_count; t++)
        if (hrt_device_types[t] == device) return t;
    return 0;
}

bool hrt_axes_along(hrt_axes *axes, const hrt_device_type *device, const float axis[3], const float up[3]) {
    axes->device = device;
    axes->is_free = false;
    return turn_along(axes->r, axis, up);
}

#if HRT_WITH_FREE
void hrt_direction(const hrt_axes *axes, const float joint[HRT_JOINTS], float direction[3]) {
    turn_tilt(axes->r, axes->device->tilts, &joint[HRT_TILT], direction);
}
#endif

void hrt_tip(const hrt_axes *axes, const float joint[HRT_JOINTS], float tip_m[3]) {
    CALL(axes, tip)(axes, joint, tip_m);
}

void hrt_jacobian(const hrt_axes *axes, const float joint[HRT_JOINTS], float jacobian[9]) {
    CALL(axes, jacobian)(axes, joint, jacobian);
}

bool hrt_inverse(const hrt_axes *axes, const float tip_m[3], float joint3[3]) {
    return CALL(axes, inverse)(axes, tip_m, joint3);
}

void hrt_counts_to_joint(const hrt_params *params, const int32_t count[HRT_JOINTS], float joint[HRT_JOINTS]) {
    for (int j = 0; j < HRT_JOINTS; j++) joint[j] = 0.0f;
    for (int j = 0; j < hrt_joints(params); j++)
        joint[j] = ((float)count[j] - params->count_zero[j]) / params->counts_per_unit[j];
}

/* Not rounded: the virtual device adds noise before rounding. */
float hrt_count_of_joint(const hrt_params *params, int j, float value) {
    return value * params->counts_per_unit[j] + params->count_zero[j];
}
