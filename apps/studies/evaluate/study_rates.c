/* Error of every extrapolator against frame rate, speed, latency, jitter, loss, encoders and model. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "evaluate.h"
#include "json_file.h"

static const double TREMOR_M = 40e-6;
static const double rates[] = {10, 15, 20, 25, 30, 50, 100}, speeds[] = {0.005, 0.01, 0.02, 0.03, 0.05, 0.1};
enum { RATES = sizeof rates / sizeof *rates, SPEEDS = sizeof speeds / sizeof *speeds };

/* Samples of the model at a rate, with the truth of the same path copied from `truth`. */
static int sampled_at(model m, const path *p, double rate, bool encoders, const recording *truth, recording *out) {
    memset(out, 0, sizeof *out);
    snprintf(out->name, sizeof out->name, "%s %g Hz", model_name[m], rate);
    if (record(m, p, rate, encoders, true, out)) return APP_FAILED;
    copy_truth(truth, out);
    return 0;
}

static const conditions ideal = {.seed = 1};

/* One path at one speed: every rate in turn, then at 20 Hz every condition. */
static int one_speed(const study_run *run, model m, double speed, double tremor, path_kind kind, cJSON *rows) {
    path p = path_make(kind, speed, tremor);
    recording truth = {0}, r = {0};
    setting s = {.model = model_name[m], .path = path_name[kind], .speed = speed, .tremor = tremor, .encoders = true};
    if (record_truth(m, &p, true, &truth)) return APP_FAILED;
    bool main_speed = fabs(speed - 0.01) < 1e-9 && kind == PATH_TOUR;
    int rc = 0;
    for (int i = 0; i < RATES && !rc; i++) {
        bool twenty = fabs(rates[i] - 20) < 1e-9;
        if (!twenty && (!main_speed || m == MODEL_HYBRID /* a hundred times dearer than the others */ ||
                        (run->quick && fabs(rates[i] - 10) > 1e-9 && fabs(rates[i] - 50) > 1e-9)))
            continue;
        rc = sampled_at(m, &p, rates[i], true, &truth, &r);
        if (rc) break;
        s.rate = rates[i];
        add_errors(rows, &r, &s, &ideal, "model");
        for (int late = 1; late <= 3 && (twenty || main_speed); late++)
            add_errors(rows, &r, &s, &(conditions){.latency_frames = late, .seed = 1}, "model");
        if (twenty && main_speed) {
            for (int k = 1; k <= 3; k++)
                add_errors(rows, &r, &s, &(conditions){.jitter = 0.25 * k, .seed = 2}, "model");
            for (int k = 1; k <= 3; k++) add_errors(rows, &r, &s, &(conditions){.loss = 0.1 * k, .seed = 3}, "model");
        }
        if (twenty) {
            truth_by_interpolation(&r);
            add_errors(rows, &r, &s, &ideal, "interpolated");
        }
        recording_free(&r);
    }
    recording_free(&truth);
    return rc;
}

/* The same without the encoders' steps. */
static int without_encoders(model m, cJSON *rows) {
    path p = path_make(PATH_TOUR, 0.01, TREMOR_M);
    recording truth = {0}, r = {0};
    setting s = {
        .model = model_name[m], .path = "tour", .speed = 0.01, .tremor = TREMOR_M, .rate = 20, .encoders = false};
    int rc = record_truth(m, &p, false, &truth);
    if (!rc) rc = sampled_at(m, &p, 20, false, &truth, &r);
    if (!rc) add_errors(rows, &r, &s, &ideal, "model");
    recording_free(&r);
    recording_free(&truth);
    return rc;
}

/* The paper's figure 5: impulses, line and error at 20 Hz, in the plane of the slide. */
static int figure5(model m, cJSON *out) {
    path p = path_make(PATH_TOUR, 0.01, 0);
    recording truth = {0}, r = {0};
    int rc = record_truth(m, &p, true, &truth);
    if (!rc) rc = sampled_at(m, &p, 20, true, &truth, &r);
    float *force = rc ? NULL : malloc(3 * (size_t)r.ticks * sizeof *force);
    if (force) {
        cJSON *samples = cJSON_AddArrayToObject(out, "samples"), *line = cJSON_AddArrayToObject(out, "truth"),
              *series = cJSON_AddObjectToObject(out, "extrapolators");
        for (int i = 0; i < r.samples; i++)
            cJSON_AddItemToArray(samples, cJSON_CreateFloatArray(r.sample[i].sample.force_N, 3));
        for (int k = 0; k < r.ticks; k += 2) cJSON_AddItemToArray(line, cJSON_CreateFloatArray(r.truth_N + 3 * k, 3));
        for (int x = 0; x < HRT_EXTRAPOLATOR_COUNT; x++) {
            replay(&r, (hrt_extrapolator)x, &ideal, force);
            cJSON *own = cJSON_AddArrayToObject(series, hrt_extrapolator_name((hrt_extrapolator)x));
            for (int k = 0; k < r.ticks; k += 2) cJSON_AddItemToArray(own, cJSON_CreateFloatArray(force + 3 * k, 3));
        }
        app_json_add(out, "dt_s %g model %s", 2e-6 * TICK_US, model_name[m]);
    }
    free(force);
    recording_free(&r);
    recording_free(&truth);
    return rc;
}

int study_rates(const study_run *run, cJSON *out) {
    cJSON *rows = cJSON_AddArrayToObject(out, "rows"), *figure = cJSON_AddObjectToObject(out, "figure5");
    int rc = 0;
    bool drawn = false;
    for (int m = 0; m < MODEL_COUNT && !rc; m++) {
        if (!run->model[m]) continue;
        for (int i = 0; i < SPEEDS && run->path[PATH_TOUR] && !rc; i++) {
            bool basic = fabs(speeds[i] - 0.01) < 1e-9 || fabs(speeds[i] - 0.03) < 1e-9;
            if ((run->quick || m == MODEL_FIBRED || m == MODEL_HYBRID || m == MODEL_CUT) && !basic) continue;
            if (m == MODEL_HYBRID && fabs(speeds[i] - 0.01) > 1e-9) continue;
            progress(model_name[m], (double)i / SPEEDS);
            rc = one_speed(run, (model)m, speeds[i], TREMOR_M, PATH_TOUR, rows);
            if (!rc && fabs(speeds[i] - 0.01) < 1e-9 && m != MODEL_HYBRID)
                rc = one_speed(run, (model)m, speeds[i], 0, PATH_TOUR, rows);
        }
        if (m == MODEL_HYBRID) continue;
        if (!rc && run->path[PATH_REVERSALS]) rc = one_speed(run, (model)m, 0.05, 0, PATH_REVERSALS, rows);
        if (!run->path[PATH_TOUR]) continue;
        if (!rc) rc = without_encoders((model)m, rows);
        if (!rc && !drawn) rc = figure5((model)m, figure), drawn = true;
    }
    return rc ? rc : study_hands(run, rows);
}
