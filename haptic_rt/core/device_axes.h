/* Mounting of a device in the scene, in either precision; include after device_types.h. */

static inline void cross(const HRT_REAL a[3], const HRT_REAL b[3], HRT_REAL c[3]) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

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
