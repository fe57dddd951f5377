/* Recommends the most accurate setting within a budget, writes it as a scene, runs it, and compares it with the
 * prediction.
 *
 * A setting is a mesh and form that was run, with another step, mass, precision, number of threads or model. The
 * combined effect is predicted: force differences are added to the mesh's, cost ratios are multiplied. The most
 * accurate prediction is run once (verification.c), and the measured result becomes the promise. An error above the sum
 * returns to the candidates with its measured value; a cost above the budget is rejected. A final run in real time
 * verifies the promise. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bandwidth.h"
#include "study.h"

/* Usable share of the budget and of the frame; the rest is for motion that the path does not contain. */
static const double ROOM = 0.9;

static bool usable(const study *t, const study_run *r) {
    return r->done && !r->failed && r->frames == t->run[0].frames && isfinite(r->force_error);
}

static bool is_mesh(const study_run *r) {
    return !strcmp(r->knob, "own") || !strcmp(r->knob, "strain_smoothing") || !strcmp(r->knob, "mesh");
}

enum { STEP, MASS, MODEL = 4, EXTRAS };

static bool sets_step(const study_run *r) {
    for (int i = r->edits_from; i < r->set_count; i++)
        if (!strncmp(r->set[i], "time.step=", 10)) return true;
    return false;
}

/* Returns whether a run may be added to a choice, one of each knob. Mass scaling is valid only on its own mesh, instead
 * of another step, and not on a mesh with its own step. Another model's cost ratio is valid only on the mesh on which
 * it was run. */
static bool is_extra(const study *t, const study_run *r, const study_choice *with, int knob) {
    static const char *const name[EXTRAS] = {"step", "mass", "precision", "threads", "model"};
    const bool alone = with->mesh_run == 0 && with->extra_count == 0;
    if (strcmp(r->knob, name[knob])) return false;
    return knob == STEP ? !sets_step(r) || !sets_step(&t->run[with->mesh_run])
                        : alone || (knob != MASS && knob != MODEL);
}

static void predict(const study *t, study_choice *c, double *force_N) {
    const study_run *own = &t->run[0], *mesh = &t->run[c->mesh_run];
    const size_t count = (size_t)own->frames * (size_t)own->instruments * 3;
    memcpy(force_N, mesh->force_N, count * sizeof *force_N);
    c->cost_s = t->slower * mesh->cpu_s, c->share = t->slower * mesh->cpu_p95_s / mesh->frame_s;
    c->busy = t->slower * mesh->busy_p95_s / mesh->frame_s, c->frame_s = mesh->frame_s;
    for (int e = 0; e < c->extra_count; e++) {
        const study_run *x = &t->run[c->extra[e]];
        for (size_t i = 0; i < count; i++) force_N[i] += x->force_N[i] - own->force_N[i];
        c->cost_s *= x->cpu_s / own->cpu_s;
        c->share *= x->cpu_p95_s / own->cpu_p95_s;
        c->busy *= x->busy_p95_s / own->busy_p95_s;
    }
    c->predicted = c->error = study_distance(force_N, t->truth.force_N, count);
}

/* Returns whether a choice fits the budget and ends before the next frame. Whatever the budget, one thread is one
 * processor. */
static bool within(const study *t, const study_choice *c) { return c->share <= ROOM * t->budget && c->busy <= ROOM; }

/* Returns whether a is better: smaller error within the budget; of errors within 5 % the cheaper. If none fits, the
 * cheapest is best. */
static bool better(const study *t, const study_choice *a, const study_choice *b) {
    const bool fits_a = within(t, a);
    if (fits_a != within(t, b)) return fits_a;
    if (!fits_a || fabs(a->error - b->error) < study_alike(fmin(a->error, b->error))) return a->share < b->share;
    return a->error < b->error;
}

/* Rejected choices: impossible, because effects may exclude one another; too expensive; or worse than predicted. */
enum { TRIED = 64 };
typedef struct tried {
    struct {
        study_choice of;
        bool cannot;
        double error; /* measured, if possible */
    } item[TRIED];
    int count;
} tried;

static int find_tried(const tried *b, const study_choice *c) {
    for (int i = 0; i < b->count; i++) {
        const study_choice *x = &b->item[i].of;
        if (x->mesh_run == c->mesh_run && x->extra_count == c->extra_count &&
            !memcmp(x->extra, c->extra, sizeof *c->extra * (size_t)c->extra_count))
            return i;
    }
    return -1;
}

/* Stores a rejected choice. Returns false if the table is full. */
static bool remember(tried *b, const study_choice *c, bool cannot, double error) {
    int at = find_tried(b, c);
    if (at < 0 && b->count == TRIED) return false;
    if (at < 0) at = b->count++;
    b->item[at].of = *c, b->item[at].cannot = cannot, b->item[at].error = error;
    return true;
}

static void consider_one(study *t, study_choice *c, const tried *known, bool *any, double *scratch) {
    const int at = find_tried(known, c);
    if (at >= 0 && known->item[at].cannot) return;
    predict(t, c, scratch);
    if (at >= 0) c->error = known->item[at].error;
    if (!*any || better(t, c, &t->choice)) {
        c->fits = within(t, c);
        t->choice = *c;
    }
    *any = true;
}

static void consider(study *t, study_choice c, int knob, const tried *known, bool *any, double *scratch) {
    if (knob == EXTRAS) {
        consider_one(t, &c, known, any, scratch);
        return;
    }
    consider(t, c, knob + 1, known, any, scratch);
    for (int i = 0; i < t->run_count; i++) {
        if (!is_extra(t, &t->run[i], &c, knob) || !usable(t, &t->run[i])) continue;
        study_choice with = c;
        with.extra[with.extra_count++] = i;
        consider(t, with, knob + 1, known, any, scratch);
    }
}

static bool choose(study *t, const tried *known) {
    const study_run *own = &t->run[0];
    double *scratch = app_zeroed((size_t)own->frames * (size_t)own->instruments * 3, sizeof(double));
    bool any = false;
    for (int i = 0; i < t->run_count; i++)
        if (is_mesh(&t->run[i]) && usable(t, &t->run[i]))
            consider(t, (study_choice){.wanted = true, .mesh_run = i}, 0, known, &any, scratch);
    free(scratch);
    return any;
}

/* Returns the change of the force at frames' ends by the rate, which no mesh is responsible for. */
static double rate_change(const study_run *felt) {
    return felt->felt_known && felt->times > 1 && isfinite(felt->change) ? felt->change : 0;
}

/* Patches cost a different share on every mesh: predictions up to this factor above the budget are still tried. */
static const double PREDICTED_ROOM = 1.5;

/* Chooses extrapolator and rate; none if the scene has no haptics. */
static void choose_felt(study *t, const bool *excluded) {
    study_choice *c = &t->choice;
    c->felt_run = 0, c->sends = SIM_SENDS_FORCE;
    if (!t->feels || !c->fits) return;
    c->felt_run = study_choose_felt(t, PREDICTED_ROOM * ROOM * t->budget / c->share, excluded);
    const study_run *felt = &t->run[c->felt_run];
    if (!c->felt_run) return;
    c->sends = felt->sends;
    c->predicted = c->error + rate_change(felt);
}

/* Result of trying a choice along the path before it is promised. Interacting changes do not add up, patches cost
 * differently on every mesh, and the machine may be slower than during the runs. */
typedef enum outcome { GOOD, EXPENSIVE, WORSE } outcome;

/* Destroys the simulation. */
static outcome try_out(study *t, sim *s) {
    study_choice *c = &t->choice, priced = *c;
    const bool good = study_cost(t, s, &priced), fits = good && within(t, &priced);
    if (good && !c->fits) { /* no prediction fits the budget, and this is the cheapest */
        *c = priced, c->fits = fits;
        return GOOD;
    }
    const double allowed = c->error + rate_change(&t->run[c->felt_run]);
    if (fits && priced.error > allowed + study_alike(allowed)) {
        c->error = priced.error;
        return WORSE;
    }
    const bool plain = c->sends == SIM_SENDS_FORCE && t->run[c->felt_run].times <= 1;
    if (!fits && plain) t->slower *= fmax(1.05, priced.share / c->share); /* probably all predictions are too low */
    if (fits) *c = priced;
    return fits ? GOOD : EXPENSIVE;
}

/* Builds the choice with the most accurate extrapolator and sample rate that fit. Returns null with the reason in
 * `end`. */
static sim *build_felt(study *t, char *why, size_t size, outcome *end, int *rc) {
    study_choice *c = &t->choice;
    const study_choice plain = *c;
    bool excluded[STUDY_RUNS] = {false};
    *end = EXPENSIVE;
    while (!app_interrupted() && study_may_try(t)) {
        *c = plain;
        choose_felt(t, excluded);
        sim *s = study_build_choice(t, why, size, rc);
        if (*rc) return s;
        *end = s ? try_out(t, s) : EXPENSIVE;
        if (*end == GOOD) return study_build_choice(t, why, size, rc);
        const study_run *last = &t->run[c->felt_run];
        if (*end == WORSE || !c->felt_run || (c->sends == SIM_SENDS_FORCE && last->times == 1)) return NULL;
        for (int i = 1; i < t->run_count; i++)
            if (t->run[i].felt_known && study_times_costlier(t, &t->run[i]) >= study_times_costlier(t, last))
                excluded[i] = true;
    }
    return NULL;
}

/* Builds the scene as it is, which was measured along the same path, if the limit allows no trial. */
static sim *build_untried(study *t, char *why, size_t size, int *rc) {
    study_choice *c = &t->choice;
    const study_run *own = &t->run[0];
    snprintf(why, size, "there was no time to try it");
    c->untried = true, c->mesh_run = c->extra_count = c->felt_run = 0, c->sends = SIM_SENDS_FORCE;
    c->predicted = c->error = own->force_error, c->cost_s = own->cpu_s, c->frame_s = own->frame_s;
    c->share = own->cpu_p95_s / own->frame_s, c->busy = own->busy_p95_s / own->frame_s, c->work_s = 0;
    c->fits = within(t, c);
    return study_build_choice(t, why, size, rc);
}

/* Builds the best possible choice. Returns null and an exit code after an error message. */
static sim *build_best(study *t, int *rc) {
    char why[400] = "";
    const int stem =
        (int)strlen(t->json) - (strlen(t->json) > 5 && !strcmp(t->json + strlen(t->json) - 5, ".json") ? 5 : 0);
    tried known = {0};
    sim *s = NULL;
    while (choose(t, &known)) {
        outcome end = EXPENSIVE;
        study_choice *c = &t->choice;
        snprintf(c->file, sizeof c->file, "%.*s-recommended.yaml", stem, t->json);
        s = build_felt(t, why, sizeof why, &end, rc);
        if (!s && !*rc && !app_interrupted() && !study_may_try(t)) {
            s = build_untried(t, why, sizeof why, rc);
            if (!s) break;
        }
        if (s || *rc || app_interrupted()) return s;
        t->worse += end == WORSE;
        if (!remember(&known, c, end != WORSE, c->error)) break;
    }
    fprintf(stderr, "the recommended scene does not run: %s\n", why);
    *rc = APP_FAILED;
    return NULL;
}

int study_recommend(study *t) {
    int rc = 0;
    sim *s = build_best(t, &rc);
    if (!s) return app_interrupted() ? app_interrupted_exit() : rc;
    study_verify(t, s);
    return app_interrupted() ? app_interrupted_exit() : 0;
}
