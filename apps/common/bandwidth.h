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

/* Memory for `count` things, zeroed; room for one more. A program that gets none says so and exits with 1. */
void *app_zeroed(size_t count, size_t size);

/* Median of `count` values, which are sorted in place. */
double app_median(double *value, int count);

/* The value that a share of `count` values does not exceed; sorted in place. 0: there are none. */
double app_percentile(double *value, int count, double share);

/* 0 to 1, evenly; moves the state on. */
double app_uniform(uint64_t *state);

/* Processor time of all threads of this process. */
double app_processor_s(void);

#endif
