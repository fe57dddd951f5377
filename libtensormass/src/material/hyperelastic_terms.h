/* A Prony series of nonlinear laws, a part of hyperelastic_pass.h (after Simo, Comput. Methods Appl. Mech. Engrg. 60
 * (1987) 153): a term relaxes its share of the second Piola stress S = F^-1 P of the law without its bulk modulus, and
 * of the pressure p = kappa (J - 1),
 *     P = P_law - F sum_i shear_i h_i - (sum_i volume_i q_i) dJ/dF,   time_i h_i' = S - h_i,   time_i q_i' = p - q_i.
 * S and p are rotation-invariant and F h_i has no moment. Under constant strain the stress relaxes by the series at any
 * strain. At given histories the terms' force is the gradient of -sum(shear_i h_i:E + volume_i q_i J). Histories store
 * S only as far as the tetrahedron is not crushed: 1/J has no bound; and S and p up to limits, so that the tangent has
 * a bound on every path (tm_law_history_limits). */

#define TM_CRUSHED 0.2 /* J at which histories store nothing; from TM_VOLUME_LEAST on all */

/* Computes S, from P and H: the symmetric part of cof F^T P/J, which it is. */
INSIDE void TM_NAME(second_piola)(const V8 H[9], const V8 P[9], V8 S[9]) {
    TM_NAME(strain) s;
    V8 cof[9], T[9], x, one;
    TM_NAME(strain_of)(H, &s);
    const V8 J = 1.0 + s.J1;
    one = 0.0 * J + 1.0;
    for (int i = 0; i < 9; i++) cof[i] = s.cof[i] + (i % 4 ? 0.0 : 1.0);
    x = (J - TM_CRUSHED) * (1 / (TM_VOLUME_LEAST - TM_CRUSHED));
    const M8 whole = x > 1, any = x > 0;
    TM_NAME(choose)(&x, &whole, &one, &x);
    x = (V8)((M8)x & any);
    V8 over = x * x * (3.0 - 2.0 * x) / J;
    over = (V8)((M8)over & any);
    TM_NAME(transposed_times)(cof, P, T);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) S[3 * i + j] = 0.5 * over * (T[3 * i + j] + T[3 * j + i]);
}

/* Limits what histories store, so that they add at most a known stiffness (law_bound.c). */
INSIDE void TM_NAME(limit_histories)(const tm_hyperelastic *h, int64_t lane, V8 S[9], V8 *pressure) {
    V8 most, least, size = S[0] * S[0];
    memcpy(&most, h->history_stress_J + lane, sizeof most);
    for (int i = 1; i < 9; i++) size += S[i] * S[i];
    TM_NAME(root)(&size);
    M8 above = TM_NAME(exceeds)(&size, &most);
    if (TM_NAME(any)(&above))
        for (int i = 0; i < 9; i++) {
            const V8 scaled = S[i] * (most / size);
            TM_NAME(choose)(&S[i], &above, &scaled, &S[i]);
        }
    memcpy(&least, h->history_pressure_J[0] + lane, sizeof least);
    memcpy(&most, h->history_pressure_J[1] + lane, sizeof most);
    above = TM_NAME(exceeds)(pressure, &most);
    const M8 below = TM_NAME(exceeds)(&least, pressure);
    TM_NAME(choose)(pressure, &above, &most, pressure);
    TM_NAME(choose)(pressure, &below, &least, pressure);
}

/* Replaces the stress P by that of long-term shares and terms, and advances the histories. grown, slope: the dilatation
 * and its derivative. The linear law takes F = 1. */
INSIDE void TM_NAME(relax_stress)(const tm_hyperelastic *h, const tm_viscous *v, int32_t p, int at, const V8 *grown,
                                  const V8 slope[9], const V8 gradient[9], V8 P[9]) {
    static const int row[6] = {0, 4, 8, 5, 2, 1};
    const double tiny = 1e-60;
    V8 bulk, J1, pressure, stored, H[9], S[9], sum[9], pulled[9], faded = {0};
    M8 linear, unused = {0};
    for (int l = 0; l < TM_WIDTH; l++) linear[l] = h->law[p].law[at + l] == TM_LAW_LINEAR ? -1 : 0;
    memcpy(&bulk, h->bulk_J + TM_LANES * (int64_t)p + at, sizeof bulk);
    TM_NAME(clamp)(grown, TM_VOLUME_LEAST - 1, TM_VOLUME_MOST - 1, &J1, &unused);
    TM_NAME(choose)(&J1, &linear, grown, &J1);
    pressure = bulk * J1;
    for (int i = 0; i < 9; i++) {
        H[i] = (V8)(~linear & (M8)gradient[i]);
        P[i] -= pressure * slope[i];
        sum[i] = (V8){0};
    }
    TM_NAME(second_piola)(H, P, S);
    stored = pressure;
    TM_NAME(limit_histories)(h, TM_LANES * (int64_t)p + at, S, &stored);
    for (int t = 0; t < v->terms; t++)
        for (int i = 0; i < 7; i++) {
            double *const m = i < 6 ? v->history[t] + (6 * (int64_t)p + i) * TM_LANES + at
                                    : v->swelling[t] + TM_LANES * (int64_t)p + at;
            V8 past;
            const V8 now = i < 6 ? S[row[i < 6 ? i : 0]] : stored;
            if (i == 6 && h->averaged) break; /* by domains: tm_nodal_dilatation_average */
            memcpy(&past, m, sizeof past);
            past += v->now[t] * now;
            if (i < 6)
                sum[row[i]] += v->shear[t] * past;
            else
                faded += v->volume[t] * past;
            past = (v->history_kept[t] * past + v->old[t] * now + tiny) - tiny;
            if (!v->history_frozen) memcpy(m, &past, sizeof past);
        }
    sum[7] = sum[5], sum[6] = sum[2], sum[3] = sum[1];
    TM_NAME(times)(H, sum, pulled);
    for (int i = 0; i < 9; i++)
        P[i] = h->shear * P[i] - (sum[i] + pulled[i]) + (h->volume * pressure - faded) * slope[i];
}
