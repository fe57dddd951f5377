/* The force loop with AVX2 and FMA, included once for double and once for single tensors: TM_REAL, TM_NAME and TM_LOAD4
 * are set by the includer. Sums as force_kernel.h does, but fused and by lanes: it agrees with the plain form to
 * rounding, not in bits.
 *
 * A row of a block is loaded as four numbers, the fourth belonging to what follows (tensors are padded for the last):
 * it meets a zero lane of u or is dropped. Forces are read and written as two and one, so that no store goes past the
 * caller's array. */
TM_AVX2 void TM_NAME(const tm_force_graph *graph, const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N) {
    const double *vertex_tensor = graph->vertex_tensor;
    const TM_REAL *edge_tensor = graph->edge_tensor;
    const int32_t *upper_begin = graph->upper_begin, *upper_end = graph->upper_end;
    const int32_t *upper_vertex = graph->upper_vertex, n = graph->vertex_count;
    const __m256i three = _mm256_set_epi64x(0, -1, -1, -1);
    memset(force_N, 0, sizeof(double) * 3 * (size_t)n);
    for (int32_t begin, end = 0; tm_next_run(graph->living, n, &begin, &end);)
        for (int32_t k = begin; k < end; k++) {
            const double *A = vertex_tensor + 9 * (int64_t)k;
            const __m256d uk = _mm256_maskload_pd(u_m + 3 * (int64_t)k, three);
            const __m256d x = _mm256_set1_pd(u_m[3 * (int64_t)k]), y = _mm256_set1_pd(u_m[3 * (int64_t)k + 1]),
                          z = _mm256_set1_pd(u_m[3 * (int64_t)k + 2]);
            __m256d fx = _mm256_mul_pd(_mm256_loadu_pd(A), uk), fy = _mm256_mul_pd(_mm256_loadu_pd(A + 3), uk),
                    fz = _mm256_mul_pd(_mm256_loadu_pd(A + 6), uk);
            for (int32_t e = upper_begin[k]; e < upper_end[k]; e++) {
                const TM_REAL *K = edge_tensor + 9 * (int64_t)e;
                const int64_t l = 3 * (int64_t)upper_vertex[e];
                const __m256d ul = _mm256_maskload_pd(u_m + l, three);
                const __m256d a = TM_LOAD4(K), b = TM_LOAD4(K + 3), c = TM_LOAD4(K + 6);
                fx = _mm256_fmadd_pd(a, ul, fx);
                fy = _mm256_fmadd_pd(b, ul, fy);
                fz = _mm256_fmadd_pd(c, ul, fz);
                const __m256d g = _mm256_fmadd_pd(c, z, _mm256_fmadd_pd(b, y, _mm256_mul_pd(a, x)));
                _mm_storeu_pd(force_N + l, _mm_sub_pd(_mm_loadu_pd(force_N + l), _mm256_castpd256_pd128(g)));
                _mm_store_sd(force_N + l + 2, _mm_sub_sd(_mm_load_sd(force_N + l + 2), _mm256_extractf128_pd(g, 1)));
            }
            /* The fourth lanes are zero: sums of all four are sums of three. */
            const __m256d xy = _mm256_hadd_pd(fx, fy), zz = _mm256_hadd_pd(fz, fz);
            const __m128d low = _mm_add_pd(_mm256_castpd256_pd128(xy), _mm256_extractf128_pd(xy, 1));
            const __m128d high = _mm_add_pd(_mm256_castpd256_pd128(zz), _mm256_extractf128_pd(zz, 1));
            double *f = force_N + 3 * (int64_t)k;
            _mm_storeu_pd(f, _mm_sub_pd(_mm_loadu_pd(f), low));
            _mm_store_sd(f + 2, _mm_sub_sd(_mm_load_sd(f + 2), high));
        }
}
