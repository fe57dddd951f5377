/* Mounting of a device in the scene, in either precision; include after device_types.h. */

static inline void cross(const HRT_REAL a[3], const HRT_REAL b[3], HRT_REAL c[3]) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

#if HRT_WITH_FREE
/* Computes the direction of a shaft tilted from z by the angle |tilt|, towards x and y in the ratio of its entries. */
static void turn_tilt(const HRT_REAL r[9], bool tilts, const HRT_REAL tilt[2], HRT_REAL direction[3]) {
    HRT_REAL along[3] = {0, 0, 1}, s;
    const HRT_REAL angle = tilts ? HRT_SQRT(tilt[0] * tilt[0] + tilt[1] * tilt[1]) : 0;
    if (angle > (HRT_REAL)1.0e-6) {
        HRT_SINE_COSINE(angle, &s, &along[2]);
        along[0] = s * (tilt[0] / angle), along[1] = s * (tilt[1] / angle);
    }
    turn(r, 1, along, direction);
}
#endif

static bool make_unit(const HRT_REAL a[3], HRT_REAL unit[3]) {
    const HRT_REAL most = (HRT_REAL)HRT_SIZE_MAX, least = (HRT_REAL)HRT_SIZE_MIN;
    for (int i = 0; i < 3; i++) /* isfinite may be optimised away in a firmware build */
        if (!(a[i] >= -most && a[i] <= most)) return false;
    const HRT_REAL size = size_of(a);
    if (!(size > least) || !(size < most)) return false;
    for (int i = 0; i < 3; i++) unit[i] = a[i] / size;
    return true;
}

/* Computes the rotation with columns x, y, z (row-major): z along `axis`, y near `up`. Returns false, with the
 * identity, if they are invalid or parallel. */
static bool turn_along(HRT_REAL r[9], const HRT_REAL axis[3], const HRT_REAL up[3]) {
    HRT_REAL z[3], y[3], x[3], unit_up[3];
    for (int i = 0; i < 9; i++) r[i] = (HRT_REAL)(i % 4 == 0);
    if (!make_unit(axis, z) || !make_unit(up, unit_up)) return false;
    cross(unit_up, z, y);
    if (!(size_of(y) > (HRT_REAL)1.0e-3) || !make_unit(y, x)) return false;
    cross(z, x, y); /* last, so that all three are perpendicular to rounding for any `up` */
    for (int i = 0; i < 3; i++) {
        HRT_REAL *row = r + (ptrdiff_t)3 * i;
        row[0] = x[i], row[1] = y[i], row[2] = z[i];
    }
    return true;
}
