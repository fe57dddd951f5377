/* Corotated tissue that relaxes; a part of corotated_kernel.h. Each tetrahedron stores, for each term of the Prony
 * series, the history h of its strain in its own axes,
 *     E = E2 + weight (U - 1 - E2),   E2 = S + (H^T H - S^2) / 2,   S = sym H,   F = 1 + H = R U
 * with the polar R and the blend of corotated_kernel.h as weight. Far above the threshold it is Biot's strain, below it
 * Biot's to second order. For a rotation by an angle a the linear S has a^2/2 there and E2 only a^4/8, and a history
 * would store it.
 *
 * The batches hold the long-term law, and each term adds the energy of E - h by its share of the moduli. Tissue at
 * equilibrium, h = E, therefore carries the load of elastic tissue with the long-term law, whatever bounds the law or
 * the history. At given histories the gradient of that energy needs the one of U = sym R^T F:
 *     T:dU = (R T + Z) : dF,   T = sum_i (shear_i D + volume_i W) (E - h_i).
 * Z is the contribution of the change of R (turn_change); without Z a history that is not aligned with the strain would
 * rotate the tissue.
 *
 * Terms see a change of volume only within the range that the law resists: tension on the volume is limited as in
 * corotated_kernel.h, and compression likewise. Otherwise relaxed stress could exceed the present stress. Crushed
 * tetrahedra lose their history, and recover by the long-term law. */

/* First and second derivatives of d by I and J. */
typedef struct TM_NAME(bend) {
    V8 d_I, d_J, d_II, d_IJ, d_JJ;
} TM_NAME(bend);
INSIDE void TM_NAME(parting_bends)(const V8 *I, const V8 *J, TM_NAME(bend) * b) {
    const V8 size = (*I + TM_CORRECTION_SIZE) * (1.0 / 3), one = size * 0 + 1;
    V8 root = size, d;
    TM_NAME(root)(&root);
    const V8 scale = 1 / (size * root), j = *J * scale, over = 1 / size;
    const double width = TM_CORRECTION_FROM - TM_CORRECTION_FULL;
    V8 t = (TM_CORRECTION_FROM - j) * (1 / width);
    const M8 near = t > 0, whole = t > 1;
    t = (V8)((M8)t & near);
    TM_NAME(choose)(&t, &whole, &one, &t);
    const V8 share = TM_CORRECTION_MAX * t * t * t * (10 - t * (15 - 6 * t));
    const V8 slope = -30 * TM_CORRECTION_MAX / width * (t * (1 - t)) * (t * (1 - t));
    const V8 bend = 60 * TM_CORRECTION_MAX / (width * width) * (t * (1 - t)) * (1 - 2 * t);
    const V8 j_I = -0.5 * j * over, j_IJ = -0.5 * scale * over, j_II = 5.0 / 12 * j * over * over, s2 = size * size;
    TM_NAME(parting)(I, J, &d, &b->d_I, &b->d_J);
    b->d_II = 2.0 / 9 * share + 4.0 / 3 * size * slope * j_I + s2 * (bend * j_I * j_I + slope * j_II);
    b->d_IJ = 2.0 / 3 * size * slope * scale + s2 * (bend * j_I * scale + slope * j_IJ);
    b->d_JJ = s2 * bend * scale * scale;
}

/* Z = d2x/dF2 : F T, the change with R of the energy of a stress T in R's axes: the gradient of R^T F : T by F is R T +
 * Z. As in corotated_tangent.c. */
INSIDE void TM_NAME(turn_change)(const TM_NAME(turned) * b, const V8 cof[9], const V8 T[9], V8 Z[9]) {
    const V8 *F = b->F, *R = b->R, x = b->trace, I = b->I;
    const V8 J = F[0] * cof[0] + F[1] * cof[1] + F[2] * cof[2];
    V8 G[9], C[9], GC[9], FtG[9], sum[9], bent[9], x1 = {0}, I1 = {0}, J1 = {0};
    TM_NAME(bend) d;
    TM_NAME(parting_bends)(&I, &J, &d);
    TM_NAME(times)(F, T, G);
    TM_NAME(transposed_times)(F, F, C);
    TM_NAME(times)(G, C, GC);
    TM_NAME(transposed_times)(F, G, FtG);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) sum[3 * i + j] = FtG[3 * i + j] + FtG[3 * j + i];
    TM_NAME(times)(F, sum, bent);
    for (int i = 0; i < 9; i++) x1 += R[i] * G[i], I1 += 2 * F[i] * G[i], J1 += cof[i] * G[i];
    const V8 denominator = x * (x * x - I) - 2 * J, least = 1e-9 * x * I + 1e-300;
    const M8 sound = denominator > least;
    V8 over;
    TM_NAME(choose)(&over, &sound, &denominator, &least);
    over = 1 / over;
    const V8 of_F = x * x + I + 0.5 * d.d_I, of_cof = 2 * x + 0.25 * d.d_J;
    const V8 F1 = 2 * x * x1 + I1 + 0.5 * (d.d_II * I1 + d.d_IJ * J1);
    const V8 cof1 = 2 * x1 + 0.25 * (d.d_IJ * I1 + d.d_JJ * J1), D1 = (3 * x * x - I) * x1 - x * I1 - 2 * J1;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int k = 3 * i + j, p = 3 * ((i + 1) % 3), q = 3 * ((i + 2) % 3), c = (j + 1) % 3, e = (j + 2) % 3;
            const V8 change = F[p + c] * G[q + e] + G[p + c] * F[q + e] - F[p + e] * G[q + c] - G[p + e] * F[q + c];
            Z[k] =
                (F1 * F[k] + of_F * G[k] - 2 * (GC[k] + bent[k]) + cof1 * cof[k] + of_cof * change - R[k] * D1) * over;
        }
}

/* Computes the change of volume in E beyond the range of the terms. It is that of the instantaneous law, all shares
 * together. slope: of the part within the range. */
INSIDE void TM_NAME(beyond)(const TM_NAME(law) * w, const tm_viscous *v, const V8 *bulk, const V8 E[9], V8 *beyond,
                            V8 *slope) {
    const V8 grown = E[0] + E[4] + E[8], fifth = grown * 0 + 0.2, least = grown * 0 + 1e-300;
    V8 limit, known, lambda = w->lambda * v->whole + *bulk * v->whole_more;
    const M8 resists = lambda > least;
    TM_NAME(choose)(&lambda, &resists, &lambda, &least);
    limit = 2 * (w->mu * v->whole) / lambda;
    const M8 stiff = limit < fifth;
    TM_NAME(choose)(&limit, &stiff, &fifth, &limit);
    limit *= 2.0 / 3;
    TM_NAME(level)(&grown, &limit, &known, slope);
    *beyond = grown - known;
}

INSIDE void TM_NAME(linear)(const TM_NAME(law) * w, bool fibred, const V8 E[9], V8 T[9]) {
    if (fibred) {
        TM_NAME(stress)(w, E, T);
        return;
    }
    const V8 sphere = w->lambda * (E[0] + E[4] + E[8]);
    for (int i = 0; i < 9; i++) T[i] = 2 * w->mu * E[i];
    for (int i = 0; i < 9; i += 4) T[i] += sphere;
}

/* Computes T of the batch at the strain E, and advances the histories. */
INSIDE void TM_NAME(remember)(const TM_NAME(law) * w, bool fibred, const tm_viscous *v, int32_t p, int at,
                              const V8 E[9], V8 T[9]) {
    static const int row[6] = {0, 4, 8, 5, 2, 1};
    const double tiny = 1e-60;
    V8 shear[9], more = {0}, bulk, beyond, slope;
    memcpy(&bulk, v->bulk_J + TM_LANES * (int64_t)p + at, sizeof bulk);
    TM_NAME(beyond)(w, v, &bulk, E, &beyond, &slope);
    for (int i = 0; i < 9; i++) shear[i] = (V8){0};
    for (int t = 0; t < v->terms; t++)
        for (int i = 0; i < 6; i++) {
            double *const m = v->history[t] + (6 * (int64_t)p + i) * TM_LANES + at;
            V8 h, e = E[row[i]];
            if (i < 3) e -= (1.0 / 3) * beyond;
            memcpy(&h, m, sizeof h);
            h += v->now[t] * e;
            shear[row[i]] += v->shear[t] * (e - h);
            if (i < 3) more += v->more[t] * (e - h);
            h = (v->history_kept[t] * h + v->old[t] * e + tiny) - tiny;
            if (!v->history_frozen) memcpy(m, &h, sizeof h);
        }
    shear[7] = shear[5], shear[6] = shear[2], shear[3] = shear[1];
    TM_NAME(linear)(w, fibred, shear, T);
    for (int i = 0; i < 9; i += 4) T[i] += bulk * more;
    const V8 unknown = (1.0 / 3) * (1 - slope) * (T[0] + T[4] + T[8]);
    for (int i = 0; i < 9; i += 4) T[i] -= unknown;
}

/* 1 down to 0.7 of a tetrahedron's volume, 0 from a fifth on and when inverted, smooth between. The slope contributes
 * to the force, so that at given histories the terms' force is the gradient of their energy. */
INSIDE void TM_NAME(sanity)(const V8 F[9], const V8 cof[9], V8 *share, V8 *slope) {
    const V8 J = F[0] * cof[0] + F[1] * cof[1] + F[2] * cof[2];
    const V8 one = J * 0 + 1;
    V8 x = (J - 0.2) * 2;
    const M8 whole = x > 1;
    x = (V8)((M8)x & (x > 0));
    TM_NAME(choose)(&x, &whole, &one, &x);
    *share = x * x * (3 - 2 * x);
    *slope = 12 * x * (1 - x);
}

/* Fades the terms out at strains of 2 and more, where they would need a shorter step: 1/(1 + (|E|^2 - 0.01)^2/16), half
 * at 2. Exactly 1 below a tenth, so that a lane that is not corotated is independent of the others in its batch. slope:
 * by |E|^2. */
INSIDE void TM_NAME(fade)(const V8 E[9], V8 *share, V8 *slope) {
    V8 size = {0};
    for (int i = 0; i < 9; i++) size += E[i] * E[i];
    size -= 0.01;
    size = (V8)((M8)size & (size > 0));
    *share = 1 / (1 + 0.0625 * size * size);
    *slope = -0.125 * size * *share * *share;
}

/* Computes E2 from the linear strain S. */
INSIDE void TM_NAME(second_order)(const V8 H[9], V8 S[9], V8 E[9]) {
    V8 HtH[9], SS[9];
    TM_NAME(transposed_times)(H, H, HtH);
    TM_NAME(times)(S, S, SS);
    for (int i = 0; i < 9; i++) E[i] = S[i] + 0.5 * (HtH[i] - SS[i]);
}

/* Computes P of the symmetric T at E2, T:dE2 = P:dH with P = T + H T - sym(S T). */
INSIDE void TM_NAME(second_order_stress)(const V8 H[9], const V8 S[9], const V8 T[9], V8 P[9]) {
    V8 HT[9], ST[9];
    TM_NAME(times)(H, T, HT);
    TM_NAME(times)(S, T, ST);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int k = 3 * i + j;
            P[k] = T[k] + (HT[k] - 0.5 * (ST[k] + ST[3 * j + i]));
        }
}

/* P += the law's correction and the terms, of a corotated batch, at the linear strain S. */
INSIDE void TM_NAME(relaxing_turned)(const TM_NAME(law) * w, bool fibred, const tm_viscous *v, int32_t p, int at,
                                     const TM_NAME(turned) * b, V8 S[9], V8 P[9]) {
    V8 M[9], E[9], T[9], Z[9], turn[9], cof[9], change[9], low[9], along = {0}, all = {0}, known[9];
    V8 share, slope, near, bend;
    TM_NAME(second_order)(b->H, S, E);
    TM_NAME(transposed_times)(b->R, b->F, M);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            change[3 * i + j] = 0.5 * (M[3 * i + j] + M[3 * j + i]) - (i == j ? 1.0 : 0.0) - E[3 * i + j];
    TM_NAME(cofactors)(b->F, cof);
    TM_NAME(sanity)(b->F, cof, &share, &slope);
    for (int i = 0; i < 9; i++) E[i] += b->weight * change[i];
    TM_NAME(fade)(E, &near, &bend);
    for (int i = 0; i < 9; i++) known[i] = share * near * E[i];
    TM_NAME(remember)(w, fibred, v, p, at, known, T);
    for (int i = 0; i < 9; i++) all += T[i] * E[i];
    for (int i = 0; i < 9; i++) T[i] = share * (near * T[i] + 2 * bend * all * E[i]);
    TM_NAME(turn_change)(b, cof, T, Z);
    TM_NAME(times)(b->R, T, turn);
    TM_NAME(second_order_stress)(b->H, S, T, low);
    for (int i = 0; i < 9; i++) along += T[i] * change[i];
    const V8 steer = 2 * b->slope * (b->energy + along), crush = slope * near * all;
    for (int i = 0; i < 9; i++)
        P[i] += b->weight * (b->stress[i] + (turn[i] + Z[i] - low[i])) + steer * b->H[i] + low[i] + crush * cof[i];
}

/* Computes the stress of a slice of a batch: long-term law, corotated or not, and terms (elastic tissue: none), without
 * averaged dilatation. Where that is averaged, also computes the polar rotation. */
INSIDE bool TM_NAME(relaxing)(const tm_tet_batches *batches, const tm_viscous *v, bool averaged, int32_t p, int at,
                              const double *u, TM_NAME(turned) * b, V8 P[9]) {
    V8 S[9], E[9], T[9], low[9];
    TM_NAME(law) w;
    TM_NAME(gradient)(batches, p, at, u, b->H);
    const bool turned = TM_NAME(blend)(batches, b->H, &b->weight, &b->slope);
    const bool fibred = TM_NAME(law_of)(batches, p, at, &w);
    if (averaged || turned) TM_NAME(straighten)(b);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) S[3 * i + j] = 0.5 * (b->H[3 * i + j] + b->H[3 * j + i]);
    TM_NAME(linear)(&w, fibred, S, P);
    if (!turned) {
        if (!v->terms) return false;
        TM_NAME(second_order)(b->H, S, E);
        TM_NAME(remember)(&w, fibred, v, p, at, E, T);
        TM_NAME(second_order_stress)(b->H, S, T, low);
        for (int i = 0; i < 9; i++) P[i] += low[i];
        return false;
    }
    TM_NAME(turn_law)(&w, fibred, false, b);
    if (!v->terms) {
        for (int i = 0; i < 9; i++) P[i] += b->weight * b->stress[i] + 2 * b->slope * b->energy * b->H[i];
        return true;
    }
    TM_NAME(relaxing_turned)(&w, fibred, v, p, at, b, S, P);
    return true;
}

/* Stores corner forces, zero for removed tetrahedra. */
INSIDE void TM_NAME(keep_corners)(const tm_tet_batches *batches, const tm_viscous *v, int32_t p, int at,
                                  const V8 P[9]) {
    V8 f[4][3];
    M8 there;
    double *to = v->corner_N + 12 * TM_LANES * (int64_t)p + at;
    TM_NAME(pull)(batches, p, at, P, f);
    TM_NAME(active_lanes)(batches, p, at, &there);
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < 3; i++) {
            f[k][i] = (V8)((M8)f[k][i] & there);
            memcpy(to + TM_LANES * (3 * k + i), &f[k][i], sizeof(V8));
        }
}

TM_TARGET static int32_t TM_NAME(strain_pass)(const tm_tet_batches *batches, const tm_viscous *v,
                                              const tm_nodal_dilatation *s, int32_t begin, int32_t end,
                                              const double *u_m) {
    int32_t active = 0;
    for (int32_t p = begin; p < end; p++) {
        bool any = false;
        for (int at = 0; at < TM_LANES; at += TM_WIDTH) {
            TM_NAME(turned) b;
            V8 P[9], grown;
            M8 there;
            any |= TM_NAME(relaxing)(batches, v, s, p, at, u_m, &b, P);
            if (!s) {
                TM_NAME(keep_corners)(batches, v, p, at, P);
                continue;
            }
            TM_NAME(active_lanes)(batches, p, at, &there);
            memcpy(&grown, s->quarter_m3 + TM_LANES * (int64_t)p + at, sizeof grown);
            grown = (V8)((M8)(grown * (b.trace - 3)) & there);
            memcpy(s->dilatation + TM_LANES * (int64_t)p + at, &grown, sizeof grown);
            for (int i = 0; i < 9; i++) {
                const int64_t to = (9 * (int64_t)p + i) * TM_LANES + at;
                memcpy(s->rotation + to, &b.R[i], sizeof(V8));
                memcpy(v->stress_J + to, &P[i], sizeof(V8));
            }
        }
        active += any;
    }
    return active;
}

TM_TARGET static void TM_NAME(pressure_pass)(const tm_tet_batches *batches, const tm_viscous *v,
                                             const tm_nodal_dilatation *s, int32_t begin, int32_t end) {
    for (int32_t p = begin; p < end; p++)
        for (int at = 0; at < TM_LANES; at += TM_WIDTH) {
            V8 P[9], R, pressure, quarter;
            TM_NAME(pressure)(s, p, at, s->corotated_Pa, &pressure);
            memcpy(&quarter, s->quarter_m3 + TM_LANES * (int64_t)p + at, sizeof quarter);
            pressure *= quarter;
            for (int i = 0; i < 9; i++) {
                const int64_t from = (9 * (int64_t)p + i) * TM_LANES + at;
                memcpy(&R, s->rotation + from, sizeof R);
                memcpy(&P[i], v->stress_J + from, sizeof(V8));
                P[i] += pressure * R;
            }
            TM_NAME(keep_corners)(batches, v, p, at, P);
        }
}
