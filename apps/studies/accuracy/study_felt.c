/* What is felt between frames: the scene's samples, as a controller gets them, through each of its extrapolators at
 * 500 Hz, against the same scene run at 500 frames a second. The tool's place is known without encoders' steps. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "studies/replay/replay.h"
#include "study.h"

static bool is_felt(const study_run *r) { return !strcmp(r->knob, "extrapolator"); }

void study_plan_felt(study *t, const sim *own) {
    if (!sim_has(own, "contact")) return;
    for (int x = 0; x < HRT_EXTRAPOLATOR_COUNT; x++) {
        const char *name = hrt_extrapolator_name((hrt_extrapolator)x);
        study_run *r = study_add(t, "extrapolator", name);
        study_set(r, "haptics.extrapolator=%s", name);
        if ((int)sim_sends_of(x) > t->sends) /* the scene's own bound is lifted */
            study_set(r, "haptics.sends=%s", sim_sends_of(x) == SIM_SENDS_PATCH ? "patch" : "stiffness");
    }
}

/* Settings of every run, with haptics where `more` says how. */
static sim *build_with(const study *t, const study_run *r, const char *const *more, char *why, size_t size) {
    char *set[STUDY_SETS];
    int count = 0;
    for (int i = 0; i < r->edits_from; i++)
        if (strcmp(r->set[i], "haptics")) set[count++] = r->set[i];
    for (; *more && count < STUDY_SETS; more++) set[count++] = (char *)(uintptr_t)*more;
    return study_build(t->file, set, count, why, size);
}

static void take_tick(recording *rec, const sim *s, const tm_tool_pose *to, int instrument, int k) {
    double size = 0;
    for (int a = 0; a < 3; a++) {
        const double force_N = s->reaction[instrument].force_N[a];
        rec->tip_m[3 * k + a] = (float)(to->tip_m[a] - s->instrument_def[instrument].trocar_m[a]);
        rec->truth_N[3 * k + a] = (float)force_N;
        size += force_N * force_N;
    }
    rec->peak_N = fmax(rec->peak_N, sqrt(size));
}

/* At 500 frames a second, each the last substep's force alone. */
static bool record_truth(const study *t, const study_run *r, recording *rec, char *why, size_t size) {
    const char *const more[] = {"time.frame_rate=500", "time.average=0", "haptics.extrapolator=hold", NULL};
    sim *s = build_with(t, r, more, why, size);
    if (!s) return false;
    const int ticks = (int)(t->duration_s * 1e6 / TICK_US), count = s->instrument_count;
    for (int i = 0; i < count; i++) {
        rec[i].ticks = ticks;
        rec[i].tip_m = calloc(3 * (size_t)ticks + 1, sizeof *rec->tip_m);
        rec[i].truth_N = calloc(3 * (size_t)ticks + 1, sizeof *rec->truth_N);
        if (!rec[i].tip_m || !rec[i].truth_N) abort();
    }
    bool good = true;
    for (int k = 0; k < ticks && good && !app_interrupted(); k++) {
        tm_tool_pose to[TM_MAX_INSTRUMENTS];
        for (int i = 0; i < count; i++) to[i] = sim_hand_pose(s, i, 1e-6 * k * TICK_US);
        good = sim_frame(s, to, s->substeps) == TM_OK && !s->broken_off;
        for (int i = 0; i < count; i++) take_tick(&rec[i], s, &to[i], i, k);
        app_progress("extrapolators: the truth, at 500 Hz", (k + 1.0) / ticks, false);
    }
    app_progress("extrapolators: the truth, at 500 Hz", 1, true);
    if (!good) snprintf(why, size, "went unstable at 500 frames a second");
    sim_destroy(s);
    return good;
}

/* The scene's own frames, with all that a controller may ask for; what they cost so goes into `r`. */
static bool record_samples(const study *t, study_run *r, recording *rec, char *why, size_t size) {
    static sim_publisher publisher;
    const char *const more[] = {"haptics.extrapolator=contact", "haptics.sends=patch", NULL};
    sim *s = build_with(t, r, more, why, size);
    if (!s) return false;
    publisher = (sim_publisher){.session = 1};
    const int frames = (int)llround(t->duration_s / s->frame_s), count = s->instrument_count;
    double *cost_s = calloc((size_t)frames + 1, sizeof *cost_s);
    if (!cost_s) abort();
    for (int i = 0; i < count; i++) {
        s->wants[i] = s->can_send;
        rec[i].frame_s = s->frame_s, rec[i].samples = frames, rec[i].instrument = i;
        hrt_params_default(&rec[i].params);
        rec[i].sample = calloc((size_t)frames + 1, sizeof *rec->sample);
        if (!rec[i].sample) abort();
    }
    bool good = true;
    for (int k = 0; k < frames && good && !app_interrupted(); k++) {
        tm_tool_pose to[TM_MAX_INSTRUMENTS];
        const int64_t end_us = llround((k + 1) * s->frame_s * 1e6),
                      back_us = llround(0.5e6 * (s->average - 1) * s->dt_s);
        for (int i = 0; i < count; i++) to[i] = sim_hand_pose(s, i, (k + 1) * s->frame_s);
        const double before = study_cpu_s();
        good = sim_frame(s, to, s->substeps) == TM_OK && !s->broken_off;
        for (int i = 0; i < count && good; i++)
            sampled_take(&publisher, s, i, &rec[i].params, end_us - back_us, end_us, &rec[i].sample[k]);
        cost_s[k] = study_cpu_s() - before;
        app_progress("extrapolators: samples", (k + 1.0) / frames, false);
    }
    app_progress("extrapolators: samples", 1, true);
    study_take_price(r, cost_s, cost_s, frames);
    free(cost_s);
    if (!good) snprintf(why, size, "went unstable with patches");
    sim_destroy(s);
    return good;
}

/* RMS of the error over that of the truth, all instruments together. */
static double felt(const recording *rec, int count, hrt_extrapolator which, int late) {
    const conditions line = {.latency_frames = late, .seed = 1};
    double error2 = 0, truth2 = 0;
    for (int i = 0; i < count; i++) {
        if (!(rec[i].peak_N > 0)) continue; /* touches nothing */
        const errors e = replay(&rec[i], which, &line, NULL);
        error2 += e.rms * e.rms * rec[i].peak_N * rec[i].peak_N * e.judged;
        for (int k = 0; k < 3 * rec[i].ticks; k++) truth2 += (double)rec[i].truth_N[k] * (double)rec[i].truth_N[k];
    }
    return truth2 > 0 ? sqrt(error2 / truth2) : NAN;
}

static void replay_all(study *t, const recording *rec, const study_run *with_patches) {
    const study_run *own = &t->run[0];
    for (int i = 0, x = 0; i < t->run_count; i++) {
        study_run *r = &t->run[i];
        if (!is_felt(r)) continue;
        const study_run *price = sim_sends_of(x) == SIM_SENDS_FORCE ? own : with_patches;
        r->cpu_s = price->cpu_s, r->cpu_p95_s = price->cpu_p95_s, r->busy_p95_s = price->busy_p95_s;
        r->frames = own->frames, r->instruments = own->instruments, r->tets = own->tets, r->threads = own->threads;
        r->frame_s = own->frame_s, r->dt_s = own->dt_s, r->substeps = own->substeps;
        for (int late = 0; late < STUDY_LATE; late++)
            r->felt[late] = felt(rec, own->instruments, (hrt_extrapolator)x, late);
        r->done = r->felt_known = true;
        r->failed = !isfinite(r->felt[0]);
        if (r->failed) snprintf(r->why, sizeof r->why, "no instrument touches along its path");
        x++;
    }
}

int study_measure_felt(study *t) {
    study_run *first = NULL;
    bool all = true;
    for (int i = 0; i < t->run_count; i++) {
        if (!is_felt(&t->run[i])) continue;
        if (!first) first = &t->run[i];
        all = study_find(t, &t->run[i]) && all;
    }
    if (!first || all) return 0;
    recording *rec = calloc(TM_MAX_INSTRUMENTS, sizeof *rec);
    char why[sizeof first->why] = "";
    if (!rec) abort();
    const bool good = record_samples(t, first, rec, why, sizeof why) &&
                      (app_interrupted() || record_truth(t, first, rec, why, sizeof why));
    if (good && !app_interrupted()) {
        const study_run price = *first; /* rewritten with its own */
        replay_all(t, rec, &price);
    }
    for (int i = 0; i < TM_MAX_INSTRUMENTS; i++) recording_free(&rec[i]);
    free(rec);
    if (app_interrupted()) return app_interrupted_exit();
    for (int i = 0; i < t->run_count && !good; i++) {
        study_run *r = &t->run[i];
        if (!is_felt(r)) continue;
        r->done = r->failed = true;
        snprintf(r->why, sizeof r->why, "%s", why);
    }
    return study_save(t, false);
}
