/* Studies along tool paths: rates and what they depend on, tissue that is cut or grasped, roughness of the force, two
 * cauteries at random. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bandwidth.h"
#include "evaluate.h"
#include "json_file.h"

/* --- rows --- */

/* Conditions of a row. */
typedef struct setting {
    const char *model, *path;
    double rate, speed, tremor;
    bool encoders;
} setting;

void progress(const char *what, double fraction) { app_progress(what, fraction, false); }

static void *copy_of(const void *from, size_t bytes) { return memcpy(app_zeroed(bytes, 1), from, bytes); }

void copy_truth(const recording *truth, recording *out) {
    const size_t bytes = 3 * (size_t)truth->ticks * sizeof(float);
    out->ticks = truth->ticks, out->peak_N = truth->peak_N;
    out->tip_m = copy_of(truth->tip_m, bytes), out->truth_N = copy_of(truth->truth_N, bytes);
    if (truth->phase) out->phase = copy_of(truth->phase, (size_t)truth->ticks);
}

static void add_error(cJSON *rows, const recording *r, const setting *s, const conditions *c, const char *truth,
                      hrt_extrapolator which, const char *name) {
    errors e = replay(r, which, c, NULL);
    cJSON *row = errors_add(rows, &e);
    app_json_add(
        row,
        "extrapolator %s model %s path %s truth %s rate_Hz %g speed_m_s %g tremor_m %g latency_frames %d jitter %g loss %g encoders %hhd peak_N %g",
        name, s->model, s->path, truth, s->rate, s->speed, s->tremor, c->latency_frames, c->jitter, c->loss,
        s->encoders, r->peak_N);
}

/* Adds one row, and one for each extrapolator. */
static void add_errors(cJSON *rows, const recording *r, const setting *s, const conditions *c, const char *truth) {
    for (int x = 0; x < HRT_EXTRAPOLATOR_COUNT; x++)
        add_error(rows, r, s, c, truth, (hrt_extrapolator)x, hrt_extrapolator_name((hrt_extrapolator)x));
}

/* --- error by rate, speed, latency, jitter, loss, encoders and model --- */

static const double TREMOR_M = 40e-6, SPEED_M_S = 0.01, RATE_HZ = 20;
static const double rates[] = {10, 15, 20, 25, 30, 50, 100}, speeds[] = {0.005, 0.01, 0.02, 0.03, 0.05, 0.1};
enum { RATES = sizeof rates / sizeof *rates, SPEEDS = sizeof speeds / sizeof *speeds };

/* Records samples of the model at a rate, with the truth of the same path copied from `truth`. */
static int sampled_at(model m, const path *p, double rate, bool encoders, const recording *truth, recording *out) {
    memset(out, 0, sizeof *out);
    snprintf(out->name, sizeof out->name, "%s %g Hz", model_name[m], rate);
    if (record(m, p, rate, encoders, true, out)) return APP_FAILED;
    copy_truth(truth, out);
    return 0;
}

static const conditions ideal = {.seed = 1};

/* Reproduces the paper's figure 5: impulses, line and error at 20 Hz, in the plane of the slide. */
static void figure5(const recording *r, model m, cJSON *out) {
    float *force = app_zeroed(3 * (size_t)r->ticks, sizeof *force);
    cJSON *samples = cJSON_AddArrayToObject(out, "samples"), *line = cJSON_AddArrayToObject(out, "truth"),
          *series = cJSON_AddObjectToObject(out, "extrapolators");
    for (int i = 0; i < r->samples; i++)
        cJSON_AddItemToArray(samples, cJSON_CreateFloatArray(r->sample[i].sample.force_N, 3));
    for (int k = 0; k < r->ticks; k += 2) cJSON_AddItemToArray(line, cJSON_CreateFloatArray(r->truth_N + 3 * k, 3));
    for (int x = 0; x < HRT_EXTRAPOLATOR_COUNT; x++) {
        replay(r, (hrt_extrapolator)x, &ideal, force);
        cJSON *own = cJSON_AddArrayToObject(series, hrt_extrapolator_name((hrt_extrapolator)x));
        for (int k = 0; k < r->ticks; k += 2) cJSON_AddItemToArray(own, cJSON_CreateFloatArray(force + 3 * k, 3));
    }
    app_json_add(out, "dt_s %g model %s", 2e-6 * TICK_US, model_name[m]);
    free(force);
}

/* Studies one path at one speed: every rate in turn, then every condition at 20 Hz; and `figure`, if not null. */
static int one_speed(const study_run *run, model m, double speed, double tremor, path_kind kind, cJSON *rows,
                     cJSON *figure) {
    path p = path_make(kind, speed, tremor);
    recording truth = {0}, r = {0};
    setting s = {.model = model_name[m], .path = path_name[kind], .speed = speed, .tremor = tremor, .encoders = true};
    if (record_truth(m, &p, true, &truth)) return APP_FAILED;
    bool main_speed = fabs(speed - 0.01) < 1e-9 && kind == PATH_TOUR;
    int rc = 0;
    for (int i = 0; i < RATES && !rc; i++) {
        bool twenty = fabs(rates[i] - 20) < 1e-9;
        if (!twenty && (!main_speed || m == MODEL_HYBRID /* a hundred times costlier than the others */ ||
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
        if (twenty && figure) figure5(&r, m, figure);
        if (twenty) {
            truth_by_interpolation(&r);
            add_errors(rows, &r, &s, &ideal, "interpolated");
        }
        recording_free(&r);
    }
    recording_free(&truth);
    return rc;
}

/* Studies the same without encoder steps. */
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
            rc = one_speed(run, (model)m, speeds[i], TREMOR_M, PATH_TOUR, rows, NULL);
            if (!rc && fabs(speeds[i] - 0.01) < 1e-9 && m != MODEL_HYBRID)
                rc = one_speed(run, (model)m, speeds[i], 0, PATH_TOUR, rows, drawn ? NULL : figure), drawn = true;
        }
        if (m == MODEL_HYBRID) continue;
        if (!rc && run->path[PATH_REVERSALS]) rc = one_speed(run, (model)m, 0.05, 0, PATH_REVERSALS, rows, NULL);
        if (!run->path[PATH_TOUR]) continue;
        if (!rc) rc = without_encoders((model)m, rows);
    }
    return rc ? rc : study_hands(run, rows);
}

/* --- tissue that is cut or grasped --- */

/* Adds rows with the truth's cuts: the simulation of 20 Hz removes the same tetrahedra at the same simulated times, so
 * that only extrapolation differs. A cautery that cuts by itself at 20 Hz removes slightly different tetrahedra; its
 * row gives the number in common. */

static int sampled_rows(model m, const path *p, const recording *truth, bool own_cuts, cJSON *rows) {
    recording r = {.replay = own_cuts || !truth->cuts.count ? NULL : &truth->cuts};
    char name[64];
    snprintf(name, sizeof name, "%s%s", path_name[p->kind], own_cuts ? ", own cuts" : "");
    const setting s = {.model = model_name[m],
                       .path = name,
                       .rate = RATE_HZ,
                       .speed = p->speed_m_s,
                       .tremor = p->tremor_m,
                       .encoders = true};
    int rc = record(m, p, RATE_HZ, true, true, &r);
    if (!rc) copy_truth(truth, &r);
    for (int late = 0; late <= 2 && !rc; late++) {
        int before = cJSON_GetArraySize(rows);
        const conditions c = {.latency_frames = late, .seed = 1};
        add_errors(rows, &r, &s, &c, "model");
        const float blend_us = r.params.blend_us;
        r.params.blend_us = 0; /* the cost of blending from one cut state to the next */
        if (truth->cuts.count) add_error(rows, &r, &s, &c, "model", HRT_LOCAL_MODEL, "local_model-unbridged");
        r.params.blend_us = blend_us;
        for (int i = before; i < cJSON_GetArraySize(rows); i++) {
            cJSON *row = cJSON_GetArrayItem(rows, i);
            app_json_add(row, "cut_true %d cut_shared %d", truth->cuts.count,
                         own_cuts ? cut_list_shared(&truth->cuts, &r.cuts) : truth->cuts.count);
        }
    }
    recording_free(&r);
    return rc;
}

static int one(model m, path_kind kind, cJSON *rows) {
    path p = path_make(kind, SPEED_M_S, TREMOR_M);
    recording truth = {0};
    int rc = record_truth(m, &p, true, &truth);
    if (!rc) rc = sampled_rows(m, &p, &truth, false, rows);
    if (!rc && kind != PATH_GRASPED) rc = sampled_rows(m, &p, &truth, true, rows);
    recording_free(&truth);
    return rc;
}

/* Returns whether a model is of isotropic tissue, and cuttable if the path cuts. */
static bool can(int m, path_kind kind) {
    return m == MODEL_ISOTROPIC || m == MODEL_HYBRID || (m == MODEL_PRECOMPUTED && kind == PATH_GRASPED);
}

int study_hands(const study_run *run, cJSON *rows) {
    int rc = 0;
    for (int kind = PATH_OTHER_HAND_CUTS; kind < PATH_NAMED; kind++) {
        if (!run->path[kind]) continue;
        progress(path_name[kind], (double)(kind - PATH_OTHER_HAND_CUTS) / (PATH_NAMED - PATH_OTHER_HAND_CUTS));
        for (int m = 0; m < MODEL_COUNT && !rc; m++)
            if (run->model[m] && can(m, (path_kind)kind)) rc = one((model)m, (path_kind)kind, rows);
    }
    return rc;
}

/* --- roughness of the force --- */

/* Measures the true force's second difference from tick to tick at 500 frames a second, from shallow to deep. */

static int one_depth(model m, double depth_m, cJSON *rows) {
    path p = path_make(PATH_TOUR, 0.01, 0);
    p.depth_m = depth_m;
    recording r = {0};
    if (record_truth(m, &p, false, &r)) return APP_FAILED;
    double *second = app_zeroed((size_t)r.ticks, sizeof *second), most = 0;
    int count = 0;
    for (int k = 1; k + 1 < r.ticks; k++) {
        const float *a = r.truth_N + 3 * (k - 1), *b = a + 3, *c = b + 3;
        double d2 = 0, na = 0, nb = 0, nc = 0;
        for (int i = 0; i < 3; i++) {
            double d = (double)c[i] - 2 * (double)b[i] + (double)a[i];
            d2 += d * d, na += fabs((double)a[i]), nb += fabs((double)b[i]), nc += fabs((double)c[i]);
        }
        if (na == 0 || nb == 0 || nc == 0) continue; /* contact begins or ends */
        second[count++] = sqrt(d2) / r.peak_N;
        most = fmax(most, second[count - 1]);
    }
    app_json_add(rows, "model %s depth_m %g largest %g p99 %g peak_N %g ticks %d", model_name[m], depth_m, most,
                 app_percentile(second, count, 0.99), r.peak_N, count);
    free(second);
    recording_free(&r);
    return 0;
}

int study_roughness(const study_run *run, cJSON *rows) {
    static const double depths_m[] = {0.001, 0.002, 0.003, 0.005, 0.008};
    int count = (int)(sizeof depths_m / sizeof *depths_m);
    for (int m = 0; m < MODEL_COUNT; m++)
        for (int d = 0; d < count; d++) {
            if (!run->model[m] || ((run->quick || m == MODEL_HYBRID) && d != 2)) continue;
            progress("roughness", (m * count + d + 1.0) / (MODEL_COUNT * count));
            const int rc = one_depth((model)m, depths_m[d], rows);
            if (rc) return rc;
        }
    return 0;
}

/* --- two cauteries at random --- */

/* They press, slide, cut and lift off for ten minutes, rendered with `local_model` at both hands. Measures the maximum
 * rendered force over the maximum of the truth. */

static const double SOAK_S = 600;
/* of a quick run: one session, a few strokes per hand */
enum { QUICK_POINTS = 9 };

static void add(cJSON *rows, const recording *r, uint64_t seed, int late, hrt_extrapolator which) {
    const conditions c = {.latency_frames = late, .seed = seed};
    const errors e = replay(r, which, &c, NULL);
    cJSON *row = errors_add(rows, &e);
    app_json_add(row, "seed %g instrument %d latency_frames %d extrapolator %s seconds %g cut %d peak_N %g",
                 (double)seed, r->instrument, late, hrt_extrapolator_name(which), 1e-6 * TICK_US * r->ticks,
                 r->replay ? r->replay->count : 0, r->peak_N);
}

/* Adds the rows of both hands of one session, from one run of the tissue. */
static int felt(const path *p, uint64_t seed, cJSON *rows) {
    recording truth[PATH_HANDS] = {{.instrument = 0}, {.instrument = 1}},
              r[PATH_HANDS] = {{.instrument = 0}, {.instrument = 1}};
    int rc = record_hands_truth(MODEL_ISOTROPIC, p, true, PATH_HANDS, truth);
    for (int h = 0; h < PATH_HANDS; h++) r[h].replay = truth->cuts.count ? &truth->cuts : NULL;
    if (!rc) rc = record_hands(MODEL_ISOTROPIC, p, RATE_HZ, true, true, PATH_HANDS, r);
    for (int h = 0; h < PATH_HANDS && !rc; h++) {
        copy_truth(&truth[h], &r[h]);
        for (int late = 0; late <= 2 && truth[h].peak_N > 0; late++) {
            add(rows, &r[h], seed, late, HRT_POSITION);
            add(rows, &r[h], seed, late, HRT_LOCAL_MODEL);
        }
    }
    for (int h = 0; h < PATH_HANDS; h++) recording_free(&r[h]), recording_free(&truth[h]);
    return rc;
}

int study_cutting(const study_run *run, cJSON *rows) {
    double done_s = run->model[MODEL_ISOTROPIC] ? 0 : SOAK_S;
    for (uint64_t seed = 1; done_s < SOAK_S; seed++) {
        const path p = path_make_random(seed, run->quick ? QUICK_POINTS : PATH_RANDOM_POINTS, SPEED_M_S, TREMOR_M);
        progress("two cauteries at random", done_s / SOAK_S);
        const int rc = felt(&p, seed, rows);
        if (rc) return rc;
        done_s += run->quick ? SOAK_S : path_length_s(&p);
    }
    return 0;
}
