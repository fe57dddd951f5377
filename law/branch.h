/* The unilateral problem of one set of rows, 0 <= gap + W lambda + depth(lambda) _|_ lambda >= 0, by branches of the
 * skin. Sweeps over rows would need hundreds: the tissue gives way far more than the skin, and neighbouring rows all
 * feel the same tissue. By branches it is a small symmetric positive definite system, and those of the last tick nearly
 * always hold.
 *
 * Who includes it sets LAW_ROWS, and defines law_couple. */
#ifndef LAW_BRANCH_H
#define LAW_BRANCH_H

#include "law/skin.h"
#include "libtensormass/numeric/linear.h"

typedef enum law_branch { LAW_OFF, LAW_SOFT, LAW_HARD, LAW_CAPPED } law_branch;

typedef struct law_problem {
    int32_t rows;
    law_real soft_m, cap_N; /* as far as the skin is soft; most that a row bears */
    law_real gap_m[LAW_ROWS], skin_m_N[LAW_ROWS], lambda_N[LAW_ROWS];
    law_real w[LAW_ROWS][LAW_ROWS]; /* [i]: what a newton in row i does along all rows, m/N */
    int32_t bearing;
    uint8_t bears[LAW_ROWS]; /* rows whose lambda may not be 0: their lines of w are there */
} law_problem;

#define LAW_DEEP LAW(0.7) /* of the deepest gap */

/* Makes p->w[i], if it is not there yet. */
static void law_couple(law_problem *p, int32_t i);

static inline bool law_stands(law_branch b) { return b == LAW_SOFT || b == LAW_HARD; }

/* gap + W lambda + depth(lambda) of row i. */
static LAW_CALL law_real law_row_error(const law_problem *p, int32_t i) {
    law_real error = p->gap_m[i] + law_skin_depth(p->skin_m_N[i], p->soft_m, p->lambda_N[i]);
    for (int32_t k = 0; k < p->bearing; k++) error += p->w[p->bears[k]][i] * p->lambda_N[p->bears[k]];
    return error;
}

static LAW_CALL void law_load(law_problem *p, int32_t i, law_real lambda_N) {
    p->lambda_N[i] = lambda_N;
    p->bears[p->bearing++] = (uint8_t)i;
    law_couple(p, i);
}

/* The multipliers of the rows whose skin is in its soft or hard branch, all at once; those of the others are given. */
static void law_solve_branches(law_problem *p, const law_branch state[LAW_ROWS]) {
    law_real a[LAW_ROWS][LAW_ROWS + 1];
    p->bearing = 0;
    for (int32_t i = 0; i < p->rows; i++) {
        p->lambda_N[i] = LAW(0);
        if (law_stands(state[i])) law_load(p, i, LAW(0));
    }
    const int32_t n = p->bearing;
    for (int32_t i = 0; i < p->rows; i++)
        if (state[i] == LAW_CAPPED) law_load(p, i, p->cap_N);
    for (int32_t r = 0; r < n; r++) {
        const int32_t i = p->bears[r];
        const bool soft = state[i] == LAW_SOFT;
        for (int32_t c = r; c < n; c++) a[r][c] = p->w[i][p->bears[c]];
        a[r][r] += soft ? p->skin_m_N[i] : p->skin_m_N[i] / LAW_SKIN_HARDENING;
        a[r][n] = (soft ? LAW(0) : -law_skin_offset(p->soft_m)) - p->gap_m[i];
        for (int32_t k = n; k < p->bearing; k++) a[r][n] -= p->w[p->bears[k]][i] * p->cap_N;
    }
    law_eliminate(a[0], LAW_ROWS + 1, n);
    for (int32_t r = 0; r < n; r++) p->lambda_N[p->bears[r]] = a[r][n];
}

static law_branch law_next_branch(const law_problem *p, int32_t i, law_branch now) {
    const law_real lambda = p->lambda_N[i];
    if (now == LAW_OFF) return law_row_error(p, i) < LAW(0) ? LAW_SOFT : LAW_OFF;
    if (now == LAW_CAPPED && law_row_error(p, i) > LAW(0)) return LAW_HARD;
    if (!(lambda > LAW(0))) return LAW_OFF;
    if (lambda >= p->cap_N) return LAW_CAPPED;
    return p->skin_m_N[i] * lambda > p->soft_m ? LAW_HARD : LAW_SOFT;
}

/* The first guess, from the multipliers that are in lambda_N. Of rows that bore nothing yet those nearly as deep as the
 * deepest: what these push away is clear of most of the others, and a row that is never taken for bearing is never
 * coupled. One that is missing is taken in by the first solve. */
static void law_first_branches(const law_problem *p, law_branch state[LAW_ROWS]) {
    law_real deepest_m = LAW(0);
    for (int32_t i = 0; i < p->rows; i++) deepest_m = law_min(deepest_m, p->gap_m[i]);
    for (int32_t i = 0; i < p->rows; i++) {
        const law_real lambda = p->lambda_N[i];
        const bool deep = p->gap_m[i] < LAW_DEEP * deepest_m;
        state[i] = p->skin_m_N[i] * lambda > p->soft_m ? LAW_HARD : lambda > LAW(0) || deep ? LAW_SOFT : LAW_OFF;
    }
}

/* True: the branches have settled, within so many solves. */
static bool law_solve(law_problem *p, int32_t solves) {
    law_branch state[LAW_ROWS];
    bool changed = true;
    law_first_branches(p, state);
    for (; solves > 0 && changed; solves--) {
        law_solve_branches(p, state);
        changed = false;
        for (int32_t i = 0; i < p->rows; i++) {
            const law_branch next = law_next_branch(p, i, state[i]);
            changed = changed || next != state[i];
            state[i] = next;
        }
    }
    for (int32_t i = 0; i < p->rows; i++) p->lambda_N[i] = law_clamp(p->lambda_N[i], LAW(0), p->cap_N);
    return !changed;
}

#endif
