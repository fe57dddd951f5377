/* Horn's quartic of a batch in single precision, in H = F - 1: errors are relative to |H|, and those of the sum of
 * second order, tr S - 3 - tr H, to |H|^2. Otherwise the energy near the threshold would be rounding alone. With t =
 * tr S - 3, J = 1 + j and K = cof F - 1, the quartic is
 *     64 (t - tr H) + 12 (t^2 - |H|^2) + a^2 - 8 j t - 32 m - 24 det H - 4 |K|^2 = d,
 * a = x^2 - I - 6, m the sum of the principal minors of H. A part of corotated_kernel.h. */

typedef struct TM_NAME(stretch) {
    V8 G[9], K[9], I, J, d, d_I, d_J, trace; /* F^T F - 1, cof F - 1 */
    V8 t, bent, line, square;                /* t, t - tr H; tr H, |H|^2 */
    V8 rest, j;                              /* terms of the quartic that do not depend on t; J - 1 */
} TM_NAME(stretch);

INSIDE void TM_NAME(measure)(const V8 H[9], TM_NAME(stretch) * s) {
    V8 *G = s->G, *K = s->K, sum, over = {0}, squares[3];
    for (int i = 0; i < 3; i++)
        for (int j = i; j < 3; j++) {
            G[3 * i + j] = H[i] * H[j] + H[3 + i] * H[3 + j] + H[6 + i] * H[6 + j];
            if (i == j) squares[i] = G[4 * i];
            G[3 * i + j] += H[3 * i + j] + H[3 * j + i];
        }
    G[3] = G[1], G[6] = G[2], G[7] = G[5];
    TM_NAME(cofactors)(H, K);
    const V8 minors = K[0] + K[4] + K[8], det = H[0] * K[0] + H[1] * K[1] + H[2] * K[2];
    s->line = H[0] + H[4] + H[8];
    s->square = squares[0] + squares[1] + squares[2];
    for (int i = 0; i < 9; i++) {
        K[i] -= H[i % 3 * 3 + i / 3];
        if (i % 4 == 0) K[i] += s->line;
        over += K[i] * K[i];
    }
    s->j = s->line + minors + det;
    s->J = s->j + 1;
    s->I = 2 * s->line + s->square + 3;
    TM_NAME(parting)(&s->I, &s->J, &s->d, &s->d_I, &s->d_J);
    sum = 12 * s->square + 32 * minors + 24 * det;
    s->rest = sum + 4 * over + s->d;
}

/* Sets t to a number that is not below the root but for rounding. */
INSIDE void TM_NAME(above_root)(TM_NAME(stretch) * s) {
    V8 far = s->d;
    const M8 parted = far > 0;
    s->trace = 3 * s->I;
    TM_NAME(root)(&s->trace);
    if (TM_NAME(any)(&parted)) {
        TM_NAME(root)(&far); /* at sqrt(3 I) + d^(1/4) */
        TM_NAME(root)(&far);
        s->trace += far;
    }
    s->bent = (s->trace - 3) - s->line;
}

/* Goes one step of Newton's iteration on the lanes that are under way: down, or up by rounding alone. */
INSIDE void TM_NAME(approach)(TM_NAME(stretch) * s, M8 *under_way) {
    const V8 t = s->line + s->bent, x = t + 3, a = (6 * t + t * t) - (2 * s->line + s->square), y = a + 6;
    const V8 slope = 4 * (x * y - 2 * s->J), least = TM_SOUND * x * s->I + TM_TINY;
    const V8 p = (64 * s->bent + (12 * t * t - 8 * s->j * t)) + (a * a - s->rest);
    const M8 steep = slope > least;
    V8 over;
    TM_NAME(choose)(&over, &steep, &slope, &least);
    const V8 up = REAL(-1e-6) * x;
    V8 move = p / over;
    const M8 little = move > up;
    TM_NAME(choose)(&move, &little, &move, &up);
    move = (V8)((M8)move & *under_way);
    s->bent -= move;
    *under_way = move > TM_LAST * x;
    s->t = s->line + s->bent;
    s->trace = s->t + 3;
}

/* R := the rotation less the unit tensor: ((10 + f) H - 2 G - 2 H G + (6 + 2 t) K + (f - 4 t - 3 a - t a + 2 j) 1) / D
 * with f = x^2 + I - 12, G = F^T F - 1, and the parts of d. */
INSIDE void TM_NAME(rotation_of)(const TM_NAME(stretch) * s, const V8 H[9], V8 R[9]) {
    const V8 t = s->t, long_way = 6 * t + t * t, short_way = 2 * s->line + s->square, f = long_way + short_way,
             a = long_way - short_way, x = t + 3;
    const V8 denominator = x * (a + 6) - 2 * s->J, least = TM_SOUND * x * s->I + TM_TINY;
    const M8 sound = denominator > least;
    V8 over, HG[9];
    TM_NAME(times)(H, s->G, HG);
    TM_NAME(choose)(&over, &sound, &denominator, &least);
    over = 1 / over;
    const V8 of_F = 0.5 * s->d_I, of_cof = 0.25 * s->d_J, of_H = (f + 10) + of_F, of_K = (2 * t + 6) + of_cof;
    const V8 unit = (f - 4 * t) - (3 * a + t * a - 2 * s->j) + (of_F + of_cof);
    for (int i = 0; i < 9; i++) {
        const V8 sum = of_H * H[i] - 2 * (s->G[i] + HG[i]) + of_K * s->K[i];
        R[i] = (i % 4 ? sum : sum + unit) * over;
    }
}

/* Returns tr S - 3. */
INSIDE V8 TM_NAME(growth)(const TM_NAME(stretch) * s) { return s->t; }
