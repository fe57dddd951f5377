#include "figures.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdlib.h>

void sim_quantiles_add(sim_quantiles *q, double value) {
    if (q->count == q->capacity) {
        int64_t larger = q->capacity ? 2 * q->capacity : 1024;
        float *moved = realloc(q->value, (size_t)larger * sizeof *moved);
        if (!moved) return;
        q->value = moved;
        q->capacity = larger;
    }
    q->value[q->count++] = (float)value;
}

static int ascending(const void *a, const void *b) {
    float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

double sim_quantile(sim_quantiles *q, double share) {
    if (!q->count) return 0;
    qsort(q->value, (size_t)q->count, sizeof *q->value, ascending);
    int64_t i = (int64_t)ceil(share * (double)q->count) - 1;
    return (double)q->value[i < 0 ? 0 : i];
}

void sim_quantiles_free(sim_quantiles *q) { free(q->value); }

void sim_magnitude_add(sim_magnitude *m, const double v[3]) {
    double square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
    m->sum_of_squares += square;
    m->peak = fmax(m->peak, sqrt(square));
    m->count++;
}

double sim_magnitude_rms(const sim_magnitude *m) { return m->count ? sqrt(m->sum_of_squares / (double)m->count) : 0; }

void sim_report_quantiles(cJSON *parent, const char *name, sim_quantiles *q) {
    cJSON *row = cJSON_AddObjectToObject(parent, name);
    cJSON_AddNumberToObject(row, "p50", sim_quantile(q, 0.5));
    cJSON_AddNumberToObject(row, "p99", sim_quantile(q, 0.99));
    cJSON_AddNumberToObject(row, "max", sim_quantile(q, 1));
}

void sim_report_magnitude(cJSON *parent, const char *name, const sim_magnitude *m) {
    cJSON *row = cJSON_AddObjectToObject(parent, name);
    cJSON_AddNumberToObject(row, "rms", sim_magnitude_rms(m));
    cJSON_AddNumberToObject(row, "peak", m->peak);
}
