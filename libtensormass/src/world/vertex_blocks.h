/* The preconditioner of settling by conjugate gradients: inverse 3x3 blocks of the vertices. */
#ifndef TM_VERTEX_BLOCKS_H
#define TM_VERTEX_BLOCKS_H

#include <string.h>

#include "base/vec.h"

static inline double tm_product(const double *a, const double *b, int32_t n) {
    double sum = 0;
    for (int32_t i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

/* inverse [3n] := inverse of each vertex tensor's free part; the identity where that is not positive. n: components. */
static inline void tm_blocks_invert(const double *vertex_tensor, const uint8_t *fixed_of, int32_t n,
                                    double *inverse_of) {
    for (int32_t v = 0; v < n / 3; v++) {
        double K[9], minor[9], *inverse = inverse_of + 9 * (int64_t)v;
        const uint8_t *fixed = fixed_of + 3 * v;
        memcpy(K, vertex_tensor + 9 * (int64_t)v, sizeof K);
        for (int i = 0; i < 9; i++)
            if (fixed[i / 3] || fixed[i % 3]) K[i] = i % 4 ? 0 : 1;
        for (int i = 0; i < 3; i++) vcross(K + 3 * ((i + 1) % 3), K + 3 * ((i + 2) % 3), minor + 3 * i);
        const double det = vdot(K, minor), size = K[0] + K[4] + K[8];
        const bool good = K[0] > 0 && minor[8] > 0 && det > 1e-9 * size * size * size;
        for (int i = 0; i < 9; i++)
            inverse[i] = fixed[i / 3] || fixed[i % 3] ? 0 : good ? minor[3 * (i % 3) + i / 3] / det : i % 4 ? 0 : 1;
    }
}

/* z := inverse r, block by block. */
static inline void tm_blocks_apply(const double *inverse, const double *r, int32_t n, double *z) {
    for (int32_t v = 0; v < n / 3; v++)
        for (int i = 0; i < 3; i++) z[3 * v + i] = vdot(inverse + 9 * (int64_t)v + 3 * i, r + 3 * v);
}

#endif
