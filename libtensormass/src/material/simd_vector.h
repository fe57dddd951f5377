/* Vectors of WIDTH lanes, one per tetrahedron, and 3x3 matrices of them; a part of corotated_kernel.h. Lanes are
 * double, or float with TM_FLOATS. */

#include "base/asan.h"

#ifdef TM_FLOATS
typedef float TM_NAME(real);
typedef int32_t TM_NAME(whole);
#else
typedef double TM_NAME(real);
typedef int64_t TM_NAME(whole);
#endif
typedef TM_NAME(real) TM_NAME(v8) __attribute__((vector_size(sizeof(TM_NAME(real)) * TM_WIDTH)));
typedef TM_NAME(whole) TM_NAME(m8) __attribute__((vector_size(sizeof(TM_NAME(real)) * TM_WIDTH)));
/* A number that is not exact in float, or that the compiler does not know, beside a vector. */
#define REAL(x) ((TM_NAME(real))(x))
#define V8 TM_NAME(v8)
#define M8 TM_NAME(m8)
/* Inlining everything costs clang 45 s where AddressSanitizer checks each access; bits are the same. */
#ifdef TM_ASAN
#define INSIDE TM_TARGET static inline
#else
#define INSIDE TM_TARGET static inline __attribute__((always_inline))
#endif

INSIDE void TM_NAME(choose)(V8 *to, const M8 *mask, const V8 *yes, const V8 *no) {
    *to = (V8)((*mask & (M8)*yes) | (~*mask & (M8)*no));
}

INSIDE bool TM_NAME(any)(const M8 *mask) {
#ifdef TM_NEON_FORM
    return vmaxvq_u32((uint32x4_t)*mask);
#elif defined(TM_FLOATS)
#if TM_WIDTH == 8
    return _mm256_movemask_ps((__m256)*mask);
#else
    return (*mask)[0] | (*mask)[1] | (*mask)[2] | (*mask)[3];
#endif
#elif TM_WIDTH == 8
    return _mm512_movepi64_mask((__m512i)*mask);
#elif TM_WIDTH == 4
    return _mm256_movemask_pd((__m256d)*mask);
#else
    return (*mask)[0] | (*mask)[1];
#endif
}

#ifndef TM_FLOATS
/* Gathers the numbers at at[0], at[step], ... Not one by one through memory: a wide load would wait for all the
 * stores. */
INSIDE void TM_NAME(pick)(const double *from, const int32_t *at, int step, V8 *to) {
#if TM_WIDTH == 8
    *to = (V8){from[at[0]],        from[at[step]],     from[at[2 * step]], from[at[3 * step]],
               from[at[4 * step]], from[at[5 * step]], from[at[6 * step]], from[at[7 * step]]};
#elif TM_WIDTH == 4
    *to = (V8){from[at[0]], from[at[step]], from[at[2 * step]], from[at[3 * step]]};
#else
    *to = (V8){from[at[0]], from[at[step]]};
#endif
}

/* Vectors at the first corner, and d[i]: component i of the vectors at another corner less those. Reads vectors whole
 * and turns them into lanes after the difference: a third of the loads of numbers one by one. */
#ifdef TM_NEON_FORM
typedef struct TM_NAME(origin) {
    float64x2_t xy[2];
    V8 z;
} TM_NAME(origin)[1];

INSIDE void TM_NAME(origin_of)(const double *from, const int32_t *corner, TM_NAME(origin) first) {
    for (int l = 0; l < 2; l++) first->xy[l] = vld1q_f64(from + corner[l]);
    TM_NAME(pick)(from + 2, corner, 1, &first->z);
}

INSIDE void TM_NAME(difference)(const double *from, const int32_t *corner, const TM_NAME(origin) first, V8 d[3]) {
    const float64x2_t one = vld1q_f64(from + corner[0]) - first->xy[0];
    const float64x2_t other = vld1q_f64(from + corner[1]) - first->xy[1];
    d[0] = (V8)vzip1q_f64(one, other), d[1] = (V8)vzip2q_f64(one, other);
    TM_NAME(pick)(from + 2, corner, 1, &d[2]);
    d[2] -= first->z;
}
#elif TM_WIDTH >= 4
typedef __m256d TM_NAME(origin)[TM_WIDTH];
/* Three numbers: a fourth may be beyond the array. */
#define THREE(from) _mm256_maskload_pd(from, _mm256_setr_epi64x(-1, -1, -1, 0))

INSIDE void TM_NAME(origin_of)(const double *from, const int32_t *corner, TM_NAME(origin) first) {
    for (int l = 0; l < TM_WIDTH; l++) first[l] = THREE(from + corner[l]);
}

INSIDE void TM_NAME(difference)(const double *from, const int32_t *corner, const TM_NAME(origin) first, V8 d[3]) {
    __m256d r[TM_WIDTH], half[TM_WIDTH / 4][3];
    for (int l = 0; l < TM_WIDTH; l++) r[l] = THREE(from + corner[l]) - first[l];
    for (int h = 0; h < TM_WIDTH / 4; h++) {
        const __m256d *q = r + 4 * h;
        const __m256d low = _mm256_unpacklo_pd(q[0], q[1]), low2 = _mm256_unpacklo_pd(q[2], q[3]);
        const __m256d high = _mm256_unpackhi_pd(q[0], q[1]), high2 = _mm256_unpackhi_pd(q[2], q[3]);
        half[h][0] = _mm256_permute2f128_pd(low, low2, 0x20);
        half[h][1] = _mm256_permute2f128_pd(high, high2, 0x20);
        half[h][2] = _mm256_permute2f128_pd(low, low2, 0x31);
    }
    for (int i = 0; i < 3; i++)
#if TM_WIDTH == 8
        d[i] = (V8)_mm512_insertf64x4(_mm512_castpd256_pd512(half[0][i]), half[1][i], 1);
#else
        d[i] = (V8)half[0][i];
#endif
}
#undef THREE
#else
typedef V8 TM_NAME(origin)[3];

INSIDE void TM_NAME(origin_of)(const double *from, const int32_t *corner, TM_NAME(origin) first) {
    for (int i = 0; i < 3; i++) TM_NAME(pick)(from + i, corner, 1, &first[i]);
}

INSIDE void TM_NAME(difference)(const double *from, const int32_t *corner, const TM_NAME(origin) first, V8 d[3]) {
    for (int i = 0; i < 3; i++) {
        TM_NAME(pick)(from + i, corner, 1, &d[i]);
        d[i] -= first[i];
    }
}
#endif

#endif

/* xy[l] := components x and y of lane l, in double. */
typedef double TM_NAME(two) __attribute__((vector_size(16)));
INSIDE void TM_NAME(pairs)(const V8 *x, const V8 *y, TM_NAME(two) xy[TM_WIDTH]) {
#ifdef TM_FLOATS
#if !defined(TM_NEON_FORM) && TM_WIDTH == 8
    const __m256 even = _mm256_unpacklo_ps((__m256)*x, (__m256)*y), odd = _mm256_unpackhi_ps((__m256)*x, (__m256)*y);
    const __m256d part[4] = {
        _mm256_cvtps_pd(_mm256_castps256_ps128(even)), _mm256_cvtps_pd(_mm256_castps256_ps128(odd)),
        _mm256_cvtps_pd(_mm256_extractf128_ps(even, 1)), _mm256_cvtps_pd(_mm256_extractf128_ps(odd, 1))};
    for (int h = 0; h < 4; h++) {
        xy[2 * h] = (TM_NAME(two))_mm256_castpd256_pd128(part[h]);
        xy[2 * h + 1] = (TM_NAME(two))_mm256_extractf128_pd(part[h], 1);
    }
#else
    for (int l = 0; l < TM_WIDTH; l++) xy[l] = (TM_NAME(two)){(double)(*x)[l], (double)(*y)[l]};
#endif
#elif !defined(TM_NEON_FORM) && TM_WIDTH >= 4
    __m256d part[2][TM_WIDTH / 4];
    memcpy(part[0], x, sizeof part[0]);
    memcpy(part[1], y, sizeof part[1]);
    for (int h = 0; h < TM_WIDTH / 4; h++) {
        const __m256d even = _mm256_unpacklo_pd(part[0][h], part[1][h]),
                      odd = _mm256_unpackhi_pd(part[0][h], part[1][h]);
        xy[4 * h] = (TM_NAME(two))_mm256_castpd256_pd128(even),
               xy[4 * h + 1] = (TM_NAME(two))_mm256_castpd256_pd128(odd);
        xy[4 * h + 2] = (TM_NAME(two))_mm256_extractf128_pd(even, 1);
        xy[4 * h + 3] = (TM_NAME(two))_mm256_extractf128_pd(odd, 1);
    }
#else
    for (int l = 0; l < TM_WIDTH; l++) xy[l] = (TM_NAME(two)){(*x)[l], (*y)[l]};
#endif
}

/* to[l] := lane l in double. */
INSIDE void TM_NAME(store_wide)(const V8 *x, double to[TM_WIDTH]) {
#ifdef TM_FLOATS
    for (int l = 0; l < TM_WIDTH; l++) to[l] = (double)(*x)[l];
#else
    memcpy(to, x, sizeof *x);
#endif
}

INSIDE void TM_NAME(root)(V8 *x) {
#ifdef TM_FLOATS
#ifdef TM_NEON_FORM
    *x = (V8)vsqrtq_f32((float32x4_t)*x);
#elif TM_WIDTH == 8
    *x = (V8)_mm256_sqrt_ps((__m256)*x);
#else
    *x = (V8){__builtin_sqrtf((*x)[0]), __builtin_sqrtf((*x)[1]), __builtin_sqrtf((*x)[2]), __builtin_sqrtf((*x)[3])};
#endif
#elif defined(TM_NEON_FORM)
    *x = (V8)vsqrtq_f64((float64x2_t)*x);
#elif TM_WIDTH == 8
    *x = (V8)_mm512_sqrt_pd((__m512d)*x);
#elif TM_WIDTH == 4
    *x = (V8)_mm256_sqrt_pd((__m256d)*x);
#else
    *x = (V8){__builtin_sqrt((*x)[0]), __builtin_sqrt((*x)[1])};
#endif
}

/* e^x of |x| < 700, within two units of the last digit: 2^n e^r, |r| < ln 2/2, by the series. The same bits for every
 * width. */
INSIDE void TM_NAME(exponential)(const V8 *x, V8 *y) {
#ifdef TM_FLOATS /* |x| < 80 */
    const V8 shifted = *x * REAL(1.4426950408889634) + REAL(12582912.0), n = shifted - REAL(12582912.0);
    const V8 r = (*x - n * REAL(0.693359375)) + n * REAL(2.12194440e-4);
    const V8 r2 = r * r;
    const V8 a = (REAL(1.0) + r) + r2 * (REAL(0.5) + r * REAL(1.0 / 6));
    const V8 b = (REAL(1.0 / 24) + r * REAL(1.0 / 120)) + r2 * (REAL(1.0 / 720) + r * REAL(1.0 / 5040));
    const V8 sum = a + r2 * r2 * b;
    *y = (V8)((M8)sum + ((M8)shifted << 23));
#else
    const V8 shifted = *x * 1.4426950408889634 + 6755399441055744.0, n = shifted - 6755399441055744.0;
    const V8 r = (*x - n * 6.93147180369123816490e-01) - n * 1.90821492927058770002e-10;
    /* By powers of two of r: a third of the time of one chain of sums. */
    const V8 r2 = r * r, r4 = r2 * r2, r8 = r4 * r4;
    const V8 a = (1.0 + r) + r2 * (0.5 + r * (1.0 / 6));
    const V8 b = (1.0 / 24 + r * (1.0 / 120)) + r2 * (1.0 / 720 + r * (1.0 / 5040));
    const V8 c = (1.0 / 40320 + r * (1.0 / 362880)) + r2 * (1.0 / 3628800 + r * (1.0 / 39916800));
    const V8 d = 1.0 / 479001600 + r * (1.0 / 6227020800);
    const V8 sum = (a + r4 * b) + r8 * (c + r4 * d);
    *y = (V8)((M8)sum + ((M8)shifted << 52));
#endif
}

INSIDE M8 TM_NAME(exceeds)(const V8 *x, const V8 *most) { return *x > *most; }

/* C = A^T B and C = A B of 3x3 matrices. */
INSIDE void TM_NAME(transposed_times)(const V8 A[9], const V8 B[9], V8 C[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) C[3 * i + j] = A[i] * B[j] + A[3 + i] * B[3 + j] + A[6 + i] * B[6 + j];
}
INSIDE void TM_NAME(times)(const V8 A[9], const V8 B[9], V8 C[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) C[3 * i + j] = A[3 * i] * B[j] + A[3 * i + 1] * B[3 + j] + A[3 * i + 2] * B[6 + j];
}
INSIDE void TM_NAME(times_transposed)(const V8 A[9], const V8 B[9], V8 C[9]) {
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            C[3 * i + j] = A[3 * i] * B[3 * j] + A[3 * i + 1] * B[3 * j + 1] + A[3 * i + 2] * B[3 * j + 2];
}

#include "material/cofactor.h"
