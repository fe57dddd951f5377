/* The force loop with AVX2 and FMA, included once for double and once for single tensors. The includer sets TM_REAL,
 * TM_OF (makes names of this precision), TM_NAME, TM_BLOCK, TM_LOAD4 and TM_LAST_ROW. The order of sums is that of
 * force_kernel.h, but fused and by lanes: it agrees with the plain form to rounding, not in bits.
 *
 * A block's rows are loaded as four numbers, the fourth of which belongs to the next row: it is multiplied by a zero
 * lane of u or dropped. Contributions of a row to its upper neighbours are kept in a ring buffer of partial sums, four
 * lanes a vertex, until the neighbour's own row. That takes one aligned load and store, where force_N takes two of
 * each. A graph without a ring (graph->ring is 0, its neighbours' numbers differ too much) adds to force_N. Both have
 * the same bits. */
typedef struct {
    __m256d a, b, c;
} TM_OF(rows);

TM_AVX2 static inline TM_OF(rows) TM_OF(load)(const TM_REAL *tensor, const double *last, int64_t e) {
    (void)last; /* single has none */
    const TM_REAL *K = TM_BLOCK(tensor, e);
    TM_OF(rows) rows = {TM_LOAD4(K), TM_LOAD4(K + 3), TM_LAST_ROW(K, last, e)};
    enum { AHEAD = 96 }; /* edges: outside the caches a fifth to a quarter of the time */
    _mm_prefetch((const char *)TM_BLOCK(K, AHEAD), _MM_HINT_T0);
    /* Used twice: keeps the compiler from loading them twice. */
    __asm__("" : "+x"(rows.a), "+x"(rows.b));
    return rows;
}

/* K^T of a vertex's displacement. */
TM_AVX2 static inline __m256d TM_OF(transposed)(const TM_OF(rows) * K, const tm_spread *u) {
    return _mm256_fmadd_pd(K->c, u->z, _mm256_fmadd_pd(K->b, u->y, _mm256_mul_pd(K->a, u->x)));
}

TM_AVX2 static inline void TM_OF(add)(const TM_OF(rows) * K, __m256d u, tm_sums *f) {
    f->x = _mm256_fmadd_pd(K->a, u, f->x);
    f->y = _mm256_fmadd_pd(K->b, u, f->y);
    f->z = _mm256_fmadd_pd(K->c, u, f->z);
}

/* Adds the contributions of rows before the partition. Edges descend: those into the partition are a row's last, and
 * each has a sum of its own. Returns how far force_N is set (without a ring). */
TM_AVX2 static int32_t TM_OF(below)(const tm_force_graph *graph, const tm_force_partition *partition,
                                    const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N) {
    const size_t mask = 32 * (size_t)graph->ring - 32;
    int32_t zeroed = partition->begin;
    for (int32_t i = 0; i < partition->halo_count; i++) {
        const int32_t j = partition->halo[i], first = graph->upper_begin[j];
        const tm_spread u = tm_spread_of(u_m + 3 * (int64_t)j);
        for (int32_t e = graph->upper_end[j] - 1; e >= first && graph->upper_vertex[e] >= partition->begin; e--) {
            const int32_t l = graph->upper_vertex[e];
            if (l >= partition->end) continue;
            const TM_OF(rows) K = TM_OF(load)(graph->edge_tensor, graph->edge_last, e);
            const __m256d g = TM_OF(transposed)(&K, &u);
            if (graph->ring) {
                tm_take_from_ring(partition->ring, (size_t)l << 5 & mask, g);
                continue;
            }
            if (l >= zeroed) zeroed = tm_force_zero(zeroed, l + 1, partition->end, force_N);
            tm_take_from(force_N + 3 * (int64_t)l, g);
        }
    }
    return zeroed;
}

/* Computes the force on the active vertices [k, end). Rows with edges out of the partition need no special case: their
 * contributions to later vertices end in entries of the ring that are never read. */
TM_AVX2 static __attribute__((noinline)) void TM_OF(run)(const tm_force_graph *graph,
                                                         const tm_force_partition *partition, int32_t k, int32_t end,
                                                         const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N) {
    const TM_REAL *TM_RESTRICT edge_tensor = graph->edge_tensor;
    const double *TM_RESTRICT edge_last = graph->edge_last;
    const double *TM_RESTRICT A = graph->vertex_tensor + 9 * (int64_t)k;
    const int32_t *TM_RESTRICT upper_begin = graph->upper_begin, *TM_RESTRICT upper_end = graph->upper_end;
    const int32_t *TM_RESTRICT upper_vertex = graph->upper_vertex, slots = graph->ring;
    const size_t mask = 32 * (size_t)slots - 32;
    double *TM_RESTRICT ring = partition->ring;
    for (; k < end; k++, A += 9) {
        const __m256d uk = tm_three(u_m + 3 * (int64_t)k);
        const tm_spread u = tm_spread_of(u_m + 3 * (int64_t)k);
        tm_sums f = {_mm256_mul_pd(_mm256_loadu_pd(A), uk), _mm256_mul_pd(_mm256_loadu_pd(A + 3), uk),
                     _mm256_mul_pd(_mm256_loadu_pd(A + 6), uk)};
        const int64_t last = upper_end[k];
        for (int64_t e = upper_begin[k]; e < last; e++) {
            const TM_OF(rows) K = TM_OF(load)(edge_tensor, edge_last, e);
            const size_t l = (uint32_t)upper_vertex[e];
            TM_OF(add)(&K, tm_three(u_m + 3 * l), &f);
            tm_take_from_ring(ring, l << 5 & mask, TM_OF(transposed)(&K, &u));
        }
        double *at = ring + 4 * (size_t)(k & (slots - 1));
        tm_give_sum(force_N + 3 * (int64_t)k, at, &f);
        _mm256_store_pd(at, _mm256_setzero_pd()); /* for vertex k + slots */
    }
}

/* The same without a ring: the numbers of neighbours differ too much for one. */
TM_AVX2 static __attribute__((noinline)) int32_t
TM_OF(run_direct)(const tm_force_graph *graph, const tm_force_partition *partition, int32_t k, int32_t end,
                  int32_t zeroed, const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N) {
    const TM_REAL *TM_RESTRICT edge_tensor = graph->edge_tensor;
    const double *TM_RESTRICT edge_last = graph->edge_last, *TM_RESTRICT A = graph->vertex_tensor + 9 * (int64_t)k;
    const int32_t *TM_RESTRICT upper_vertex = graph->upper_vertex, part_end = partition->end;
    for (; k < end; k++, A += 9) {
        const __m256d uk = tm_three(u_m + 3 * (int64_t)k);
        const tm_spread u = tm_spread_of(u_m + 3 * (int64_t)k);
        tm_sums f = {_mm256_mul_pd(_mm256_loadu_pd(A), uk), _mm256_mul_pd(_mm256_loadu_pd(A + 3), uk),
                     _mm256_mul_pd(_mm256_loadu_pd(A + 6), uk)};
        const int64_t last = graph->upper_end[k];
        int64_t e = graph->upper_begin[k];
        if (e < last && upper_vertex[last - 1] >= zeroed && zeroed < part_end)
            zeroed = tm_force_zero(zeroed, upper_vertex[last - 1] + 1, part_end, force_N);
        for (; e < last && upper_vertex[e] < part_end; e++) {
            const TM_OF(rows) K = TM_OF(load)(edge_tensor, edge_last, e);
            const int64_t l = 3 * (int64_t)upper_vertex[e];
            TM_OF(add)(&K, tm_three(u_m + l), &f);
            tm_take_from(force_N + l, TM_OF(transposed)(&K, &u));
        }
        for (; e < last; e++) { /* edges into later partitions */
            const TM_OF(rows) K = TM_OF(load)(edge_tensor, edge_last, e);
            TM_OF(add)(&K, tm_three(u_m + 3 * (int64_t)upper_vertex[e]), &f);
        }
        tm_give_sum(force_N + 3 * (int64_t)k, force_N + 3 * (int64_t)k, &f);
    }
    return zeroed;
}

TM_AVX2 static void TM_OF(pass_direct)(const tm_force_graph *graph, tm_force_partition *partition, int32_t from,
                                       int32_t to, const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N) {
    if (from == partition->begin) partition->zeroed = TM_OF(below)(graph, partition, u_m, force_N);
    if (to > partition->zeroed) partition->zeroed = tm_force_zero(partition->zeroed, to, partition->end, force_N);
    for (int32_t begin, end = from; tm_next_run(graph->active, to, &begin, &end);)
        partition->zeroed = TM_OF(run_direct)(graph, partition, begin, end, partition->zeroed, u_m, force_N);
}

TM_AVX2 void TM_NAME(const tm_force_graph *graph, tm_force_partition *partition, int32_t from, int32_t to,
                     const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N) {
    if (!graph->ring) {
        TM_OF(pass_direct)(graph, partition, from, to, u_m, force_N);
        return;
    }
    if (from == partition->begin) {
        memset(partition->ring, 0, sizeof(double) * 4 * (size_t)graph->ring);
        TM_OF(below)(graph, partition, u_m, force_N);
    }
    int32_t k = from;
    for (int32_t begin, end = from; k < to; k = end) {
        if (!tm_next_run(graph->active, to, &begin, &end)) begin = end = to;
        for (int64_t i = 3 * (int64_t)k; i < 3 * (int64_t)begin; i++) force_N[i] = 0.0; /* removed */
        TM_OF(run)(graph, partition, begin, end, u_m, force_N);
    }
}
