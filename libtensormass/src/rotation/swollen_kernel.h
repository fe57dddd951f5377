/* Tissue that turns and whose changes of volume are averaged; a part of kernel.h. Two passes over all tetrahedra, with
 * the sums over domains between them (swollen.c): rotations and changes of volume first, then pressures' forces. */

TM_TARGET static void TM_NAME(swell)(const tm_packs *packs, const tm_swollen *s, const double *u_m) {
    for (int32_t p = 0; p < packs->count; p++)
        for (int at = 0; at < TM_LANES; at += TM_WIDTH) {
            V8 H[9], F[9], R[9], I, trace, straight;
            TM_NAME(gradient)(packs, p, at, u_m, H);
            for (int i = 0; i < 9; i++) F[i] = H[i] + (i % 4 ? 0.0 : 1.0);
            TM_NAME(polar)(F, R, &I, &trace);
            trace -= 3;
            straight = H[0] + H[4] + H[8];
            for (int i = 0; i < 9; i++) memcpy(s->turn + (9 * (int64_t)p + i) * TM_LANES + at, &R[i], sizeof(V8));
            memcpy(s->grown + TM_LANES * (int64_t)p + at, &trace, sizeof trace);
            memcpy(s->straight + TM_LANES * (int64_t)p + at, &straight, sizeof straight);
        }
}

TM_TARGET static void TM_NAME(press)(const tm_packs *packs, const tm_swollen *s, double *force_N) {
    for (int32_t p = 0; p < packs->count; p++)
        for (int at = 0; at < TM_LANES; at += TM_WIDTH) {
            V8 P[9], pull, drawn;
            M8 there;
            memcpy(&pull, s->pull_J + TM_LANES * (int64_t)p + at, sizeof pull);
            memcpy(&drawn, s->drawn_J + TM_LANES * (int64_t)p + at, sizeof drawn);
            for (int i = 0; i < 9; i++) {
                memcpy(&P[i], s->turn + (9 * (int64_t)p + i) * TM_LANES + at, sizeof(V8));
                P[i] *= pull;
                if (i % 4 == 0) P[i] -= drawn;
            }
            TM_NAME(living)(packs, p, at, &there);
            TM_NAME(scatter)(packs, p, at, &there, P, force_N);
        }
}
