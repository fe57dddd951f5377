/* What is felt between frames: the scene's samples, as a controller gets them, through each of its extrapolators at
 * 500 Hz, and samples that come more often through plain ones, against the same scene run at 500 frames a second. The
 * tool's place is known without encoders' steps. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bandwidth.h"
#include "studies/replay/replay.h"
#include "study.h"

static bool is_felt(const study_run *r) { return !strcmp(r->knob, "extrapolator") || !strcmp(r->knob, "rate"); }

/* Samples come once a frame, so that more of them are more frames. A scene's key for samples between frames belongs
 * here, in place of the frame rate. */
static void set_sample_rate(study_run *r, double rate_Hz) { study_set(r, "time.frame_rate=%.9g", rate_Hz); }

/* Above that a controller of 500 Hz has no tick to extrapolate to. */
static const double FASTEST_HZ = 250;

/* Plain forces more often, in place of stiffness or patches. */
static void plan_rates(study *t, const sim *own) {
    static const hrt_extrapolator law[] = {HRT_HOLD, HRT_POSITION};
    char name[60];
    if (t->frame_Hz > 0) return; /* whoever asks for a rate gets no other */
    for (int times = t->quick ? 8 : 2; times <= 8; times *= 2) {
        const double rate_Hz = times / own->frame_s;
        if (rate_Hz > FASTEST_HZ) return;
        for (int k = 0; k < 2; k++) {
            snprintf(name, sizeof name, "%s at %.4g Hz", hrt_extrapolator_name(law[k]), rate_Hz);
            study_run *r = study_add(t, "rate", name);
            r->law = (int)law[k], r->times = times, r->felt_first = k == 0;
            set_sample_rate(r, rate_Hz);
            study_set(r, "haptics.extrapolator=%s", hrt_extrapolator_name(law[k]));
        }
    }
}

void study_plan_felt(study *t, const sim *own) {
    if (!sim_has(own, "contact")) return;
    for (int x = 0; x < HRT_EXTRAPOLATOR_COUNT; x++) {
        const char *name = hrt_extrapolator_name((hrt_extrapolator)x);
        study_run *r = study_add(t, "extrapolator", name);
        r->law = x, r->times = 1, r->felt_first = x == 0;
        study_set(r, "haptics.extrapolator=%s", name);
        if ((int)sim_sends_of(x) > t->sends) /* the scene's own bound is lifted */
            study_set(r, "haptics.sends=%s", sim_sends_of(x) == SIM_SENDS_PATCH ? "patch" : "stiffness");
    }
    plan_rates(t, own);
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
static bool record_truth(study *t, study_run *r, recording *rec, char *why, size_t size) {
    const char *const more[] = {"time.frame_rate=500", "time.average=0", "haptics.extrapolator=hold", NULL};
    sim *s = build_with(t, r, more, why, size);
    if (!s) return false;
    const double began_s = app_seconds();
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
        study_doing(t, "extrapolators: the truth, at 500 Hz", (k + 1.0) / ticks);
        if (!study_part_goes_on(t, r, began_s, k + 1, ticks)) break;
    }
    if (!good) snprintf(why, size, "went unstable at 500 frames a second");
    sim_destroy(s);
    return good && !r->left_out;
}

static void drop_samples(recording *rec) {
    for (int i = 0; i < rec->samples; i++) free(rec->sample[i].patch);
    free(rec->sample);
    rec->sample = NULL, rec->samples = 0;
}

static void take_room(const sim *s, recording *rec, int frames) {
    for (int i = 0; i < s->instrument_count; i++) {
        drop_samples(&rec[i]);
        rec[i].frame_s = s->frame_s, rec[i].samples = frames, rec[i].instrument = i;
        hrt_params_default(&rec[i].params);
        rec[i].sample = calloc((size_t)frames + 1, sizeof *rec->sample);
        if (!rec[i].sample) abort();
    }
}

/* Frames along the path, as a controller gets their samples; what each costs. False: went unstable, or left out. */
static bool drive(study *t, study_run *r, sim *s, recording *rec, double *cost_s, int frames) {
    static sim_publisher publisher;
    char label[120];
    const double began_s = app_seconds();
    bool good = true;
    publisher = (sim_publisher){.session = 1};
    snprintf(label, sizeof label, "extrapolators: samples at %.4g Hz", 1 / s->frame_s);
    for (int k = 0; k < frames && good && !app_interrupted(); k++) {
        tm_tool_pose to[TM_MAX_INSTRUMENTS];
        const int64_t end_us = llround((k + 1) * s->frame_s * 1e6),
                      back_us = llround(0.5e6 * (s->average - 1) * s->dt_s);
        for (int i = 0; i < s->instrument_count; i++) to[i] = sim_hand_pose(s, i, (k + 1) * s->frame_s);
        const double before = study_cpu_s();
        good = sim_frame(s, to, s->substeps) == TM_OK && !s->broken_off;
        for (int i = 0; i < s->instrument_count && good; i++)
            sampled_take(&publisher, s, i, &rec[i].params, end_us - back_us, end_us, &rec[i].sample[k]);
        cost_s[k] = study_cpu_s() - before;
        study_doing(t, label, (k + 1.0) / frames);
        if (!study_part_goes_on(t, r, began_s, k + 1, frames)) return false;
    }
    return good;
}

/* The scene's own frames with all that a controller may ask for, or more of them with forces alone; what they cost so
 * goes into `r`. */
static bool record_samples(study *t, study_run *r, recording *rec, char *why, size_t size) {
    const char *const patches[] = {"haptics.extrapolator=contact", "haptics.sends=patch", NULL};
    const char *const plain[] = {r->set[r->edits_from], "haptics.extrapolator=hold", NULL};
    sim *s = build_with(t, r, r->times > 1 ? plain : patches, why, size);
    if (!s) return false;
    const int frames = (int)llround(t->duration_s / s->frame_s);
    double *cost_s = calloc((size_t)frames + 1, sizeof *cost_s);
    if (!cost_s) abort();
    take_room(s, rec, frames);
    for (int i = 0; i < s->instrument_count; i++) s->wants[i] = s->can_send;
    const bool good = drive(t, r, s, rec, cost_s, frames);
    if (!good && !r->left_out) snprintf(why, size, "went unstable with its samples");
    study_take_price(r, cost_s, cost_s, frames);
    r->frames = frames, r->frame_s = s->frame_s, r->dt_s = s->dt_s, r->substeps = s->substeps;
    free(cost_s);
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

static void replay_one(const study *t, study_run *r, const recording *rec, const study_run *price) {
    const study_run *own = &t->run[0];
    r->cpu_s = price->cpu_s, r->cpu_p95_s = price->cpu_p95_s, r->busy_p95_s = price->busy_p95_s;
    r->frames = price->frames, r->frame_s = price->frame_s, r->dt_s = price->dt_s, r->substeps = price->substeps;
    r->instruments = own->instruments, r->tets = own->tets, r->threads = own->threads;
    for (int late = 0; late < STUDY_LATE; late++)
        r->felt[late] = felt(rec, own->instruments, (hrt_extrapolator)r->law, late);
    r->done = r->felt_known = true;
    r->failed = !isfinite(r->felt[0]);
    if (r->failed) snprintf(r->why, sizeof r->why, "no instrument touches along its path");
}

/* Replays the runs of this rate. */
static void finish(study *t, int times, const recording *rec, const study_run *with_samples) {
    for (int i = 1; i < t->run_count; i++) {
        study_run *r = &t->run[i];
        if (!is_felt(r) || r->times != times || r->done) continue;
        replay_one(t, r, rec, times == 1 && sim_sends_of(r->law) == SIM_SENDS_FORCE ? &t->run[0] : with_samples);
    }
}

/* `times` 0: runs of all rates, for there is no truth. */
static void give_up(study *t, int times, const study_run *first, const char *why) {
    const bool left_out = first->left_out;
    char words[sizeof first->why];
    snprintf(words, sizeof words, "%s", left_out ? first->why : why);
    for (int i = 1; i < t->run_count; i++) {
        study_run *r = &t->run[i];
        if (!is_felt(r) || (times && r->times != times) || r->done) continue;
        r->left_out = left_out, r->done = r->failed = !left_out;
        snprintf(r->why, sizeof r->why, "%s", words);
    }
}

int study_measure_felt(study *t) {
    recording *rec = calloc(TM_MAX_INSTRUMENTS, sizeof *rec);
    bool truth = false;
    if (!rec) abort();
    for (int i = 1; i < t->run_count && !app_interrupted(); i++) {
        study_run *r = &t->run[i];
        char why[sizeof r->why] = "";
        if (!is_felt(r) || !r->felt_first) continue;
        const bool good = record_samples(t, r, rec, why, sizeof why) &&
                          (truth || app_interrupted() || (truth = record_truth(t, r, rec, why, sizeof why)));
        if (app_interrupted()) break;
        const study_run price = *r; /* rewritten with its own */
        if (good)
            finish(t, r->times, rec, &price);
        else
            give_up(t, truth ? r->times : 0, &price, why);
        if (!truth) break;
    }
    for (int i = 0; i < TM_MAX_INSTRUMENTS; i++) recording_free(&rec[i]);
    free(rec);
    return app_interrupted() ? app_interrupted_exit() : study_save(t, false);
}
