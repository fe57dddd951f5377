/* The recommended scene, run: once for what is promised of it, once in real time to hold it to that. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bandwidth.h"
#include "study.h"

/* Frames along the hand's path, over and over. */
typedef struct walk {
    study_builder *fresh; /* the scene anew for each time round: the path's end is not its beginning */
    int frames, late;
    int samples; /* of a frame */
    double back; /* study_back */
    double frame_s, sample_s, start_s;
    int frame;                         /* the one that is run */
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

/* Along the path once, and as often as `seconds` hold. */
static walk begin_walk(const study_run *own, const sim *s, double seconds) {
    walk w = {.frames = (int)fmax(own->frames, ceil(seconds / s->frame_s)),
              .samples = s->samples,
              .back = study_back(s),
              .frame_s = s->frame_s,
              .sample_s = s->sample_s};
    w.cost_s = calloc((size_t)w.frames + 1, sizeof *w.cost_s);
    w.work_s = calloc((size_t)w.frames + 1, sizeof *w.work_s);
    w.force_N = calloc((size_t)w.frames * (size_t)w.samples * (size_t)own->instruments * 3 + 1, sizeof *w.force_N);
    if (!w.cost_s || !w.work_s || !w.force_N) abort();
    return w;
}

static void end_walk(walk *w) {
    free(w->cost_s);
    free(w->work_s);
    free(w->force_N);
}

/* In real time a sample begins when its period does, as in a session. */
static void wait_for_sample(void *user, int sample) {
    const walk *w = user;
    wait_until(w->start_s + w->frame * w->frame_s + sample * w->sample_s);
}

static void take_forces(void *user, const sim *s, int sample) {
    walk *w = user;
    const size_t at = ((size_t)w->frame * (size_t)w->samples + (size_t)sample) * (size_t)s->instrument_count;
    for (int i = 0; i < s->instrument_count; i++)
        memcpy(w->force_N + 3 * (at + (size_t)i), s->reaction[i].force_N, 3 * sizeof(double));
}

/* Samples at their times where the walk has a builder, else once round as fast as they come. False: went unstable, or
 * was broken off. Ends the simulation. */
static bool go(study *t, sim *s, walk *w) {
    const bool paced = w->fresh != NULL;
    const study_each each = {paced ? wait_for_sample : NULL, take_forces, w};
    const char *label = paced ? "the recommendation, in real time" : "the recommendation, priced";
    const int every = (int)ceil(0.01 / s->frame_s); /* the work is no burden to short frames */
    const int path = t->run[0].frames;
    bool good = true;
    int k = 0;
    w->start_s = app_seconds();
    for (; k < w->frames && good && !app_interrupted(); k++) {
        if (k && k % path == 0) {
            const double left_s = app_seconds();
            sim_destroy(s);
            if (!(s = w->fresh(t))) break;
            w->start_s += app_seconds() - left_s;
        }
        w->frame = k;
        good = study_frame(s, k % path, &each, &w->cost_s[k]);
        w->wall_s = app_seconds() - w->start_s;
        w->late += w->wall_s > (k + 1) * w->frame_s;
        w->work_s[k] = k % every ? w->work_s[k - 1] : study_work_s();
        t->time.last_s =
            fmax((w->frames - k - 1) * (paced ? w->frame_s : w->cost_s[k]) + (paced ? 0 : study_hold_s(t)), 0.1);
        study_doing(t, label, (k + 1.0) / w->frames);
        if (!paced && study_end_s(t) < study_hold_s(t)) break;
        if (paced && study_end_s(t) < 0 && k + 1 >= path) break;
    }
    study_doing(t, label, 1);
    sim_destroy(s);
    good = good && s && !app_interrupted() && k >= (paced ? path : w->frames);
    w->frames = k < w->frames ? k : w->frames;
    return good;
}

/* Of the worst time round. */
static double error_of(const study *t, const walk *w) {
    const study_run *own = &t->run[0];
    const size_t width = (size_t)own->instruments * 3, path = (size_t)own->frames * width;
    const int laps = w->frames / own->frames;
    double worst = laps ? 0 : NAN, *force_N = malloc(sizeof *force_N * (path + 1));
    if (!force_N) abort();
    for (int lap = 0; lap < laps; lap++) {
        study_at_frames(w->force_N + (size_t)lap * path * (size_t)w->samples, own->frames, w->samples, width, w->back,
                        force_N);
        worst = fmax(worst, study_distance(force_N, t->truth.force_N, path));
    }
    free(force_N);
    return worst;
}

bool study_price(study *t, sim *s, study_choice *out) {
    walk w = begin_walk(&t->run[0], s, 0);
    study_run with = {0};
    const double was = out->share, frame_s = s->frame_s;
    const int threads = study_threads(s);
    const bool good = go(t, s, &w);
    if (good) {
        study_take_price(&with, w.cost_s, w.cost_s, w.frames);
        out->error = error_of(t, &w);
        out->frame_s = frame_s, out->cost_s = with.cpu_s, out->share = with.cpu_p95_s / frame_s;
        out->busy = threads > 1 ? out->busy * out->share / was : out->share;
        out->work_s = app_median(w.work_s, w.frames);
    }
    end_walk(&w);
    return good;
}

void study_hold(study *t, sim *s, study_builder *fresh) {
    study_choice *c = &t->choice;
    const double frame_s = s->frame_s;
    /* At least once along the path, else there is no error to hold against. */
    walk w = begin_walk(&t->run[0], s, fmin(t->hold_s, t->limit_s / 4));
    w.fresh = fresh;
    const bool good = go(t, s, &w);
    study_run held = {0};
    c->held_frames = w.frames, c->held_late = w.late, c->held_wall_s = w.wall_s;
    c->held_error = error_of(t, &w);
    c->held = study_judge_pace(w.cost_s, w.work_s, w.frames, c->work_s, frame_s * t->budget);
    study_take_price(&held, w.cost_s, w.cost_s, w.frames);
    c->held_share = held.cpu_p95_s / frame_s;
    end_walk(&w);
    c->real_time = c->held_late <= STUDY_OVER * c->held_frames;
    c->kept = good && c->fits && c->held.dearer <= STUDY_OVER && c->held_error <= 2 * c->error + STUDY_ALIKE &&
              c->held_error >= 0.5 * c->error - STUDY_ALIKE;
}
