/* Corner forces of the listed batches, for a force pass divided among threads; a part of corotated_kernel.h. They are
 * stored by index in the list, and added by tm_corner_forces_add. A bit marks each lane that has any. Also computes the
 * batches' energies. */
TM_TARGET static void TM_NAME(pulls)(const tm_tet_batches *batches, const int32_t *list, int32_t count,
                                     const double *u_m, double *corner_N, uint8_t *who, double *energy_J) {
    for (int32_t n = 0; n < count; n++) {
        who[n] = 0;
        energy_J[n] = 0;
        for (int at = 0; at < TM_LANES; at += TM_WIDTH) {
            TM_NAME(turned) b;
            V8 P[9], f[4][3];
            if (!TM_NAME(turn)(batches, list[n], at, u_m, true, &b)) continue;
            const M8 heavy = b.weight > 0;
            TM_NAME(stress_of)(&b, P);
            TM_NAME(add_energy)(&b, energy_J + n);
            TM_NAME(pull)(batches, list[n], at, P, f);
            for (int i = 0; i < 12; i++)
                memcpy(corner_N + 12 * TM_LANES * (int64_t)n + TM_LANES * i + at, &f[i / 3][i % 3], sizeof(V8));
            for (int l = 0; l < TM_WIDTH; l++) who[n] |= (uint8_t)((heavy[l] & 1) << (at + l));
        }
    }
}
