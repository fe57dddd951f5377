/* Solves small symmetric systems. */
#ifndef LAW_LINEAR_H
#define LAW_LINEAR_H

#include "libtensormass/numeric/number.h"

/* Solves a x = b; a is symmetric positive definite [n][stride] with b in its column n. Only the upper triangle of a is
 * read and written; x is returned in column n. A pivot that is not positive sets its unknown to 0. */
static LAW_CALL void law_eliminate(law_real *a, int32_t stride, int32_t n) {
    const law_real least = LAW(1e-12);
    for (int32_t k = 0; k < n; k++) {
        const law_real *line = a + k * stride;
        const law_real inverse = line[k] > least ? LAW(1) / line[k] : LAW(0);
        for (int32_t i = k + 1; i < n; i++) {
            const law_real factor = line[i] * inverse, *from = line + i, *end = line + n;
            law_real *to = a + i * stride + i;
            do *to++ -= factor * *from;
            while (++from <= end);
        }
    }
    for (int32_t k = n - 1; k >= 0; k--) {
        law_real *line = a + k * stride, sum = line[n];
        for (int32_t j = k + 1; j < n; j++) sum -= line[j] * a[j * stride + n];
        line[n] = line[k] > least ? sum / line[k] : LAW(0);
    }
}

/* Returns the index of entry (i, j), i <= j, of a symmetric matrix with its upper triangle stored row by row, n
 * wide. */
static inline int32_t law_packed(int32_t n, int32_t i, int32_t j) { return i * (2 * n - i - 1) / 2 + j; }

/* Factorises LDL^T in place: the first n rows and columns of a packed matrix `width` wide, with `shift` added to its
 * diagonal. Returns false if it is not positive semidefinite. A pivot within `least` of zero must have a row within
 * `loose` of zero, as constrained components have. */
static LAW_CALL bool law_semidefinite(law_real *a, int32_t width, int32_t n, law_real shift, law_real least,
                                      law_real loose) {
    for (int32_t k = 0; k < n; k++) {
        law_real *line = a + law_packed(width, k, 0);
        const law_real pivot = line[k] + shift;
        if (!(pivot >= -least)) return false;
        const bool none = pivot <= least;
        for (int32_t i = k + 1; i < n; i++) {
            if (none && !(line[i] <= loose && line[i] >= -loose)) return false;
            const law_real factor = none ? LAW(0) : line[i] / pivot, *from = line + i, *end = line + n;
            if (factor == LAW(0)) continue;
            law_real *to = a + law_packed(width, i, i);
            do *to++ -= factor * *from;
            while (++from < end);
        }
    }
    return true;
}

#endif
