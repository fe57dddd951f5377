#include <stdio.h>
#include <stdlib.h>

#include "bandwidth.h"
#include "libtensormass/numeric/order.h"
#include "libtensormass/numeric/random.h"

double app_processor_s(void) { return app_clock_s(CLOCK_PROCESS_CPUTIME_ID); }

void *app_zeroed(size_t count, size_t size) {
    void *memory = calloc(count + 1, size);
    if (memory) return memory;
    fprintf(stderr, "no memory for %zu bytes; use a coarser mesh or --quick\n", count * size);
    exit(1);
}

double app_median(double *value, int count) {
    num_sort(value, count);
    return count % 2 ? value[count / 2] : 0.5 * (value[count / 2 - 1] + value[count / 2]);
}

double app_percentile(double *value, int count, double share) {
    num_sort(value, count);
    return count ? value[(int)(share * (count - 1))] : 0;
}

double app_uniform(uint64_t *state) { return num_unit(num_random64(state)); }

static void triad(const double *restrict a, const double *restrict b, double *restrict c, size_t n, double s) {
    for (size_t i = 0; i < n; i++) c[i] = a[i] + s * b[i];
}

double app_bandwidth_B_s(size_t bytes, int rounds) {
    enum { MAX_ROUNDS = 64 };
    if (rounds > MAX_ROUNDS) rounds = MAX_ROUNDS;
    size_t n = bytes / (3 * sizeof(double));
    double *memory = malloc(3 * n * sizeof *memory), rate[MAX_ROUNDS];
    if (!memory || n == 0 || rounds < 1) {
        free(memory);
        return 0;
    }
    for (size_t i = 0; i < 3 * n; i++) memory[i] = 1.0;
    /* Repeats small arrays until the clock resolves the time. */
    size_t passes = 1 + (size_t)20e6 / bytes;
    volatile double sink = 0;
    (void)sink;
    for (int r = -1; r < rounds; r++) { /* round -1 warms up */
        double start = app_seconds();
        for (size_t p = 0; p < passes; p++) {
            triad(memory, memory + n, memory + 2 * n, n, 1.0 + (double)p);
            sink += memory[2 * n + p % n]; /* keeps the compiler from removing a pass */
        }
        if (r >= 0) rate[r] = (double)(3 * n * sizeof *memory * passes) / (app_seconds() - start);
    }
    free(memory);
    return app_median(rate, rounds);
}
