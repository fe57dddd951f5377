/* Force between samples at the hand. The scene's samples at each rate, as a controller receives them, pass through each
 * of its extrapolators at 500 Hz. The result is compared with the same scene run at 500 frames a second. The tool's
 * pose is known without encoder steps. Frames remain as they are: their rate is that of pictures. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bandwidth.h"
#include "scene/effects.h"
#include "sim/stream.h"
#include "studies/replay/replay.h"
#include "study.h"

/* --- planned runs --- */

/* Fills the samples per frame, ascending: one, the scene's own, and rates up to that of the controller's ticks. Returns
 * their number. */
enum { RATES = 8 };
static int list_rates(const study *t, const sim *own, int times[RATES]) {
    static const double rate_Hz[] = {50, 500, 100, 250};
    int count = 0, wanted[RATES] = {1, t->own_times}, wanted_count = 2;
    for (int i = 0; i < (t->quick ? 2 : 4); i++) wanted[wanted_count++] = (int)floor(rate_Hz[i] * own->frame_s + 1e-9);
    for (int i = 0; i < wanted_count; i++) {
        int at = 0;
        while (at < count && times[at] < wanted[i]) at++;
        if (wanted[i] < 1 || (at < count && times[at] == wanted[i])) continue;
        memmove(times + at + 1, times + at, sizeof *times * (size_t)(count - at));
        times[at] = wanted[i];
        count++;
    }
    return count;
}

/* Returns whether a combination is worth a run. Without stiffness and patch `tangent` and `local_model` equal simpler
 * laws; the paper's unsigned law is compared once. The scene's own combination always runs. */
static bool makes_sense(const study *t, int law, int times, sim_sends most) {
    if (law == t->own_law && times == t->own_times) return true;
    if (law == HRT_PAPER_POSITION) return times == 1;
    return most >= sim_sends_of(law) || (law != HRT_TANGENT && law != HRT_LOCAL_MODEL);
}

static void plan_one(study *t, const sim *own, int law, int times) {
    static const char *const words[] = {"force", "stiffness", "patch"};
    const char *name = hrt_extrapolator_name((hrt_extrapolator)law);
    const double rate_Hz = times / own->frame_s;
    const sim_sends most = sim_stream_sends_by_rate(rate_Hz), asks = sim_sends_of(law);
    char label[60];
    snprintf(label, sizeof label, times > 1 ? "%s at %.4g Hz" : "%s", name, rate_Hz);
    study_run *r = study_add(t, times > 1 ? "rate" : "extrapolator", label);
    r->law = law, r->times = times, r->sends = asks < most ? asks : most;
    study_set(r, "haptics.extrapolator=%s", name);
    study_set(r, "haptics.rate=%.9g Hz", rate_Hz);
    if (t->sends >= 0 && t->sends != (int)r->sends) study_set(r, "haptics.sends=%s", words[r->sends]);
}

/* Returns whether one recording serves both runs. Samples with stiffness or patch are recorded separately, so that
 * others do not include their cost. With one sample per frame one recording serves all: the scene as it is gives the
 * cost without them. */
static bool is_served(const study_run *r, const study_run *by) {
    return study_is_felt(r) && r->times == by->times &&
           (r->times == 1 || (r->sends == SIM_SENDS_FORCE) == (by->sends == SIM_SENDS_FORCE));
}

void study_plan_felt(study *t, const sim *own) {
    int times[RATES];
    if (!sim_has(own, "contact")) return;
    const int count = list_rates(t, own, times), from = t->run_count;
    for (int k = 0; k < count; k++)
        for (int law = 0; law < HRT_EXTRAPOLATOR_COUNT; law++)
            if (makes_sense(t, law, times[k], sim_stream_sends_by_rate(times[k] / own->frame_s)))
                plan_one(t, own, law, times[k]);
    for (int i = from; i < t->run_count; i++) {
        t->run[i].felt_first = true;
        for (int j = from; j < i; j++)
            if (is_served(&t->run[i], &t->run[j])) t->run[i].felt_first = false;
    }
}

/* --- the reference --- */

/* Builds with the settings common to all runs; `more`: settings of haptics. */
static sim *build_with(const study *t, const study_run *r, const char *const *more, char *why, size_t size) {
    char *set[STUDY_SETS];
    int count = 0;
    for (int i = 0; i < r->edits_from; i++)
        if (strcmp(r->set[i], "haptics")) set[count++] = r->set[i];
    for (; *more && count < STUDY_SETS; more++) set[count++] = (char *)(uintptr_t)*more;
    return study_build(t->file, set, count, why, size);
}

typedef struct truth_run {
    study *t;
    study_run *r;
    double began_s;
    int ticks;
} truth_run;

static void lead(void *user, const sim *s, double time_s, tm_tool_pose to[TM_MAX_INSTRUMENTS]) {
    (void)user;
    for (int i = 0; i < s->instrument_count; i++) to[i] = sim_hand_pose(s, i, time_s);
}

static bool goes_on(void *user, const sim *s, int k) {
    truth_run *now = user;
    (void)s;
    study_doing(now->t, "extrapolators: the truth, at 500 Hz", (k + 1.0) / now->ticks);
    return study_part_goes_on(now->t, now->r, now->began_s, k + 1, now->ticks) && !app_interrupted();
}

/* Records 500 frames a second, each with the force of its last substep only. */
static bool record_truth(study *t, study_run *r, recording *rec, char *why, size_t size) {
    const char *const more[] = {"time.frame_rate=500",       "time.average=0",      "haptics.rate=500 Hz",
                                "haptics.extrapolator=hold", "haptics.sends=force", NULL};
    sim *s = build_with(t, r, more, why, size);
    if (!s) return false;
    truth_run now = {t, r, app_seconds(), (int)(t->duration_s * 1e6 / TICK_US)};
    const bool good =
        record_ticks(s, now.ticks, s->instrument_count, &(leader){lead, goes_on, &now}, rec) == TM_OK && !s->broken_off;
    if (!good) snprintf(why, size, "went unstable at 500 frames a second");
    sim_destroy(s);
    return good && !r->left_out;
}

/* --- samples --- */

typedef struct taking {
    sim_publisher publisher;
    recording *rec;
    double *force_N; /* [frames*samples][instruments][3] */
    int frame;
} taking;

static void read_sample(void *user, const sim *s, int sample) {
    taking *now = user;
    const int k = now->frame * s->samples + sample, count = s->instrument_count;
    for (int i = 0; i < count; i++) {
        recording_sample(&now->rec[i], &now->publisher, s, k);
        memcpy(now->force_N + 3 * ((size_t)k * (size_t)count + (size_t)i), s->reaction[i].force_N, 3 * sizeof(double));
    }
}

/* Runs frames along the path with samples as a controller receives them, and measures each frame's cost. Returns false
 * if the tissue became unstable or the run was left out. */
static bool drive(study *t, study_run *r, sim *s, taking *now, double *cost_s, int frames) {
    const study_each each = {NULL, read_sample, now};
    char label[120];
    const double began_s = app_seconds();
    snprintf(label, sizeof label, "extrapolators: samples at %.4g Hz", 1 / s->sample_s);
    for (int k = 0; k < frames && !app_interrupted(); k++) {
        now->frame = k;
        if (!study_frame(s, k, &each, &cost_s[k])) return false;
        study_doing(t, label, (k + 1.0) / frames);
        if (!study_part_goes_on(t, r, began_s, k + 1, frames)) return false;
    }
    return true;
}

/* Returns the change of the force at the frames' ends by the rate: the same measure as for a mesh's error. */
static double change_of(const study *t, const sim *s, const double *samples_N, int frames) {
    const study_run *own = &t->run[0];
    const size_t width = 3 * (size_t)s->instrument_count;
    if (frames != own->frames) return NAN;
    double *force_N = app_zeroed(width * (size_t)frames, sizeof *force_N);
    study_at_frames(samples_N, frames, s->samples, width, study_back(s), force_N);
    const double change = study_distance(force_N, own->force_N, width * (size_t)frames);
    free(force_N);
    return change;
}

/* Runs the scene with this many samples per frame; stores the cost in `r`. */
static bool sample_scene(study *t, study_run *r, recording *rec, char *why, size_t size) {
    static taking now;
    char rate[60];
    snprintf(rate, sizeof rate, "haptics.rate=%.9g Hz", study_rate_Hz(t, r));
    const bool patches =
        r->times == 1 ? sim_stream_sends_by_rate(study_rate_Hz(t, r)) == SIM_SENDS_PATCH : r->sends != SIM_SENDS_FORCE;
    const char *const more[] = {rate, patches ? "haptics.extrapolator=local_model" : "haptics.extrapolator=hold",
                                patches ? "haptics.sends=patch" : "haptics.sends=force", NULL};
    sim *s = build_with(t, r, more, why, size);
    if (!s) return false;
    const int frames = (int)llround(t->duration_s / s->frame_s);
    double *cost_s = app_zeroed((size_t)frames, sizeof *cost_s);
    now = (taking){.publisher = {.session = 1}, .rec = rec};
    now.force_N = app_zeroed(3 * (size_t)frames * (size_t)s->samples * (size_t)s->instrument_count, sizeof(double));
    for (int i = 0; i < s->instrument_count; i++) {
        s->wants[i] = s->can_send, rec[i].instrument = i;
        recording_begin(&rec[i], s, frames * s->samples, 0);
    }
    const bool good = drive(t, r, s, &now, cost_s, frames);
    if (!good && !r->left_out) snprintf(why, size, "went unstable with its samples");
    study_measure_cost(r, cost_s, cost_s, frames);
    r->frames = frames, r->frame_s = s->frame_s, r->dt_s = s->dt_s, r->substeps = s->substeps;
    r->change = good ? change_of(t, s, now.force_N, frames) : NAN;
    free(cost_s);
    free(now.force_N);
    sim_destroy(s);
    return good;
}

/* --- replays --- */

/* Returns the RMS error over the RMS of the reference, over all instruments. */
static double felt(const recording *rec, int count, hrt_extrapolator which, int late) {
    const conditions line = {.latency_frames = late, .seed = 1};
    double error2 = 0, truth2 = 0;
    for (int i = 0; i < count; i++) {
        if (!(rec[i].peak_N > 0)) continue; /* never touches */
        const errors e = replay(&rec[i], which, &line, NULL);
        error2 += e.rms * e.rms * rec[i].peak_N * rec[i].peak_N * e.judged;
        for (int k = 0; k < 3 * rec[i].ticks; k++) truth2 += (double)rec[i].truth_N[k] * (double)rec[i].truth_N[k];
    }
    return truth2 > 0 ? sqrt(error2 / truth2) : NAN;
}

static void replay_one(const study *t, study_run *r, const recording *rec, const study_run *cost) {
    const study_run *own = &t->run[0];
    r->cpu_s = cost->cpu_s, r->cpu_p95_s = cost->cpu_p95_s, r->busy_p95_s = cost->busy_p95_s;
    r->frames = cost->frames, r->frame_s = cost->frame_s, r->dt_s = cost->dt_s, r->substeps = cost->substeps;
    r->instruments = own->instruments, r->tets = own->tets, r->threads = own->threads;
    for (int late = 0; late < STUDY_LATE; late++)
        r->felt[late] = felt(rec, own->instruments, (hrt_extrapolator)r->law, late);
    r->done = r->felt_known = true;
    r->failed = !isfinite(r->felt[0]);
    if (r->failed) snprintf(r->why, sizeof r->why, "no instrument touches along its path");
}

/* Replays the runs that these samples serve. */
static void finish(study *t, const study_run *first, const recording *rec) {
    for (int i = 1; i < t->run_count; i++) {
        study_run *r = &t->run[i];
        const bool plain = first->times == 1 && r->sends == SIM_SENDS_FORCE;
        if (!is_served(r, first) || r->done) continue;
        r->change = first->change;
        replay_one(t, r, rec, plain ? &t->run[0] : first);
    }
}

/* Marks runs as failed; `all`: runs of all rates, because there is no reference. */
static void give_up(study *t, bool all, const study_run *first, const char *why) {
    const bool left_out = first->left_out;
    char words[sizeof first->why];
    snprintf(words, sizeof words, "%s", left_out ? first->why : why);
    for (int i = 1; i < t->run_count; i++) {
        study_run *r = &t->run[i];
        if (!(all ? study_is_felt(r) : is_served(r, first)) || r->done) continue;
        r->left_out = left_out, r->done = r->failed = !left_out;
        snprintf(r->why, sizeof r->why, "%s", words);
    }
}

static bool is_done(const study *t, const study_run *first) {
    bool all = true;
    for (int i = 1; i < t->run_count; i++) all = all && (!is_served(&t->run[i], first) || t->run[i].done);
    return all;
}

/* Measures the runs that r's samples serve. Returns false if none can be judged, because there is no reference. */
static bool measure_group(study *t, study_run *r, recording *rec, bool *truth) {
    char why[sizeof r->why] = "";
    if (is_done(t, r)) return true;
    const bool good = study_may_start(t, r, study_expected_group_s(t, r)) && sample_scene(t, r, rec, why, sizeof why) &&
                      (*truth || app_interrupted() || (*truth = record_truth(t, r, rec, why, sizeof why)));
    if (app_interrupted()) return false;
    const study_run first = *r; /* rewritten with its own settings */
    if (good)
        finish(t, &first, rec);
    else
        give_up(t, !*truth, &first, why);
    return *truth;
}

/* Measures one sample per frame first, then from the highest rate down. */
int study_measure_felt(study *t) {
    recording *rec = app_zeroed(TM_MAX_INSTRUMENTS, sizeof *rec);
    bool truth = false, goes_on = true;
    for (int i = 1; i < t->run_count && goes_on; i++)
        if (t->run[i].felt_first && t->run[i].times == 1) goes_on = measure_group(t, &t->run[i], rec, &truth);
    for (int i = t->run_count - 1; i > 0 && goes_on; i--)
        if (t->run[i].felt_first) goes_on = measure_group(t, &t->run[i], rec, &truth);
    for (int i = 0; i < TM_MAX_INSTRUMENTS; i++) recording_free(&rec[i]);
    free(rec);
    return app_interrupted() ? app_interrupted_exit() : study_save(t, false);
}
