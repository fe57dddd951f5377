/* Differences of displacements, taken in double and rounded; a part of every kernel in single precision. */

/* Vectors at the first corner, in double, and d[i]: component i of the vectors at another corner less those. */
#if TM_WIDTH == 8
typedef __m256d TM_NAME(origin)[8];
/* Three numbers: a fourth may be beyond the array. */
#define THREE(from) _mm256_maskload_pd(from, _mm256_setr_epi64x(-1, -1, -1, 0))

INSIDE void TM_NAME(origin_of)(const double *from, const int32_t *corner, TM_NAME(origin) first) {
    for (int l = 0; l < 8; l++) first[l] = THREE(from + corner[l]);
}

/* Lanes l and l + 4 share a vector, which is turned by fours. */
INSIDE void TM_NAME(difference)(const double *from, const int32_t *corner, const TM_NAME(origin) first, V8 d[3]) {
    __m256 r[4];
#pragma GCC unroll 4
    for (int l = 0; l < 4; l++) {
        const __m128 low = _mm256_cvtpd_ps(THREE(from + corner[l]) - first[l]);
        const __m128 high = _mm256_cvtpd_ps(THREE(from + corner[l + 4]) - first[l + 4]);
        r[l] = _mm256_insertf128_ps(_mm256_castps128_ps256(low), high, 1);
    }
    const __m256 low = _mm256_unpacklo_ps(r[0], r[1]), low2 = _mm256_unpacklo_ps(r[2], r[3]);
    const __m256 high = _mm256_unpackhi_ps(r[0], r[1]), high2 = _mm256_unpackhi_ps(r[2], r[3]);
    d[0] = (V8)_mm256_shuffle_ps(low, low2, 0x44);
    d[1] = (V8)_mm256_shuffle_ps(low, low2, 0xee);
    d[2] = (V8)_mm256_shuffle_ps(high, high2, 0x44);
}
#undef THREE
#elif defined(TM_NEON_FORM)
typedef struct TM_NAME(origin) {
    float64x2_t xy[4], z[2];
} TM_NAME(origin)[1];

INSIDE float64x2_t TM_NAME(third)(const double *from, const int32_t *corner) {
    return vld1q_lane_f64(from + corner[1] + 2, vld1q_dup_f64(from + corner[0] + 2), 1);
}

INSIDE void TM_NAME(origin_of)(const double *from, const int32_t *corner, TM_NAME(origin) first) {
    for (int l = 0; l < 4; l++) first->xy[l] = vld1q_f64(from + corner[l]);
    for (int h = 0; h < 2; h++) first->z[h] = TM_NAME(third)(from, corner + 2 * h);
}

INSIDE void TM_NAME(difference)(const double *from, const int32_t *corner, const TM_NAME(origin) first, V8 d[3]) {
    float32x4_t xy[2]; /* x y of a lane, then of the next */
    for (int h = 0; h < 2; h++) {
        const float64x2_t one = vld1q_f64(from + corner[2 * h]) - first->xy[2 * h];
        xy[h] = vcvt_high_f32_f64(vcvt_f32_f64(one), vld1q_f64(from + corner[2 * h + 1]) - first->xy[2 * h + 1]);
    }
    d[0] = (V8)vuzp1q_f32(xy[0], xy[1]), d[1] = (V8)vuzp2q_f32(xy[0], xy[1]);
    d[2] = (V8)vcvt_high_f32_f64(vcvt_f32_f64(TM_NAME(third)(from, corner) - first->z[0]),
                                 TM_NAME(third)(from, corner + 2) - first->z[1]);
}
#else
typedef double TM_NAME(origin)[3][TM_WIDTH];

INSIDE void TM_NAME(origin_of)(const double *from, const int32_t *corner, TM_NAME(origin) first) {
    for (int i = 0; i < 3; i++)
        for (int l = 0; l < TM_WIDTH; l++) first[i][l] = from[corner[l] + i];
}

/* Not lane by lane into d: each would be a store that the next load of the vector waits for. */
INSIDE void TM_NAME(difference)(const double *from, const int32_t *corner, TM_NAME(origin) first, V8 d[3]) {
    for (int i = 0; i < 3; i++)
        d[i] = (V8){(float)(from[corner[0] + i] - first[i][0]), (float)(from[corner[1] + i] - first[i][1]),
                    (float)(from[corner[2] + i] - first[i][2]), (float)(from[corner[3] + i] - first[i][3])};
}
#endif
