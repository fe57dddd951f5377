/* The one header with `restrict` and intrinsics. The force loop's arrays never overlap, and only told so does the
 * compiler keep sums in registers; it does not find the AVX2 form by itself, for a block's three columns fill no
 * vector. The plain C form is the reference; its order of sums is fixed (see force_kernel.h). */
#ifndef TM_KERNEL_H
#define TM_KERNEL_H

#include <stdbool.h>
#include <stdint.h>

#if defined(__x86_64__) && (defined(__GNUC__) || defined(__clang__))
#include <immintrin.h>
#define TM_HAS_AVX2 1
#define TM_AVX2 __attribute__((target("avx2,fma")))
#endif

#define TM_RESTRICT restrict

/* What the force loop walks: the living vertices, and in each one's room of upper edges (k,l), l>k, the living ones, at
 * its front and ascending. What is dead is not read. */
typedef struct tm_force_graph {
    int32_t vertex_count;
    uint64_t *living;      /* [vertex_count/64 rounded up] a bit for each vertex with mass or damping */
    int32_t *upper_begin;  /* [vertex_count+1] first slot of each vertex's room */
    int32_t *upper_end;    /* [vertex_count] one past its last living edge */
    int32_t *upper_vertex; /* [edge_count] by slot: l */
    double *vertex_tensor; /* [9*vertex_count] double even when edges are single: an eighth of the whole, and the larger
                              numbers */
    void *edge_tensor;     /* [9*edge_count] by slot, double or float */
} tm_force_graph;

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
static inline bool tm_next_run(const uint64_t *living, int32_t n, int32_t *begin, int32_t *end) {
    *begin = tm_bit_from(living, n, *end, 0);
    *end = tm_bit_from(living, n, *begin, ~UINT64_C(0));
    return *begin < n;
}

/* force := -K u. */
typedef void (*tm_force_kernel)(const tm_force_graph *graph, const double *TM_RESTRICT u_m,
                                double *TM_RESTRICT force_N);

#define TM_FORCE_DECLARE(name)                                                                                         \
    void name(const tm_force_graph *graph, const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N)
TM_FORCE_DECLARE(tm_force_plain_double);
TM_FORCE_DECLARE(tm_force_plain_single);
TM_FORCE_DECLARE(tm_force_avx2_double);
TM_FORCE_DECLARE(tm_force_avx2_single);

/* The best this processor has, or the plain form. Tensors must be padded by TM_FORCE_PADDING numbers. */
enum { TM_FORCE_PADDING = 4 };
tm_force_kernel tm_force_choose(bool plain, bool single);

#endif
