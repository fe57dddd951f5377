/* Laws in Green's strain E = (F^T F - 1)/2, a part of hyperelastic_kernel.h. St. Venant-Kirchhoff has the transversely
 * isotropic terms of Picinbono, Delingette and Ayache (Graph. Models 65 (2003) 305). Fung's is their exponential; it is
 * Guccione's (J. Biomech. Eng. 113 (1991) 42) where the bulk modulus is separate:
 *     w(E) = mu tr E^2 + dlambda I1 I4 + 2 dmu I5 + beta/2 I4^2,   I1 = tr E, I4 = a.E a, I5 = a.E^2 a,
 *     St. Venant-Kirchhoff: W = w + (1 - c) lambda/2 I1^2 + c lambda/2 (J - 1)^2,
 *     Fung:                 W = C/2 (exp(2 w/C) - 1) + lambda/2 (J - 1)^2.
 * E is the same for F and its mirror image; the term in J resists inversion. */

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

INSIDE void TM_NAME(st_venant_kirchhoff)(const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s, V8 P[9],
                                         M8 *outside) {
    V8 E[9], S[9], J1, unused;
    TM_NAME(green_strain)(H, E);
    TM_NAME(green_stress)(w, E, S, &unused);
    TM_NAME(clamp)(&s->J1, TM_VOLUME_LEAST - 1, TM_VOLUME_MOST - 1, &J1, outside);
    const V8 share = w->c[0], sphere = (1.0 - share) * w->lambda * (E[0] + E[4] + E[8]);
    const V8 pressure = share * w->lambda * J1;
    for (int i = 0; i < 9; i += 4) S[i] += sphere;
    TM_NAME(pull_forward)(H, S, &pressure, s, P);
}

/* c: C times the volume, 1/C per volume, largest exponent; beyond it the exponential is constant. */
INSIDE void TM_NAME(fung)(const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s, V8 P[9], M8 *outside) {
    V8 E[9], S[9], J1, energy, Q, steep;
    TM_NAME(green_strain)(H, E);
    TM_NAME(green_stress)(w, E, S, &energy);
    TM_NAME(clamp)(&s->J1, TM_VOLUME_LEAST - 1, TM_VOLUME_MOST - 1, &J1, outside);
    Q = 2.0 * energy / w->c[0];
    const M8 above = TM_NAME(exceeds)(&Q, &w->c[1]);
    TM_NAME(choose)(&Q, &above, &w->c[1], &Q);
    *outside = *outside | above;
    TM_NAME(exponential)(&Q, &steep);
    const V8 pressure = w->lambda * J1;
    for (int i = 0; i < 9; i++) S[i] *= steep;
    TM_NAME(pull_forward)(H, S, &pressure, s, P);
}

#ifdef TM_ENERGIES
INSIDE double TM_NAME(linear_energy)(const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s, int lane) {
    V8 E[9], S[9], own;
    for (int i = 0; i < 9; i++) E[i] = 0.5 * (H[i] + H[i % 3 * 3 + i / 3]);
    TM_NAME(green_stress)(w, E, S, &own);
    return own[lane] + 0.5 * w->lambda[lane] * s->trace[lane] * s->trace[lane];
}

INSIDE double TM_NAME(green_energy)(const TM_NAME(hyper) * w, const V8 H[9], const TM_NAME(strain) * s, int lane,
                                    bool exponential) {
    V8 E[9], S[9], own;
    TM_NAME(green_strain)(H, E);
    TM_NAME(green_stress)(w, E, S, &own);
    const double share = exponential ? 1 : w->c[0][lane], I1 = E[0][lane] + E[4][lane] + E[8][lane];
    const double J1 = s->J1[lane], c = fmin(fmax(J1, TM_VOLUME_LEAST - 1), TM_VOLUME_MOST - 1);
    const double volume = w->lambda[lane] * (share * c * (J1 - 0.5 * c) + (1 - share) * 0.5 * I1 * I1);
    if (!exponential) return own[lane] + volume;
    const double C = w->c[0][lane], Q = 2 * own[lane] / C, most = fmin(Q, w->c[1][lane]);
    return 0.5 * C * (expm1(most) + exp(most) * (Q - most)) + volume;
}
#endif
