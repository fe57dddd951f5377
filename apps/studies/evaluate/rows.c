/* What the studies share: a row for each extrapolator and setting, and how far they are. */
#include <stdlib.h>
#include <string.h>

#include "evaluate.h"
#include "json_file.h"

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

void add_error(cJSON *rows, const recording *r, const setting *s, const conditions *c, const char *truth,
               hrt_extrapolator which, const char *name) {
    errors e = replay(r, which, c, NULL);
    cJSON *row = errors_add(rows, &e);
    app_json_add(
        row,
        "extrapolator %s model %s path %s truth %s rate_Hz %g speed_m_s %g tremor_m %g latency_frames %d jitter %g loss %g encoders %hhd peak_N %g",
        name, s->model, s->path, truth, s->rate, s->speed, s->tremor, c->latency_frames, c->jitter, c->loss,
        s->encoders, r->peak_N);
}

void add_errors(cJSON *rows, const recording *r, const setting *s, const conditions *c, const char *truth) {
    for (int x = 0; x < HRT_EXTRAPOLATOR_COUNT; x++)
        add_error(rows, r, s, c, truth, (hrt_extrapolator)x, hrt_extrapolator_name((hrt_extrapolator)x));
}
