/* In which order a study's runs are made, so that its limit holds what says most: the scene as it is, the finest mesh,
 * which the truth is of, extrapolators, then the quicker before the longer. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bandwidth.h"
#include "study.h"

/* --- the scene as it is --- */

/* The path ends at frame t->time.cut_at: all runs, and the promise, are of what is before. */
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

int study_measure_own(study *t) {
    study_run *own = &t->run[0];
    t->time.run_began_s = app_seconds();
    int rc = study_measure(t, own);
    if (rc || !t->time.cut_at) return rc;
    cut_path(t);
    /* Once more as far as that, however slow the machine is now: its moments of shape are of a path's length. */
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
    double sum = study_expected_felt_s(t) + study_try_s(t) + study_hold_s(t);
    for (int i = 1; i < t->run_count; i++)
        if (!study_is_felt(&t->run[i])) sum += study_expected_s(t, &t->run[i]);
    study_path_words(t, words, sizeof words);
    app_remark("tm-accuracy: %d settings along %s; as it is the scene took %s, so all may take %s, of a limit of %s",
               t->run_count, words, study_span(t->run[0].setup_s + t->run[0].wall_s * t->run[0].frames, own),
               study_span(sum, all), study_span(t->limit_s, limit));
}

int study_measure_all(study *t) {
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
