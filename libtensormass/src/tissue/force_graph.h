/* The force loop. Its arrays never overlap (TM_RESTRICT). The compiler does not find the AVX2 form by itself, for a
 * block's three columns fill no vector. The plain C form is the reference; its order of sums is fixed (see
 * force_kernel.h). */
#ifndef TM_KERNEL_H
#define TM_KERNEL_H

#include <stdbool.h>
#include <stdint.h>

#include "base/simd.h"

enum { TM_FORCE_RING = 1024 }; /* 32 kB, what the nearest cache holds */

/* What the force loop walks: the living vertices, and in each one's room of upper edges (k,l), l>k, the living ones, at
 * its front and ascending. What is dead is not read. */
typedef struct tm_force_graph {
    int32_t vertex_count;
    uint64_t *active;      /* [vertex_count/64 rounded up] a bit for each vertex with mass or damping */
    int32_t *upper_begin;  /* [vertex_count+1] first slot of each vertex's room */
    int32_t *upper_end;    /* [vertex_count] one past its last living edge */
    int32_t *upper_vertex; /* [edge_count] by slot: l */
    double *vertex_tensor; /* [9*vertex_count] double even when edges are single: an eighth of the whole, and the larger
                              numbers */
    void *edge_tensor;     /* by slot. Double: [8*edge_count], a block's nine but for the last, so that it fills a cache
                              line and lies on no border. Single: [9*edge_count], padded; there that brings nothing */
    double *edge_last;     /* [edge_count] by slot: the ninth. Null: single */
    int32_t ring;          /* half sums that a wide pass keeps, a power of two: more than neighbours' numbers are apart;
                              0: none, they are too far apart for TM_FORCE_RING */
} tm_force_graph;

/* The block of a slot, row by row; whatever its precision. */
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
/* Moves the blocks of `count` slots: to `to`, those that began at `from`. */
void tm_edge_move(const tm_force_graph *graph, int32_t to, int32_t from, int32_t count);

/* The first place from `at` on whose bit is not that of `flip` (0 or all ones); n: none. */
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

/* The next run of living vertices from `*end` on: [*begin, *end). Start with *end = 0. False: none is left. A whole
 * organ is one run. */
static inline bool tm_next_run(const uint64_t *active, int32_t n, int32_t *begin, int32_t *end) {
    *begin = tm_bit_from(active, n, *end, 0);
    *end = tm_bit_from(active, n, *begin, ~UINT64_C(0));
    return *begin < n;
}

/* A part of a pass: the vertices that one thread computes the force on, all of it, in the order of the whole pass. So
 * every division into parts has the same bits: what crosses a border is computed on both sides of it, each taking its
 * own end. */
typedef struct tm_force_partition {
    _Alignas(64) int32_t begin; /* [begin, end) of the vertices; alone on its cache lines, for `zeroed` changes */
    int32_t end;
    int32_t halo_count;
    const int32_t *halo; /* [halo_count] vertices before `begin` with an upper edge into the part, ascending */
    int32_t zeroed;      /* of a pass under way: force_N is set from `begin` to here */
    double *ring;        /* [4*graph->ring], aligned to 64 bytes, of a pass under way: half sums of the next vertices */
} tm_force_partition;

static inline tm_force_partition tm_force_whole(const tm_force_graph *graph) {
    return (tm_force_partition){.begin = 0, .end = graph->vertex_count};
}

/* Sets force_N to zero up to vertex `to`, and some further: just ahead of the rows, so that it is still in the cache
 * when they add to it. Returns how far. */
static inline int32_t tm_force_zero(int32_t from, int32_t to, int32_t end, double *TM_RESTRICT force_N) {
    enum { AHEAD = 64 };
    to = to < end - AHEAD ? to + AHEAD : end;
    for (int64_t i = 3 * (int64_t)from; i < 3 * (int64_t)to; i++) force_N[i] = 0.0;
    return to;
}

/* force := -K u on the vertices [begin, end) of a part. A pass calls it from the part's begin to its end, without
 * gaps: what lies behind `end` is half a sum, or nothing, until then. */
typedef void (*tm_force_kernel)(const tm_force_graph *graph, tm_force_partition *part, int32_t begin, int32_t end,
                                const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N);

/* The whole pass. */
static inline void tm_force_pass(tm_force_kernel kernel, const tm_force_graph *graph, const double *TM_RESTRICT u_m,
                                 double *TM_RESTRICT force_N) {
    _Alignas(64) double ring[4 * TM_FORCE_RING];
    tm_force_partition whole = tm_force_whole(graph);
    whole.ring = ring;
    kernel(graph, &whole, whole.begin, whole.end, u_m, force_N);
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

/* The best this processor has, or the plain form. Vertex tensors and single edges must be padded by TM_FORCE_PADDING
 * numbers. */
enum { TM_FORCE_PADDING = 4 };
tm_force_kernel tm_force_choose(bool plain, bool single);
/* Is it one of the AVX2 forms, so that the processor has AVX2? */
bool tm_force_is_wide(tm_force_kernel kernel);

#endif
