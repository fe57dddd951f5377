/* Corner forces of the listed batches, for threads that share vertices; a part of corotated_kernel.h. They are stored
 * by index in the list. A bit marks each lane that has any. Also computes the batches' energies. */
TM_TARGET static void TM_NAME(pulls)(const tm_tet_batches *all, const int32_t *list, int32_t count, const double *u_m,
                                     double *corner_N, uint8_t *who, double *energy_J) {
    const TM_BATCHES *batches = TM_BATCHES_OF(all);
    for (int32_t n = 0; n < count; n += TM_TOGETHER) {
        TM_NAME(turned) b[TM_NAME(SETS)];
        int at[TM_NAME(SETS)];
        const int many = n + TM_TOGETHER <= count ? TM_TOGETHER : 1;
        const int sets = TM_NAME(turn_all)(batches, list + n, many, u_m, true, b, at);
        for (int k = 0; k < many; k++) who[n + k] = 0, energy_J[n + k] = 0;
        for (int c = 0; c < sets; c++) {
            V8 P[9], f[4][3];
            const M8 heavy = b[c].weight > 0;
            const int32_t of = n + TM_PLACE(at[c]);
            const int lane = at[c] % TM_LANES;
            TM_NAME(stress_of)(b + c, P);
            TM_NAME(add_energy)(b + c, energy_J + of);
            TM_NAME(pull)(batches, list[of], lane, P, f);
            for (int i = 0; i < 12; i++)
                TM_NAME(store_wide)(&f[i / 3][i % 3], corner_N + 12 * TM_LANES * (int64_t)of + TM_LANES * i + lane);
            for (int l = 0; l < TM_WIDTH; l++) who[of] |= (uint8_t)((heavy[l] & 1) << (lane + l));
        }
    }
}
