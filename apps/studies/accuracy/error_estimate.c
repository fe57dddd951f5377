/* Reference solution of a study: Richardson's estimate from its own meshes, and the error of every run relative to
 * it. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "study.h"

double study_distance(const double *a, const double *b, size_t count) {
    double difference = 0, size = 0;
    for (size_t i = 0; i < count; i++) {
        difference += (a[i] - b[i]) * (a[i] - b[i]);
        size += b[i] * b[i];
    }
    return size > 0 ? sqrt(difference / size) : difference > 0 ? INFINITY : 0;
}

static size_t forces(const study_run *r) { return (size_t)r->frames * (size_t)r->instruments * 3; }
static bool usable(const study_run *r) { return r->done && !r->failed; }
/* Returns the size of the tetrahedra, up to a factor of the organ. */
static double size_of(const study_run *r) { return cbrt(1.0 / r->tets); }

/* Collects one form's runs, coarse to fine. Foreign meshes have another surface and so another limit. */
static int family(const study *t, study_form form, int *run) {
    int n = 0;
    for (int i = 0; i < t->run_count; i++) {
        const study_run *r = &t->run[i];
        const bool mesh = !strcmp(r->knob, "own") || !strcmp(r->knob, "strain_smoothing") || !strcmp(r->knob, "mesh");
        if (!mesh || r->form != form || r->foreign || !usable(r) || forces(r) != forces(&t->run[0])) continue;
        int at = n++;
        for (; at > 0 && t->run[run[at - 1]].tets > r->tets; at--) run[at] = run[at - 1];
        run[at] = i;
    }
    return n;
}

/* Returns the change from fine to the limit over the change from coarse to fine, for order p. */
static double weight(double coarse, double fine, double p) { return 1 / (pow(coarse / fine, p) - 1); }

/* Solves (F1 - F0) : (F2 - F1) = (h0^p - h1^p) : (h1^p - h2^p) for p, within the orders possible for linear
 * tetrahedra. */
static bool observe(const study *t, const int *run, double *p) {
    const study_run *r[3] = {&t->run[run[0]], &t->run[run[1]], &t->run[run[2]]};
    const double h0 = size_of(r[0]), h1 = size_of(r[1]), h2 = size_of(r[2]);
    const double ratio = study_distance(r[0]->force_N, r[1]->force_N, forces(r[0])) /
                         (study_distance(r[2]->force_N, r[1]->force_N, forces(r[0])) + 1e-300);
    double low = 0.2, high = 4;
    for (int i = 0; i < 60; i++) {
        *p = 0.5 * (low + high);
        if ((pow(h0, *p) - pow(h1, *p)) / (pow(h1, *p) - pow(h2, *p)) < ratio)
            low = *p;
        else
            high = *p;
    }
    const bool plausible = *p > 0.5 && *p < 3;
    if (!plausible) *p = 1.5;
    return plausible;
}

/* Extrapolates force and shape: f + times (f - c). */
static void go_beyond(study_truth *h, const study_run *c, const study_run *f, double times) {
    const size_t shape = STUDY_MOMENTS * STUDY_POINTS * 3;
    double sum = 0;
    h->force_N = realloc(h->force_N, sizeof(double) * (forces(f) + 1));
    h->u_m = realloc(h->u_m, sizeof(double) * shape);
    if (!h->force_N || !h->u_m) abort();
    for (size_t i = 0; i < forces(f); i++) {
        h->force_N[i] = f->force_N[i] + times * (f->force_N[i] - c->force_N[i]);
        sum += h->force_N[i] * h->force_N[i];
    }
    for (size_t i = 0; i < shape; i++) h->u_m[i] = f->u_m[i] + times * (f->u_m[i] - c->u_m[i]);
    h->frames = f->frames, h->instruments = f->instruments, h->rms_N = sqrt(sum / f->frames);
}

/* Computes the limit of one form, with an uncertainty that disregards the other form. */
static bool limit(const study *t, study_form form, study_truth *out) {
    int run[STUDY_RUNS];
    const int n = family(t, form, run);
    *out = (study_truth){0};
    if (n < 2) return false;
    /* Two nearly equal sizes would amplify the difference of their results. */
    int partner = n - 2;
    while (partner > 0 && size_of(&t->run[run[partner]]) < 1.3 * size_of(&t->run[run[n - 1]])) partner--;
    out->coarse = run[partner], out->fine = run[n - 1], out->order = 1.5;
    if (n > 2) out->order_observed = observe(t, run + n - 3, &out->order);
    const study_run *c = &t->run[out->coarse], *f = &t->run[out->fine];
    const double w = weight(size_of(c), size_of(f), out->order),
                 spread = fmax(weight(size_of(c), size_of(f), 1) - w, w - weight(size_of(c), size_of(f), 2));
    go_beyond(out, c, f, w);
    out->extrapolated = true;
    out->uncertainty = fabs(spread) * study_distance(c->force_N, f->force_N, forces(f));
    return true;
}

static void free_truth(study_truth *h) {
    free(h->force_N);
    free(h->u_m);
}

/* Without two meshes, uses the smaller step; the mesh's error is then unknown. */
static void fall_back(study *t) {
    int best = 0;
    for (int i = 0; i < t->run_count; i++)
        if (!strcmp(t->run[i].name, "half the step") && usable(&t->run[i])) best = i;
    t->truth = (study_truth){.fine = best, .coarse = best, .uncertainty = NAN};
    go_beyond(&t->truth, &t->run[best], &t->run[best], 0);
}

/* Above this uncertainty the finest run alone is more reliable than an estimate. */
static const double DOUBT = 0.5;

/* Replaces the limit by the finest run; the uncertainty is the distance of the limit at order 1. */
static void read_finest(study *t) {
    study_truth *h = &t->truth;
    const study_run *c = &t->run[h->coarse], *f = &t->run[h->fine];
    h->extrapolated = false;
    go_beyond(h, f, f, 0);
    h->uncertainty = weight(size_of(c), size_of(f), 1) * study_distance(c->force_N, f->force_N, forces(f));
}

static void find_truth(study *t) {
    study_truth form[2];
    bool have[2];
    for (int f = 0; f < 2; f++) have[f] = limit(t, (study_form)f, &form[f]);
    if (!have[0] && !have[1]) {
        fall_back(t);
        return;
    }
    /* The form that changed less so far has less left to change. */
    const int best = !have[0] || (have[1] && form[1].uncertainty < form[0].uncertainty) ? 1 : 0;
    t->truth = form[best];
    if (have[1 - best]) { /* both have the same limit: the distance of their estimates is an uncertainty */
        const double apart = study_distance(form[1 - best].force_N, form[best].force_N,
                                            (size_t)t->truth.frames * (size_t)t->truth.instruments * 3);
        t->truth.uncertainty = fmax(t->truth.uncertainty, 0.5 * apart);
        free_truth(&form[1 - best]);
    }
    if (!(t->truth.uncertainty <= DOUBT)) read_finest(t);
}

static double peak(const double *force, size_t count) {
    double most = 0;
    for (size_t i = 0; i + 2 < count; i += 3)
        most = fmax(most, sqrt(force[i] * force[i] + force[i + 1] * force[i + 1] + force[i + 2] * force[i + 2]));
    return most;
}

/* Compares runs with their own frames against the run with the most, at common frames. */
static void judge_rate(const study *t, study_run *r) {
    const study_run *most = r;
    for (int i = 0; i < t->run_count; i++)
        if (usable(&t->run[i]) && !strcmp(t->run[i].knob, "frame") && t->run[i].frames > most->frames)
            most = &t->run[i];
    const size_t width = (size_t)r->instruments * 3;
    double difference = 0, size = 0;
    for (int k = 1; k <= r->frames; k++) {
        const long other = lround(k * r->frame_s / most->frame_s);
        if (other < 1 || other > most->frames) continue;
        for (size_t c = 0; c < width; c++) {
            const double b = most->force_N[(size_t)(other - 1) * width + c],
                         d = r->force_N[(size_t)(k - 1) * width + c] - b;
            difference += d * d, size += b * b;
        }
    }
    r->force_error = size > 0 ? sqrt(difference / size) : NAN;
    r->peak_change = peak(r->force_N, forces(r)) / peak(t->run[0].force_N, forces(&t->run[0])) - 1;
}

void study_judge(study *t) {
    find_truth(t);
    const study_run *own = &t->run[0];
    for (int i = 0; i < t->run_count; i++) {
        study_run *r = &t->run[i];
        if (!usable(r)) continue;
        if (r->felt_known) { /* as late as with a simulation that needs its complete frame */
            r->force_error = r->felt[1];
            continue;
        }
        if (!strcmp(r->knob, "frame")) {
            judge_rate(t, r);
            continue;
        }
        if (forces(r) != forces(own)) continue;
        const bool physics = !strcmp(r->knob, "drop") || !strcmp(r->knob, "add") || !strcmp(r->knob, "law") ||
                             !strcmp(r->knob, "constant");
        if (!physics) r->force_error = study_distance(r->force_N, t->truth.force_N, forces(r));
        if (!physics && r->points) /* other tissue has another reference solution */
            r->shape_error = study_distance(r->u_m, t->truth.u_m, STUDY_MOMENTS * STUDY_POINTS * 3);
        r->change = study_distance(r->force_N, own->force_N, forces(r));
        r->peak_change = peak(r->force_N, forces(r)) / peak(own->force_N, forces(own)) - 1;
    }
}
