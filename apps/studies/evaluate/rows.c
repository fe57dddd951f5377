/* What the studies share: a row for each extrapolator and setting, and how far they are. */
#include <stdlib.h>
#include <string.h>

#include "evaluate.h"

void progress(const char *what, double fraction) { app_progress(what, fraction, false); }

void copy_truth(const recording *truth, recording *out) {
    size_t bytes = 3 * (size_t)truth->ticks * sizeof(float);
    out->ticks = truth->ticks, out->peak_N = truth->peak_N;
    out->tip_m = malloc(bytes), out->truth_N = malloc(bytes);
    if (!out->tip_m || !out->truth_N) abort();
    memcpy(out->tip_m, truth->tip_m, bytes);
    memcpy(out->truth_N, truth->truth_N, bytes);
    if (!truth->phase) return;
    out->phase = malloc((size_t)truth->ticks);
    if (!out->phase) abort();
    memcpy(out->phase, truth->phase, (size_t)truth->ticks);
}

cJSON *add_row(cJSON *rows) {
    cJSON *row = cJSON_CreateObject();
    cJSON_AddItemToArray(rows, row);
    return row;
}

void add_error(cJSON *rows, const recording *r, const setting *s, const conditions *c, const char *truth,
               hrt_extrapolator which, const char *name) {
    errors e = replay(r, which, c, NULL);
    cJSON *row = errors_json(&e);
    cJSON_AddItemToArray(rows, row);
    cJSON_AddStringToObject(row, "extrapolator", name);
    cJSON_AddStringToObject(row, "model", s->model);
    cJSON_AddStringToObject(row, "path", s->path);
    cJSON_AddStringToObject(row, "truth", truth);
    cJSON_AddNumberToObject(row, "rate_Hz", s->rate);
    cJSON_AddNumberToObject(row, "speed_m_s", s->speed);
    cJSON_AddNumberToObject(row, "tremor_m", s->tremor);
    cJSON_AddNumberToObject(row, "latency_frames", c->latency_frames);
    cJSON_AddNumberToObject(row, "jitter", c->jitter);
    cJSON_AddNumberToObject(row, "loss", c->loss);
    cJSON_AddBoolToObject(row, "encoders", s->encoders);
    cJSON_AddNumberToObject(row, "peak_N", r->peak_N);
}

void add_errors(cJSON *rows, const recording *r, const setting *s, const conditions *c, const char *truth) {
    for (int x = 0; x < HRT_EXTRAPOLATOR_COUNT; x++)
        add_error(rows, r, s, c, truth, (hrt_extrapolator)x, hrt_extrapolator_name((hrt_extrapolator)x));
}
