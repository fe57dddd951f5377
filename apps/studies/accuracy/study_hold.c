/* The recommended scene, run: once for what is promised of it, once in real time to hold it to that. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bandwidth.h"
#include "study.h"

/* Frames along the hand's path, over and over. Forces are kept where the scene as it is has a frame, too. */
typedef struct walk {
    study_builder *fresh; /* the scene anew for each time round: the path's end is not its beginning */
    int frames, late;
    int times;                         /* frames for one of the scene as it is */
    double *cost_s, *work_s, *force_N; /* [frames], [frames], [frames / times][instruments][3] */
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
    const int times = (int)fmax(1, round(own->frame_s / s->frame_s)), frames = times * own->frames;
    walk w = {.frames = (int)fmax(frames, ceil(seconds / s->frame_s)), .times = times};
    w.cost_s = calloc((size_t)w.frames + 1, sizeof *w.cost_s);
    w.work_s = calloc((size_t)w.frames + 1, sizeof *w.work_s);
    w.force_N = calloc((size_t)(w.frames / times + 1) * (size_t)own->instruments * 3 + 1, sizeof *w.force_N);
    if (!w.cost_s || !w.work_s || !w.force_N) abort();
    return w;
}

static void end_walk(walk *w) {
    free(w->cost_s);
    free(w->work_s);
    free(w->force_N);
}

/* Frames at their times where the walk has a builder, else once round as fast as they come. False: went unstable, or
 * was broken off. Ends the simulation. */
static bool go(study *t, sim *s, walk *w) {
    const bool paced = w->fresh != NULL;
    const study_run *own = &t->run[0];
    const char *label = paced ? "the recommendation, in real time" : "the recommendation, priced";
    const int every = (int)ceil(0.01 / s->frame_s); /* the work is no burden to short frames */
    const int path = w->times * own->frames;
    double start_s = app_seconds();
    bool good = true;
    int k = 0;
    for (; k < w->frames && good && !app_interrupted(); k++) {
        if (k && k % path == 0) {
            const double left_s = app_seconds();
            sim_destroy(s);
            if (!(s = w->fresh(t))) break;
            start_s += app_seconds() - left_s;
        }
        tm_tool_pose to[TM_MAX_INSTRUMENTS];
        const double time_s = (k % path + 1) * s->frame_s, before = study_cpu_s();
        for (int i = 0; i < own->instruments; i++) to[i] = sim_hand_pose(s, i, time_s);
        good = sim_frame(s, to, s->substeps) == TM_OK && !s->broken_off;
        w->cost_s[k] = study_cpu_s() - before;
        w->wall_s = app_seconds() - start_s;
        w->late += w->wall_s > (k + 1) * s->frame_s;
        const size_t at = (size_t)(k / w->times) * (size_t)own->instruments;
        for (int i = 0; i < own->instruments; i++) /* the last one stays: that of the frame's end */
            memcpy(w->force_N + 3 * (at + (size_t)i), s->reaction[i].force_N, 3 * sizeof(double));
        w->work_s[k] = k % every ? w->work_s[k - 1] : study_work_s();
        t->time.last_s =
            fmax((w->frames - k - 1) * (paced ? s->frame_s : w->cost_s[k]) + (paced ? 0 : study_hold_s(t)), 0.1);
        study_doing(t, label, (k + 1.0) / w->frames);
        if (!paced && study_end_s(t) < study_hold_s(t)) break;
        if (paced && study_end_s(t) < 0 && k + 1 >= path) break;
        if (paced) wait_until(start_s + (k + 1) * s->frame_s);
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
    const size_t path = (size_t)own->frames * (size_t)own->instruments * 3;
    const int laps = w->frames / (w->times * own->frames);
    double worst = laps ? 0 : NAN;
    for (int lap = 0; lap < laps; lap++)
        worst = fmax(worst, study_distance(w->force_N + (size_t)lap * path, t->truth.force_N, path));
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
