/* Gradients of batches, and forces on their corners; a part of every kernel over tetrahedra (corotated_kernel.h,
 * hyperelastic_kernel.h). */

INSIDE void TM_NAME(living)(const tm_tet_batches *batches, int32_t p, int at, M8 *there) {
    if (p < batches->count - 1 &&
        !memcmp(batches->alive + TM_LANES * (int64_t)p + at, (char[8]){1, 1, 1, 1, 1, 1, 1, 1}, TM_WIDTH)) {
        *there = (M8){0} == 0;
        return;
    }
    for (int l = 0; l < TM_WIDTH; l++) {
        const int32_t tet = TM_LANES * p + at + l;
        (*there)[l] = tet < batches->tet_count && batches->alive[tet] ? -1 : 0;
    }
}

/* Computes grad u of the batch's active tetrahedra, 0 of the others. */
INSIDE void TM_NAME(gradient)(const tm_tet_batches *batches, int32_t p, int at, const double *u, V8 H[9]) {
    const tm_tet_batch *batch = batches->batch + p;
    M8 there;
    TM_NAME(living)(batches, p, at, &there);
    for (int i = 0; i < 3; i++) {
        V8 first, d[3], alpha;
        TM_NAME(pick)(u + i, batch->component[0] + at, 1, &first);
        for (int k = 0; k < 3; k++) {
            TM_NAME(pick)(u + i, batch->component[k + 1] + at, 1, &d[k]);
            d[k] -= first;
        }
        for (int j = 0; j < 3; j++) {
            memcpy(&alpha, batch->shape_1_m[j] + at, sizeof alpha);
            H[3 * i + j] = d[0] * alpha;
            for (int k = 1; k < 3; k++) {
                memcpy(&alpha, batch->shape_1_m[3 * k + j] + at, sizeof alpha);
                H[3 * i + j] += d[k] * alpha;
            }
            H[3 * i + j] = (V8)((M8)H[3 * i + j] & there);
        }
    }
}

/* Computes the corner forces of a stress times the volume: corners 1, 2, 3, and corner 0 as minus their sum. */
INSIDE void TM_NAME(pull)(const tm_tet_batches *batches, int32_t p, int at, const V8 P[9], V8 f[4][3]) {
    const tm_tet_batch *batch = batches->batch + p;
    V8 alpha[9];
    for (int i = 0; i < 9; i++) memcpy(&alpha[i], batch->shape_1_m[i] + at, sizeof(V8));
    for (int i = 0; i < 3; i++) {
        f[0][i] = (V8){0};
        for (int k = 0; k < 3; k++) {
            f[k + 1][i] = P[3 * i] * alpha[3 * k] + P[3 * i + 1] * alpha[3 * k + 1] + P[3 * i + 2] * alpha[3 * k + 2];
            f[0][i] -= f[k + 1][i];
        }
    }
}
