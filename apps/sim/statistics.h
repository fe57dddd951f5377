/* Root mean squares of a run; io/histogram.h has the quantiles. */
#ifndef TM_SIM_STATISTICS_H
#define TM_SIM_STATISTICS_H

#include <stdbool.h>
#include <stdint.h>

typedef struct sim_magnitude {
    double sum_of_squares, peak;
    int64_t count;
} sim_magnitude;
void sim_magnitude_add(sim_magnitude *m, const double v[3]);
double sim_magnitude_rms(const sim_magnitude *m);

struct cJSON;
/* {"rms": …, "peak": …} */
void sim_report_magnitude(struct cJSON *parent, const char *name, const sim_magnitude *m);

#endif
