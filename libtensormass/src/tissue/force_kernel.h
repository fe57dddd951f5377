/* The plain force loop, included once for double and once for single tensors: TM_REAL and TM_NAME are set by the
 * includer.
 *
 * Living vertices ascending, and within a vertex its living upper edges ascending: what reaches F_k is first -K_jk^T
 * u_j of the lower neighbours in ascending order, then -K_kk u_k - sum of K_kl u_l. This order is the promise behind
 * equal bits. */
void TM_NAME(const tm_force_graph *graph, const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N) {
    const double *TM_RESTRICT vertex_tensor = graph->vertex_tensor;
    const TM_REAL *TM_RESTRICT edge_tensor = graph->edge_tensor;
    const int32_t *TM_RESTRICT upper_begin = graph->upper_begin, *TM_RESTRICT upper_end = graph->upper_end;
    const int32_t *TM_RESTRICT upper_vertex = graph->upper_vertex, n = graph->vertex_count;
    for (int32_t i = 0; i < 3 * n; i++) force_N[i] = 0.0;
    for (int32_t begin, end = 0; tm_next_run(graph->living, n, &begin, &end);)
        for (int32_t k = begin; k < end; k++) {
            const double *A = vertex_tensor + 9 * (int64_t)k;
            const double x = u_m[3 * k], y = u_m[3 * k + 1], z = u_m[3 * k + 2];
            double fx = A[0] * x + A[1] * y + A[2] * z;
            double fy = A[3] * x + A[4] * y + A[5] * z;
            double fz = A[6] * x + A[7] * y + A[8] * z;
            for (int32_t e = upper_begin[k]; e < upper_end[k]; e++) {
                const TM_REAL *K = edge_tensor + 9 * (int64_t)e;
                const int32_t l = 3 * upper_vertex[e];
                const double p = u_m[l], q = u_m[l + 1], r = u_m[l + 2];
                fx += (double)K[0] * p + (double)K[1] * q + (double)K[2] * r;
                fy += (double)K[3] * p + (double)K[4] * q + (double)K[5] * r;
                fz += (double)K[6] * p + (double)K[7] * q + (double)K[8] * r;
                force_N[l] -= (double)K[0] * x + (double)K[3] * y + (double)K[6] * z;
                force_N[l + 1] -= (double)K[1] * x + (double)K[4] * y + (double)K[7] * z;
                force_N[l + 2] -= (double)K[2] * x + (double)K[5] * y + (double)K[8] * z;
            }
            force_N[3 * k] -= fx;
            force_N[3 * k + 1] -= fy;
            force_N[3 * k + 2] -= fz;
        }
}
