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

/* force := -K u. `vertex` [9*vertex_count] and `edge` [9*edge_count] hold float or double tensors. */
typedef void (*tm_force_kernel)(int32_t vertex_count, const int32_t *TM_RESTRICT upper_begin,
                                const int32_t *TM_RESTRICT edge_vertex, const void *vertex, const void *edge,
                                const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N);

#define TM_FORCE_DECLARE(name)                                                                                         \
    void name(int32_t vertex_count, const int32_t *TM_RESTRICT upper_begin, const int32_t *TM_RESTRICT edge_vertex,    \
              const void *vertex, const void *edge, const double *TM_RESTRICT u_m, double *TM_RESTRICT force_N)
TM_FORCE_DECLARE(tm_force_plain_double);
TM_FORCE_DECLARE(tm_force_plain_single);
TM_FORCE_DECLARE(tm_force_avx2_double);
TM_FORCE_DECLARE(tm_force_avx2_single);

/* The best this processor has, or the plain form. Tensors must be padded by TM_FORCE_PADDING numbers. */
enum { TM_FORCE_PADDING = 4 };
tm_force_kernel tm_force_choose(bool plain, bool single);

#endif
