/* Shared basics: contracts, errors, memory pools, a clock, small vectors. */
#ifndef TM_BASE_INTERNAL_H
#define TM_BASE_INTERNAL_H

#include "base/contract.h"
#include "base/vec.h"

/* Every array of an object is one block of its pool; releasing the pool frees the object. A failed allocation marks the
 * pool, so that builders allocate everything first and check once. Blocks are zeroed and aligned to 64 bytes. */
typedef struct tm_pool_block tm_pool_block;
typedef struct tm_pool {
    tm_pool_block *first;
    int64_t bytes;
    bool failed;
} tm_pool;
void *tm_pool_alloc(tm_pool *pool, int64_t count, size_t size);
void tm_pool_release(tm_pool *pool);
#define TM_ALLOC(pool, type, count) ((type *)tm_pool_alloc((pool), (count), sizeof(type)))

tm_status tm_fail_memory(tm_error *error, const char *what);

/* One Jacobi rotation: makes entry (p, q) of a symmetric n x n matrix zero. Writes its cosine and sine. An entry that
 * is zero already changes nothing: cosine 1, sine 0. */
static inline void tm_jacobi(double *A, int n, int p, int q, double *cosine, double *sine) {
    *cosine = 1, *sine = 0;
    if (A[n * p + q] == 0) return;
    const double theta = (A[(n + 1) * q] - A[(n + 1) * p]) / (2 * A[n * p + q]);
    const double t = (theta < 0 ? -1 : 1) / (fabs(theta) + sqrt(theta * theta + 1));
    const double c = 1 / sqrt(t * t + 1), s = t * c;
    for (int k = 0; k < n; k++) {
        const double a = A[n * k + p], b = A[n * k + q];
        A[n * k + p] = c * a - s * b;
        A[n * k + q] = s * a + c * b;
    }
    for (int k = 0; k < n; k++) {
        const double a = A[n * p + k], b = A[n * q + k];
        A[n * p + k] = c * a - s * b;
        A[n * q + k] = s * a + c * b;
    }
    *cosine = c, *sine = s;
}
/* Leaves the eigenvalues of a symmetric 6x6 matrix on its diagonal, by Jacobi rotations: accurate for any spread of
 * eigenvalues. */
void tm_diagonalise6(double A[36]);
/* Monotonic time, s. */
double tm_clock_s(void);

#endif
