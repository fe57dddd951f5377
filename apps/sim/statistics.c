#include "statistics.h"

#include <cjson/cJSON.h>
#include <math.h>

void sim_magnitude_add(sim_magnitude *m, const double v[3]) {
    double square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2];
    m->sum_of_squares += square;
    m->peak = fmax(m->peak, sqrt(square));
    m->count++;
}

double sim_magnitude_rms(const sim_magnitude *m) { return m->count ? sqrt(m->sum_of_squares / (double)m->count) : 0; }

void sim_report_magnitude(cJSON *parent, const char *name, const sim_magnitude *m) {
    cJSON *row = cJSON_AddObjectToObject(parent, name);
    cJSON_AddNumberToObject(row, "rms", sim_magnitude_rms(m));
    cJSON_AddNumberToObject(row, "peak", m->peak);
}
