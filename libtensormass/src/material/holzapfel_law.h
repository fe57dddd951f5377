/* Fibres of Holzapfel, Gasser and Ogden with dispersion (Gasser, Ogden and Holzapfel, J. R. Soc. Interface 3 (2006) 15)
 * in neo-Hookean tissue, a part of hyperelastic_kernel.h:
 *     W = neo-Hooke + k1/(2 k2) (exp(k2 y^2) - 1),   y = kappa (I - 3) + (1 - 3 kappa) (|F a|^2 - 1) where positive,
 * else 0: fibres resist extension only. Beyond y_max their stress continues along its tangent. Two limits, as the
 * exponential alone makes steps short: of all |F|, and of the stretch along the fibres. A shear by 0.4 reaches 1.78 and
 * 1.36 in a block of 12 cells (docs/which-law.md). */

#ifdef TM_LAW_FACTS
#define TM_HOLZAPFEL_STRETCH 1.8
#define TM_HOLZAPFEL_FIBRE_STRETCH 1.45

static void tm_holzapfel_limits(tm_material *m, bool stretch_given) {
    if (!stretch_given) m->stretch_max = TM_HOLZAPFEL_STRETCH;
    if (m->law_constant[3] == 0) m->law_constant[3] = stretch_given ? m->stretch_max : TM_HOLZAPFEL_FIBRE_STRETCH;
}

/* Returns y of the largest stretch along fibres; beyond it their stress continues along its tangent. */
static double tm_holzapfel_limit(const tm_material *m) {
    const double s = m->law_constant[3], kappa = m->law_constant[2];
    return kappa * (s * s + 2 / s - 3) + (1 - 3 * kappa) * (s * s - 1);
}

static tm_status tm_holzapfel_check(const tm_material *m, tm_error *error) {
    const double *c = m->law_constant, y = tm_holzapfel_limit(m);
    if (!(c[1] > 0)) return tm_law_bad(m, "k2", c[1], "k2 > 0", error);
    if (!(c[3] > 1)) return tm_law_bad(m, "fibre_stretch", c[3], "fibre_stretch > 1", error);
    if (!(c[1] * y * y <= TM_EXPONENT_MAX))
        return tm_fail(
            error, TM_ERR_MATERIAL, -1,
            "law %s with k2 = %g: the exponent k2 y^2 = %g at the fibres' largest stretch %g, k2 y^2 <= %g is "
            "violated; lower k2 or fibre_stretch",
            tm_law_name((tm_law_kind)m->law), c[1], c[1] * y * y, c[3], TM_EXPONENT_MAX);
    return TM_OK;
}

static void tm_holzapfel_prepare(const tm_material *m, double volume_m3, double c[TM_LAW_CONSTANTS]) {
    c[0] *= volume_m3, c[3] = tm_holzapfel_limit(m);
}

/* y + 1 = F K:F with K = kappa 1 + (1 - 3 kappa) a a^T <= (1 - 2 kappa) 1, so that the fibres' tangent f'' dy dy + f'
 * d2y is at most (4 f'' (y + 1) + 2 f') (1 - 2 kappa). They pull. */
static void tm_holzapfel_bound(const tm_material *m, double lambda_Pa, const tm_bound_cell *c, tm_bound *b) {
    const double k1 = m->law_constant[0], k2 = m->law_constant[1], kappa = m->law_constant[2];
    const double s2 = c->stretch * c->stretch, more2 = c->R[1] * c->R[1] - s2; /* s2 along the fibre, at most */
    const double y = (1 - 2 * kappa) * s2 + kappa * more2 - 1, inner = fmin(fmax(y, 0), tm_holzapfel_limit(m));
    const double x = k2 * inner * inner, stiff = k1 * tm_exponential(x) * (1 + 2 * x);
    const double pull = k1 * tm_exponential(x) * inner + stiff * (fmax(y, 0) - inner), share = 1 - 2 * kappa;
    tm_neo_hooke_bound(m, lambda_Pa, c, b);
    if (y <= 0) return;
    tm_bound_add(b, c, (4 * stiff * (y + 1) + 2 * pull) * share, 0, 2 * pull * sqrt(share * (y + 1)));
}

static const tm_law_facts tm_holzapfel_facts = {
    .name = "holzapfel",
    .needs_fibre = true,
    .constant = {{"k1", "pressure", NULL, 0, 1e15, 4e3,
                  "stiffness of its fibres, which act only in tension; with `k2`"},
                 {"k2", "none", NULL, 0, 1e6, 0.8, "exponent with which the fibres stiffen"},
                 {"dispersion", "none", "0", 0, 1 / 3.0, 0.1,
                  "kappa, from 0 (all along the fibre) to 1/3 (any direction)"},
                 {"fibre_stretch", "none", "0", 0, TM_STRETCH_MOST, 0,
                  "largest stretch at which the fibres stiffen exponentially, 0: `stretch`, or 1.45 if that is left "
                  "out; beyond it their stress follows its tangent"}},
    .limits = tm_holzapfel_limits,
    .check = tm_holzapfel_check,
    .prepare = tm_holzapfel_prepare,
    .bound = tm_holzapfel_bound};
#else

/* c: k1 times the volume, k2, kappa, y_max. */
INSIDE void TM_NAME(holzapfel)(const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s, V8 P[9],
                               M8 *outside) {
    const V8 *a = w->fibre, share = 1.0 - 3.0 * w->c[2], zero = 0.0 * w->mu;
    V8 g[3], z = zero, inner, steep;
    TM_NAME(neo_hooke)(w, H, s, P, outside);
    for (int i = 0; i < 3; i++) {
        const V8 d = H[3 * i] * a[0] + H[3 * i + 1] * a[1] + H[3 * i + 2] * a[2];
        z += d * (2.0 * a[i] + d);
        g[i] = a[i] + d;
    }
    const V8 y = w->c[2] * s->I3 + share * z;
    const M8 taut = TM_NAME(exceeds)(&y, &zero), above = TM_NAME(exceeds)(&y, &w->c[3]);
    if (!TM_NAME(any)(&taut)) return;
    *outside = *outside | above;
    TM_NAME(choose)(&inner, &above, &w->c[3], &y);
    const V8 exponent = w->c[1] * inner * inner;
    TM_NAME(exponential)(&exponent, &steep);
    V8 pull = w->c[0] * steep * (inner + (1.0 + 2.0 * exponent) * (y - inner));
    TM_NAME(choose)(&pull, &taut, &pull, &zero);
    const V8 even = 2.0 * w->c[2] * pull, along = 2.0 * share * pull;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) P[3 * i + j] += even * H[3 * i + j] + along * g[i] * a[j];
    for (int i = 0; i < 9; i += 4) P[i] += even;
}

#ifdef TM_ENERGIES
INSIDE double TM_NAME(holzapfel_energy)(const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s, int lane) {
    const double k1 = w->c[0][lane], k2 = w->c[1][lane], kappa = w->c[2][lane], most = w->c[3][lane];
    double z = 0;
    for (int i = 0; i < 3; i++) {
        double d = 0;
        for (int j = 0; j < 3; j++) d += H[3 * i + j][lane] * w->fibre[j][lane];
        z += d * (2 * w->fibre[i][lane] + d);
    }
    const double y = fmax(0, kappa * s->I3[lane] + (1 - 3 * kappa) * z), inner = fmin(y, most), x = k2 * inner * inner;
    const double more = y - inner,
                 fibres = k1 / (2 * k2) * expm1(x) + k1 * exp(x) * more * (inner + 0.5 * (1 + 2 * x) * more);
    return TM_NAME(neo_hooke_energy)(w, H, s, lane) + fibres;
}
#endif
#endif
