/* Force of the condensed part on the interface. Sums in eight lanes, always the same: one after the other they would
 * wait for each other. */
#include "hybrid.h"

#include <string.h>

enum { LANES = 8 };
static double sum_lanes(const double lane[LANES]) {
    double sum = 0;
    for (int k = 0; k < LANES; k++) sum += lane[k];
    return sum;
}

double tms_dot(const double *restrict a, const double *restrict b, int32_t n) {
    double lane[LANES] = {0}, rest = 0;
    int32_t i = 0;
    for (; i + LANES <= n; i += LANES)
        for (int k = 0; k < LANES; k++) lane[k] += a[i + k] * b[i + k];
    for (; i < n; i++) rest += a[i] * b[i];
    return rest + sum_lanes(lane);
}

/* push -= r * x, and the sum of r * at. */
static double both_halves(const double *restrict r, double x, const double *restrict at, double *restrict push,
                          int32_t n) {
    double lane[LANES] = {0}, rest = 0;
    int32_t j = 0;
    for (; j + LANES <= n; j += LANES)
        for (int k = 0; k < LANES; k++) {
            lane[k] += r[j + k] * at[j + k];
            push[j + k] -= r[j + k] * x;
        }
    for (; j < n; j++) {
        rest += r[j] * at[j];
        push[j] -= r[j] * x;
    }
    return rest + sum_lanes(lane);
}

/* push := interface_N - schur * at, each entry of the triangle read once. */
void tms_hybrid_push_back(const tm_hybrid *h) {
    const int32_t n = h->interface_count;
    const double *row = h->schur, *at = h->at_m;
    double *push = h->push_N;
    memcpy(push, h->responses.interface_N, 8 * (size_t)n);
    for (int32_t i = 0; i < n; row += n - i, i++)
        push[i] -= row[0] * at[i] + both_halves(row + 1, at[i], at + i + 1, push + i + 1, n - i - 1);
}
