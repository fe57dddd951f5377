/* The exactest setting within a budget, written as a scene, run, and held to what was promised of it.
 *
 * A setting is one mesh and form that was run, with another step, mass, precision, threads or another model beside it.
 * What these do together: their differences of force are added to that of the mesh, and their ratios of price
 * multiplied. The exactest by that is run once (study_hold.c), and what came out is promised: an error that is worse
 * than the sum goes back among the others as what it is, a price above the budget is passed over. That it comes out so
 * in real time is what the run at the end is for. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "study.h"

/* Of the budget, and of the frame; the rest is for what the hand does that its path did not. */
static const double ROOM = 0.9;
/* A hand tells forces apart that differ by some 7 %; a seventieth of that decides nothing. */
static const double FELT = 1e-3;

static bool usable(const study *t, const study_run *r) {
    return r->done && !r->failed && r->frames == t->run[0].frames && isfinite(r->force_error);
}

static bool is_mesh(const study_run *r) {
    return !strcmp(r->knob, "own") || !strcmp(r->knob, "volume") || !strcmp(r->knob, "mesh");
}

enum { STEP, MASS, MODEL = 4, EXTRAS };

static bool sets_step(const study_run *r) {
    for (int i = r->edits_from; i < r->set_count; i++)
        if (!strncmp(r->set[i], "time.step=", 10)) return true;
    return false;
}

/* What a setting may have beside its mesh, one of each knob. What is heavier for a step is so on its own mesh alone, in
 * place of another step, and of a mesh that has a step of its own no other is; another model's price on another mesh is
 * not this one's ratio, so that it goes with the mesh alone on which it was run. */
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
    c->busy = t->slower * mesh->busy_p95_s / mesh->frame_s;
    for (int e = 0; e < c->extra_count; e++) {
        const study_run *x = &t->run[c->extra[e]];
        for (size_t i = 0; i < count; i++) force_N[i] += x->force_N[i] - own->force_N[i];
        c->cost_s *= x->cpu_s / own->cpu_s;
        c->share *= x->cpu_p95_s / own->cpu_p95_s;
        c->busy *= x->busy_p95_s / own->busy_p95_s;
    }
    c->predicted = c->error = study_distance(force_N, t->truth.force_N, count);
}

/* Not worth telling apart: a twentieth, or what no hand feels. */
static double alike(double error) { return fmax(FELT, 0.05 * error); }

/* Within the budget, and done before the next frame is due; whatever the budget, one thread is one processor. */
static bool within(const study *t, const study_choice *c) { return c->share <= ROOM * t->budget && c->busy <= ROOM; }

/* Within the budget the exactest; errors that differ by less than a twentieth are alike, and then the cheaper. Nothing
 * within it: the cheapest of all. */
static bool better(const study *t, const study_choice *a, const study_choice *b) {
    const bool fits_a = within(t, a);
    if (fits_a != within(t, b)) return fits_a;
    if (!fits_a || fabs(a->error - b->error) < alike(fmin(a->error, b->error))) return a->share < b->share;
    return a->error < b->error;
}

/* What was run: it cannot be, as effects may exclude one another, or was too dear; or was worse than predicted. */
enum { TRIED = 64 };
typedef struct tried {
    struct {
        study_choice of;
        bool cannot;
        double error; /* measured, where it can be */
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

/* False: no room for more. */
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
    double *scratch = malloc(sizeof(double) * ((size_t)own->frames * (size_t)own->instruments * 3 + 1));
    bool any = false;
    if (!scratch) abort();
    for (int i = 0; i < t->run_count; i++)
        if (is_mesh(&t->run[i]) && usable(t, &t->run[i]))
            consider(t, (study_choice){.wanted = true, .mesh_run = i}, 0, known, &any, scratch);
    free(scratch);
    return any;
}

/* The truest at the hand of the extrapolators that ask for `most` at most; none where the scene has no haptics. */
static void choose_extrapolator(study *t, sim_sends most) {
    study_choice *c = &t->choice;
    c->felt_run = 0, c->sends = SIM_SENDS_FORCE;
    for (int i = 1, x = -1; i < t->run_count; i++) {
        const study_run *r = &t->run[i];
        if (strcmp(r->knob, "extrapolator")) continue;
        x++; /* in the controller's order */
        if (!t->feels || !c->fits || !r->done || r->failed || sim_sends_of(x) > most) continue;
        if (!c->felt_run || r->force_error < 0.95 * t->run[c->felt_run].force_error)
            c->felt_run = i, c->sends = sim_sends_of(x);
    }
}

/* --- the scene --- */

static void names(const study *t, char *text, size_t size) {
    const study_choice *c = &t->choice;
    snprintf(text, size, "%s", t->run[c->mesh_run].name);
    for (int e = 0; e < c->extra_count; e++) {
        const size_t used = strlen(text);
        snprintf(text + used, size - used, "; %s", t->run[c->extra[e]].name);
    }
    const size_t used = strlen(text);
    if (c->felt_run) snprintf(text + used, size - used, "; extrapolator %s", t->run[c->felt_run].name);
}

static bool is_quiet(const char *set) {
    return !strcmp(set, "haptics") || !strcmp(set, "recording") || !strcmp(set, "rendering");
}

static int gather_edits(const study *t, char **edit) {
    const study_choice *c = &t->choice;
    int n = 0;
    for (int i = 0; i < t->set_count; i++)
        if (!is_quiet(t->set[i])) edit[n++] = t->set[i];
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
    char setting[400], doubt[100], hand[200] = "", evidence[3000], *edit[7 * STUDY_SETS];
    names(t, setting, sizeof setting);
    snprintf(doubt, sizeof doubt, "what the mesh leaves out is not known: no finer one was run");
    if (isfinite(t->truth.uncertainty))
        snprintf(doubt, sizeof doubt, "the truth itself is uncertain by %.2g %%", 100 * t->truth.uncertainty);
    if (c->felt_run)
        snprintf(hand, sizeof hand,
                 "#   at the hand %s is %.2g %% RMS off between frames, with samples a frame late (%.2g %% at once)\n",
                 t->run[c->felt_run].name, 100 * t->run[c->felt_run].felt[1], 100 * t->run[c->felt_run].felt[0]);
    snprintf(evidence, sizeof evidence,
             "# Recommended by tm-accuracy for %.3g processors, from %s%s.\n"
             "#   setting    %s\n"
             "#   force      %.2g %% RMS off the study's truth along the hand's path (the scene as it is: %.2g %%);\n"
             "#              %s%s\n"
             "%s"
             "#   price      %.3g ms a frame of %.3g ms; 95th percentile: %.2g of a processor (as it is: %.2g)\n"
             "#   evidence   %s; what holds is what was run on that machine\n",
             t->budget, t->file, c->fits ? "" : " (nothing measured fits that; this is the cheapest)", setting,
             100 * c->error, 100 * own->force_error,
             t->truth.extrapolated || c->error > STUDY_ALIKE ? "" : "that truth is this very run; ", doubt, hand,
             1e3 * c->cost_s, 1e3 * own->frame_s, c->share, own->cpu_p95_s / own->frame_s, t->json);
    return study_write_yaml(t, c->file, edit, gather_edits(t, edit), evidence);
}

void study_say(const study *t) {
    const study_choice *c = &t->choice;
    char setting[400], verdict[500];
    names(t, setting, sizeof setting);
    study_verdict(c, verdict, sizeof verdict);
    printf("\nRecommended for %.3g processors: %s\n  %s\n", t->budget, setting, c->file);
    if (t->worse)
        printf("  %d setting%s came out worse than predicted, and had to be the best as it came out\n", t->worse,
               t->worse > 1 ? "s" : "");
    printf("  promised: force %.2f %% off (predicted %.2f %%), %.1f %% of a processor%s\n", 100 * c->error,
           100 * c->predicted, 100 * c->share, c->fits ? "" : " - MORE THAN THE BUDGET: nothing measured fits it");
    printf(
        "  held %d frames: force %.2f %% off, %.1f %% of a processor; %.1f %% of the frames took more processor time "
        "than the budget; %d came late by the wall clock%s\n  %s\n",
        c->held_frames, 100 * c->held_error, 100 * c->held_share, 100 * c->held.over, c->held_late,
        c->real_time ? "" : " (too many)", verdict);
}

/* The choice of now, as it was written; null: it cannot be. */
static sim *build_written(const study *t, char *why, size_t size) {
    char *set[STUDY_SETS];
    int count = 0;
    const study_choice *c = &t->choice;
    for (int i = 0; i < t->set_count; i++) { /* what the file could not take, and what no study runs with */
        const bool quiet = is_quiet(t->set[i]) && !(c->felt_run && !strcmp(t->set[i], "haptics"));
        if (quiet || !study_yaml_can(t->set[i])) set[count++] = t->set[i];
    }
    sim *s = study_build(c->file, set, count, why, size);
    for (int i = 0; s && i < s->instrument_count && c->felt_run; i++) s->wants[i] = s->can_send;
    return s;
}

static sim *build_again(study *t) {
    char why[400];
    return build_written(t, why, sizeof why);
}

/* Written, and built; null: that, or `rc`. */
static sim *build_choice(study *t, char *why, size_t size, int *rc) {
    *rc = write_scene(t);
    return *rc || app_interrupted() ? NULL : build_written(t, why, size);
}

/* The choice is run along the path before it is promised: what its changes do together is not their sum where they
 * touch the same thing, what patches cost is another figure on every mesh, and the machine may be slower than it was
 * when its runs were made. */
typedef enum outcome { GOOD, DEAR, WORSE } outcome;

/* Ends the simulation. */
static outcome try_out(study *t, sim *s) {
    study_choice *c = &t->choice, priced = *c;
    const bool good = study_price(t, s, &priced), fits = good && within(t, &priced);
    if (good && !c->fits) { /* by what was predicted nothing does, and this is the cheapest */
        *c = priced, c->fits = fits;
        return GOOD;
    }
    if (fits && priced.error > c->error + alike(c->error)) {
        c->error = priced.error;
        return WORSE;
    }
    if (!fits && c->sends == SIM_SENDS_FORCE) t->slower *= fmax(1.05, priced.share / c->share); /* so all are, likely */
    if (fits) *c = priced;
    return fits ? GOOD : DEAR;
}

/* The choice with the truest extrapolator that it has room for; null: `end` says why. */
static sim *build_felt(study *t, char *why, size_t size, outcome *end, int *rc) {
    study_choice *c = &t->choice;
    const study_choice plain = *c;
    *end = DEAR;
    for (int most = SIM_SENDS_PATCH; most >= SIM_SENDS_FORCE && !app_interrupted(); most = (int)c->sends - 1) {
        *c = plain;
        choose_extrapolator(t, (sim_sends)most);
        sim *s = build_choice(t, why, size, rc);
        if (*rc) return s;
        *end = s ? try_out(t, s) : DEAR;
        if (*end == GOOD) return build_choice(t, why, size, rc);
        if (*end == WORSE) return NULL;
    }
    return NULL;
}

/* The best that can be built. Null, and an exit code, having complained. */
static sim *build_best(study *t, int *rc) {
    char why[400] = "";
    const int stem =
        (int)strlen(t->json) - (strlen(t->json) > 5 && !strcmp(t->json + strlen(t->json) - 5, ".json") ? 5 : 0);
    tried known = {0};
    while (choose(t, &known)) {
        outcome end;
        study_choice *c = &t->choice;
        snprintf(c->file, sizeof c->file, "%.*s-recommended.yaml", stem, t->json);
        sim *s = build_felt(t, why, sizeof why, &end, rc);
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
    study_hold(t, s, build_again);
    return app_interrupted() ? app_interrupted_exit() : 0;
}
