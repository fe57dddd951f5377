/* Writes the choice as a scene with its name and evidence, and runs it: once for the promise, once in real time to
 * verify it. */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bandwidth.h"
#include "study.h"

/* --- the scene --- */

static void study_choice_names(const study *t, char *text, size_t size) {
    const study_choice *c = &t->choice;
    snprintf(text, size, "%s", t->run[c->mesh_run].name);
    for (int e = 0; e < c->extra_count; e++) {
        const size_t used = strlen(text);
        snprintf(text + used, size - used, "; %s", t->run[c->extra[e]].name);
    }
    const size_t used = strlen(text);
    const study_run *felt = &t->run[c->felt_run];
    if (c->felt_run)
        snprintf(text + used, size - used, "; extrapolator %s, haptics.rate %.4g Hz",
                 hrt_extrapolator_name((hrt_extrapolator)felt->law), study_rate_Hz(t, felt));
}

static int gather_edits(const study *t, char **edit) {
    const study_choice *c = &t->choice;
    int n = 0;
    for (int i = 0; i < t->set_count; i++)
        if (!sim_effect_left_out(t->set[i])) edit[n++] = t->set[i];
    const study_run *mesh = &t->run[c->mesh_run];
    for (int i = mesh->edits_from; i < mesh->set_count; i++) edit[n++] = mesh->set[i];
    for (int e = 0; e < c->extra_count; e++)
        for (int i = t->run[c->extra[e]].edits_from; i < t->run[c->extra[e]].set_count; i++)
            edit[n++] = t->run[c->extra[e]].set[i];
    const study_run *felt = &t->run[c->felt_run];
    for (int i = felt->edits_from; i < felt->set_count && c->felt_run; i++) edit[n++] = felt->set[i];
    return n;
}

static int write_scene(study *t) {
    const study_choice *c = &t->choice;
    const study_run *own = &t->run[0];
    char setting[400], doubt[100], path[120], reason[400], hand[500] = "", evidence[3500], *edit[7 * STUDY_SETS];
    study_choice_names(t, setting, sizeof setting);
    study_path_words(t, path, sizeof path);
    snprintf(doubt, sizeof doubt, "what the mesh leaves out is not known: no finer one was run");
    if (isfinite(t->truth.uncertainty))
        snprintf(doubt, sizeof doubt, "the truth itself is uncertain by %.2g %%", 100 * t->truth.uncertainty);
    if (c->felt_run)
        study_rate_reason(t, reason, sizeof reason), snprintf(hand, sizeof hand, "#   samples    %s\n", reason);
    snprintf(evidence, sizeof evidence,
             "# Recommended by tm-accuracy for %.3g processors, from %s%s.\n"
             "#   setting    %s\n"
             "#   force      %.2g %% RMS off the study's truth along %s (the scene as it is: %.2g %%);\n"
             "#              %s%s\n"
             "%s"
             "#   price      %.3g ms a frame of %.3g ms; 95th percentile: %.2g of a processor (as it is: %.2g)\n"
             "#   evidence   %s; what holds is what was run on that machine\n",
             t->budget, t->file, c->fits ? "" : " (nothing measured fits that; this is the cheapest)", setting,
             100 * c->error, path, 100 * own->force_error,
             t->truth.extrapolated || c->error > STUDY_ALIKE ? "" : "that truth is this very run; ", doubt, hand,
             1e3 * c->cost_s, 1e3 * c->frame_s, c->share, own->cpu_p95_s / own->frame_s, t->json);
    return study_write_yaml(t, c->file, edit, gather_edits(t, edit), evidence);
}

void study_say(const study *t) {
    const study_choice *c = &t->choice;
    char setting[400], path[120], verdict[500], reason[400];
    study_rate_reason(t, reason, sizeof reason);
    study_path_words(t, path, sizeof path);
    study_choice_names(t, setting, sizeof setting);
    study_verdict(c, verdict, sizeof verdict);
    printf("\nRecommended for %.3g processors: %s\n  %s\n", t->budget, setting, c->file);
    if (*reason) printf("  force samples: %s\n", reason);
    if (t->worse)
        printf("  %d setting%s came out worse than predicted, and had to be the best as it came out\n", t->worse,
               t->worse > 1 ? "s" : "");
    if (c->untried) puts("  the scene as it is: the limit left no time to try anything else; raise --limit");
    printf("  promised along %s, as the table's errors are: force %.2f %% off (predicted %.2f %%), %.1f %% of a "
           "processor%s\n",
           path, 100 * c->error, 100 * c->predicted, 100 * c->share,
           c->fits ? "" : " - MORE THAN THE BUDGET: nothing measured fits it");
    printf(
        "  held %d frames: force %.2f %% off, %.1f %% of a processor; %.1f %% of the frames took more processor time "
        "than the budget; %d came late by the wall clock%s\n  %s\n",
        c->held_frames, 100 * c->held_error, 100 * c->held_share, 100 * c->held.over, c->held_late,
        c->real_time ? "" : " (too many)", verdict);
}

/* Builds the present choice as written. Returns null if that is impossible. */
static sim *build_written(const study *t, char *why, size_t size) {
    char *set[STUDY_SETS];
    int count = 0;
    const study_choice *c = &t->choice;
    for (int i = 0; i < t->set_count; i++) /* effects that no study runs */
        if (sim_effect_left_out(t->set[i]) && !(c->felt_run && !strcmp(t->set[i], "haptics"))) set[count++] = t->set[i];
    sim *s = study_build(c->file, set, count, why, size);
    for (int i = 0; s && i < s->instrument_count && c->felt_run; i++)
        s->wants[i] = c->sends < s->can_send ? c->sends : s->can_send;
    return s;
}

/* Writes and builds the choice. Returns null with the reason in `why` or an exit code in `rc`. */
sim *study_build_choice(study *t, char *why, size_t size, int *rc) {
    *rc = write_scene(t);
    return *rc || app_interrupted() ? NULL : build_written(t, why, size);
}

/* --- its runs --- */

/* Frames along the hand's path, repeatedly. */
typedef struct walk {
    bool paced; /* in real time, with a new scene for each pass: the path's end differs from its beginning */
    int frames, late;
    int samples; /* per frame */
    double back; /* study_back */
    double frame_s, sample_s, start_s;
    int frame;                         /* current frame */
    double *cost_s, *work_s, *force_N; /* [frames], [frames], [frames*samples][instruments][3] */
    double wall_s;
} walk;

static void wait_until(double when_s) {
    const double left_s = when_s - app_seconds();
    if (left_s <= 0) return;
    struct timespec nap = {(time_t)left_s, (long)(1e9 * (left_s - floor(left_s)))};
    while (!app_interrupted() && nanosleep(&nap, &nap) && errno == EINTR) {
    }
}

/* Begins one pass along the path, and as many more as fit into `seconds`. */
static walk begin_walk(const study_run *own, const sim *s, double seconds) {
    walk w = {.frames = (int)fmax(own->frames, ceil(seconds / s->frame_s)),
              .samples = s->samples,
              .back = study_back(s),
              .frame_s = s->frame_s,
              .sample_s = s->sample_s};
    w.cost_s = app_zeroed((size_t)w.frames, sizeof *w.cost_s);
    w.work_s = app_zeroed((size_t)w.frames, sizeof *w.work_s);
    w.force_N = app_zeroed((size_t)w.frames * (size_t)w.samples * (size_t)own->instruments * 3, sizeof *w.force_N);
    return w;
}

static void end_walk(walk *w) {
    free(w->cost_s);
    free(w->work_s);
    free(w->force_N);
}

/* Waits for the beginning of a sample's period, as in a real-time session. */
static void wait_for_sample(void *user, int sample) {
    const walk *w = user;
    wait_until(w->start_s + w->frame * w->frame_s + sample * w->sample_s);
}

static void read_forces(void *user, const sim *s, int sample) {
    walk *w = user;
    const size_t at = ((size_t)w->frame * (size_t)w->samples + (size_t)sample) * (size_t)s->instrument_count;
    for (int i = 0; i < s->instrument_count; i++)
        memcpy(w->force_N + 3 * (at + (size_t)i), s->reaction[i].force_N, 3 * sizeof(double));
}

/* Runs the walk: samples at their times if it is paced, else one pass at full speed. Returns false if the tissue became
 * unstable or the run was stopped. Destroys the simulation. */
static bool go(study *t, sim *s, walk *w) {
    const bool paced = w->paced;
    char why[400];
    const study_each each = {paced ? wait_for_sample : NULL, read_forces, w};
    const char *label = paced ? "the recommendation, in real time" : "the recommendation, priced";
    const int every = (int)ceil(0.01 / s->frame_s); /* bounds the extra work per short frame */
    const int path = t->run[0].frames;
    bool good = true;
    int k = 0;
    w->start_s = app_seconds();
    for (; k < w->frames && good && !app_interrupted(); k++) {
        if (k && k % path == 0) {
            const double left_s = app_seconds();
            sim_destroy(s);
            if (!(s = build_written(t, why, sizeof why))) break;
            w->start_s += app_seconds() - left_s;
        }
        w->frame = k;
        good = study_frame(s, k % path, &each, &w->cost_s[k]);
        w->wall_s = app_seconds() - w->start_s;
        w->late += w->wall_s > (k + 1) * w->frame_s;
        w->work_s[k] = k % every ? w->work_s[k - 1] : study_work_s();
        t->time.last_s =
            fmax((w->frames - k - 1) * (paced ? w->frame_s : w->cost_s[k]) + (paced ? 0 : study_verify_s(t)), 0.1);
        study_doing(t, label, (k + 1.0) / w->frames);
        if (!paced && study_end_s(t) < study_verify_s(t)) break;
        if (paced && study_end_s(t) < 0 && k + 1 >= path) break;
    }
    study_doing(t, label, 1);
    sim_destroy(s);
    good = good && s && !app_interrupted() && k >= (paced ? path : w->frames);
    w->frames = k < w->frames ? k : w->frames;
    return good;
}

/* Returns the error of the worst pass. */
static double error_of(const study *t, const walk *w) {
    const study_run *own = &t->run[0];
    const size_t width = (size_t)own->instruments * 3, path = (size_t)own->frames * width;
    const int laps = w->frames / own->frames;
    double worst = laps ? 0 : NAN, *force_N = app_zeroed(path, sizeof *force_N);
    for (int lap = 0; lap < laps; lap++) {
        study_at_frames(w->force_N + (size_t)lap * path * (size_t)w->samples, own->frames, w->samples, width, w->back,
                        force_N);
        worst = fmax(worst, study_distance(force_N, t->truth.force_N, path));
    }
    free(force_N);
    return worst;
}

bool study_cost(study *t, sim *s, study_choice *out) {
    walk w = begin_walk(&t->run[0], s, 0);
    study_run with = {0};
    const double was = out->share, frame_s = s->frame_s;
    const int threads = study_threads(s);
    const bool good = go(t, s, &w);
    if (good) {
        study_measure_cost(&with, w.cost_s, w.cost_s, w.frames);
        out->error = error_of(t, &w);
        out->frame_s = frame_s, out->cost_s = with.cpu_s, out->share = with.cpu_p95_s / frame_s;
        out->busy = threads > 1 ? out->busy * out->share / was : out->share;
        out->work_s = app_median(w.work_s, w.frames);
    }
    end_walk(&w);
    return good;
}

void study_verify(study *t, sim *s) {
    study_choice *c = &t->choice;
    const double frame_s = s->frame_s;
    /* At least one pass, or there is no error to compare. */
    walk w = begin_walk(&t->run[0], s, fmin(t->hold_s, t->limit_s / 4));
    w.paced = true;
    const bool good = go(t, s, &w);
    study_run held = {0};
    c->held_frames = w.frames, c->held_late = w.late, c->held_wall_s = w.wall_s;
    c->held_error = error_of(t, &w);
    c->held = study_judge_pace(w.cost_s, w.work_s, w.frames, c->work_s, frame_s * t->budget);
    study_measure_cost(&held, w.cost_s, w.cost_s, w.frames);
    c->held_share = held.cpu_p95_s / frame_s;
    end_walk(&w);
    c->real_time = c->held_late <= STUDY_OVER * c->held_frames;
    c->kept = good && c->fits && c->held.costlier <= STUDY_OVER && c->held_error <= 2 * c->error + STUDY_ALIKE &&
              c->held_error >= 0.5 * c->error - STUDY_ALIKE;
}
