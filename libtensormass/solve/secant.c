/* Quick steps for ticks that differ little from the one before: the known matrix, mended by how the residual has
 * answered lately (Anderson's method). One look a step, where Newton's takes one for every Krylov vector; what it
 * learnt serves the next tick too. */
#include "local.h"
#include "local_eval.h"

#include <math.h>
#include <string.h>

static bool knows_all(const tms_local *l) {
    for (int32_t i = 0; i < l->now.count; i++)
        for (int k = 0; k < 3 && !l->tool[l->now.row[i].instrument].given; k++)
            if (l->act_of[l->slot_of[l->now.row[i].vertex[k]]] < 0) return false;
    return true;
}

/* By act from by slot. */
static void pick(const tms_local *l, const double *by_slot, double *by_act) {
    for (int32_t j = 0; j < l->act_count; j++) memcpy(by_act + 3 * j, by_slot + 3 * l->act[j], 24);
}

/* b := b less its part in the span of the changes of r lately, each by as much of its change of f, whose sum goes into
 * f_part. Newest first; a change that says nothing new is left out. */
static void use_pairs(tms_local *l, double *b, double *f_part) {
    const int32_t m = 3 * l->act_count;
    double *q[TMS_PAIRS], *f[TMS_PAIRS];
    int32_t n = 0;
    memset(f_part, 0, 8 * (size_t)m);
    for (int32_t k = 1; k <= l->pair_count; k++) {
        const int32_t at = (l->pair_next + TMS_PAIRS - k) % TMS_PAIRS;
        double *r = l->krylov[n], *df = l->ready[n], size = 0, left = 0;
        pick(l, l->pair_r[at], r);
        pick(l, l->pair_f[at], df);
        for (int32_t j = 0; j < m; j++) r[j] *= tms_local_scale(l, j), size += r[j] * r[j];
        for (int32_t i = 0; i < n; i++) {
            double dot = 0;
            for (int32_t j = 0; j < m; j++) dot += r[j] * q[i][j];
            for (int32_t j = 0; j < m; j++) r[j] -= dot * q[i][j], df[j] -= dot * f[i][j];
        }
        for (int32_t j = 0; j < m; j++) left += r[j] * r[j];
        if (!(left > 1e-8 * size)) continue;
        const double unit = 1 / sqrt(left);
        for (int32_t j = 0; j < m; j++) r[j] *= unit, df[j] *= unit;
        q[n] = r, f[n] = df;
        n++;
    }
    for (int32_t i = 0; i < n; i++) {
        double dot = 0;
        for (int32_t j = 0; j < m; j++) dot += b[j] * tms_local_scale(l, j) * q[i][j];
        for (int32_t j = 0; j < m; j++) b[j] -= dot * q[i][j] / tms_local_scale(l, j), f_part[j] += dot * f[i][j];
    }
}

static void remember(tms_local *l, const double *f_before, const double *r_before) {
    double *df = l->pair_f[l->pair_next], *dr = l->pair_r[l->pair_next];
    for (int32_t i = 0; i < l->use_count; i++)
        for (int c = 0; c < 3; c++) {
            const int32_t d = 3 * l->use[i] + c;
            df[d] = l->f[d] - f_before[d];
            dr[d] = l->r[d] - r_before[d];
        }
    l->pair_next = (l->pair_next + 1) % TMS_PAIRS;
    if (l->pair_count < TMS_PAIRS) l->pair_count++;
}

int32_t tms_local_secant(tms_local *l, double *merit) {
    double *b = l->step, *f_part = l->krylov[TMS_KRYLOV], *f_before = l->keep, *r_before = l->f_spare;
    bool factored = false;
    int32_t steps = 0;
    while (!l->converged && steps < TMS_SECANT_STEPS) {
        if (!factored || !knows_all(l)) {
            if (!tms_local_factor(l, -1)) return steps;
            factored = true;
        }
        const double old = *merit;
        memcpy(f_before, l->f, 24 * (size_t)l->capacity);
        memcpy(r_before, l->r, 24 * (size_t)l->capacity);
        pick(l, l->r, b);
        use_pairs(l, b, f_part);
        tms_lu_solve(l->lu, l->pivot, 3 * l->act_count, b);
        for (int32_t j = 0; j < 3 * l->act_count; j++) l->f[3 * l->act[j / 3] + j % 3] -= b[j] + f_part[j];
        *merit = tms_local_evaluate(l);
        remember(l, f_before, r_before);
        steps++;
        l->converged |= l->nearly;
        if (l->converged) break;
        if (*merit > old) { /* astray: back, and leave it to Newton */
            memcpy(l->f, f_before, 24 * (size_t)l->capacity);
            *merit = tms_local_evaluate(l);
            break;
        }
        if (*merit > 0.8 * old) break; /* stalled */
    }
    return steps;
}
