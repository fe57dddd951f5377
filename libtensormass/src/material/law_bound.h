/* Bounds of the tangents of nonlinear laws: what a law states of its own terms, cell by cell of the states allowed
 * (law_bound.c, with the proof). */
#ifndef TM_LAW_BOUND_H
#define TM_LAW_BOUND_H

#include "libtensormass/numeric/elementary.h"

#include <math.h>

#include "material/material_field.h"

/* States F = t N, t = |F|, whose law is evaluated at G = phi(t) N: ranges of what bounds need. */
typedef struct tm_bound_cell {
    double R[2];             /* |G|: least and most; where no limit is exceeded both are the most */
    double J[2];             /* det G */
    double stretch, strain;  /* largest principal stretch and Green's strain |E| of G */
    double trace[2], e_most; /* of E: its trace, largest eigenvalue */
    double along, across;    /* largest dphi/dt and phi/t */
    double bend[2], turn[2]; /* -d2phi/dt2 and (phi/t - dphi/dt)/t */
} tm_bound_cell;

/* D.d2W.D <= along a^2 + 2 mixed |a| |b| + across b^2, for D = a N + b M, |M| = 1, M normal to N. */
typedef struct tm_bound {
    double along, across, mixed;
    double bulk_Pa, offset_Pa; /* of the law's U(J): U' = bulk (J - 1), level beyond the volumes allowed, - offset */
} tm_bound;

/* Adds terms whose second derivative by G is at most `most`, whose stress P has P:N >= pull, and a part normal to N of
 * at most `sideways`. */
static inline void tm_bound_add(tm_bound *b, const tm_bound_cell *c, double most, double pull, double sideways) {
    b->along += c->along * c->along * fmax(most, 0) - pull * c->bend[pull < 0];
    b->across += c->across * c->across * fmax(most, 0) - pull * c->turn[pull < 0];
    b->mixed += c->turn[1] * sideways;
}

/* Adds the terms of the material's law, but for U(J), whose constants it sets; lambda in place of the material's
 * (law_facts.h). */
void tm_law_bound_terms(const tm_material *material, double lambda_Pa, const tm_bound_cell *cell, tm_bound *bound);

#endif
