/* Fung's exponential of the linear law in Green's strain, a part of hyperelastic_kernel.h; Guccione's law (J. Biomech.
 * Eng. 113 (1991) 42) where the bulk modulus is separate:
 *     W = C/2 (exp(2 w/C) - 1) + lambda/2 (J - 1)^2,   w that of green_strain.h, less k/2 min(I4, 0)^2 with `slack`.
 * Pressure as in neo_hooke_law.h. */

#ifdef TM_LAW_FACTS
/* Returns 2 w/C at the limit of uniaxial stretch along the fibre; beyond it the exponential is constant. */
static double tm_fung_limit(const tm_material *m) {
    const double s = m->stretch_max, along = 0.5 * (s * s - 1), across = 0.5 * (1 / s - 1), I1 = along + 2 * across;
    const double w = m->mu_Pa * (along * along + 2 * across * across) + m->dlambda_Pa * I1 * along +
                     (2 * m->dmu_Pa + 0.5 * m->beta_Pa) * along * along;
    return 2 * w / m->law_constant[0];
}

static tm_status tm_fung_check(const tm_material *m, tm_error *error) {
    const double C = m->law_constant[0];
    if (!(C > 0)) return tm_law_bad(m, "C", C, "C > 0", error);
    if (!(m->lambda_Pa > 0)) return tm_law_bad(m, "lambda", m->lambda_Pa, "lambda > 0", error);
    const double loose = tm_loose_fibre_Pa(m, m->law_constant[1]);
    const double along = 2 * m->mu_Pa + 2 * m->dlambda_Pa + 4 * m->dmu_Pa + m->beta_Pa - loose;
    if (!(along > 0 && m->mu_Pa * along > m->dlambda_Pa * m->dlambda_Pa))
        return tm_fail(
            error, TM_ERR_MATERIAL, -1,
            "law %s: its exponent is not positive for every strain, mu_T (2 mu_T + 2 dlambda + 4 dmu + beta - slack "
            "(E_L - E_T)) > dlambda^2 is violated: %g > %g; raise beta or mu_L, lower slack, or bring lambda_L nearer "
            "to lambda_T",
            tm_law_name((tm_law_kind)m->law), m->mu_Pa * along, m->dlambda_Pa * m->dlambda_Pa);
    const double exponent = tm_fung_limit(m);
    if (!(exponent > 0)) return tm_law_bad(m, "2 w/C", exponent, "2 w/C > 0 under tension along the fibre", error);
    if (!(exponent <= TM_EXPONENT_MAX))
        return tm_fail(
            error, TM_ERR_MATERIAL, -1,
            "law %s with C = %g Pa: the exponent 2 w/C = %g at the largest stretch %g, 2 w/C <= %g is violated; "
            "raise C or lower the stretch",
            tm_law_name((tm_law_kind)m->law), C, exponent, m->stretch_max, TM_EXPONENT_MAX);
    return TM_OK;
}

static void tm_fung_prepare(const tm_material *m, double volume_m3, double c[TM_LAW_CONSTANTS]) {
    c[0] *= volume_m3, c[1] = tm_fung_limit(m), c[2] = 2 / c[0];
    c[3] = volume_m3 * tm_loose_fibre_Pa(m, m->law_constant[1]);
}

/* d2W = e^Q (d2w + 2/C P_w P_w^T), |P_w| <= s |S|, |S|^2 <= 2 c w = c C Q, c the largest eigenvalue; beyond the largest
 * Q e^Q d2w alone. Below it |E|^2 <= C Q over the least eigenvalue, which `slack` lowers. tr S < 0 pushes only where
 * 4 w < -tr S; `slack` adds to tr S. */
static void tm_fung_bound(const tm_material *m, double lambda_Pa, const tm_bound_cell *c, tm_bound *b) {
    const double C = m->law_constant[0], limit = tm_fung_limit(m);
    const double loose = tm_loose_fibre_Pa(m, m->law_constant[1]);
    const tm_green_bounds g = tm_green_bounds_of(m, 0, c);
    tm_material loosened = *m;
    double range[2];
    loosened.beta_Pa -= loose;
    tm_green_range(&loosened, m->mu_Pa, range);
    const double Q = fmin(limit, g.range[1] * c->strain * c->strain / C), steep = tm_exponential(Q);
    tm_bound_cell below = *c;
    below.strain = fmin(c->strain, sqrt(C * Q / range[0]));
    below.stretch = fmin(c->stretch, sqrt(1 + 2 * below.strain));
    below.e_most = fmin(c->e_most, below.strain);
    const tm_green_bounds h = tm_green_bounds_of(m, 0, &below);
    double most = steep * (h.most + tm_loose_most(loose, &below) + 2 * below.stretch * below.stretch * g.range[1] * Q);
    double sideways = steep * fmin(h.sideways + TM_LOOSE_SIDEWAYS * loose, below.stretch * sqrt(g.range[1] * C * Q));
    if (Q == limit) {
        most = fmax(most, steep * (g.most + tm_loose_most(loose, c)));
        sideways = fmax(sideways, steep * (g.sideways + TM_LOOSE_SIDEWAYS * loose));
    }
    const double pull = g.trace < 0 ? g.trace * tm_exponential(fmin(Q, -0.5 * g.trace / C)) : 0;
    tm_bound_add(b, c, most, pull / c->R[0], sideways);
    b->bulk_Pa = lambda_Pa, b->offset_Pa = 0;
}

static const tm_law_facts tm_fung_facts = {
    .name = "fung",
    .has_fibres = true,
    .constant = {{"C", "pressure", NULL, 0, 1e15, 10e3,
                  "W = C/2 (exp(2 w/C) - 1), w the linear law in Green's strain; a smaller C stiffens at smaller "
                  "strains"},
                 {"slack", "none", "0", 0, 1, 0.6,
                  "share of the fibres' additional Young's modulus that does not act in compression; stiff fibres "
                  "that push kink"}},
    .check = tm_fung_check,
    .prepare = tm_fung_prepare,
    .bound = tm_fung_bound};
#else

/* c: C times the volume, largest exponent, 2/C per volume, k times the volume; beyond the exponent the exponential is
 * constant. */
INSIDE void TM_NAME(fung)(const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s, V8 P[9], M8 *outside) {
    V8 E[9], S[9], J1, energy, Q, steep;
    TM_NAME(green_strain)(H, E);
    TM_NAME(green_stress)(w, E, S, &energy);
    TM_NAME(loosen_fibres)(w, &w->c[3], E, S, &energy);
    TM_NAME(clamp)(&s->J1, TM_VOLUME_LEAST - 1, TM_VOLUME_MOST - 1, &J1, outside);
    Q = w->c[2] * energy;
    const M8 above = TM_NAME(exceeds)(&Q, &w->c[1]);
    TM_NAME(choose)(&Q, &above, &w->c[1], &Q);
    *outside = *outside | above;
    TM_NAME(exponential)(&Q, &steep);
    const V8 pressure = w->lambda * J1;
    for (int i = 0; i < 9; i++) S[i] *= steep;
    TM_NAME(pull_forward)(H, S, &pressure, s, P);
}

#ifdef TM_ENERGIES
INSIDE double TM_NAME(fung_energy)(const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s, int lane) {
    V8 E[9], S[9], own;
    TM_NAME(green_strain)(H, E);
    TM_NAME(green_stress)(w, E, S, &own);
    TM_NAME(loosen_fibres)(w, &w->c[3], E, S, &own);
    const double J1 = s->J1[lane], c = fmin(fmax(J1, TM_VOLUME_LEAST - 1), TM_VOLUME_MOST - 1);
    const double C = w->c[0][lane], Q = 2 * own[lane] / C, most = fmin(Q, w->c[1][lane]);
    return 0.5 * C * (expm1(most) + exp(most) * (Q - most)) + w->lambda[lane] * c * (J1 - 0.5 * c);
}
#endif
#endif
