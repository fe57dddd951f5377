/* The unilateral problem by active set (contact_law/active_set.h), for a tool that is already deep in the tissue.
 * The solution equals that of sweeps over the rows; only rows with load, or nearly, are coupled. */
#include <math.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>

#include <setjmp.h>

#include <cmocka.h>

#define LAW_REAL float
enum { LAW_ROWS = 16, SOLVES = 4, SWEEPS = 20000 };
#include "contact_law/active_set.h"

static const float WIDE_M = 0.006f, GIVES_M_N = 0.003f, APART_M = 0.0025f;
static int coupled;
static uint32_t there; /* one bit per row */

static float apart_m(int32_t i, int32_t j) {
    const float x = (float)(i % 4 - j % 4), y = (float)(i / 4 - j / 4);
    return APART_M * sqrtf(x * x + y * y);
}

static void law_couple(law_problem *p, int32_t i) {
    if ((there >> i & 1u) != 0) return;
    there |= 1u << i;
    coupled++;
    for (int32_t j = 0; j < p->rows; j++) p->w[i][j] = GIVES_M_N * expf(-apart_m(i, j) / WIDE_M);
}

/* Makes four by four rows of soft tissue under a tip that has sunk in, deepest at row `under`; depth falls with
 * distance. */
static law_problem sunk(int32_t under, float deep_m, float radius_m) {
    law_problem p = {.rows = LAW_ROWS, .soft_m = 0.00075f, .cap_N = 8.0f};
    for (int32_t i = 0; i < LAW_ROWS; i++) {
        const float away = apart_m(i, under);
        p.gap_m[i] = away * away / (2.0f * radius_m) - deep_m;
        p.row_compliance_m_N[i] = 0.001f;
    }
    coupled = 0, there = 0;
    return p;
}

static void by_sweeps(law_problem *p) {
    p->loaded_count = p->rows;
    for (int32_t i = 0; i < p->rows; i++) p->loaded[i] = (uint8_t)i, law_couple(p, i);
    for (int k = 0; k < SWEEPS; k++)
        for (int32_t i = 0; i < p->rows; i++) {
            const float free_gap = law_row_error(p, i) -
                                   law_compliance_depth(p->row_compliance_m_N[i], p->soft_m, p->lambda_N[i]) -
                                   p->w[i][i] * p->lambda_N[i];
            p->lambda_N[i] =
                law_compliance_reaction(p->row_compliance_m_N[i], p->soft_m, free_gap, p->w[i][i], p->cap_N);
        }
}

static void test_only_loaded_rows_are_coupled(void **state) {
    (void)state;
    for (int32_t under = 0; under < LAW_ROWS; under++)
        for (int mm = 1; mm <= 4; mm++) {
            law_problem p = sunk(under, 0.001f * (float)mm, 0.0025f * (float)mm);
            int32_t in = 0, bear = 0;
            assert_true(law_solve(&p, SOLVES));
            for (int32_t i = 0; i < LAW_ROWS; i++) {
                in += p.gap_m[i] < 0.0f ? 1 : 0;
                bear += p.lambda_N[i] > 0.0f ? 1 : 0;
            }
            if (coupled > bear + 2)
                fail_msg("row %d, %d mm: %d coupled, %d bear, %d in it", under, mm, coupled, bear, in);
            law_problem all = sunk(under, 0.001f * (float)mm, 0.0025f * (float)mm);
            by_sweeps(&all);
            for (int32_t i = 0; i < LAW_ROWS; i++)
                if (fabsf(p.lambda_N[i] - all.lambda_N[i]) > 1e-3f)
                    fail_msg("row %d, %d mm, row %d: %g N, by sweeps %g", under, mm, i, p.lambda_N[i], all.lambda_N[i]);
        }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_only_loaded_rows_are_coupled)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
