/* The graph and the kernels of the force loop. Its arrays never overlap (TM_RESTRICT). The AVX2 form is written by
 * hand: a block's three columns fill no vector, so compilers do not find it. The plain C form is the reference; its
 * order of sums is fixed (see force_kernel.h). */
#ifndef TM_KERNEL_H
#define TM_KERNEL_H

#include <stdbool.h>
#include <stdint.h>

#include "base/simd.h"

enum { TM_FORCE_RING = 1024 }; /* 32 kB, the size of the nearest cache */

/* Input of the force loop: the active vertices and, for each, its active upper edges (k,l), l>k. They are at the front
 * of the vertex's range, ascending. Removed edges are not read. */
typedef struct tm_force_graph {
    int32_t vertex_count;
    uint64_t *active;      /* [vertex_count/64 rounded up] a bit for each vertex with mass or damping */
    int32_t *upper_begin;  /* [vertex_count+1] first slot of each vertex's range */
    int32_t *upper_end;    /* [vertex_count] one past its last active edge */
    int32_t *upper_vertex; /* [edge_count] by slot: l */
    double *vertex_tensor; /* [9*vertex_count] double even when edges are single: an eighth of the data, and the larger
                              numbers */
    void *edge_tensor; /* by slot. Double: [8*edge_count], a block's numbers without the ninth: one cache line. Single:
                          [9*edge_count], padded; there a split brings nothing */
    double *edge_last; /* [edge_count] by slot: the ninth. Null: single */
    int32_t ring; /* partial sums of a SIMD pass, a power of two above the largest distance of neighbours' numbers; 0:
                     none, the distance exceeds TM_FORCE_RING */
} tm_force_graph;

/* Reads the block of a slot, row by row, in either precision. */
static inline void tm_edge_read(const tm_force_graph *graph, int32_t slot, double K[9]) {
    const double *eight = (const double *)graph->edge_tensor + 8 * (int64_t)slot;
    const float *nine = (const float *)graph->edge_tensor + 9 * (int64_t)slot;
    for (int i = 0; i < 9; i++) K[i] = !graph->edge_last ? (double)nine[i] : i < 8 ? eight[i] : graph->edge_last[slot];
}
static inline void tm_edge_write(const tm_force_graph *graph, int32_t slot, const double K[9]) {
    double *eight = (double *)graph->edge_tensor + 8 * (int64_t)slot;
    float *nine = (float *)graph->edge_tensor + 9 * (int64_t)slot;
    for (int i = 0; i < 9; i++)
        if (!graph->edge_last)
            nine[i] = (float)K[i];
        else
            *(i < 8 ? eight + i : graph->edge_last + slot) = K[i];
}
/* Moves the blocks of `count` slots from `from` to `to`. */
void tm_edge_move(const tm_force_graph *graph, int32_t to, int32_t from, int32_t count);

/* Returns the first index from `at` on whose bit differs from `flip` (0 or all ones); n: none. */
static inline int32_t tm_bit_from(const uint64_t *bits, int32_t n, int32_t at, uint64_t flip) {
    while (at < n) {
        const uint64_t word = (bits[at / 64] ^ flip) >> (at % 64);
        if (word) {
            at += __builtin_ctzll(word);
            return at < n ? at : n;
        }
        at = (at / 64 + 1) * 64;
    }
    return n;
}

/* Finds the next run of active vertices from `*end` on: [*begin, *end). Start with *end = 0. Returns false if none is
 * left. A complete organ is one run. */
static inline bool tm_next_run(const uint64_t *active, int32_t n, int32_t *begin, int32_t *end) {
    *begin = tm_bit_from(active, n, *end, 0);
    *end = tm_bit_from(active, n, *begin, ~UINT64_C(0));
    return *begin < n;
}

/* A partition of a pass: the vertices whose complete force one thread computes, in the order of the complete pass. So
 * results are bit-identical for any partition ends: an edge across an end is computed on both sides, each for its own
 * vertex. */
typedef struct tm_force_partition {
    _Alignas(64) int32_t begin; /* its vertices [begin, end); lines of its own: `zeroed` changes */
    int32_t end;
    int32_t halo_count;
    const int32_t *halo; /* [halo_count] vertices before `begin` with an upper edge into the partition, ascending */
    int32_t zeroed;      /* of a running pass: force_N is set from `begin` to here */
    double *ring; /* [4*graph->ring], aligned to 64 bytes, of a running pass: partial sums of the next vertices */
} tm_force_partition;

static inline tm_force_partition tm_force_whole(const tm_force_graph *graph) {
    return (tm_force_partition){.begin = 0, .end = graph->vertex_count};
}

/* Zeroes force_N up to vertex `to` and a little further. This runs just ahead of the rows, so that the values are still
 * in the cache. Returns how far. */
static inline int32_t tm_force_zero(int32_t from, int32_t to, int32_t end, double *TM_RESTRICT force_N) {
    enum { AHEAD = 64 };
    to = to < end - AHEAD ? to + AHEAD : end;
    for (int64_t i = 3 * (int64_t)from; i < 3 * (int64_t)to; i++) force_N[i] = 0.0;
    return to;
}

/* force := -K u on the vertices [begin, end) of a partition. A pass calls it from the partition's begin to its end,
 * without gaps: until then values after `end` are partial or unset. */
typedef void (*tm_force_kernel)(const tm_force_graph *graph, tm_force_partition *part, int32_t begin, int32_t end,
                                const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N);

/* Runs the pass over vertices that have no edge to others: all, or some bodies. */
static inline void tm_force_pass_range(tm_force_kernel kernel, const tm_force_graph *graph, int32_t begin, int32_t end,
                                       const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N) {
    _Alignas(64) double ring[4 * TM_FORCE_RING];
    tm_force_partition range = {.begin = begin, .end = end, .ring = ring};
    kernel(graph, &range, begin, end, u_m, force_N);
}

/* Runs the complete pass. */
static inline void tm_force_pass(tm_force_kernel kernel, const tm_force_graph *graph, const double *TM_RESTRICT u_m,
                                 double *TM_RESTRICT force_N) {
    tm_force_pass_range(kernel, graph, 0, graph->vertex_count, u_m, force_N);
}

#define TM_FORCE_DECLARE(name)                                                                                         \
    void name(const tm_force_graph *graph, tm_force_partition *part, int32_t begin, int32_t end,                       \
              const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N)
TM_FORCE_DECLARE(tm_force_plain_double);
TM_FORCE_DECLARE(tm_force_plain_single);
TM_FORCE_DECLARE(tm_force_avx2_double);
TM_FORCE_DECLARE(tm_force_avx2_single);
TM_FORCE_DECLARE(tm_force_neon_double);
TM_FORCE_DECLARE(tm_force_neon_single);

/* Returns the fastest form of this processor, or the plain one. Vertex tensors and single edges must be padded by
 * TM_FORCE_PADDING numbers. */
enum { TM_FORCE_PADDING = 4 };
tm_force_kernel tm_force_choose(bool plain, bool single);
/* Returns whether it is an AVX2 form, so that the processor has AVX2. */
bool tm_force_is_wide(tm_force_kernel kernel);

#endif
