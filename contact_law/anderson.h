/* Rounds: the rows' normals turn with the shape that their forces make. The next forces come from those that the shape
 * was made with and those that the rows made of it, by Anderson's mixing over the last rounds; taking the rows' forces
 * as they are swings or creeps.
 *
 * Who includes it sets LAW_DOFS, ANDERSON_DEPTH (rounds looked back), ANDERSON_FLOOR (a share of the trace, added to
 * the diagonal), ANDERSON_NOISE (square of the share of the forces below which a change is rounding), and LAW_ANDERSON,
 * a struct with the members next (slot), residual_change_N and step_N [ANDERSON_DEPTH][LAW_DOFS], zero where nothing is
 * remembered. */
#ifndef LAW_ANDERSON_H
#define LAW_ANDERSON_H

#include "libtensormass/numeric/linear.h"

typedef struct law_anderson_iterate {
    law_real residual_N[LAW_DOFS];                                /* what the rows make of the shape, less its forces */
    law_real previous_N[LAW_DOFS], previous_residual_N[LAW_DOFS]; /* forces and residual of the round before */
} law_anderson_iterate;

static LAW_CALL law_real law_inner(const law_real *a, const law_real *b, int32_t n) {
    law_real sum = LAW(0);
    for (; n > 0; n--) sum += *a++ * *b++;
    return sum;
}

/* What the last two rounds say of how the residual follows the forces. Where it grows with them, the rows themselves
 * have changed: a step to where it would vanish leads the wrong way, and far. So it does where both are rounding. */
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

/* mix[i][ANDERSON_DEPTH] := the combination of the remembered changes of the residual that is nearest to it. */
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

/* r->residual_N is of this round; force_N becomes the next. Returns how much of it changed: a ratio of squares. */
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
