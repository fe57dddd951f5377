/* Comparisons of numbers for qsort. */
#ifndef NUM_ORDER_H
#define NUM_ORDER_H

#include <stdint.h>
#include <stdlib.h>

static inline int num_ascending(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}
static inline int num_ascending_int32(const void *a, const void *b) {
    const int32_t x = *(const int32_t *)a, y = *(const int32_t *)b;
    return (x > y) - (x < y);
}
static inline int num_ascending_int64(const void *a, const void *b) {
    const int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
    return (x > y) - (x < y);
}
static inline void num_sort(double *value, int64_t count) { qsort(value, (size_t)count, sizeof *value, num_ascending); }

#endif
