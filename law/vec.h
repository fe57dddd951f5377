/* Vectors of three, in the precision of who includes this: LAW_REAL as for the law. */
#ifndef LAW_VEC_H
#define LAW_VEC_H

#include <math.h>

#include "law/number.h"

static inline law_real vdot(const law_real a[3], const law_real b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
static inline law_real vnorm(const law_real a[3]) {
    const law_real square = vdot(a, a);
    return (law_real)(sizeof square == sizeof(float) ? sqrtf((float)square) : sqrt((double)square));
}
static inline void vset(const law_real a[3], law_real out[3]) { out[0] = a[0], out[1] = a[1], out[2] = a[2]; }
static inline void vsub(const law_real a[3], const law_real b[3], law_real out[3]) {
    for (int c = 0; c < 3; c++) out[c] = a[c] - b[c];
}
/* out = a + s b */
static inline void vmadd(const law_real a[3], law_real s, const law_real b[3], law_real out[3]) {
    for (int c = 0; c < 3; c++) out[c] = a[c] + s * b[c];
}
static inline void vscale(law_real s, const law_real a[3], law_real out[3]) {
    for (int c = 0; c < 3; c++) out[c] = s * a[c];
}
static inline void vcross(const law_real a[3], const law_real b[3], law_real out[3]) {
    law_real x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2], z = a[0] * b[1] - a[1] * b[0];
    out[0] = x, out[1] = y, out[2] = z;
}
/* Unit vector of a, and its length; the zero vector stays zero. */
static inline law_real vunit(const law_real a[3], law_real out[3]) {
    law_real length = vnorm(a);
    vscale(length > 0 ? 1 / length : 0, a, out);
    return length;
}

#endif
