/* Active-set solver of the unilateral problem of a set of rows:
 *   0 <= gap + W lambda + depth(lambda) _|_ lambda >= 0.
 * Gauss-Seidel would need hundreds of sweeps: tissue is far more compliant than the contact compliance, and
 * neighbouring rows are strongly coupled. With known contact statuses it is a small symmetric positive definite system,
 * and the statuses of the last tick are nearly always still valid.
 *
 * The including file sets LAW_ROWS and defines law_couple. */
#ifndef LAW_ACTIVE_SET_H
#define LAW_ACTIVE_SET_H

#include "contact_law/compliance.h"
#include "libtensormass/numeric/linear.h"

typedef enum law_status { LAW_OFF, LAW_SOFT, LAW_HARD, LAW_CAPPED } law_status;

typedef struct law_problem {
    int32_t rows;
    law_real soft_m, cap_N; /* depth up to which the contact compliance is soft; maximum row force */
    law_real gap_m[LAW_ROWS], row_compliance_m_N[LAW_ROWS], lambda_N[LAW_ROWS];
    /* [i]: column of the Delassus matrix: gap changes of all rows per force in row i, m/N */
    law_real w[LAW_ROWS][LAW_ROWS];
    int32_t loaded_count;
    uint8_t loaded[LAW_ROWS]; /* rows whose lambda may be nonzero: their columns of w are computed */
} law_problem;

#define LAW_DEEP LAW(0.7) /* relative to the deepest gap */

/* Computes p->w[i] if it is missing. */
static void law_couple(law_problem *p, int32_t i);

static inline bool law_stands(law_status b) { return b == LAW_SOFT || b == LAW_HARD; }

/* Returns gap + W lambda + depth(lambda) of row i. */
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

/* Solves for the forces of all soft and hard rows at once; the forces of the others are prescribed. */
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

/* Sets the first guess from the forces in lambda_N. Of the unloaded rows, only those nearly as deep as the deepest
 * start as soft. Their forces clear most of the others, and a row that is never loaded need not be coupled. The first
 * solve adds rows that are missing. */
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

/* Solves for the statuses and forces. Returns false if the statuses still change after `solves` iterations. */
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
