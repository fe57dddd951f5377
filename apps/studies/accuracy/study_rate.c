/* Chooses, prints and explains the rate of force samples and its extrapolator. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "study.h"

/* A hand distinguishes forces that differ by some 7 %; 1/70 of that is negligible. */
static const double FELT = 1e-3;

double study_alike(double error) { return fmax(FELT, 0.05 * error); }

double study_rate_Hz(const study *t, const study_run *r) { return r->times / t->run[0].frame_s; }

double study_times_costlier(const study *t, const study_run *r) {
    const study_run *own = &t->run[0];
    return r->cpu_p95_s / r->frame_s / (own->cpu_p95_s / own->frame_s);
}

bool study_is_felt(const study_run *r) { return !strcmp(r->knob, "extrapolator") || !strcmp(r->knob, "rate"); }

/* Returns whether a law may be recommended: the paper's unsigned law serves only for comparison. */
static bool is_judged(const study_run *r) {
    return study_is_felt(r) && r->felt_known && r->done && !r->failed && r->law != HRT_PAPER_POSITION;
}

static bool is_open(const study *t, int i, double costlier_max, const bool *excluded) {
    const study_run *r = &t->run[i];
    return is_judged(r) && !(excluded && excluded[i]) && study_times_costlier(t, r) <= fmax(costlier_max, 1);
}

/* Returns which of two runs with equal error and cost is preferred: the scene's own extrapolator, else the smaller
 * error. */
static bool is_preferred(const study *t, const study_run *a, const study_run *b) {
    if ((a->law == t->own_law) != (b->law == t->own_law)) return a->law == t->own_law;
    return a->force_error < b->force_error;
}

int study_choose_felt(const study *t, double costlier_max, const bool *excluded) {
    int truest = 0, best = 0;
    for (int i = 1; i < t->run_count; i++)
        if (is_open(t, i, costlier_max, excluded) && (!truest || t->run[i].force_error < t->run[truest].force_error))
            truest = i;
    const double enough = t->run[truest].force_error + study_alike(t->run[truest].force_error);
    for (int i = 1; i < t->run_count && truest; i++) {
        const study_run *r = &t->run[i], *b = &t->run[best];
        if (!is_open(t, i, costlier_max, excluded) || r->force_error > enough) continue;
        const double ratio = best ? study_times_costlier(t, r) / study_times_costlier(t, b) : 0;
        if (ratio < 0.95 || (ratio < 1.05 && is_preferred(t, r, b))) best = i;
    }
    return best;
}

int study_best_at(const study *t, int times) {
    bool others[STUDY_RUNS];
    for (int i = 0; i < t->run_count; i++) others[i] = t->run[i].times != times;
    return study_choose_felt(t, INFINITY, others);
}

void study_print_rates(const study *t) {
    int last = 0;
    for (int i = 1; i < t->run_count; i++) {
        const study_run *r = &t->run[i];
        if (!is_judged(r) || r->times == last) continue;
        if (!last)
            printf("\n%-14s %-15s %9s %10s %12s %8s\n", "force samples", "extrapolator", "at once", "1 late", "2 late",
                   "share");
        last = r->times;
        const int best = study_best_at(t, r->times);
        const study_run *b = &t->run[best];
        char rate[20];
        snprintf(rate, sizeof rate, "%.4g Hz", study_rate_Hz(t, b));
        printf("%-14s %-15s %7.2f %% %8.2f %% %10.2f %% %7.1f%%%s\n", rate,
               hrt_extrapolator_name((hrt_extrapolator)b->law), 100 * b->felt[0], 100 * b->felt[1], 100 * b->felt[2],
               100 * b->cpu_p95_s / b->frame_s, best == t->choice.felt_run ? "  recommended" : "");
    }
    if (last)
        puts("The best extrapolator at each rate (haptics.rate): RMS error at the hand, samples 0, 1 and 2 of their "
             "periods late.");
}

void study_rate_reason(const study *t, char *text, size_t size) {
    const study_choice *c = &t->choice;
    const study_run *r = &t->run[c->felt_run], *truest = r;
    text[0] = 0;
    if (!c->felt_run) return;
    for (int i = 1; i < t->run_count; i++)
        if (is_judged(&t->run[i]) && t->run[i].force_error < truest->force_error) truest = &t->run[i];
    const int used =
        snprintf(text, size, "%s at %.4g Hz errs by %.2g %% at the hand, a sample late: ",
                 hrt_extrapolator_name((hrt_extrapolator)r->law), study_rate_Hz(t, r), 100 * r->force_error);
    if (truest == r)
        snprintf(text + used, size - (size_t)used, "the least of all rates and extrapolators");
    else
        snprintf(text + used, size - (size_t)used, "%s at %.4g Hz errs by %.2g %%, %s",
                 hrt_extrapolator_name((hrt_extrapolator)truest->law), study_rate_Hz(t, truest),
                 100 * truest->force_error,
                 r->force_error <= truest->force_error + study_alike(truest->force_error)
                     ? "a difference that no hand feels, and is no cheaper"
                     : "but the budget has no room for it");
    for (int i = 1; i < t->run_count; i++) {
        const study_run *own = &t->run[i];
        const size_t end = strlen(text);
        if (is_judged(own) && own != r && own->law == t->own_law && own->times == t->own_times)
            snprintf(text + end, size - end, "; the scene as it is: %s at %.4g Hz, %.2g %%",
                     hrt_extrapolator_name((hrt_extrapolator)own->law), study_rate_Hz(t, own), 100 * own->force_error);
    }
}
