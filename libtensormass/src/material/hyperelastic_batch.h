/* Stress of a batch of tetrahedra under nonlinear laws; a part of hyperelastic_pass.h, in double, and of
 * hyperelastic_single_pass.h, in single. */

#ifdef TM_FLOATS
#define TM_HYPER tm_single_law
#define TM_LAWS tm_single_laws
#else
#define TM_HYPER tm_hyperelastic
#define TM_LAWS tm_law_pack
#endif

INSIDE void TM_NAME(hyper_of)(const TM_HYPER *h, int32_t p, int at, TM_NAME(hyper) * w) {
    const TM_LAWS *law = h->law + p;
    memcpy(&w->mu, h->packs.batch[p].mu_J + at, sizeof(V8));
    memcpy(&w->lambda, h->packs.batch[p].lambda_J + at, sizeof(V8));
    memcpy(&w->dlambda, law->dlambda_J + at, sizeof(V8));
    memcpy(&w->dmu, law->dmu_J + at, sizeof(V8));
    memcpy(&w->beta, law->beta_J + at, sizeof(V8));
    memcpy(&w->I3_max, law->I3_max + at, sizeof(V8));
#pragma GCC unroll 8
    for (int i = 0; i < TM_LAW_CONSTANTS; i++) memcpy(&w->c[i], law->constant[i] + at, sizeof(V8));
#pragma GCC unroll 3
    for (int i = 0; i < 3; i++) memcpy(&w->fibre[i], law->fibre[i] + at, sizeof(V8));
}

/* Stress of a batch with one law, known here so that only its constants are read. */
INSIDE void TM_NAME(own_stress)(const TM_HYPER *h, int32_t p, int at, int64_t law, const V8 H[9], V8 P[9],
                                M8 *outside) {
    TM_NAME(hyper) w;
    TM_NAME(hyper_of)(h, p, at, &w);
    TM_NAME(hyper_stress)(law, &w, H, P, outside);
}

/* Stress of a batch with several laws: evaluates each for all lanes, and keeps it for its own lanes. */
INSIDE void TM_NAME(mixed_stress)(const TM_HYPER *h, int32_t p, int at, const V8 H[9], V8 P[9], M8 *outside) {
    V8 Q[9];
    M8 own = {0}, out;
    TM_NAME(hyper) w;
    TM_NAME(hyper_of)(h, p, at, &w);
    *outside = (M8){0};
    for (int i = 0; i < 9; i++) P[i] = (V8){0};
    for (int64_t law = 0; law < TM_LAW_COUNT; law++) {
        if (!(h->law[p].laws >> law & 1)) continue;
        TM_NAME(hyper_stress)(law, &w, H, Q, &out);
        for (int l = 0; l < TM_WIDTH; l++) own[l] = h->law[p].law[at + l] == law ? -1 : 0;
        for (int i = 0; i < 9; i++) TM_NAME(choose)(&P[i], &own, &Q[i], &P[i]);
        *outside |= out & own;
    }
}

/* Computes the stress of a batch of any laws. */
INSIDE void TM_NAME(batch_stress)(const TM_HYPER *h, int32_t p, int at, const V8 H[9], V8 P[9], M8 *outside) {
#define OWN(NAME, name)                                                                                                \
    case 1u << TM_LAW_##NAME: TM_NAME(own_stress)(h, p, at, TM_LAW_##NAME, H, P, outside); break;
    switch (h->law[p].laws) {
        TM_NONLINEAR_LAWS(OWN)
    default: TM_NAME(mixed_stress)(h, p, at, H, P, outside);
    }
#undef OWN
}
#undef TM_HYPER
#undef TM_LAWS
