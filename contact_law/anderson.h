/* Fixed-point iteration of row forces and row geometry, with Anderson mixing. The normals of the rows rotate with the
 * shape that their forces produce. The next forces combine those of the last iterations and those that the rows
 * returned. Plain fixed-point iteration oscillates or converges slowly.
 *
 * The including file sets:
 *   - LAW_DOFS;
 *   - ANDERSON_DEPTH: number of previous iterations used;
 *   - ANDERSON_FLOOR: share of the trace that is added to the diagonal;
 *   - ANDERSON_NOISE: square of the relative force below which a change is rounding;
 *   - LAW_ANDERSON: a struct with next (index), residual_change_N and step_N [ANDERSON_DEPTH][LAW_DOFS], all 0. */
#ifndef LAW_ANDERSON_H
#define LAW_ANDERSON_H

#include "libtensormass/numeric/linear.h"

typedef struct law_anderson_iterate {
    law_real residual_N[LAW_DOFS]; /* forces that the rows return for the shape, minus those that produced it */
    law_real previous_N[LAW_DOFS], previous_residual_N[LAW_DOFS]; /* forces and residual of the previous iteration */
} law_anderson_iterate;

static LAW_CALL law_real law_inner(const law_real *a, const law_real *b, int32_t n) {
    law_real sum = LAW(0);
    for (; n > 0; n--) sum += *a++ * *b++;
    return sum;
}

/* Stores how the residual changed with the forces in the last iteration. If both grew together, the rows themselves
 * have changed: extrapolation to zero residual would go far in the wrong direction. Then, and if both are rounding, it
 * stores zeros. */
static void law_anderson_remember(LAW_ANDERSON *m, const law_anderson_iterate *r, const law_real *force_N, int32_t n) {
    law_real along = ANDERSON_NOISE > LAW(0) ? ANDERSON_NOISE * law_inner(force_N, force_N, n) : LAW(0),
             *change = m->residual_change_N[m->next], *step = m->step_N[m->next];
    for (int32_t i = 0; i < n; i++) {
        change[i] = r->residual_N[i] - r->previous_residual_N[i];
        step[i] = force_N[i] - r->previous_N[i];
        along += change[i] * step[i];
        step[i] += change[i];
    }
    for (int32_t i = 0; i < n && !(along < LAW(0)); i++) change[i] = step[i] = LAW(0);
    m->next = (uint8_t)((m->next + 1) % ANDERSON_DEPTH);
}

/* Computes mix[i][ANDERSON_DEPTH]: the least-squares combination of the stored residual changes. */
static void law_anderson_nearest(const LAW_ANDERSON *m, const law_real *residual_N, int32_t n,
                                 law_real mix[ANDERSON_DEPTH][ANDERSON_DEPTH + 1]) {
    law_real trace = LAW(1e-30);
    for (int32_t i = 0; i < ANDERSON_DEPTH; i++) {
        for (int32_t j = i; j <= ANDERSON_DEPTH; j++)
            mix[i][j] =
                law_inner(m->residual_change_N[i], j < ANDERSON_DEPTH ? m->residual_change_N[j] : residual_N, n);
        trace += mix[i][i];
    }
    for (int32_t i = 0; i < ANDERSON_DEPTH; i++) {
        for (int32_t j = i; j <= ANDERSON_DEPTH; j++) mix[i][j] /= trace;
        mix[i][i] += ANDERSON_FLOOR;
    }
    law_eliminate(mix[0], ANDERSON_DEPTH + 1, ANDERSON_DEPTH);
}

/* Replaces force_N by the forces of the next iteration; r->residual_N is that of this one. Returns the squared relative
 * change. */
static law_real law_anderson_step(LAW_ANDERSON *m, law_anderson_iterate *r, law_real *force_N, int32_t n, bool first) {
    law_real mix[ANDERSON_DEPTH][ANDERSON_DEPTH + 1], moved = LAW(0), size = LAW(1e-30);
    if (!first) law_anderson_remember(m, r, force_N, n);
    law_anderson_nearest(m, r->residual_N, n, mix);
    for (int32_t i = 0; i < n; i++) {
        law_real step = r->residual_N[i];
        r->previous_residual_N[i] = step;
        r->previous_N[i] = force_N[i];
        for (int32_t k = 0; k < ANDERSON_DEPTH; k++) step -= mix[k][ANDERSON_DEPTH] * m->step_N[k][i];
        force_N[i] += step;
        moved += step * step;
        size += force_N[i] * force_N[i];
    }
    return moved / size;
}

#endif
