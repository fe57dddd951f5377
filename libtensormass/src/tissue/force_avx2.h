/* Helpers of the AVX2 forms of the force loop, for tensors of both precisions. */
#ifndef TM_FORCE_AVX2_H
#define TM_FORCE_AVX2_H

#include "tissue/force_graph.h"

/* Three numbers and a zero. For a caller's array: reads nothing past its end. */
TM_AVX2 static inline __m256d tm_three(const double *from) {
    return _mm256_maskload_pd(from, _mm256_set_epi64x(0, -1, -1, -1));
}

/* A displacement, each component in all lanes. */
typedef struct tm_spread {
    __m256d x, y, z;
} tm_spread;
TM_AVX2 static inline tm_spread tm_spread_of(const double *u) {
    return (tm_spread){_mm256_broadcast_sd(u), _mm256_broadcast_sd(u + 1), _mm256_broadcast_sd(u + 2)};
}

/* Force of one vertex: sums of each component by lanes, the fourth zero. */
typedef struct tm_sums {
    __m256d x, y, z;
} tm_sums;

/* at -= g, as two and one: no store past the end of the caller's array. */
TM_AVX2 static inline void tm_take_from(double *at, __m256d g) {
    _mm_storeu_pd(at, _mm_sub_pd(_mm_loadu_pd(at), _mm256_castpd256_pd128(g)));
    _mm_store_sd(at + 2, _mm_sub_sd(_mm_load_sd(at + 2), _mm256_extractf128_pd(g, 1)));
}

/* Subtracts g from the partial sum at this offset. */
TM_AVX2 static inline void tm_take_from_ring(double *ring, size_t bytes, __m256d g) {
    double *at = (double *)((char *)ring + bytes);
    _mm256_store_pd(at, _mm256_sub_pd(_mm256_load_pd(at), g));
}

/* force_N := partial sum - f: lanes 0 and 1, and 2 and 3, then both. */
TM_AVX2 static inline void tm_give_sum(double *force_N, const double *half, const tm_sums *f) {
    const __m256d xy = _mm256_add_pd(_mm256_unpacklo_pd(f->x, f->y), _mm256_unpackhi_pd(f->x, f->y)),
                  zz = _mm256_add_pd(f->z, _mm256_unpackhi_pd(f->z, f->z));
    const __m128d low = _mm_add_pd(_mm256_castpd256_pd128(xy), _mm256_extractf128_pd(xy, 1)),
                  high = _mm_add_sd(_mm256_castpd256_pd128(zz), _mm256_extractf128_pd(zz, 1));
    _mm_storeu_pd(force_N, _mm_sub_pd(_mm_loadu_pd(half), low));
    _mm_store_sd(force_N + 2, _mm_sub_sd(_mm_load_sd(half + 2), high));
}

/* Numbers 6 and 7 of a block, and twice the last one. */
TM_AVX2 static inline __m256d tm_last_row(const double *from, const double *last) {
    return _mm256_blend_pd(_mm256_castpd128_pd256(_mm_loadu_pd(from)), _mm256_broadcast_sd(last), 12);
}

#endif
