/* Horn's quartic of a batch in double, in F; a part of corotated_kernel.h. */

/* What the quartic and R follow from. */
typedef struct TM_NAME(stretch) {
    V8 C[9], cof[9], I, II, J, d, d_I, d_J, trace;
} TM_NAME(stretch);

INSIDE void TM_NAME(measure)(const V8 F[9], TM_NAME(stretch) * s) {
    V8 *C = s->C;
    for (int i = 0; i < 3; i++)
        for (int j = i; j < 3; j++) C[3 * i + j] = F[i] * F[j] + F[3 + i] * F[3 + j] + F[6 + i] * F[6 + j];
    C[3] = C[1], C[6] = C[2], C[7] = C[5];
    s->I = C[0] + C[4] + C[8];
    TM_NAME(cofactors)(F, s->cof);
    s->J = F[0] * s->cof[0] + F[1] * s->cof[1] + F[2] * s->cof[2];
    s->II = (V8){0};
    for (int i = 0; i < 9; i++) s->II += s->cof[i] * s->cof[i];
    TM_NAME(parting)(&s->I, &s->J, &s->d, &s->d_I, &s->d_J);
}

/* Sets the trace to a number that is not below the root; from there on the quartic rises. */
INSIDE void TM_NAME(above_root)(TM_NAME(stretch) * s) {
    V8 far = s->d;
    const M8 parted = far > 0;
    s->trace = 3 * s->I;
    TM_NAME(root)(&s->trace);
    if (!TM_NAME(any)(&parted)) return;
    TM_NAME(root)(&far); /* at sqrt(3 I) + d^(1/4) */
    TM_NAME(root)(&far);
    s->trace += far;
}

/* Goes one step of Newton's iteration on the lanes that are under way. */
INSIDE void TM_NAME(approach)(TM_NAME(stretch) * s, M8 *under_way) {
    const V8 x = s->trace, y = x * x - s->I, slope = 4 * (x * y - 2 * s->J), least = TM_SOUND * x * s->I + TM_TINY;
    const M8 steep = slope > least;
    V8 over;
    TM_NAME(choose)(&over, &steep, &slope, &least);
    V8 move = (y * y - 8 * s->J * x - 4 * s->II - s->d) / over;
    move = (V8)((M8)move & (move > 0) & *under_way); /* from above only; other signs are rounding */
    s->trace = x - move;
    *under_way = move > TM_LAST * s->trace;
}

INSIDE void TM_NAME(rotation_of)(const TM_NAME(stretch) * s, const V8 F[9], V8 R[9]) {
    const V8 x = s->trace, denominator = x * (x * x - s->I) - 2 * s->J, least = TM_SOUND * x * s->I + TM_TINY;
    const M8 sound = denominator > least;
    V8 over, FC[9];
    TM_NAME(times)(F, s->C, FC);
    TM_NAME(choose)(&over, &sound, &denominator, &least);
    over = 1 / over;
    const V8 of_F = (x * x + s->I) + 0.5 * s->d_I, of_cof = 2 * x + 0.25 * s->d_J;
    for (int i = 0; i < 9; i++) R[i] = (of_F * F[i] - 2 * FC[i] + of_cof * s->cof[i]) * over;
}

/* Returns tr S - 3. */
INSIDE V8 TM_NAME(growth)(const TM_NAME(stretch) * s) { return s->trace - 3; }
