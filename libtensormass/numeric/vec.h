/* Vectors of three, in the precision that the including file sets: LAW_REAL, as for the contact law. */
#ifndef LAW_VEC_H
#define LAW_VEC_H

#include <math.h>

#include "libtensormass/numeric/number.h"

/* By value: stays in registers across calls, where arrays would go through memory. */
typedef struct law_v3 {
    law_real x, y, z;
} law_v3;

#define LAW_IN_PLACE static inline __attribute__((always_inline))
LAW_IN_PLACE law_v3 vget(const law_real a[3]) { return (law_v3){a[0], a[1], a[2]}; }
LAW_IN_PLACE void vput(law_v3 v, law_real out[3]) { out[0] = v.x, out[1] = v.y, out[2] = v.z; }
LAW_IN_PLACE law_v3 vtimes(law_real s, law_v3 a) { return (law_v3){s * a.x, s * a.y, s * a.z}; }
LAW_IN_PLACE law_v3 vplus(law_v3 a, law_v3 b) { return (law_v3){a.x + b.x, a.y + b.y, a.z + b.z}; }
LAW_IN_PLACE law_v3 vminus(law_v3 a, law_v3 b) { return (law_v3){a.x - b.x, a.y - b.y, a.z - b.z}; }
LAW_IN_PLACE law_real vinner(law_v3 a, law_v3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
LAW_IN_PLACE law_v3 vouter(law_v3 a, law_v3 b) {
    return (law_v3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
LAW_IN_PLACE law_real vroot(law_real square) { return _Generic(square, float : sqrtf, double : sqrt)(square); }
LAW_IN_PLACE law_real vsize(law_v3 a) { return vroot(vinner(a, a)); }

/* In memory; `out` may alias an input. */
static inline law_real vdot(const law_real a[3], const law_real b[3]) { return vinner(vget(a), vget(b)); }
static inline law_real vnorm(const law_real a[3]) { return vsize(vget(a)); }
static inline void vset(const law_real a[3], law_real out[3]) { out[0] = a[0], out[1] = a[1], out[2] = a[2]; }
static inline void vsub(const law_real a[3], const law_real b[3], law_real out[3]) {
    for (int c = 0; c < 3; c++) out[c] = a[c] - b[c];
}
/* out = a + s b */
static inline void vmadd(const law_real a[3], law_real s, const law_real b[3], law_real out[3]) {
    for (int c = 0; c < 3; c++) out[c] = a[c] + s * b[c];
}
/* to += s b */
static inline void vadd(law_real to[3], law_real s, const law_real b[3]) {
    for (int c = 0; c < 3; c++) to[c] += s * b[c];
}
static inline void vscale(law_real s, const law_real a[3], law_real out[3]) {
    for (int c = 0; c < 3; c++) out[c] = s * a[c];
}
static inline void vcross(const law_real a[3], const law_real b[3], law_real out[3]) {
    vput(vouter(vget(a), vget(b)), out);
}
/* Computes the unit vector of a and returns its length; the zero vector stays zero. */
static inline law_real vunit(const law_real a[3], law_real out[3]) {
    law_real length = vnorm(a);
    vscale(length > 0 ? 1 / length : 0, a, out);
    return length;
}
/* Returns the distance from a point to a line segment. */
static inline law_real vsegment(const law_real point[3], const law_real from[3], const law_real to[3]) {
    law_real axis[3], off[3];
    vsub(to, from, axis);
    vsub(point, from, off);
    const law_real length2 = vdot(axis, axis), t = length2 > 0 ? law_clamp(vdot(off, axis) / length2, 0, 1) : 0;
    vmadd(off, -t, axis, off);
    return vnorm(off);
}

#endif
