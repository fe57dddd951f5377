/* Tissue that turns and relaxes; a part of kernel.h. Each tetrahedron keeps, for each term of the Prony series, the
 * history h of its strain in its own axes,
 *     E = sym H + weight (U - 1 - sym H),   F = 1 + H = R U with the polar R,
 * where weight is the blend of kernel.h: below the threshold that is the linear strain, far above it Biot's. The packs'
 * law is what the series leaves, and each term adds the energy of E - h by its share of the moduli: tissue that has
 * come to rest, h = E, bears what elastic tissue of the law that is left bears, whatever bounds the law or the history.
 * At given histories the gradient of that energy needs the one of U:  with T = sum_i (shear_i D + volume_i W) (E - h_i)
 *     T:dU = R (T - Y) : dF  with the skew Y of  Y U + U Y = T U - U T  (from U dU + dU U = dC);
 * without Y a history out of line with the strain would turn the tissue by itself. With fibres R is that of least
 * energy, and its own change is left out: a torque by the little that it differs from the polar one.
 *
 * Terms know a change of volume within what the law resists (tension on the volume grows no further than kernel.h says,
 * and as much the other way): relaxed stress must not outweigh the stress that is there. What is crushed forgets, and
 * comes back by the law that is left. */

/* y of (tr U - U) y = z. The matrix is singular where U's two smaller stretches cancel, inside out: its inverse is
 * bounded there. */
INSIDE void TM_NAME(spin)(const V8 U[9], const V8 T[9], V8 Y[9]) {
    V8 TU[9], z[3], y[3];
    TM_NAME(times)(T, U, TU);
    /* U T is its transpose: both are symmetric. */
    z[0] = TU[7] - TU[5], z[1] = TU[2] - TU[6], z[2] = TU[3] - TU[1];
    const V8 a = U[4] + U[8], b = U[0] + U[8], c = U[0] + U[4], d = -U[1], e = -U[2], f = -U[5];
    const V8 c00 = b * c - f * f, c01 = e * f - d * c, c02 = d * f - b * e;
    const V8 c11 = a * c - e * e, c12 = d * e - a * f, c22 = a * b - d * d;
    const V8 det = a * c00 + d * c01 + e * c02, size = U[0] * U[0] + U[4] * U[4] + U[8] * U[8];
    const V8 inverse = det / (det * det + 1e-4 * size * size * size);
    y[0] = (c00 * z[0] + c01 * z[1] + c02 * z[2]) * inverse;
    y[1] = (c01 * z[0] + c11 * z[1] + c12 * z[2]) * inverse;
    y[2] = (c02 * z[0] + c12 * z[1] + c22 * z[2]) * inverse;
    for (int i = 0; i < 9; i += 4) Y[i] = (V8){0};
    Y[1] = -y[2], Y[2] = y[1], Y[3] = y[2], Y[5] = -y[0], Y[6] = -y[1], Y[7] = y[0];
}

/* The change of volume in E beyond what terms know: by the sudden law, that is by all shares. */
INSIDE void TM_NAME(beyond)(const TM_NAME(law) * w, const tm_viscous *v, const V8 *bulk, const V8 E[9], V8 *beyond) {
    const V8 grown = E[0] + E[4] + E[8], fifth = grown * 0 + 0.2, least = grown * 0 + 1e-300;
    V8 limit, lambda = w->lambda * v->whole + *bulk * v->whole_more;
    const M8 resists = lambda > least;
    TM_NAME(choose)(&lambda, &resists, &lambda, &least);
    limit = 2 * (w->mu * v->whole) / lambda;
    const M8 stiff = limit < fifth;
    TM_NAME(choose)(&limit, &stiff, &fifth, &limit);
    const V8 above = grown - limit, below = grown + limit;
    *beyond = (V8)(((M8)above & (above > 0)) | ((M8)below & (below < 0)));
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

/* T of the pack at the strain E, on which the histories go on. */
INSIDE void TM_NAME(remember)(const TM_NAME(law) * w, bool fibred, const tm_viscous *v, int32_t p, int at,
                              const V8 E[9], V8 T[9]) {
    static const int row[6] = {0, 4, 8, 5, 2, 1};
    const double tiny = 1e-60;
    V8 shear[9], more = {0}, bulk, beyond;
    memcpy(&bulk, v->bulk_J + TM_LANES * (int64_t)p + at, sizeof bulk);
    TM_NAME(beyond)(w, v, &bulk, E, &beyond);
    for (int i = 0; i < 9; i++) shear[i] = (V8){0};
    for (int t = 0; t < v->terms; t++)
        for (int i = 0; i < 6; i++) {
            double *const m = v->memory[t] + (6 * (int64_t)p + i) * TM_LANES + at;
            V8 h, e = E[row[i]];
            if (i < 3) e -= (1.0 / 3) * beyond;
            memcpy(&h, m, sizeof h);
            h += v->now[t] * e;
            shear[row[i]] += v->shear[t] * (e - h);
            if (i < 3) more += v->more[t] * (e - h);
            h = (v->keep[t] * h + v->old[t] * e + tiny) - tiny;
            if (!v->still) memcpy(m, &h, sizeof h);
        }
    shear[7] = shear[5], shear[6] = shear[2], shear[3] = shear[1];
    TM_NAME(linear)(w, fibred, shear, T);
    for (int i = 0; i < 9; i += 4) T[i] += bulk * more;
}

/* 1 down to a third of a tetrahedron's volume, 0 from a twentieth on and inside out, smooth between them. */
INSIDE void TM_NAME(sanity)(const V8 F[9], V8 *share) {
    const V8 J =
        F[0] * (F[4] * F[8] - F[5] * F[7]) + F[1] * (F[5] * F[6] - F[3] * F[8]) + F[2] * (F[3] * F[7] - F[4] * F[6]);
    const V8 one = J * 0 + 1;
    V8 x = (J - 0.05) * (1 / 0.28);
    const M8 whole = x > 1;
    x = (V8)((M8)x & (x > 0));
    TM_NAME(choose)(&x, &whole, &one, &x);
    *share = x * x * (3 - 2 * x);
}

/* With fibres what R's change leaves out grows with the strain: far out, at strains of 2 and more, terms fade. Of a
 * lane that does not turn, or has no fibre, nothing. */
INSIDE void TM_NAME(fade)(const TM_NAME(law) * w, const V8 U[9], const V8 *weight, V8 *share) {
    V8 size = {0};
    for (int i = 0; i < 9; i++) size += (U[i] - (i % 4 ? 0.0 : 1.0)) * (U[i] - (i % 4 ? 0.0 : 1.0));
    const M8 has = (w->dlambda != 0) | (w->dmu != 0) | (w->beta != 0);
    const V8 far = 0.0625 * *weight * size * size;
    *share /= 1 + (V8)((M8)far & has);
}

/* Stress of a slice of a pack: the law's that is left, turned or not, and the terms' (of elastic tissue none), but for
 * changes of volume that are averaged; the polar rotation with it where they are. */
INSIDE bool TM_NAME(relaxing)(const tm_packs *packs, const tm_viscous *v, bool averaged, int32_t p, int at,
                              const double *u, TM_NAME(turned) * b, V8 P[9]) {
    V8 E[9], T[9], U[9], Y[9], M[9], turn[9];
    TM_NAME(law) w;
    TM_NAME(gradient)(packs, p, at, u, b->H);
    const bool turned = TM_NAME(blend)(packs, b->H, &b->weight, &b->slope);
    const bool fibred = TM_NAME(law_of)(packs, p, at, &w);
    if (averaged || turned) TM_NAME(straighten)(b);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) E[3 * i + j] = 0.5 * (b->H[3 * i + j] + b->H[3 * j + i]);
    TM_NAME(linear)(&w, fibred, E, P);
    if (!turned) {
        if (!v->terms) return false;
        TM_NAME(remember)(&w, fibred, v, p, at, E, T);
        for (int i = 0; i < 9; i++) P[i] += T[i];
        return false;
    }
    TM_NAME(turn_law)(&w, fibred, false, b);
    if (!v->terms) {
        for (int i = 0; i < 9; i++) P[i] += b->weight * b->stress[i] + 2 * b->slope * b->energy * b->H[i];
        return true;
    }
    TM_NAME(transposed_times)(b->R, b->F, M);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) U[3 * i + j] = 0.5 * (M[3 * i + j] + M[3 * j + i]);
    V8 change[9], along = {0}, share;
    for (int i = 0; i < 9; i++) change[i] = U[i] - (i % 4 ? 0.0 : 1.0) - E[i];
    TM_NAME(sanity)(b->F, &share);
    for (int i = 0; i < 9; i++) E[i] = share * (E[i] + b->weight * change[i]);
    TM_NAME(remember)(&w, fibred, v, p, at, E, T);
    if (fibred) TM_NAME(fade)(&w, U, &b->weight, &share);
    for (int i = 0; i < 9; i++) T[i] *= share;
    TM_NAME(spin)(U, T, Y);
    for (int i = 0; i < 9; i++) along += T[i] * change[i];
    if (fibred) {
        const M8 polar = (w.dlambda == 0) & (w.dmu == 0) & (w.beta == 0);
        for (int i = 0; i < 9; i++) Y[i] = (V8)((M8)Y[i] & polar);
    }
    for (int i = 0; i < 9; i++) Y[i] = T[i] - Y[i];
    TM_NAME(times)(b->R, Y, turn);
    const V8 steer = 2 * b->slope * (b->energy + along);
    for (int i = 0; i < 9; i++) P[i] += b->weight * (b->stress[i] + (turn[i] - T[i])) + steer * b->H[i] + T[i];
    return true;
}

/* Nothing of those who are dead. */
INSIDE void TM_NAME(keep_corners)(const tm_packs *packs, const tm_viscous *v, int32_t p, int at, const V8 P[9]) {
    V8 f[4][3];
    M8 there;
    double *to = v->corner_N + 12 * TM_LANES * (int64_t)p + at;
    TM_NAME(pull)(packs, p, at, P, f);
    TM_NAME(living)(packs, p, at, &there);
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < 3; i++) {
            f[k][i] = (V8)((M8)f[k][i] & there);
            memcpy(to + TM_LANES * (3 * k + i), &f[k][i], sizeof(V8));
        }
}

TM_TARGET static int32_t TM_NAME(strain_pass)(const tm_packs *packs, const tm_viscous *v, const tm_swollen *s,
                                              int32_t begin, int32_t end, const double *u_m) {
    int32_t active = 0;
    for (int32_t p = begin; p < end; p++) {
        bool any = false;
        for (int at = 0; at < TM_LANES; at += TM_WIDTH) {
            TM_NAME(turned) b;
            V8 P[9], grown;
            M8 there;
            any |= TM_NAME(relaxing)(packs, v, s, p, at, u_m, &b, P);
            if (!s) {
                TM_NAME(keep_corners)(packs, v, p, at, P);
                continue;
            }
            TM_NAME(living)(packs, p, at, &there);
            memcpy(&grown, s->quarter_m3 + TM_LANES * (int64_t)p + at, sizeof grown);
            grown = (V8)((M8)(grown * (b.trace - 3)) & there);
            memcpy(s->grown + TM_LANES * (int64_t)p + at, &grown, sizeof grown);
            for (int i = 0; i < 9; i++) {
                const int64_t to = (9 * (int64_t)p + i) * TM_LANES + at;
                memcpy(s->turn + to, &b.polar[i], sizeof(V8));
                memcpy(v->stress_J + to, &P[i], sizeof(V8));
            }
        }
        active += any;
    }
    return active;
}

TM_TARGET static void TM_NAME(pressure_pass)(const tm_packs *packs, const tm_viscous *v, const tm_swollen *s,
                                             int32_t begin, int32_t end) {
    for (int32_t p = begin; p < end; p++)
        for (int at = 0; at < TM_LANES; at += TM_WIDTH) {
            V8 P[9], R, pressure, quarter;
            TM_NAME(pressure)(s, p, at, s->turned, &pressure);
            memcpy(&quarter, s->quarter_m3 + TM_LANES * (int64_t)p + at, sizeof quarter);
            pressure *= quarter;
            for (int i = 0; i < 9; i++) {
                const int64_t from = (9 * (int64_t)p + i) * TM_LANES + at;
                memcpy(&R, s->turn + from, sizeof R);
                memcpy(&P[i], v->stress_J + from, sizeof(V8));
                P[i] += pressure * R;
            }
            TM_NAME(keep_corners)(packs, v, p, at, P);
        }
}
