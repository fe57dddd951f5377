/* Quantiles and root mean squares of a run, without keeping every value's order until the end. */
#ifndef TM_SIM_FIGURES_H
#define TM_SIM_FIGURES_H

#include <stdbool.h>
#include <stdint.h>

typedef struct sim_quantiles {
    float *value;
    int64_t count, capacity;
} sim_quantiles;

/* Grows; not for a real-time thread's inner loop, once a frame is fine. */
void sim_quantiles_add(sim_quantiles *q, double value);
/* Sorts. 0 when empty. */
double sim_quantile(sim_quantiles *q, double share);
void sim_quantiles_free(sim_quantiles *q);

typedef struct sim_magnitude {
    double sum_of_squares, peak;
    int64_t count;
} sim_magnitude;
void sim_magnitude_add(sim_magnitude *m, const double v[3]);
double sim_magnitude_rms(const sim_magnitude *m);

struct cJSON;
/* {"p50": …, "p99": …, "max": …} */
void sim_report_quantiles(struct cJSON *parent, const char *name, sim_quantiles *q);
/* {"rms": …, "peak": …} */
void sim_report_magnitude(struct cJSON *parent, const char *name, const sim_magnitude *m);

#endif
