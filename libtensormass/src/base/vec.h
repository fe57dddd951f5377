/* Vectors of three doubles, and small helpers beside them. */
#ifndef TM_VEC_H
#define TM_VEC_H

#include <math.h>

#define LAW_REAL double
#include "law/number.h"

static inline double vdot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
static inline double vnorm(const double a[3]) { return sqrt(vdot(a, a)); }
static inline void vset(const double a[3], double out[3]) { out[0] = a[0], out[1] = a[1], out[2] = a[2]; }
static inline void vsub(const double a[3], const double b[3], double out[3]) {
    for (int c = 0; c < 3; c++) out[c] = a[c] - b[c];
}
/* out = a + s b */
static inline void vmadd(const double a[3], double s, const double b[3], double out[3]) {
    for (int c = 0; c < 3; c++) out[c] = a[c] + s * b[c];
}
static inline void vscale(double s, const double a[3], double out[3]) {
    for (int c = 0; c < 3; c++) out[c] = s * a[c];
}
static inline void vcross(const double a[3], const double b[3], double out[3]) {
    double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2], z = a[0] * b[1] - a[1] * b[0];
    out[0] = x, out[1] = y, out[2] = z;
}
/* Unit vector of a, and its length; the zero vector stays zero. */
static inline double vunit(const double a[3], double out[3]) {
    double length = vnorm(a);
    vscale(length > 0 ? 1 / length : 0, a, out);
    return length;
}

#endif
