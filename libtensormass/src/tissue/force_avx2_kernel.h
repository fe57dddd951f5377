/* The force loop with AVX2 and FMA, included once for double and once for single tensors: TM_REAL, TM_NAME, TM_BELOW
 * and TM_LOAD4 are set by the includer. Sums as force_kernel.h does, but fused and by lanes: it agrees with the plain
 * form to rounding, not in bits.
 *
 * A row of a block is loaded as four numbers, the fourth belonging to what follows (tensors are padded for the last):
 * it meets a zero lane of u or is dropped. Forces are read and written as two and one, so that no store goes past the
 * caller's array. */
#define TM_TAKE_FROM(at, g)                                                                                            \
    do {                                                                                                               \
        _mm_storeu_pd(at, _mm_sub_pd(_mm_loadu_pd(at), _mm256_castpd256_pd128(g)));                                    \
        _mm_store_sd((at) + 2, _mm_sub_sd(_mm_load_sd((at) + 2), _mm256_extractf128_pd(g, 1)));                        \
    } while (0)

TM_AVX2 static int32_t TM_BELOW(const tm_force_graph *graph, const tm_force_part *part, const double *TM_RESTRICT u_m,
                                double *TM_RESTRICT force_N) {
    int32_t zeroed = part->begin;
    for (int32_t i = 0; i < part->below_count; i++) {
        const int32_t j = part->below[i];
        const __m256d x = _mm256_set1_pd(u_m[3 * (int64_t)j]), y = _mm256_set1_pd(u_m[3 * (int64_t)j + 1]),
                      z = _mm256_set1_pd(u_m[3 * (int64_t)j + 2]);
        for (int32_t e = graph->upper_begin[j]; e < graph->upper_end[j] && graph->upper_vertex[e] < part->end; e++) {
            const TM_REAL *K = (const TM_REAL *)graph->edge_tensor + 9 * (int64_t)e;
            const int32_t l = graph->upper_vertex[e];
            if (l < part->begin) continue;
            if (l >= zeroed) zeroed = tm_force_zero(zeroed, l + 1, part->end, force_N);
            const __m256d g =
                _mm256_fmadd_pd(TM_LOAD4(K + 6), z, _mm256_fmadd_pd(TM_LOAD4(K + 3), y, _mm256_mul_pd(TM_LOAD4(K), x)));
            TM_TAKE_FROM(force_N + 3 * (int64_t)l, g);
        }
    }
    return zeroed;
}

TM_AVX2 void TM_NAME(const tm_force_graph *graph, tm_force_part *part, int32_t from, int32_t to,
                     const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N) {
    const double *vertex_tensor = graph->vertex_tensor;
    const TM_REAL *edge_tensor = graph->edge_tensor;
    const int32_t *upper_begin = graph->upper_begin, *upper_end = graph->upper_end;
    const int32_t *upper_vertex = graph->upper_vertex, part_end = part->end;
    const __m256i three = _mm256_set_epi64x(0, -1, -1, -1);
    int32_t zeroed = from == part->begin ? TM_BELOW(graph, part, u_m, force_N) : part->zeroed;
    if (to > zeroed) zeroed = tm_force_zero(zeroed, to, part_end, force_N);
    for (int32_t begin, end = from; tm_next_run(graph->living, to, &begin, &end);)
        for (int32_t k = begin; k < end; k++) {
            const double *A = vertex_tensor + 9 * (int64_t)k;
            const __m256d uk = _mm256_maskload_pd(u_m + 3 * (int64_t)k, three);
            const __m256d x = _mm256_set1_pd(u_m[3 * (int64_t)k]), y = _mm256_set1_pd(u_m[3 * (int64_t)k + 1]),
                          z = _mm256_set1_pd(u_m[3 * (int64_t)k + 2]);
            __m256d fx = _mm256_mul_pd(_mm256_loadu_pd(A), uk), fy = _mm256_mul_pd(_mm256_loadu_pd(A + 3), uk),
                    fz = _mm256_mul_pd(_mm256_loadu_pd(A + 6), uk);
            const int32_t last = upper_end[k];
            int32_t e = upper_begin[k];
            if (e < last && upper_vertex[last - 1] >= zeroed && zeroed < part_end)
                zeroed = tm_force_zero(zeroed, upper_vertex[last - 1] + 1, part_end, force_N);
            for (; e < last && upper_vertex[e] < part_end; e++) {
                const TM_REAL *K = edge_tensor + 9 * (int64_t)e;
                const int64_t l = 3 * (int64_t)upper_vertex[e];
                const __m256d ul = _mm256_maskload_pd(u_m + l, three);
                const __m256d a = TM_LOAD4(K), b = TM_LOAD4(K + 3), c = TM_LOAD4(K + 6);
                fx = _mm256_fmadd_pd(a, ul, fx);
                fy = _mm256_fmadd_pd(b, ul, fy);
                fz = _mm256_fmadd_pd(c, ul, fz);
                const __m256d g = _mm256_fmadd_pd(c, z, _mm256_fmadd_pd(b, y, _mm256_mul_pd(a, x)));
                TM_TAKE_FROM(force_N + l, g);
            }
            for (; e < last; e++) { /* into parts behind */
                const TM_REAL *K = edge_tensor + 9 * (int64_t)e;
                const __m256d ul = _mm256_maskload_pd(u_m + 3 * (int64_t)upper_vertex[e], three);
                fx = _mm256_fmadd_pd(TM_LOAD4(K), ul, fx);
                fy = _mm256_fmadd_pd(TM_LOAD4(K + 3), ul, fy);
                fz = _mm256_fmadd_pd(TM_LOAD4(K + 6), ul, fz);
            }
            /* The fourth lanes are zero: sums of all four are sums of three. */
            const __m256d xy = _mm256_hadd_pd(fx, fy), zz = _mm256_hadd_pd(fz, fz);
            const __m128d low = _mm_add_pd(_mm256_castpd256_pd128(xy), _mm256_extractf128_pd(xy, 1));
            const __m128d high = _mm_add_pd(_mm256_castpd256_pd128(zz), _mm256_extractf128_pd(zz, 1));
            TM_TAKE_FROM(force_N + 3 * (int64_t)k, _mm256_set_m128d(high, low));
        }
    part->zeroed = zeroed;
}
#undef TM_TAKE_FROM
