/* Corotated tissue with averaged dilatation; a part of corotated_kernel.h. Two passes over all tetrahedra, with the
 * sums over domains between them (nodal_dilatation.c): first rotations and dilatations, then the forces of
 * pressures. */

/* Sums the pressures of its four domains. */
INSIDE void TM_NAME(pressure)(const tm_nodal_dilatation *s, int32_t p, int at, const double *of, V8 *sum) {
    const int32_t *i = s->domain + 4 * (TM_LANES * (int64_t)p + at);
    V8 more;
    TM_NAME(pick)(of, i, 4, sum);
    for (int k = 1; k < 4; k++) {
        TM_NAME(pick)(of, i + k, 4, &more);
        *sum += more;
    }
}

TM_TARGET static void TM_NAME(swell)(const tm_tet_batches *batches, const tm_nodal_dilatation *s, const double *u_m) {
    for (int32_t p = 0; p < batches->count; p++)
        for (int at = 0; at < TM_LANES; at += TM_WIDTH) {
            V8 F[9], R[9], I, grown, straight, quarter;
            M8 there;
            TM_NAME(gradient)(batches, p, at, u_m, F);
            straight = F[0] + F[4] + F[8];
            for (int i = 0; i < 9; i += 4) F[i] += 1.0;
            TM_NAME(polar)(F, R, &I, &grown);
            TM_NAME(active_lanes)(batches, p, at, &there);
            memcpy(&quarter, s->quarter_m3 + TM_LANES * (int64_t)p + at, sizeof quarter);
            grown = (V8)((M8)(quarter * (grown - 3)) & there);
            straight = (V8)((M8)(quarter * straight) & there);
            for (int i = 0; i < 9; i++) memcpy(s->rotation + (9 * (int64_t)p + i) * TM_LANES + at, &R[i], sizeof(V8));
            memcpy(s->dilatation + TM_LANES * (int64_t)p + at, &grown, sizeof grown);
            memcpy(s->linear_dilatation + TM_LANES * (int64_t)p + at, &straight, sizeof straight);
        }
}

TM_TARGET static void TM_NAME(press)(const tm_tet_batches *batches, const tm_nodal_dilatation *s, double *force_N) {
    for (int32_t p = 0; p < batches->count; p++)
        for (int at = 0; at < TM_LANES; at += TM_WIDTH) {
            V8 P[9], pull, drawn, quarter;
            M8 there;
            TM_NAME(pressure)(s, p, at, s->corotated_Pa, &pull);
            TM_NAME(pressure)(s, p, at, s->linear_Pa, &drawn);
            memcpy(&quarter, s->quarter_m3 + TM_LANES * (int64_t)p + at, sizeof quarter);
            pull *= quarter, drawn *= quarter;
            for (int i = 0; i < 9; i++) {
                memcpy(&P[i], s->rotation + (9 * (int64_t)p + i) * TM_LANES + at, sizeof(V8));
                P[i] *= pull;
                if (i % 4 == 0) P[i] -= drawn;
            }
            TM_NAME(active_lanes)(batches, p, at, &there);
            TM_NAME(scatter)(batches, p, at, &there, P, force_N);
        }
}
