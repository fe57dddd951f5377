/* The device that this build is for, as controller, simulation and virtual device know it: its axes, limits, counts and
 * geometry. A device is one file engine_NAME.h; the row below names it.
 *
 * The geometry is included once for `float`, the controller's (core/kinematics.c), and once for the simulation's
 * precision (device/kinematics.c): the includer sets HRT_REAL, HRT_AXES, HRT_KINEMATICS(name), the functions HRT_SQRT,
 * HRT_ASIN, HRT_ATAN2 and HRT_SINE_COSINE, and HRT_SIZE_MIN and _MAX, between which a square keeps its digits. What
 * all devices share of it stands here; `tip`, `jacobian` and `inverse` are the device's. */

#ifndef HRT_ENGINE
#define HRT_ENGINE "engine_impulse.h" /* the row */
#endif

#ifdef HRT_REAL

static HRT_REAL size_of(const HRT_REAL a[3]) { return HRT_SQRT(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }

/* y = s M x, row-major 3x3. */
static inline void turn(const HRT_REAL m[9], HRT_REAL s, const HRT_REAL x[3], HRT_REAL y[3]) {
    for (int i = 0; i < 3; i++) y[i] = s * (m[3 * i] * x[0] + m[3 * i + 1] * x[1] + m[3 * i + 2] * x[2]);
}

static inline void cross(const HRT_REAL a[3], const HRT_REAL b[3], HRT_REAL c[3]) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

static bool make_unit(const HRT_REAL a[3], HRT_REAL unit[3]) {
    const HRT_REAL most = (HRT_REAL)HRT_SIZE_MAX, least = (HRT_REAL)HRT_SIZE_MIN;
    for (int i = 0; i < 3; i++) /* not by isfinite: the firmware build may be told that no NaN exists */
        if (!(a[i] >= -most && a[i] <= most)) return false;
    const HRT_REAL size = size_of(a);
    if (!(size > least) || !(size < most)) return false;
    for (int i = 0; i < 3; i++) unit[i] = a[i] / size;
    return true;
}

bool HRT_KINEMATICS(axes_along)(HRT_AXES *axes, const HRT_REAL axis[3], const HRT_REAL up[3]) {
    HRT_REAL z[3], y[3], x[3], unit_up[3];
    for (int i = 0; i < 9; i++) axes->r[i] = (HRT_REAL)(i % 4 == 0);
    if (!make_unit(axis, z) || !make_unit(up, unit_up)) return false;
    cross(unit_up, z, y);
    if (!(size_of(y) > (HRT_REAL)1.0e-3) || !make_unit(y, x)) return false;
    cross(z, x, y); /* last, so that all three are perpendicular to rounding however slanted `up` is */
    for (int i = 0; i < 3; i++) {
        HRT_REAL *row = axes->r + (ptrdiff_t)3 * i;
        row[0] = x[i], row[1] = y[i], row[2] = z[i];
    }
    return true;
}

void HRT_KINEMATICS(counts_to_joint)(const hrt_params *params, const int32_t count[HRT_JOINTS],
                                     HRT_REAL joint[HRT_JOINTS]) {
    for (int j = 0; j < HRT_JOINTS; j++)
        joint[j] = ((HRT_REAL)count[j] - (HRT_REAL)params->count_zero[j]) / (HRT_REAL)params->counts_per_unit[j];
}

/* Not rounded: an encoder may add its noise first. */
HRT_REAL HRT_KINEMATICS(count_of_joint)(const hrt_params *params, int j, HRT_REAL value) {
    return value * (HRT_REAL)params->counts_per_unit[j] + (HRT_REAL)params->count_zero[j];
}

#endif

#include HRT_ENGINE
