/* Rounds: the rows' normals turn with the shape that their forces make. The next forces come from those that the shape
 * was made with and those that the rows made of it, by Anderson's mixing over the last rounds; taking the rows' forces
 * as they are swings or creeps.
 *
 * Who includes it sets LAW_DOFS, LAW_MEMORY (rounds looked back), LAW_MIX_FLOOR (a share of the trace, added to the
 * diagonal), LAW_MIX_NOISE (square of the share of the forces below which a change is rounding), and LAW_MIXING, a
 * struct with the members next (slot), residual_change_N and step_N [LAW_MEMORY][LAW_DOFS], zero where nothing is
 * remembered. */
#ifndef LAW_MIXING_H
#define LAW_MIXING_H

#include "libtensormass/numeric/linear.h"

typedef struct law_round {
    law_real residual_N[LAW_DOFS];                            /* what the rows make of the shape, less its forces */
    law_real before_N[LAW_DOFS], before_residual_N[LAW_DOFS]; /* forces and residual of the round before */
} law_round;

static LAW_CALL law_real law_inner(const law_real *a, const law_real *b, int32_t n) {
    law_real sum = LAW(0);
    for (; n > 0; n--) sum += *a++ * *b++;
    return sum;
}

/* What the last two rounds say of how the residual follows the forces. Where it grows with them, the rows themselves
 * have changed: a step to where it would vanish leads the wrong way, and far. So it does where both are rounding. */
static void law_remember(LAW_MIXING *m, const law_round *r, const law_real *force_N, int32_t n) {
    law_real along = LAW_MIX_NOISE > LAW(0) ? LAW_MIX_NOISE * law_inner(force_N, force_N, n) : LAW(0),
             *change = m->residual_change_N[m->next], *step = m->step_N[m->next];
    for (int32_t i = 0; i < n; i++) {
        change[i] = r->residual_N[i] - r->before_residual_N[i];
        step[i] = force_N[i] - r->before_N[i];
        along += change[i] * step[i];
        step[i] += change[i];
    }
    for (int32_t i = 0; i < n && !(along < LAW(0)); i++) change[i] = step[i] = LAW(0);
    m->next = (uint8_t)((m->next + 1) % LAW_MEMORY);
}

/* mix[i][LAW_MEMORY] := the combination of the remembered changes of the residual that is nearest to it. */
static void law_nearest(const LAW_MIXING *m, const law_real *residual_N, int32_t n,
                        law_real mix[LAW_MEMORY][LAW_MEMORY + 1]) {
    law_real trace = LAW(1e-30);
    for (int32_t i = 0; i < LAW_MEMORY; i++) {
        for (int32_t j = i; j <= LAW_MEMORY; j++)
            mix[i][j] = law_inner(m->residual_change_N[i], j < LAW_MEMORY ? m->residual_change_N[j] : residual_N, n);
        trace += mix[i][i];
    }
    for (int32_t i = 0; i < LAW_MEMORY; i++) {
        for (int32_t j = i; j <= LAW_MEMORY; j++) mix[i][j] /= trace;
        mix[i][i] += LAW_MIX_FLOOR;
    }
    law_eliminate(mix[0], LAW_MEMORY + 1, LAW_MEMORY);
}

/* r->residual_N is of this round; force_N becomes the next. Returns how much of it changed: a ratio of squares. */
static law_real law_take_forces(LAW_MIXING *m, law_round *r, law_real *force_N, int32_t n, bool first) {
    law_real mix[LAW_MEMORY][LAW_MEMORY + 1], moved = LAW(0), size = LAW(1e-30);
    if (!first) law_remember(m, r, force_N, n);
    law_nearest(m, r->residual_N, n, mix);
    for (int32_t i = 0; i < n; i++) {
        law_real step = r->residual_N[i];
        r->before_residual_N[i] = step;
        r->before_N[i] = force_N[i];
        for (int32_t k = 0; k < LAW_MEMORY; k++) step -= mix[k][LAW_MEMORY] * m->step_N[k][i];
        force_N[i] += step;
        moved += step * step;
        size += force_N[i] * force_N[i];
    }
    return moved / size;
}

#endif
