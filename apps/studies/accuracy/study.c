/* tm-accuracy --scene from start to end. Orders the runs so that the time limit covers the most informative ones: the
 * scene as it is, the finest mesh (needed for the reference), extrapolators, then shorter before longer runs. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bandwidth.h"
#include "study.h"

/* --- the scene as it is --- */

/* Ends the path at frame t->time.cut_at: all runs and the prediction concern the part before. */
static void cut_path(study *t) {
    study_run *own = &t->run[0];
    char limit[24], words[120];
    t->duration_s = t->time.cut_at * own->frame_s;
    t->time.cut_at = 0;
    free(own->force_N), free(own->u_m), free(t->time.path);
    own->force_N = own->u_m = t->time.path = NULL;
    study_make_key(t, own);
    study_path_words(t, words, sizeof words);
    app_remark("tm-accuracy: every run, error and promise is of %s: the limit of %s holds no more (--limit)", words,
               study_span(t->limit_s, limit));
}

/* Measures the scene as it is, along as much of its path as the limit allows. */
static int study_measure_own(study *t) {
    study_run *own = &t->run[0];
    t->time.run_began_s = app_seconds();
    int rc = study_measure(t, own);
    if (rc || !t->time.cut_at) return rc;
    cut_path(t);
    /* Measures it again over the same length, even if the machine is slower now: its moments of shape belong to that
     * length. */
    const double limit_s = t->limit_s;
    t->limit_s = INFINITY;
    t->time.run_began_s = app_seconds();
    rc = study_measure(t, own);
    t->limit_s = limit_s;
    return rc;
}

/* --- the others --- */

static int measure_one(study *t, study_run *r) {
    const double expected_s = study_expected_s(t, r);
    if (study_find(t, r)) return 0;
    if (!study_may_start(t, r, expected_s)) return 0;
    const int rc = study_measure(t, r);
    if (r->done && !r->failed) study_run_took(t, expected_s);
    return rc;
}

static int measure_felt(study *t) {
    bool all = true;
    for (int i = 1; i < t->run_count; i++)
        if (study_is_felt(&t->run[i])) all = study_find(t, &t->run[i]) && all;
    return all ? 0 : study_measure_felt(t);
}

static const study *ordered;
static int by_expectation(const void *a, const void *b) {
    const double x = study_expected_s(ordered, &ordered->run[*(const int *)a]),
                 y = study_expected_s(ordered, &ordered->run[*(const int *)b]);
    return x != y ? (x > y) - (x < y) : *(const int *)a - *(const int *)b;
}

static void say_what_comes(const study *t) {
    char own[24], all[24], limit[24], words[120];
    double sum = study_expected_felt_s(t) + study_try_s(t) + study_verify_s(t);
    for (int i = 1; i < t->run_count; i++)
        if (!study_is_felt(&t->run[i])) sum += study_expected_s(t, &t->run[i]);
    study_path_words(t, words, sizeof words);
    app_remark("tm-accuracy: %d settings along %s; as it is the scene took %s, so all may take %s, of a limit of %s",
               t->run_count, words, study_span(t->run[0].setup_s + t->run[0].wall_s * t->run[0].frames, own),
               study_span(sum, all), study_span(t->limit_s, limit));
}

/* Measures all other runs: the finest mesh, extrapolators, then shorter before longer ones. */
static int study_measure_all(study *t) {
    int order[STUDY_RUNS], count = 0, finest = 0, rc = 0;
    for (int i = 1; i < t->run_count; i++) {
        const study_run *r = &t->run[i];
        const bool refined = !strcmp(r->knob, "mesh") && r->form == STUDY_AS_IT_IS && !r->foreign;
        if (!study_is_felt(r)) order[count++] = i;
        if (refined && (!finest || t->mesh[r->mesh].tets > t->mesh[t->run[finest].mesh].tets)) finest = i;
    }
    ordered = t;
    qsort(order, (size_t)count, sizeof *order, by_expectation);
    say_what_comes(t);
    if (finest) rc = measure_one(t, &t->run[finest]);
    if (!rc) rc = measure_felt(t);
    for (int i = 0; i < count && !rc; i++)
        if (order[i] != finest) rc = measure_one(t, &t->run[order[i]]);
    return rc;
}

/* --- all --- */

static void print_runs(const study *t) {
    printf("%-14s %-40s %9s %9s %10s %8s\n", "knob", "setting", "error", "change", "ms a frame", "share");
    for (int i = 0; i < t->run_count; i++) {
        const study_run *r = &t->run[i];
        char error[20] = "-", change[20] = "-";
        if (r->left_out) printf("%-14s %-40s left out: %s\n", r->knob, r->name, r->why);
        if (!r->done) continue;
        if (r->failed) {
            printf("%-14s %-40s cannot be: %s\n", r->knob, r->name, r->why);
            continue;
        }
        if (isfinite(r->force_error)) snprintf(error, sizeof error, "%.2f %%", 100 * r->force_error);
        if (isfinite(r->change)) snprintf(change, sizeof change, "%.2f %%", 100 * r->change);
        printf("%-14s %-40s %9s %9s %10.3f %7.1f%%\n", r->knob, r->name, error, change, 1e3 * r->cpu_s,
               100 * r->cpu_p95_s / r->frame_s);
    }
}

static void print_truth(const study *t) {
    const study_truth *h = &t->truth;
    char path[120];
    study_path_words(t, path, sizeof path);
    const study_run *c = &t->run[h->coarse], *f = &t->run[h->fine];
    if (h->coarse == h->fine)
        printf("\nNo finer mesh of it was run: errors are against half the step, and what the mesh leaves out is not "
               "known.\n");
    else if (!h->extrapolated)
        printf("\nError: RMS of the force's distance, over %s, from the finest run (%d tetrahedra). The "
               "meshes are not near a limit yet:\nit may lie another %.0f %% away, and errors are as much less "
               "certain. Edges longer than the instrument's radius do that: try --limit.\n",
               path, f->tets, 100 * h->uncertainty);
    else
        printf("\nError: RMS of the force's distance, over %s, from Richardson's estimate of meshes of %d "
               "and %d tetrahedra\n(order %.2f, %s), which is itself uncertain by %.1f %%.\n",
               path, c->tets, f->tets, h->order, h->order_observed ? "observed" : "assumed", 100 * h->uncertainty);
    printf("Share: of one processor, 95th percentile of the frames.\n");
    int left_out = 0;
    for (int i = 0; i < t->run_count; i++) left_out += t->run[i].left_out;
    char limit[24];
    if (left_out)
        printf("%d settings were left out: the limit of %s does not hold them. The same command goes on with them, a "
               "longer --limit does more.\n",
               left_out, study_span(t->limit_s, limit));
}

/* Draws the page by Python; the study is valid without it. */
static int draw(const study *t) {
    char script[2048], python[1200];
    const char *asked = getenv("TM_PYTHON");
    if (!app_shared_file("apps/studies/accuracy/scene_page.py", script, sizeof script))
        return app_bad_input(script, 0, "the program that draws the page is missing; make install installs it");
    const ssize_t length = readlink("/proc/self/exe", python, 1000);
    python[length > 0 ? length : 0] = 0;
    char *slash = strrchr(python, '/');
    if (slash) snprintf(slash, 60, "/../venv/bin/python");
    fflush(NULL);
    const char *with = asked ? asked : slash && !access(python, X_OK) ? python : "python3";
    execlp(with, with, script, t->json, "-o", t->page, (char *)NULL);
    return app_bad_input("--page", 0, "python3 cannot be started; install it, or draw %s with %s elsewhere", t->json,
                         script);
}

/* Warns if the tool never touches: all errors would be 0. */
static void remark_untouched(const study *t) {
    const study_run *own = &t->run[0];
    for (int i = 0; i < own->frames * own->instruments * 3; i++)
        if (own->force_N[i] != 0) return;
    app_remark("%s: within %.3g s the hand touches nothing, so there is no force to judge; give a longer --duration",
               t->file, t->duration_s);
}

static void free_all(study *t) {
    for (int i = 0; i < t->run_count; i++) {
        study_run *r = &t->run[i];
        for (int k = 0; k < r->set_count; k++) free(r->set[k]);
        free(r->force_N);
        free(r->u_m);
    }
    free(t->truth.force_N);
    free(t->truth.u_m);
    cJSON_Delete(t->old);
}

int study_whole(study *t) {
    const size_t stem =
        strlen(t->json) > 5 && !strcmp(t->json + strlen(t->json) - 5, ".json") ? strlen(t->json) - 5 : strlen(t->json);
    char folder[1000], whole[4096];
    snprintf(folder, sizeof folder, "%.*s", (int)stem, t->json);
    char *slash = strrchr(folder, '/');
    if (slash) *slash = 0;
    if (!realpath(slash ? (slash == folder ? "/" : folder) : ".", whole))
        return app_bad_input(t->json, 0, "its folder does not exist; make it");
    snprintf(t->folder, sizeof t->folder, "%.800s/%.150s.files", whole, slash ? slash + 1 : folder);
    study_open(t);
    study_time_begin(t);
    int rc = study_plan_own(t);
    if (!rc) rc = study_measure_own(t);
    if (!rc && t->run[0].failed) rc = app_bad_input(t->file, 0, "as it is, the scene %s", t->run[0].why);
    if (!rc) remark_untouched(t);
    if (!rc) rc = study_plan(t);
    if (!rc) rc = study_measure_all(t);
    if (app_interrupted() && t->run_count)
        app_remark("tm-accuracy: %s contains the completed runs; the same command continues from there", t->json);
    if (!rc) study_judge(t);
    if (!rc && t->choice.wanted) rc = study_recommend(t);
    if (!rc) rc = study_save(t, true);
    study_time_end(t);
    if (!rc && !app_is_quiet()) {
        print_runs(t);
        print_truth(t);
        study_print_rates(t);
        if (t->choice.wanted) study_say(t);
    }
    const bool page = !rc && t->page;
    if (page) rc = draw(t);
    free_all(t);
    return rc;
}
