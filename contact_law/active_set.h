/* The unilateral problem of one set of rows, 0 <= gap + W lambda + depth(lambda) _|_ lambda >= 0, by branches of the
 * skin. Sweeps over rows would need hundreds: the tissue gives way far more than the skin, and neighbouring rows all
 * feel the same tissue. By branches it is a small symmetric positive definite system, and those of the last tick nearly
 * always hold.
 *
 * Who includes it sets LAW_ROWS, and defines law_couple. */
#ifndef LAW_ACTIVE_SET_H
#define LAW_ACTIVE_SET_H

#include "contact_law/compliance.h"
#include "libtensormass/numeric/linear.h"

typedef enum law_status { LAW_OFF, LAW_SOFT, LAW_HARD, LAW_CAPPED } law_status;

typedef struct law_problem {
    int32_t rows;
    law_real soft_m, cap_N; /* as far as the skin is soft; most that a row bears */
    law_real gap_m[LAW_ROWS], row_compliance_m_N[LAW_ROWS], lambda_N[LAW_ROWS];
    law_real w[LAW_ROWS][LAW_ROWS]; /* [i]: what a newton in row i does along all rows, m/N */
    int32_t loaded_count;
    uint8_t loaded[LAW_ROWS]; /* rows whose lambda may not be 0: their lines of w are there */
} law_problem;

#define LAW_DEEP LAW(0.7) /* of the deepest gap */

/* Makes p->w[i], if it is not there yet. */
static void law_couple(law_problem *p, int32_t i);

static inline bool law_stands(law_status b) { return b == LAW_SOFT || b == LAW_HARD; }

/* gap + W lambda + depth(lambda) of row i. */
static LAW_CALL law_real law_row_error(const law_problem *p, int32_t i) {
    law_real error = p->gap_m[i] + law_compliance_depth(p->row_compliance_m_N[i], p->soft_m, p->lambda_N[i]);
    for (int32_t k = 0; k < p->loaded_count; k++) error += p->w[p->loaded[k]][i] * p->lambda_N[p->loaded[k]];
    return error;
}

static LAW_CALL void law_load(law_problem *p, int32_t i, law_real lambda_N) {
    p->lambda_N[i] = lambda_N;
    p->loaded[p->loaded_count++] = (uint8_t)i;
    law_couple(p, i);
}

/* The multipliers of the rows whose skin is in its soft or hard branch, all at once; those of the others are given. */
static void law_solve_statuses(law_problem *p, const law_status state[LAW_ROWS]) {
    law_real a[LAW_ROWS][LAW_ROWS + 1];
    p->loaded_count = 0;
    for (int32_t i = 0; i < p->rows; i++) {
        p->lambda_N[i] = LAW(0);
        if (law_stands(state[i])) law_load(p, i, LAW(0));
    }
    const int32_t n = p->loaded_count;
    for (int32_t i = 0; i < p->rows; i++)
        if (state[i] == LAW_CAPPED) law_load(p, i, p->cap_N);
    for (int32_t r = 0; r < n; r++) {
        const int32_t i = p->loaded[r];
        const bool soft = state[i] == LAW_SOFT;
        for (int32_t c = r; c < n; c++) a[r][c] = p->w[i][p->loaded[c]];
        a[r][r] += soft ? p->row_compliance_m_N[i] : p->row_compliance_m_N[i] / LAW_COMPLIANCE_HARDENING;
        a[r][n] = (soft ? LAW(0) : -law_compliance_offset(p->soft_m)) - p->gap_m[i];
        for (int32_t k = n; k < p->loaded_count; k++) a[r][n] -= p->w[p->loaded[k]][i] * p->cap_N;
    }
    law_eliminate(a[0], LAW_ROWS + 1, n);
    for (int32_t r = 0; r < n; r++) p->lambda_N[p->loaded[r]] = a[r][n];
}

static law_status law_next_status(const law_problem *p, int32_t i, law_status now) {
    const law_real lambda = p->lambda_N[i];
    if (now == LAW_OFF) return law_row_error(p, i) < LAW(0) ? LAW_SOFT : LAW_OFF;
    if (now == LAW_CAPPED && law_row_error(p, i) > LAW(0)) return LAW_HARD;
    if (!(lambda > LAW(0))) return LAW_OFF;
    if (lambda >= p->cap_N) return LAW_CAPPED;
    return p->row_compliance_m_N[i] * lambda > p->soft_m ? LAW_HARD : LAW_SOFT;
}

/* The first guess, from the multipliers that are in lambda_N. Of rows that bore nothing yet those nearly as deep as the
 * deepest: what these push away is clear of most of the others, and a row that is never taken for bearing is never
 * coupled. One that is missing is taken in by the first solve. */
static void law_first_statuses(const law_problem *p, law_status state[LAW_ROWS]) {
    law_real deepest_m = LAW(0);
    for (int32_t i = 0; i < p->rows; i++) deepest_m = law_min(deepest_m, p->gap_m[i]);
    for (int32_t i = 0; i < p->rows; i++) {
        const law_real lambda = p->lambda_N[i];
        const bool deep = p->gap_m[i] < LAW_DEEP * deepest_m;
        state[i] = p->row_compliance_m_N[i] * lambda > p->soft_m ? LAW_HARD
                   : lambda > LAW(0) || deep                     ? LAW_SOFT
                                                                 : LAW_OFF;
    }
}

/* True: the branches have settled, within so many solves. */
static bool law_solve(law_problem *p, int32_t solves) {
    law_status state[LAW_ROWS];
    bool changed = true;
    law_first_statuses(p, state);
    for (; solves > 0 && changed; solves--) {
        law_solve_statuses(p, state);
        changed = false;
        for (int32_t i = 0; i < p->rows; i++) {
            const law_status next = law_next_status(p, i, state[i]);
            changed = changed || next != state[i];
            state[i] = next;
        }
    }
    for (int32_t i = 0; i < p->rows; i++) p->lambda_N[i] = law_clamp(p->lambda_N[i], LAW(0), p->cap_N);
    return !changed;
}

#endif
