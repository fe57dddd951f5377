/* Solves lambda = reaction(gap + delassus lambda) by Newton's method. The reaction of contact compliance is piecewise
 * linear: once the loaded rows are known, one or two steps find the solution. Before each step, sweeps over single rows
 * find them; each sweep reduces the error. */
#include "hybrid.h"

#include <math.h>

enum { STEPS = 24, PLAIN = 3, SWEEPS = 8 };
static const double SOLVED = 1e-9;      /* relative to the largest displacement by one of the forces */
static const double TOUCHING_M = 1e-13; /* as of the full solve (newton_matrix.c) */

double tms_reuse_gap(const tms_reuse_system *s, int32_t i) {
    double gap = s->gap_m[i];
    for (int32_t j = 0; j < s->count; j++) gap += s->delassus_m_N[i][j] * s->lambda_N[j];
    return gap;
}

/* Computes each row's distance from its law, and the matrix; returns false if all are within tolerance. */
static bool is_off(tms_reuse_system *s) {
    double most = 0, worst = 0;
    for (int32_t i = 0; i < s->count; i++) {
        const double gap = tms_reuse_gap(s, i), own = s->delassus_m_N[i][i] + s->row_compliance_m_N[i],
                     load_N =
                         tm_contact_compliance_reaction(s->row_compliance_m_N[i], s->radius_m[i], gap, 0, s->cap_N),
                     per = gap < 0 && load_N < s->cap_N
                               ? 1 / tm_contact_compliance_slope(s->row_compliance_m_N[i], s->radius_m[i], load_N)
                               : 0;
        s->off_N[i] = s->lambda_N[i] - load_N;
        worst = fmax(worst, own * fabs(s->off_N[i]));
        most = fmax(most, own * fabs(load_N));
        for (int32_t j = 0; j < s->count; j++) s->matrix[i * s->count + j] = per * s->delassus_m_N[i][j] + (i == j);
    }
    return !(worst <= SOLVED * most + TOUCHING_M);
}

static void sweep(tms_reuse_system *s) {
    for (int32_t i = 0; i < s->count; i++) {
        const double own = s->delassus_m_N[i][i], free_gap = tms_reuse_gap(s, i) - own * s->lambda_N[i];
        s->lambda_N[i] =
            tm_contact_compliance_reaction(s->row_compliance_m_N[i], s->radius_m[i], free_gap, own, s->cap_N);
    }
}

bool tms_reuse_solve(tms_reuse_system *s) {
    for (int step = 0; is_off(s); step++) {
        if (step == STEPS || !tms_lu(s->matrix, s->pivot, s->count)) return false;
        tms_lu_solve(s->matrix, s->pivot, s->count, s->off_N);
        for (int32_t i = 0; i < s->count; i++) s->lambda_N[i] = fmin(fmax(s->lambda_N[i] - s->off_N[i], 0), s->cap_N);
        for (int i = 0; step >= PLAIN && i < SWEEPS; i++) sweep(s);
    }
    return true;
}
