/* Memory bandwidth of this machine, measured in the same run as the figure that is compared with it. */
#ifndef TM_BANDWIDTH_H
#define TM_BANDWIDTH_H

#include <stddef.h>
#include <stdint.h>

#include "clock.h"

/* Returns the memory bandwidth of one thread, B/s. It computes c[i] = a[i] + s b[i] over arrays of `bytes` together
 * (the triad of McCalpin's STREAM) and takes the median of `rounds` passes. Returns 0 if memory is exhausted. Choose
 * `bytes` like the working set in question. */
double app_bandwidth_B_s(size_t bytes, int rounds);

/* Allocates `count` zeroed elements, and one more. If memory is exhausted, the program ends with a message and exit
 * code 1. */
void *app_zeroed(size_t count, size_t size);

/* Returns the median of `count` values, which it sorts in place. */
double app_median(double *value, int count);

/* Returns the value that a share of `count` values does not exceed; sorts them in place. Returns 0 if there are
 * none. */
double app_percentile(double *value, int count, double share);

/* Returns a uniform random number in 0 to 1 and advances the state. */
double app_uniform(uint64_t *state);

/* Returns the processor time of all threads of this process, s. */
double app_processor_s(void);

#endif
