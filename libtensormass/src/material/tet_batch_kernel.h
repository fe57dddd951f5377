/* Gradients of batches, and forces on their corners; a part of every kernel over tetrahedra (corotated_kernel.h,
 * hyperelastic_kernel.h). */

#ifdef TM_FLOATS
#define TM_BATCHES tm_single_batches
#define TM_BATCH tm_single_batch
#else
#define TM_BATCHES tm_tet_batches
#define TM_BATCH tm_tet_batch
#endif

/* Returns whether all lanes are active. */
INSIDE bool TM_NAME(active_lanes)(const TM_BATCHES *batches, int32_t p, int at, M8 *there) {
    const tm_tet_span span = batches->span[p];
    if (span.tet + TM_LANES <= span.end &&
        !memcmp(batches->alive + span.tet + at, (char[8]){1, 1, 1, 1, 1, 1, 1, 1}, TM_WIDTH)) {
        *there = (M8){0} == 0;
        return true;
    }
    for (int l = 0; l < TM_WIDTH; l++) {
        const int32_t tet = span.tet + at + l;
        (*there)[l] = tet < span.end && batches->alive[tet] ? -1 : 0;
    }
    return false;
}

/* Computes grad u of the batch's active tetrahedra, 0 of the others. */
INSIDE void TM_NAME(gradient)(const TM_BATCHES *batches, int32_t p, int at, const double *u, V8 H[9]) {
    const TM_BATCH *batch = batches->batch + p;
    TM_NAME(origin) first;
    M8 there;
    const bool all = TM_NAME(active_lanes)(batches, p, at, &there);
    TM_NAME(origin_of)(u, batch->component[0] + at, first);
#pragma GCC unroll 3
    for (int k = 0; k < 3; k++) { /* corner by corner: nine sums and little else in registers */
        V8 d[3], alpha;
        TM_NAME(difference)(u, batch->component[k + 1] + at, first, d);
        for (int j = 0; j < 3; j++) {
            memcpy(&alpha, batch->shape_1_m[3 * k + j] + at, sizeof alpha);
            for (int i = 0; i < 3; i++) H[3 * i + j] = k ? H[3 * i + j] + d[i] * alpha : d[i] * alpha;
        }
    }
    for (int i = 0; i < 9 && !all; i++) H[i] = (V8)((M8)H[i] & there);
}

/* Computes the corner forces of a stress times the volume: corners 1, 2, 3, and corner 0 as minus their sum. */
INSIDE void TM_NAME(pull)(const TM_BATCHES *batches, int32_t p, int at, const V8 P[9], V8 f[4][3]) {
    const TM_BATCH *batch = batches->batch + p;
    V8 alpha[9];
    __asm__("" : "+r"(batch)); /* reads alpha again: kept since the gradient, it would be spilled */
    for (int i = 0; i < 9; i++) memcpy(&alpha[i], batch->shape_1_m[i] + at, sizeof(V8));
    for (int i = 0; i < 3; i++) {
        f[0][i] = (V8){0};
        for (int k = 0; k < 3; k++) {
            f[k + 1][i] = P[3 * i] * alpha[3 * k] + P[3 * i + 1] * alpha[3 * k + 1] + P[3 * i + 2] * alpha[3 * k + 2];
            f[0][i] -= f[k + 1][i];
        }
    }
}
#undef TM_BATCHES
#undef TM_BATCH
