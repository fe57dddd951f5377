/* Nonlinear laws, WIDTH lanes at a time: the stress of each law (NAME_law.h), and its continuation beyond the largest
 * stretch. Included once for each instruction set and once for complex numbers, with TM_NAME(x) set. Energies and
 * stresses are times the volume. A law is written in H = grad u, not in F, so that small strains lose no digits.
 *
 * Limits of stretch. No law's tangent is bounded for every F, and a step needs a bound. Beyond |F|^2 = 3 + I3_max the
 * law is evaluated at F scaled back to phi(|F|), which ends at 1 + TM_STRETCH_BAND of the limit. A spring of stiffness
 * kappa = 4/3 mu resists the excess. |F| is rotation-invariant, so rotation generates no energy. Force and energy have
 * no jump there, the tangent has one. */

/* Constants of WIDTH lanes. */
typedef struct TM_NAME(hyper) {
    V8 mu, lambda, dlambda, dmu, beta; /* times volume */
    V8 c[TM_LAW_CONSTANTS], fibre[3];  /* the meaning of `c` depends on the law */
    V8 I3_max;
} TM_NAME(hyper);

/* Strain measures that every law needs. */
typedef struct TM_NAME(strain) {
    V8 trace, I3, J1; /* tr H; |F|^2 - 3; det F - 1 */
    V8 cof[9];        /* cofactors of F, minus the unit tensor */
} TM_NAME(strain);

INSIDE void TM_NAME(clamp)(const V8 *x, double least, double most, V8 *y, M8 *outside) {
    const V8 low = *x * 0 + REAL(least), high = *x * 0 + REAL(most);
    const M8 above = TM_NAME(exceeds)(x, &high), below = TM_NAME(exceeds)(&low, x);
    TM_NAME(choose)(y, &above, &high, x);
    TM_NAME(choose)(y, &below, &low, y);
    *outside = *outside | above | below;
}

INSIDE void TM_NAME(strain_of)(const V8 H[9], TM_NAME(strain) * s) {
    V8 cof[9], square = H[0] * H[0];
    TM_NAME(cofactors)(H, cof);
    for (int i = 1; i < 9; i++) square += H[i] * H[i];
    s->trace = H[0] + H[4] + H[8];
    s->I3 = 2 * s->trace + square;
    s->J1 = s->trace + (cof[0] + cof[4] + cof[8]) + (H[0] * cof[0] + H[1] * cof[1] + H[2] * cof[2]);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) s->cof[3 * i + j] = cof[3 * i + j] - H[3 * j + i];
    for (int i = 0; i < 9; i += 4) s->cof[i] += s->trace;
}

#include "material/green_strain.h"

#include "material/law_files.h"

/* Computes the first Piola stress; `outside`: lanes that continue linearly. */
INSIDE void TM_NAME(stress_of_law)(int64_t law, const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s,
                                   V8 P[9], M8 *outside) {
    switch (law) {
    case TM_LAW_LINEAR: TM_NAME(linear_law)(w, H, P); break;
#define TM_STRESS(NAME, name)                                                                                          \
    case TM_LAW_##NAME: TM_NAME(name)(w, H, s, P, outside); break;
        TM_NONLINEAR_LAWS(TM_STRESS)
#undef TM_STRESS
    default:
        for (int i = 0; i < 9; i++) P[i] = s->I3 * 0;
    }
}

/* phi(t), its derivative, and t - limit, of lanes beyond the limit. */
typedef struct TM_NAME(beyond) {
    V8 scale, slope, excess, N[9]; /* phi/t; N = F/t */
    M8 who;
} TM_NAME(beyond);

INSIDE void TM_NAME(scale_back)(const TM_NAME(hyper) * w, const V8 *I3, V8 H[9], TM_NAME(beyond) * b) {
    V8 t = *I3 + 3.0, limit = w->I3_max + 3.0;
    TM_NAME(root)(&t);
    TM_NAME(root)(&limit);
    const V8 band = REAL(TM_STRETCH_BAND) * limit, x = (t - limit) / band, over = 1.0 / (1.0 + x);
    b->excess = t - limit;
    b->scale = (limit + band * x * over) / t;
    b->slope = over * over;
    for (int i = 0; i < 9; i++) {
        b->N[i] = (H[i] + REAL(i % 4 ? 0.0 : 1.0)) / t;
        const V8 scaled = b->scale * H[i] + REAL(i % 4 ? 0.0 : 1.0) * (b->scale - 1.0);
        TM_NAME(choose)(&H[i], &b->who, &scaled, &H[i]);
    }
}

/* Computes the derivative by F from that by the scaled state, P, and adds the spring's force along N. */
INSIDE void TM_NAME(pull_back)(const TM_NAME(beyond) * b, const V8 *spring, V8 P[9]) {
    V8 along = P[0] * b->N[0];
    for (int i = 1; i < 9; i++) along += P[i] * b->N[i];
    along = (b->slope - b->scale) * along + *spring;
    for (int i = 0; i < 9; i++) {
        const V8 whole = b->scale * P[i] + along * b->N[i];
        TM_NAME(choose)(&P[i], &b->who, &whole, &P[i]);
    }
}

INSIDE void TM_NAME(hyper_stress)(int64_t law, const TM_NAME(hyper) * w, const V8 H[9], V8 P[9], M8 *outside) {
    TM_NAME(strain) s;
    TM_NAME(beyond) b;
    V8 G[9];
    TM_NAME(strain_of)(H, &s);
    b.who = TM_NAME(exceeds)(&s.I3, &w->I3_max);
    *outside = b.who;
    if (!TM_NAME(any)(&b.who)) {
        TM_NAME(stress_of_law)(law, w, H, &s, P, outside);
        return;
    }
    for (int i = 0; i < 9; i++) G[i] = H[i];
    TM_NAME(scale_back)(w, &s.I3, G, &b);
    TM_NAME(strain_of)(G, &s);
    TM_NAME(stress_of_law)(law, w, G, &s, P, outside);
    const V8 spring = REAL(4.0 / 3) * w->mu * b.excess;
    TM_NAME(pull_back)(&b, &spring, P);
}

/* Computes the dilatation J - 1 of the law's state, scaled back beyond the limit of stretch, and its derivative by F.
 * That of linear tissue is tr H. */
INSIDE void TM_NAME(dilatation)(int64_t law, const TM_NAME(hyper) * w, const V8 H[9], V8 *grown, V8 slope[9]) {
    TM_NAME(strain) s;
    TM_NAME(beyond) b;
    V8 G[9];
    TM_NAME(strain_of)(H, &s);
    const V8 zero = 0.0 * s.trace;
    for (int i = 0; i < 9; i++) slope[i] = zero + REAL(i % 4 ? 0.0 : 1.0);
    *grown = s.trace;
    if (law == TM_LAW_LINEAR) return;
    b.who = TM_NAME(exceeds)(&s.I3, &w->I3_max);
    if (!TM_NAME(any)(&b.who)) {
        for (int i = 0; i < 9; i++) slope[i] += s.cof[i];
        *grown = s.J1;
        return;
    }
    for (int i = 0; i < 9; i++) G[i] = H[i];
    TM_NAME(scale_back)(w, &s.I3, G, &b);
    TM_NAME(strain_of)(G, &s);
    for (int i = 0; i < 9; i++) slope[i] += s.cof[i];
    *grown = s.J1;
    TM_NAME(pull_back)(&b, &zero, slope);
}
