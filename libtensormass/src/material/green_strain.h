/* Green's strain E = (F^T F - 1)/2 for the laws that are written in it, a part of hyperelastic_kernel.h and
 * law_facts.c: w(E) = mu tr E^2 + dlambda I1 I4 + 2 dmu I5 + beta/2 I4^2,   I1 = tr E, I4 = a.E a, I5 = a.E^2 a. E is
 * the same for F and its mirror image, so that a law needs a term in J to resist inversion. */

#ifdef TM_LAW_FACTS
/* Least and largest eigenvalue of the quadratic form 2 w in Mandel form, without lambda. */
static void tm_green_range(const tm_material *m, double mu, double range[2]) {
    const double c = 2 * m->dlambda_Pa + 4 * m->dmu_Pa + m->beta_Pa,
                 half = sqrt(0.25 * c * c + 2 * m->dlambda_Pa * m->dlambda_Pa);
    range[0] = 2 * mu + fmin(0.5 * c - half, fmin(0, 2 * m->dmu_Pa));
    range[1] = 2 * mu + fmax(0.5 * c + half, fmax(0, 2 * m->dmu_Pa));
}

/* Of the terms in E, with S = dw/dE and X = sym F^T D: d2w along D is S:D^T D + 2 w(X), with |X| <= s |D|, s the
 * largest stretch, and tr X = F:D <= R |D|. P:N = S:F^T F/R = (4 w + tr S)/R. The part of P normal to N is at most s
 * |S|; that of 2 mu F E at most mu R s^2/2, as weights s_i^2/R^2 give the values s_i^2 a deviation of at most half
 * their range. */
typedef struct tm_green_bounds {
    double most, sideways;
    double trace; /* least tr S */
    double range[2];
} tm_green_bounds;

/* Returns k, Pa, of fibres that push less: the law has w - k/2 min(I4, 0)^2, k = s (E_L - E_T), s the share `slack`.
 * It is 0 for isotropic tissue, and for fibres that are softer than what is around them. */
static double tm_loose_fibre_Pa(const tm_material *m, double slack) {
    const double across = m->lambda_Pa + m->mu_Pa, mixed = m->lambda_Pa + m->dlambda_Pa;
    const double along = m->lambda_Pa + 2 * m->mu_Pa + 2 * m->dlambda_Pa + 4 * m->dmu_Pa + m->beta_Pa;
    const double rest = across * along - mixed * mixed;
    if (m->dlambda_Pa == 0 && m->dmu_Pa == 0 && m->beta_Pa == 0) return 0;
    const double E_T = 4 * m->mu_Pa * rest / ((across + m->mu_Pa) * along - mixed * mixed), E_L = rest / across;
    return slack * fmax(E_L - E_T, 0);
}

/* That term's second derivative along D is -k ((a.X a)^2 + I4 |D a|^2), X = sym F^T D: at most k |I4|, |I4| <= 1/2. Its
 * stress -k I4 F a a^T pulls, and has a size of at most k x sqrt(1 - 2 x) < 0.2 k, x = -I4. */
#define TM_LOOSE_SIDEWAYS 0.2
static double tm_loose_most(double loose_Pa, const tm_bound_cell *c) { return loose_Pa * fmin(0.5, c->strain); }

static tm_green_bounds tm_green_bounds_of(const tm_material *m, double lambda, const tm_bound_cell *c) {
    tm_green_bounds g;
    double more[2];
    tm_green_range(m, m->mu_Pa, g.range);
    tm_green_range(m, 0, more);
    const double s2 = c->stretch * c->stretch, R = c->R[1], size = fmax(more[1], -more[0]);
    const double along = fmin(c->e_most, c->strain), push = fmin(0.5, c->strain), any = fmax(along, push);
    const double I1 = fmin(fmax(fabs(c->trace[0]), fabs(c->trace[1])), sqrt(3) * c->strain);
    const double fibres =
        fabs(m->dlambda_Pa) * (any + I1) + 4 * fabs(m->dmu_Pa) * any + fmax(m->beta_Pa * along, -m->beta_Pa * push);
    const double across = m->dlambda_Pa + 2 * m->mu_Pa + 3 * lambda;
    const double fibre = 3 * m->dlambda_Pa + m->beta_Pa + 4 * m->dmu_Pa;
    g.most = 2 * m->mu_Pa * along + fmin(fmax(fibres, 0), size * c->strain) +
             fmax(lambda * c->trace[0], lambda * c->trace[1]) + fmax(lambda, 0) * R * R + g.range[1] * s2;
    g.sideways = 0.5 * m->mu_Pa * R * s2 + c->stretch * size * c->strain;
    g.trace = fmin(across * c->trace[0], across * c->trace[1]) + fmin(fibre * along, -fibre * push);
    return g;
}
#else

/* Computes S = dw/dE, and w. */
INSIDE void TM_NAME(green_stress)(const TM_NAME(hyper) * w, const V8 E[9], V8 S[9], V8 *energy) {
    const V8 *a = w->fibre;
    V8 Ea[3], square = E[0] * E[0];
    for (int i = 1; i < 9; i++) square += E[i] * E[i];
    for (int i = 0; i < 3; i++) Ea[i] = E[3 * i] * a[0] + E[3 * i + 1] * a[1] + E[3 * i + 2] * a[2];
    const V8 I1 = E[0] + E[4] + E[8], I4 = a[0] * Ea[0] + a[1] * Ea[1] + a[2] * Ea[2];
    const V8 I5 = Ea[0] * Ea[0] + Ea[1] * Ea[1] + Ea[2] * Ea[2], along = w->dlambda * I1 + w->beta * I4;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            S[3 * i + j] =
                2.0 * w->mu * E[3 * i + j] + along * a[i] * a[j] + 2.0 * w->dmu * (a[i] * Ea[j] + Ea[i] * a[j]);
    for (int i = 0; i < 9; i += 4) S[i] += w->dlambda * I4;
    *energy = w->mu * square + w->dlambda * I1 * I4 + 2.0 * w->dmu * I5 + 0.5 * w->beta * I4 * I4;
}

/* Subtracts the term of fibres that push less from w and its stress; `loose`: k. */
INSIDE void TM_NAME(loosen_fibres)(const TM_NAME(hyper) * w, const V8 *loose, const V8 E[9], V8 S[9], V8 *energy) {
    const V8 *a = w->fibre, zero = 0.0 * w->mu;
    const M8 loosened = TM_NAME(exceeds)(loose, &zero);
    V8 Ea[3];
    if (!TM_NAME(any)(&loosened)) return;
    for (int i = 0; i < 3; i++) Ea[i] = E[3 * i] * a[0] + E[3 * i + 1] * a[1] + E[3 * i + 2] * a[2];
    const V8 I4 = a[0] * Ea[0] + a[1] * Ea[1] + a[2] * Ea[2], push = *loose * I4, less = *energy - 0.5 * push * I4;
    const V8 least = zero - REAL(1e-30); /* at rest a complex step squared is below 0 */
    const M8 pushed = TM_NAME(exceeds)(&least, &push);
    if (!TM_NAME(any)(&pushed)) return;
    for (int i = 0; i < 9; i++) {
        const V8 pull = S[i] - push * a[i / 3] * a[i % 3];
        TM_NAME(choose)(&S[i], &pushed, &pull, &S[i]);
    }
    TM_NAME(choose)(energy, &pushed, &less, energy);
}

INSIDE void TM_NAME(green_strain)(const V8 H[9], V8 E[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = i; j < 3; j++) {
            const V8 square = H[i] * H[j] + H[3 + i] * H[3 + j] + H[6 + i] * H[6 + j];
            E[3 * j + i] = E[3 * i + j] = 0.5 * (H[3 * i + j] + H[3 * j + i] + square);
        }
}

/* P = F S + pressure cof F. */
INSIDE void TM_NAME(pull_forward)(const V8 H[9], const V8 S[9], const V8 *pressure, const TM_NAME(strain) * s,
                                  V8 P[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            P[3 * i + j] = S[3 * i + j] + H[3 * i] * S[j] + H[3 * i + 1] * S[3 + j] + H[3 * i + 2] * S[6 + j] +
                           *pressure * s->cof[3 * i + j];
    for (int i = 0; i < 9; i += 4) P[i] += *pressure;
}

/* The linear law, for bodies beside others of a nonlinear one: S is its stress if E is the linear strain. */
INSIDE void TM_NAME(linear_law)(const TM_NAME(hyper) * w, const V8 H[9], V8 P[9]) {
    V8 E[9], unused;
    for (int i = 0; i < 9; i++) E[i] = 0.5 * (H[i] + H[i % 3 * 3 + i / 3]);
    TM_NAME(green_stress)(w, E, P, &unused);
    const V8 sphere = w->lambda * (E[0] + E[4] + E[8]);
    for (int i = 0; i < 9; i += 4) P[i] += sphere;
}

#ifdef TM_ENERGIES
INSIDE double TM_NAME(linear_energy)(const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s, int lane) {
    V8 E[9], S[9], own;
    for (int i = 0; i < 9; i++) E[i] = 0.5 * (H[i] + H[i % 3 * 3 + i / 3]);
    TM_NAME(green_stress)(w, E, S, &own);
    return own[lane] + 0.5 * w->lambda[lane] * s->trace[lane] * s->trace[lane];
}
#endif
#endif
