/* The plain force loop, included once for double and once for single tensors: TM_REAL, TM_NAME, TM_HALO, TM_BLOCK and
 * TM_NINTH are set by the includer.
 *
 * It adds over active vertices ascending, and within a vertex over its active upper edges ascending. F_k gets first
 * -K_jk^T u_j of the lower neighbours in ascending order, then -K_kk u_k - sum of K_kl u_l. Bit-identical results rely
 * on this order. */

/* Adds the contributions of rows before the partition. Other partitions own these rows and add only to their
 * vertices. */
static int32_t TM_HALO(const tm_force_graph *graph, const tm_force_partition *partition, const double *TM_RESTRICT u_m,
                       double *TM_RESTRICT force_N) {
    int32_t zeroed = partition->begin;
    for (int32_t i = 0; i < partition->halo_count; i++) {
        const int32_t j = partition->halo[i];
        const double x = u_m[3 * j], y = u_m[3 * j + 1], z = u_m[3 * j + 2];
        for (int32_t e = graph->upper_begin[j]; e < graph->upper_end[j] && graph->upper_vertex[e] < partition->end;
             e++) {
            const TM_REAL *K = TM_BLOCK(graph->edge_tensor, e);
            const double ninth = TM_NINTH(K, graph->edge_last, e);
            const int32_t l = 3 * graph->upper_vertex[e];
            if (graph->upper_vertex[e] < partition->begin) continue;
            if (graph->upper_vertex[e] >= zeroed)
                zeroed = tm_force_zero(zeroed, graph->upper_vertex[e] + 1, partition->end, force_N);
            force_N[l] -= (double)K[0] * x + (double)K[3] * y + (double)K[6] * z;
            force_N[l + 1] -= (double)K[1] * x + (double)K[4] * y + (double)K[7] * z;
            force_N[l + 2] -= (double)K[2] * x + (double)K[5] * y + ninth * z;
        }
    }
    return zeroed;
}

void TM_NAME(const tm_force_graph *graph, tm_force_partition *partition, int32_t from, int32_t to,
             const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N) {
    const double *TM_RESTRICT vertex_tensor = graph->vertex_tensor;
    const TM_REAL *TM_RESTRICT edge_tensor = graph->edge_tensor;
    const int32_t *TM_RESTRICT upper_begin = graph->upper_begin, *TM_RESTRICT upper_end = graph->upper_end;
    const int32_t *TM_RESTRICT upper_vertex = graph->upper_vertex, part_end = partition->end;
    int32_t zeroed = from == partition->begin ? TM_HALO(graph, partition, u_m, force_N) : partition->zeroed;
    if (to > zeroed) zeroed = tm_force_zero(zeroed, to, part_end, force_N);
    for (int32_t begin, end = from; tm_next_run(graph->active, to, &begin, &end);)
        for (int32_t k = begin; k < end; k++) {
            const int32_t last = upper_end[k];
            const double *A = vertex_tensor + 9 * (int64_t)k;
            const double x = u_m[3 * k], y = u_m[3 * k + 1], z = u_m[3 * k + 2];
            double fx = A[0] * x + A[1] * y + A[2] * z;
            double fy = A[3] * x + A[4] * y + A[5] * z;
            double fz = A[6] * x + A[7] * y + A[8] * z;
            int32_t e = upper_begin[k];
            if (e < last && upper_vertex[last - 1] >= zeroed && zeroed < part_end)
                zeroed = tm_force_zero(zeroed, upper_vertex[last - 1] + 1, part_end, force_N);
            for (; e < last && upper_vertex[e] < part_end; e++) {
                const TM_REAL *K = TM_BLOCK(edge_tensor, e);
                const double ninth = TM_NINTH(K, graph->edge_last, e);
                const int32_t l = 3 * upper_vertex[e];
                const double p = u_m[l], q = u_m[l + 1], r = u_m[l + 2];
                fx += (double)K[0] * p + (double)K[1] * q + (double)K[2] * r;
                fy += (double)K[3] * p + (double)K[4] * q + (double)K[5] * r;
                fz += (double)K[6] * p + (double)K[7] * q + ninth * r;
                force_N[l] -= (double)K[0] * x + (double)K[3] * y + (double)K[6] * z;
                force_N[l + 1] -= (double)K[1] * x + (double)K[4] * y + (double)K[7] * z;
                force_N[l + 2] -= (double)K[2] * x + (double)K[5] * y + ninth * z;
            }
            for (; e < last; e++) { /* edges into later partitions, which read this row themselves */
                const TM_REAL *K = TM_BLOCK(edge_tensor, e);
                const double ninth = TM_NINTH(K, graph->edge_last, e);
                const double *u = u_m + 3 * upper_vertex[e];
                fx += (double)K[0] * u[0] + (double)K[1] * u[1] + (double)K[2] * u[2];
                fy += (double)K[3] * u[0] + (double)K[4] * u[1] + (double)K[5] * u[2];
                fz += (double)K[6] * u[0] + (double)K[7] * u[1] + ninth * u[2];
            }
            force_N[3 * k] -= fx;
            force_N[3 * k + 1] -= fy;
            force_N[3 * k + 2] -= fz;
        }
    partition->zeroed = zeroed;
}
