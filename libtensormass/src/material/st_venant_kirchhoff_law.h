/* St. Venant-Kirchhoff with the transversely isotropic terms of Picinbono, Delingette and Ayache (Graph. Models 65
 * (2003) 305), a part of hyperelastic_kernel.h: W = w + (1 - c) lambda/2 I1^2 + c lambda/2 (J - 1)^2 - k/2 min(I4,
 * 0)^2,   k = s (E_L - E_T), w, I1 and I4 those of green_strain.h, c the share `compression`, s the share `slack`:
 * compressed along the fibre, tissue has Young's modulus E_L - s (E_L - E_T). Stiff fibres that push kink when their
 * stress reaches the shear modulus along them (Rosen, in: Fiber Composite Materials, ASM (1965) 37). Pressure as in
 * neo_hooke_law.h. */

#ifdef TM_LAW_FACTS
static void tm_st_venant_kirchhoff_prepare(const tm_material *m, double volume_m3, double c[TM_LAW_CONSTANTS]) {
    c[1] = volume_m3 * tm_loose_fibre_Pa(m, m->law_constant[1]);
}

static void tm_st_venant_kirchhoff_bound(const tm_material *m, double lambda_Pa, const tm_bound_cell *c, tm_bound *b) {
    const double rest = (1 - m->law_constant[0]) * lambda_Pa, I1 = fmax(fabs(c->trace[0]), fabs(c->trace[1]));
    const double loose = tm_loose_fibre_Pa(m, m->law_constant[1]);
    const tm_green_bounds g = tm_green_bounds_of(m, rest, c);
    const double w4 = 2 * fmin(g.range[0], 0) * c->strain * c->strain + 2 * fmin(rest, 0) * I1 * I1;
    const double pull = w4 + g.trace;
    tm_bound_add(b, c, g.most + tm_loose_most(loose, c), pull / c->R[pull > 0], g.sideways + TM_LOOSE_SIDEWAYS * loose);
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

INSIDE void TM_NAME(st_venant_kirchhoff)(const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s, V8 P[9],
                                         M8 *outside) {
    V8 E[9], S[9], J1, unused;
    TM_NAME(green_strain)(H, E);
    TM_NAME(green_stress)(w, E, S, &unused);
    TM_NAME(loosen_fibres)(w, &w->c[1], E, S, &unused);
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
    TM_NAME(loosen_fibres)(w, &w->c[1], E, S, &own);
    const double share = w->c[0][lane], I1 = E[0][lane] + E[4][lane] + E[8][lane];
    const double J1 = s->J1[lane], c = fmin(fmax(J1, TM_VOLUME_LEAST - 1), TM_VOLUME_MOST - 1);
    return own[lane] + w->lambda[lane] * (share * c * (J1 - 0.5 * c) + (1 - share) * 0.5 * I1 * I1);
}
#endif
#endif
