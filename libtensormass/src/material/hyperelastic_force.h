/* The force pass of nonlinear laws; a part of hyperelastic_pass.h and hyperelastic_single_pass.h. Input: TM_BATCHES,
 * the struct of the batches. The forces have the type of the vectors. */

/* Computes corner forces of the batches [begin, end), from corner_N on. Returns how many tetrahedra are beyond a limit.
 */
TM_TARGET static int32_t TM_NAME(hyper_force)(const TM_BATCHES *h, int32_t begin, int32_t end, const double *u_m,
                                              TM_NAME(real) * corner_N) {
    int32_t count = 0;
    for (int32_t p = begin; p < end; p++)
        for (int at = 0; at < TM_LANES; at += TM_WIDTH) {
            V8 H[9], P[9], f[4][3];
            M8 outside;
            TM_NAME(gradient)(&h->packs, p, at, u_m, H);
            TM_NAME(batch_stress)(h, p, at, H, P, &outside);
            TM_NAME(pull)(&h->packs, p, at, P, f);
#pragma GCC unroll 12
            for (int i = 0; i < 12; i++)
                memcpy(corner_N + 12 * TM_LANES * (int64_t)(p - begin) + TM_LANES * i + at, &f[i / 3][i % 3],
                       sizeof(V8));
            if (TM_NAME(any)(&outside))
                for (int l = 0; l < TM_WIDTH; l++) count += outside[l] != 0;
        }
    return count;
}
#undef TM_BATCHES
