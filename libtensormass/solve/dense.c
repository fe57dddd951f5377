/* LU with partial pivoting of the on-line system's small matrices. */
#include "local.h"

#include <math.h>

bool tms_lu(double *restrict a, int32_t *restrict pivot, int32_t n) {
    for (int32_t k = 0; k < n; k++) {
        int32_t best = k;
        for (int32_t i = k + 1; i < n; i++)
            if (fabs(a[(int64_t)i * n + k]) > fabs(a[(int64_t)best * n + k])) best = i;
        pivot[k] = best;
        if (!(fabs(a[(int64_t)best * n + k]) > 1e-300)) return false;
        if (best != k)
            for (int32_t j = 0; j < n; j++) {
                const double t = a[(int64_t)k * n + j];
                a[(int64_t)k * n + j] = a[(int64_t)best * n + j];
                a[(int64_t)best * n + j] = t;
            }
        const double *restrict top = a + (int64_t)k * n;
        const double inverse = 1 / top[k];
        for (int32_t i = k + 1; i < n; i++) {
            double *restrict row = a + (int64_t)i * n;
            const double factor = row[k] * inverse;
            row[k] = factor;
            if (factor != 0)
                for (int32_t j = k + 1; j < n; j++) row[j] -= factor * top[j];
        }
    }
    return true;
}

void tms_lu_solve(const double *a, const int32_t *pivot, int32_t n, double *x) {
    for (int32_t k = 0; k < n; k++) { /* rows were swapped whole, so all swaps come first */
        const double t = x[k];
        x[k] = x[pivot[k]];
        x[pivot[k]] = t;
    }
    for (int32_t i = 1; i < n; i++) {
        double sum = 0;
        for (int32_t j = 0; j < i; j++) sum += a[(int64_t)i * n + j] * x[j];
        x[i] -= sum;
    }
    for (int32_t i = n - 1; i >= 0; i--) {
        double sum = 0;
        for (int32_t j = i + 1; j < n; j++) sum += a[(int64_t)i * n + j] * x[j];
        x[i] = (x[i] - sum) / a[(int64_t)i * n + i];
    }
}
