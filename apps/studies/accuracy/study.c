/* tm-accuracy --scene, from first to last. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "study.h"

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

/* Python draws; the study stands without it. */
static int draw(const study *t) {
    char script[2048], python[1200];
    const char *asked = getenv("TM_PYTHON");
    if (!app_shared_file("apps/studies/accuracy/scene_page.py", script, sizeof script))
        return app_bad_input(script, 0, "the program that draws the page is not there; make install puts it there");
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

/* Errors of a force that is not there would all be 0. */
static void remark_untouched(const study *t) {
    const study_run *own = &t->run[0];
    for (int i = 0; i < own->frames * own->instruments * 3; i++)
        if (own->force_N[i] != 0) return;
    app_remark("%s: within %.3g s the hand touches nothing: nothing can be said of its force; take a longer --duration",
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
        return app_bad_input(t->json, 0, "its folder is not there; make it");
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
        app_remark("tm-accuracy: %s holds what is done; the same command goes on from there", t->json);
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
