/* St. Venant-Kirchhoff with the transversely isotropic terms of Picinbono, Delingette and Ayache (Graph. Models 65
 * (2003) 305), a part of hyperelastic_kernel.h: W = w + (1 - c) lambda/2 I1^2 + c lambda/2 (J - 1)^2 - k/2 min(I4,
 * 0)^2,   k = s (E_L - E_T), w, I1 and I4 those of green_strain.h, c the share `compression`, s the share `slack`:
 * compressed along the fibre, tissue has Young's modulus E_L - s (E_L - E_T). Stiff fibres that push kink when their
 * stress reaches the shear modulus along them (Rosen, in: Fiber Composite Materials, ASM (1965) 37). Pressure as in
 * neo_hooke_law.h. */

#ifdef TM_LAW_FACTS
/* Returns k, Pa: 0 of isotropic tissue, and of fibres that are softer than what is around them. */
static double tm_loose_fibre_Pa(const tm_material *m) {
    const double across = m->lambda_Pa + m->mu_Pa, mixed = m->lambda_Pa + m->dlambda_Pa;
    const double along = m->lambda_Pa + 2 * m->mu_Pa + 2 * m->dlambda_Pa + 4 * m->dmu_Pa + m->beta_Pa;
    const double rest = across * along - mixed * mixed;
    if (m->dlambda_Pa == 0 && m->dmu_Pa == 0 && m->beta_Pa == 0) return 0;
    const double E_T = 4 * m->mu_Pa * rest / ((across + m->mu_Pa) * along - mixed * mixed), E_L = rest / across;
    return m->law_constant[1] * fmax(E_L - E_T, 0);
}

static void tm_st_venant_kirchhoff_prepare(const tm_material *m, double volume_m3, double c[TM_LAW_CONSTANTS]) {
    c[1] = volume_m3 * tm_loose_fibre_Pa(m);
}

/* The last term's second derivative along D is -k ((a.X a)^2 + I4 |D a|^2), X = sym F^T D: at most k |I4|, |I4| <= 1/2.
 * Its stress -k I4 F a a^T pulls, and has a size of at most k x sqrt(1 - 2 x) < 0.2 k, x = -I4. */
static void tm_st_venant_kirchhoff_bound(const tm_material *m, double lambda_Pa, const tm_bound_cell *c, tm_bound *b) {
    const double rest = (1 - m->law_constant[0]) * lambda_Pa, I1 = fmax(fabs(c->trace[0]), fabs(c->trace[1]));
    const double loose = tm_loose_fibre_Pa(m);
    const tm_green_bounds g = tm_green_bounds_of(m, rest, c);
    const double w4 = 2 * fmin(g.range[0], 0) * c->strain * c->strain + 2 * fmin(rest, 0) * I1 * I1;
    const double pull = w4 + g.trace;
    tm_bound_add(b, c, g.most, pull / c->R[pull > 0], g.sideways);
    if (loose > 0) tm_bound_add(b, c, loose * fmin(0.5, c->strain), 0, 0.2 * loose);
    b->bulk_Pa = m->law_constant[0] * lambda_Pa, b->offset_Pa = 0;
}

static const tm_law_facts tm_st_venant_kirchhoff_facts = {
    .name = "st-venant-kirchhoff",
    .has_fibres = true,
    .constant =
        {{"compression", "none", "0.5", 0, 1, 0.5,
          "share of lambda that resists compression, without which pressed tissue collapses"},
         {"slack", "none", "0", 0, 1, 0.6,
          "share of the fibres' additional Young's modulus that does not act in compression; stiff fibres that push kink"}},
    .prepare = tm_st_venant_kirchhoff_prepare,
    .bound = tm_st_venant_kirchhoff_bound};
#else

/* Adds the stress of fibres that push less. */
INSIDE void TM_NAME(loosen_fibres)(const TM_NAME(hyper) * w, const V8 E[9], V8 S[9]) {
    const V8 *a = w->fibre, zero = 0.0 * w->mu;
    V8 Ea[3];
    for (int i = 0; i < 3; i++) Ea[i] = E[3 * i] * a[0] + E[3 * i + 1] * a[1] + E[3 * i + 2] * a[2];
    const V8 I4 = a[0] * Ea[0] + a[1] * Ea[1] + a[2] * Ea[2], push = w->c[1] * I4;
    const V8 least = zero - REAL(1e-30); /* at rest a complex step squared is below 0 */
    const M8 pushed = TM_NAME(exceeds)(&least, &push);
    if (!TM_NAME(any)(&pushed)) return;
    for (int i = 0; i < 9; i++) {
        const V8 less = S[i] - push * a[i / 3] * a[i % 3];
        TM_NAME(choose)(&S[i], &pushed, &less, &S[i]);
    }
}

INSIDE void TM_NAME(st_venant_kirchhoff)(const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s, V8 P[9],
                                         M8 *outside) {
    V8 E[9], S[9], J1, unused;
    TM_NAME(green_strain)(H, E);
    TM_NAME(green_stress)(w, E, S, &unused);
    TM_NAME(loosen_fibres)(w, E, S);
    TM_NAME(clamp)(&s->J1, TM_VOLUME_LEAST - 1, TM_VOLUME_MOST - 1, &J1, outside);
    const V8 share = w->c[0], sphere = (1.0 - share) * w->lambda * (E[0] + E[4] + E[8]);
    const V8 pressure = share * w->lambda * J1;
    for (int i = 0; i < 9; i += 4) S[i] += sphere;
    TM_NAME(pull_forward)(H, S, &pressure, s, P);
}

#ifdef TM_ENERGIES
INSIDE double TM_NAME(st_venant_kirchhoff_energy)(const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s,
                                                  int lane) {
    V8 E[9], S[9], own;
    TM_NAME(green_strain)(H, E);
    TM_NAME(green_stress)(w, E, S, &own);
    const double share = w->c[0][lane], I1 = E[0][lane] + E[4][lane] + E[8][lane];
    const double J1 = s->J1[lane], c = fmin(fmax(J1, TM_VOLUME_LEAST - 1), TM_VOLUME_MOST - 1);
    double I4 = 0;
    for (int i = 0; i < 9; i++) I4 += w->fibre[i / 3][lane] * E[i][lane] * w->fibre[i % 3][lane];
    I4 = fmin(I4, 0);
    return own[lane] + w->lambda[lane] * (share * c * (J1 - 0.5 * c) + (1 - share) * 0.5 * I1 * I1) -
           0.5 * w->c[1][lane] * I4 * I4;
}
#endif
#endif
