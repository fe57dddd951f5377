/* Time of a study: its limit and the expected time of each run, from before its start and from its beginning. A status
 * line every ten seconds shows the activity and the expected end. */
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "bandwidth.h"
#include "study.h"

/* Shares of the limit: the scene as it is, along its path; the same if it has touched nothing by then; any run. */
static const double OWN = 1.0 / 40, UNTOUCHED = 1.0 / 10, RUN = 1.0 / 4;
/* Beginning of a run that determines its speed: frames, seconds, and share of its time. */
enum { BEGINNING = 3 };
static const double BEGINNING_S = 0.3, BEGINNING_SHARE = 0.02;

const char *study_span(double seconds, char text[24]) {
    const long whole = lround(seconds);
    if (!(seconds < 1e6))
        snprintf(text, 24, "days");
    else if (seconds < 9.95)
        snprintf(text, 24, "%.2g s", seconds);
    else if (whole < 60)
        snprintf(text, 24, "%ld s", whole);
    else
        snprintf(text, 24, whole % 60 ? "%ld min %ld s" : "%ld min", whole / 60, whole % 60);
    return text;
}

void study_path_words(const study *t, char *text, size_t size) {
    if (t->duration_s < t->asked_s - 1e-9)
        snprintf(text, size, "the first %.4g s of the path's %.4g s", t->duration_s, t->asked_s);
    else
        snprintf(text, size, "the path's %.4g s", t->duration_s);
}

/* --- the line --- */

static struct {
    pthread_mutex_t lock;
    pthread_cond_t wake;
    pthread_t thread;
    bool runs, stops;
    int to; /* stderr itself, which is redirected while a scene is built */
    char what[200];
    double began_s, limit_s, left_s; /* left_s: NAN while unknown */
} line = {.lock = PTHREAD_MUTEX_INITIALIZER, .wake = PTHREAD_COND_INITIALIZER};

enum { EVERY_S = 10 };

static void say(void) {
    char so_far[24], limit[24], left[24], more[60] = "";
    if (isfinite(line.left_s))
        snprintf(more, sizeof more, ", about %s to the end", study_span(fmax(line.left_s, 1), left));
    dprintf(line.to, "tm-accuracy: %s; %s so far%s (limit %s)\n", line.what,
            study_span(app_seconds() - line.began_s, so_far), more, study_span(line.limit_s, limit));
}

static void *speak(void *nothing) {
    pthread_mutex_lock(&line.lock);
    struct timespec next;
    clock_gettime(CLOCK_REALTIME, &next);
    while (!line.stops) {
        next.tv_sec += EVERY_S;
        while (!line.stops && pthread_cond_timedwait(&line.wake, &line.lock, &next) == 0) {
        }
        if (!line.stops) say();
    }
    pthread_mutex_unlock(&line.lock);
    return nothing;
}

/* Starts the status line, unless stderr is a terminal, where app_progress prints one. */
static void begin_line(const study *t) {
    sigset_t all, before;
    line.began_s = t->time.began_s, line.limit_s = t->limit_s, line.left_s = NAN;
    snprintf(line.what, sizeof line.what, "reading the scene");
    if (app_is_quiet() || isatty(STDERR_FILENO)) return;
    line.to = dup(STDERR_FILENO);
    sigfillset(&all); /* the main thread handles Ctrl-C */
    pthread_sigmask(SIG_SETMASK, &all, &before);
    line.runs = line.to >= 0 && !pthread_create(&line.thread, NULL, speak, NULL);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
}

void study_time_begin(study *t) {
    t->time = (study_time){.began_s = app_seconds(), .run_began_s = app_seconds(), .run_allowed_s = INFINITY};
    begin_line(t);
}

void study_time_end(study *t) {
    free(t->time.path);
    t->time.path = NULL;
    if (!line.runs) return;
    pthread_mutex_lock(&line.lock);
    line.stops = true;
    pthread_cond_signal(&line.wake);
    pthread_mutex_unlock(&line.lock);
    pthread_join(line.thread, NULL);
    close(line.to);
    line.runs = false;
}

/* --- expected times --- */

static double own_s(const study *t) {
    const study_run *own = &t->run[0];
    return own->setup_s + own->wall_s * own->frames;
}

/* Returns the measured over the expected time of finished runs. */
static double learned(const study *t) {
    return t->time.made < 3 ? 1 : fmin(fmax(t->time.took_s / t->time.expected_s, 0.5), 3);
}

double study_expected_s(const study *t, const study_run *r) {
    const study_mesh *m = &t->mesh[r->mesh];
    const double more = r->mesh ? (double)m->tets / t->mesh[0].tets : 1;
    double factor = more / (r->mesh && m->step > 0 ? fmin(1, m->step) : fmin(1, pow(more, -1.0 / 3)));
    if (more > 1) factor *= 1.5; /* cache misses */
    if (r->form == STUDY_OTHER_VOLUME) factor *= 2;
    if (!strcmp(r->name, "half the step") || !strcmp(r->knob, "model")) factor *= 2;
    return learned(t) * factor * own_s(t);
}

/* Returns the expected time of a group. With one sample per frame, it also pays for patches and the truth at 500 Hz.
 * Other rates pay for the substeps added by rounding a sample up, and for patches. */
double study_expected_group_s(const study *t, const study_run *first) {
    const study_run *own = &t->run[0];
    if (first->times == 1) return 5 * own_s(t);
    const double of_sample = ceil(own->frame_s / first->times / own->dt_s - 1e-6),
                 more = fmax(first->times * of_sample * own->dt_s / own->frame_s, 1);
    return (first->sends == SIM_SENDS_FORCE ? 1.2 : 3) * more * own_s(t);
}

double study_expected_felt_s(const study *t) {
    double sum = 0;
    for (int i = 1; i < t->run_count; i++)
        if (t->run[i].felt_first && !t->run[i].done && !t->run[i].left_out)
            sum += study_expected_group_s(t, &t->run[i]);
    return sum;
}

double study_try_s(const study *t) { return t->choice.wanted ? 2 * own_s(t) : 0; }

double study_verify_s(const study *t) {
    return t->choice.wanted ? fmax(own_s(t), fmax(fmin(t->hold_s, t->limit_s / 4), t->duration_s)) : 0;
}

double study_end_s(const study *t) { return t->time.began_s + t->limit_s - app_seconds(); }

bool study_may_try(const study *t) {
    const study_choice *c = &t->choice;
    const double once_s = fmax(c->cost_s / t->slower / t->run[0].cpu_s, 1) * own_s(t);
    return app_seconds() + once_s + study_verify_s(t) < t->time.began_s + t->limit_s;
}

double study_run_limit_s(const study *t) { return RUN * t->limit_s; }

double study_left_s(const study *t) {
    return t->time.began_s + t->limit_s - app_seconds() - 2 * study_try_s(t) - study_verify_s(t);
}

/* Returns the expected time of all unfinished runs. */
static double expected_left_s(const study *t) {
    double sum = 2 * study_try_s(t) + study_verify_s(t) + study_expected_felt_s(t);
    for (int i = 1; i < t->run_count; i++) {
        const study_run *r = &t->run[i];
        const bool replayed = !strcmp(r->knob, "extrapolator") || !strcmp(r->knob, "rate");
        if (!r->done && !r->left_out && !replayed) sum += study_expected_s(t, r);
    }
    return sum;
}

/* Sets activity, progress and remaining time. The caller must hold the lock. */
static void set_line(const study *t, const char *what, double share) {
    int done = 0, left_out = 0;
    char of[60] = "", out[40] = "", percent[20] = "";
    for (int i = 0; i < t->run_count; i++) done += t->run[i].done, left_out += t->run[i].left_out;
    line.left_s = NAN;
    if (t->run_count > 1) {
        const double end_s = t->time.last_s > 0 ? t->time.last_s : expected_left_s(t);
        line.left_s = fmin(end_s, study_end_s(t));
        snprintf(of, sizeof of, "%d of %d settings done", done, t->run_count);
    }
    if (left_out) snprintf(out, sizeof out, " and %d left out", left_out);
    if (share >= 0) snprintf(percent, sizeof percent, ", %.0f %%", 100 * share);
    snprintf(line.what, sizeof line.what, "%s%s%s%.110s%s", of, out, *of ? ", now " : "", what, percent);
}

void study_doing(const study *t, const char *what, double share) {
    char text[200] = "", left[24];
    pthread_mutex_lock(&line.lock);
    set_line(t, what, share);
    pthread_mutex_unlock(&line.lock);
    if (isfinite(line.left_s))
        snprintf(text, sizeof text, "%.120s (about %s to the end of the study)", what, study_span(line.left_s, left));
    app_progress(*text ? text : what, fmax(share, 0), share >= 1);
}

/* --- runs that start, and continue --- */

void study_leave_out(study_run *r, const char *whose, double needs_s, double has_s) {
    char needs[24], has[24];
    r->left_out = true;
    study_span(needs_s, needs), study_span(has_s, has);
    if (has_s > 0)
        snprintf(r->why, sizeof r->why, "%s it needs about %s, and has %s; raise --limit", whose, needs, has);
    else
        snprintf(r->why, sizeof r->why, "%s it needs about %s, and no time is left; raise --limit", whose, needs);
}

bool study_may_start(study *t, study_run *r, double expected_s) {
    t->time.run_began_s = app_seconds();
    t->time.run_allowed_s = fmin(study_left_s(t), study_run_limit_s(t));
    if (expected_s <= t->time.run_allowed_s) return true;
    study_leave_out(r, "by the scene as it is", expected_s, t->time.run_allowed_s);
    return false;
}

static bool touches(const study_run *r, int frames) {
    for (int i = 0; i < frames * r->instruments * 3; i++)
        if (r->force_N[i] != 0) return true;
    return false;
}

static bool own_goes_on(study *t, const study_run *r, int k, double spent_s) {
    if (!t->time.path) t->time.path = app_zeroed((size_t)r->frames, sizeof *t->time.path);
    t->time.path[k - 1] = spent_s;
    const bool enough = spent_s > OWN * t->limit_s && touches(r, k);
    if (k == r->frames || k < 2 || (!enough && spent_s <= UNTOUCHED * t->limit_s)) return true;
    t->time.cut_at = k;
    return false;
}

/* Returns the share of a run's time for its first `share` of frames: frames with contact are costlier. */
static double share_of_time(const study *t, double share) {
    const study_run *own = &t->run[0];
    const double *path = t->time.path;
    const int k = (int)floor(share * own->frames);
    if (!path || k < 1 || !(path[own->frames - 1] > 0)) return share;
    return path[k < own->frames ? k - 1 : own->frames - 1] / path[own->frames - 1];
}

bool study_part_goes_on(study *t, study_run *r, double began_s, int k, int frames) {
    const double spent_s = app_seconds() - began_s, allowed_s = t->time.run_allowed_s - (began_s - t->time.run_began_s);
    if (k < BEGINNING || spent_s < fmax(BEGINNING_S, BEGINNING_SHARE * allowed_s)) return true;
    const double needs_s = spent_s / fmax(share_of_time(t, (double)k / frames), 1e-9);
    if (needs_s <= allowed_s || k == frames) return true;
    study_leave_out(r, "by its own first frames", needs_s, allowed_s);
    return false;
}

bool study_goes_on(study *t, study_run *r, int k) {
    if (r == &t->run[0]) return own_goes_on(t, r, k, app_seconds() - t->time.run_began_s);
    return study_part_goes_on(t, r, t->time.run_began_s, k, r->frames);
}

void study_run_took(study *t, double expected_s) {
    t->time.expected_s += expected_s / learned(t);
    t->time.took_s += app_seconds() - t->time.run_began_s;
    t->time.made++;
}
