/* The devices for simulation and virtual device: core/device_types.h in `double`. */
#include "kinematics.h"

#include <math.h>

#include "libtensormass/numeric/elementary.h"

#define HRT_REAL double
#define HRT_AXES hrt_axes64
#define HRT_TWIN
#define HRT_SQRT sqrt
#define HRT_ASIN tm_arcsine
#define HRT_ATAN2 tm_arctangent2
#define HRT_SINE_COSINE tm_sine_cosine
#define HRT_SIZE_MIN 1.0e-100
#define HRT_SIZE_MAX 1.0e100
#include "core/device_types.h"

#include "core/device_axes.h" /* requires device_types.h */

#define TWIN_ROW(name) &name##_twin,
static const hrt_twin *const twins[] = {HRT_DEVICE_TYPES(TWIN_ROW)}; /* in the order of hrt_device_types */

const hrt_twin *hrt_twin_of(const hrt_device_type *device) { return twins[hrt_device_type_number(device)]; }

bool hrt_axes_along64(hrt_axes64 *axes, const hrt_device_type *device, const double axis[3], const double up[3]) {
    axes->device = device;
    axes->twin = hrt_twin_of(device);
    return turn_along(axes->r, axis, up);
}

void hrt_tip64(const hrt_axes64 *axes, const double joint[HRT_JOINTS], double tip_m[3]) {
    axes->twin->tip(axes, joint, tip_m);
}

void hrt_jacobian64(const hrt_axes64 *axes, const double joint[HRT_JOINTS], double jacobian[9]) {
    axes->twin->jacobian(axes, joint, jacobian);
}

bool hrt_inverse64(const hrt_axes64 *axes, const double tip_m[3], double joint3[3]) {
    return axes->twin->inverse(axes, tip_m, joint3);
}

void hrt_shaft_tip64(const hrt_axes64 *axes, const double shaft[3], double tip_m[3]) {
    const double joint[HRT_JOINTS] = {shaft[0], shaft[1], shaft[2]};
    impulse_engine_tip(axes, joint, tip_m);
}

bool hrt_shaft_of_tip64(const hrt_axes64 *axes, const double tip_m[3], double shaft[3]) {
    return impulse_engine_inverse(axes, tip_m, shaft);
}

void hrt_direction64(const hrt_axes64 *axes, const double joint[HRT_JOINTS], double direction[3]) {
    turn_tilt(axes->r, axes->device->tilts, &joint[HRT_TILT], direction);
}

void hrt_tilt64(const hrt_axes64 *axes, const double direction[3], double tilt_rad[2]) {
    double along[3];
    turn_back(axes->r, direction, along);
    const double across = sqrt(along[0] * along[0] + along[1] * along[1]);
    const double angle = tm_arctangent2(across, along[2]);
    for (int i = 0; i < 2; i++) tilt_rad[i] = across > 0 ? angle * (along[i] / across) : 0;
}

void hrt_counts_to_joint64(const hrt_params *params, const int32_t count[HRT_JOINTS], double joint[HRT_JOINTS]) {
    for (int j = 0; j < HRT_JOINTS; j++) joint[j] = 0.0;
    for (int j = 0; j < params->device->joints; j++)
        joint[j] = ((double)count[j] - (double)params->count_zero[j]) / (double)params->counts_per_unit[j];
}

double hrt_count_of_joint64(const hrt_params *params, int j, double value) {
    return value * (double)params->counts_per_unit[j] + (double)params->count_zero[j];
}
