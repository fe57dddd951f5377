/* Points by value, for the contact law alone: in registers from call to call, where arrays would go through memory. */
#ifndef HRT_VECTOR_H
#define HRT_VECTOR_H

#include "internal.h"

typedef struct hrt_v3 {
    float x, y, z;
} hrt_v3;

static inline __attribute__((always_inline)) hrt_v3 hrt_get(const float a[3]) { return (hrt_v3){a[0], a[1], a[2]}; }
static inline __attribute__((always_inline)) void hrt_put(hrt_v3 v, float a[3]) { a[0] = v.x, a[1] = v.y, a[2] = v.z; }
static inline __attribute__((always_inline)) hrt_v3 hrt_times(float s, hrt_v3 a) {
    return (hrt_v3){s * a.x, s * a.y, s * a.z};
}
static inline __attribute__((always_inline)) hrt_v3 hrt_plus(hrt_v3 a, hrt_v3 b) {
    return (hrt_v3){a.x + b.x, a.y + b.y, a.z + b.z};
}
static inline __attribute__((always_inline)) hrt_v3 hrt_minus(hrt_v3 a, hrt_v3 b) {
    return (hrt_v3){a.x - b.x, a.y - b.y, a.z - b.z};
}
static inline __attribute__((always_inline)) float hrt_inner(hrt_v3 a, hrt_v3 b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
static inline __attribute__((always_inline)) hrt_v3 hrt_outer(hrt_v3 a, hrt_v3 b) {
    return (hrt_v3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
static inline __attribute__((always_inline)) float hrt_size(hrt_v3 a) { return sqrtf(hrt_inner(a, a)); }

#endif
