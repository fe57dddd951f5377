/* The force loop with NEON, included once for double and once for single tensors. The includer sets TM_REAL, TM_NAME,
 * TM_LOAD2, TM_BLOCK, TM_NINTH and TM_OF, which makes names of this precision. The order of sums is that of
 * force_kernel.h, but fused and by lanes: it agrees with the plain form to rounding, not in bits.
 *
 * A vector holds two numbers, a row of a block three: the first two of each row are in a vector of their own, the
 * thirds of the upper rows in a fourth, the last number stays a scalar. */
typedef struct {
    float64x2_t a, b, c; /* K[0..1], K[3..4], K[6..7] */
    float64x2_t third;   /* K[2], K[5] */
    double last;         /* K[8] */
} TM_OF(rows);

static inline TM_OF(rows) TM_OF(load_rows)(const TM_REAL *tensor, const double *last, int32_t e) {
    (void)last; /* single has none */
    const TM_REAL *K = TM_BLOCK(tensor, e);
    const float64x2_t v01 = TM_LOAD2(K), v23 = TM_LOAD2(K + 2), v45 = TM_LOAD2(K + 4), v67 = TM_LOAD2(K + 6);
    return (TM_OF(rows)){v01, vextq_f64(v23, v45, 1), v67, vcombine_f64(vget_low_f64(v23), vget_high_f64(v45)),
                         TM_NINTH(K, last, e)};
}

/* at -= K^T (x, y, z) */
static inline void TM_OF(take_transposed)(double *TM_RESTRICT at, const TM_OF(rows) * K, double x, double y, double z) {
    float64x2_t g = vmulq_n_f64(K->a, x);
    g = vfmaq_n_f64(g, K->b, y);
    g = vfmaq_n_f64(g, K->c, z);
    vst1q_f64(at, vsubq_f64(vld1q_f64(at), g));
    at[2] -= __builtin_fma(K->last, z, __builtin_fma(vgetq_lane_f64(K->third, 1), y, vgetq_lane_f64(K->third, 0) * x));
}

/* Sums of a row of the complete matrix, by lanes. */
typedef struct {
    float64x2_t x, y, z, third;
    double last;
} TM_OF(sum);

static inline TM_OF(sum) TM_OF(add_product)(TM_OF(sum) f, const TM_OF(rows) * K, const double *TM_RESTRICT u) {
    const float64x2_t pq = vld1q_f64(u);
    const double r = u[2];
    f.x = vfmaq_f64(f.x, K->a, pq);
    f.y = vfmaq_f64(f.y, K->b, pq);
    f.z = vfmaq_f64(f.z, K->c, pq);
    f.third = vfmaq_n_f64(f.third, K->third, r);
    f.last = __builtin_fma(K->last, r, f.last);
    return f;
}

static int32_t TM_OF(below)(const tm_force_graph *graph, const tm_force_partition *part, const double *TM_RESTRICT u_m,
                            double *TM_RESTRICT force_N) {
    int32_t zeroed = part->begin;
    for (int32_t i = 0; i < part->halo_count; i++) {
        const int32_t j = part->halo[i];
        const double x = u_m[3 * (int64_t)j], y = u_m[3 * (int64_t)j + 1], z = u_m[3 * (int64_t)j + 2];
        for (int32_t e = graph->upper_begin[j]; e < graph->upper_end[j] && graph->upper_vertex[e] < part->end; e++) {
            const int32_t l = graph->upper_vertex[e];
            if (l < part->begin) continue;
            if (l >= zeroed) zeroed = tm_force_zero(zeroed, l + 1, part->end, force_N);
            const TM_OF(rows) K = TM_OF(load_rows)(graph->edge_tensor, graph->edge_last, e);
            TM_OF(take_transposed)(force_N + 3 * (int64_t)l, &K, x, y, z);
        }
    }
    return zeroed;
}

void TM_NAME(const tm_force_graph *graph, tm_force_partition *part, int32_t from, int32_t to,
             const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N) {
    const double *vertex_tensor = graph->vertex_tensor;
    const TM_REAL *edge_tensor = graph->edge_tensor;
    const double *edge_last = graph->edge_last;
    const int32_t *upper_begin = graph->upper_begin, *upper_end = graph->upper_end;
    const int32_t *upper_vertex = graph->upper_vertex, part_end = part->end;
    int32_t zeroed = from == part->begin ? TM_OF(below)(graph, part, u_m, force_N) : part->zeroed;
    if (to > zeroed) zeroed = tm_force_zero(zeroed, to, part_end, force_N);
    for (int32_t begin, end = from; tm_next_run(graph->active, to, &begin, &end);)
        for (int32_t k = begin; k < end; k++) {
            const double *A = vertex_tensor + 9 * (int64_t)k, *uk = u_m + 3 * (int64_t)k;
            const double x = uk[0], y = uk[1], z = uk[2];
            const float64x2_t none = vdupq_n_f64(0);
            TM_OF(sum) f = {none, none, none, none, 0};
            const int32_t last = upper_end[k];
            int32_t e = upper_begin[k];
            if (e < last && upper_vertex[last - 1] >= zeroed && zeroed < part_end)
                zeroed = tm_force_zero(zeroed, upper_vertex[last - 1] + 1, part_end, force_N);
            for (; e < last && upper_vertex[e] < part_end; e++) {
                const TM_OF(rows) K = TM_OF(load_rows)(edge_tensor, edge_last, e);
                const int64_t l = 3 * (int64_t)upper_vertex[e];
                f = TM_OF(add_product)(f, &K, u_m + l);
                TM_OF(take_transposed)(force_N + l, &K, x, y, z);
            }
            for (; e < last; e++) { /* edges into later partitions */
                const TM_OF(rows) K = TM_OF(load_rows)(edge_tensor, edge_last, e);
                f = TM_OF(add_product)(f, &K, u_m + 3 * (int64_t)upper_vertex[e]);
            }
            double *at = force_N + 3 * (int64_t)k;
            at[0] -= vaddvq_f64(f.x) + vgetq_lane_f64(f.third, 0) + A[0] * x + A[1] * y + A[2] * z;
            at[1] -= vaddvq_f64(f.y) + vgetq_lane_f64(f.third, 1) + A[3] * x + A[4] * y + A[5] * z;
            at[2] -= vaddvq_f64(f.z) + f.last + A[6] * x + A[7] * y + A[8] * z;
        }
    part->zeroed = zeroed;
}
