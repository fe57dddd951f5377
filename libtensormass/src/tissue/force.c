/* The force loops: the plain reference in both precisions, the AVX2 or NEON forms where available, and their
 * selection. */
#include "tissue/force_graph.h"

#include <stddef.h>
#include <string.h>

#include "base/intrinsics.h"
#ifdef TM_HAS_AVX2
#include "tissue/force_avx2.h"
#endif

/* --- double --- */

#define TM_REAL double
#define TM_BLOCK(tensor, e) ((const TM_REAL *)(tensor) + 8 * (int64_t)(e))
#define TM_NINTH(K, last, e) ((last)[e])

#define TM_NAME tm_force_plain_double
#define TM_HALO halo_plain_double
#include "tissue/force_kernel.h"
#undef TM_NAME
#undef TM_HALO

#ifdef TM_HAS_AVX2
#define TM_NAME tm_force_avx2_double
#define TM_OF(name) name##_avx2_double
#define TM_LOAD4(from) _mm256_loadu_pd(from)
#define TM_LAST_ROW(K, last, e) tm_last_row((K) + 6, (last) + (e))
#include "tissue/force_avx2_kernel.h"
#undef TM_NAME
#undef TM_OF
#undef TM_LOAD4
#undef TM_LAST_ROW
#endif

#ifdef TM_HAS_NEON
#define TM_NAME tm_force_neon_double
#define TM_OF(name) name##_neon_double
#define TM_LOAD2(from) vld1q_f64(from)
#include "tissue/force_neon_kernel.h"
#undef TM_NAME
#undef TM_OF
#undef TM_LOAD2
#endif

#undef TM_REAL
#undef TM_BLOCK
#undef TM_NINTH

/* --- single --- */

#define TM_REAL float
#define TM_BLOCK(tensor, e) ((const TM_REAL *)(tensor) + 9 * (int64_t)(e))
#define TM_NINTH(K, last, e) ((double)(K)[8])

#define TM_NAME tm_force_plain_single
#define TM_HALO halo_plain_single
#include "tissue/force_kernel.h"
#undef TM_NAME
#undef TM_HALO

#ifdef TM_HAS_AVX2
#define TM_NAME tm_force_avx2_single
#define TM_OF(name) name##_avx2_single
#define TM_LOAD4(from) _mm256_cvtps_pd(_mm_loadu_ps(from))
#define TM_LAST_ROW(K, last, e) TM_LOAD4((K) + 6)
#include "tissue/force_avx2_kernel.h"
#undef TM_NAME
#undef TM_OF
#undef TM_LOAD4
#undef TM_LAST_ROW
#endif

#ifdef TM_HAS_NEON
#define TM_NAME tm_force_neon_single
#define TM_OF(name) name##_neon_single
#define TM_LOAD2(from) vcvt_f64_f32(vld1_f32(from))
#include "tissue/force_neon_kernel.h"
#undef TM_NAME
#undef TM_OF
#undef TM_LOAD2
#endif

#undef TM_REAL
#undef TM_BLOCK
#undef TM_NINTH

/* --- blocks --- */

void tm_edge_move(const tm_force_graph *graph, int32_t to, int32_t from, int32_t count) {
    const size_t bytes = graph->edge_last ? 8 * sizeof(double) : 9 * sizeof(float);
    char *tensor = graph->edge_tensor;
    memmove(tensor + bytes * (size_t)to, tensor + bytes * (size_t)from, bytes * (size_t)count);
    if (graph->edge_last) memmove(graph->edge_last + to, graph->edge_last + from, sizeof(double) * (size_t)count);
}

/* --- selection --- */

tm_force_kernel tm_force_choose(bool plain, bool single) {
#ifdef TM_HAS_AVX2
    if (!plain && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        return single ? tm_force_avx2_single : tm_force_avx2_double;
#endif
#ifdef TM_HAS_NEON
    if (!plain) return single ? tm_force_neon_single : tm_force_neon_double; /* every arm64 has it */
#endif
    (void)plain;
    return single ? tm_force_plain_single : tm_force_plain_double;
}

bool tm_force_is_wide(tm_force_kernel kernel) {
    return kernel != tm_force_plain_single && kernel != tm_force_plain_double;
}
