/* The force loops: the plain reference in both precisions, the AVX2 or NEON forms where they can be, and the choice
 * between them. */
#include "tissue/kernel.h"

#include <stddef.h>
#include <string.h>

#define TM_REAL double
#define TM_NAME tm_force_plain_double
#define TM_BELOW below_plain_double
#include "tissue/force_kernel.h"
#undef TM_REAL
#undef TM_NAME
#undef TM_BELOW

#define TM_REAL float
#define TM_NAME tm_force_plain_single
#define TM_BELOW below_plain_single
#include "tissue/force_kernel.h"
#undef TM_REAL
#undef TM_NAME
#undef TM_BELOW

#ifdef TM_HAS_AVX2
#define TM_REAL double
#define TM_NAME tm_force_avx2_double
#define TM_BELOW below_avx2_double
#define TM_LOAD4(from) _mm256_loadu_pd(from)
#include "tissue/force_avx2_kernel.h"
#undef TM_REAL
#undef TM_NAME
#undef TM_BELOW
#undef TM_LOAD4

#define TM_REAL float
#define TM_NAME tm_force_avx2_single
#define TM_BELOW below_avx2_single
#define TM_LOAD4(from) _mm256_cvtps_pd(_mm_loadu_ps(from))
#include "tissue/force_avx2_kernel.h"
#undef TM_REAL
#undef TM_NAME
#undef TM_BELOW
#undef TM_LOAD4
#endif

#ifdef TM_HAS_NEON
#define TM_REAL double
#define TM_NAME tm_force_neon_double
#define TM_OF(name) name##_neon_double
#define TM_LOAD2(from) vld1q_f64(from)
#include "tissue/force_neon_kernel.h"
#undef TM_REAL
#undef TM_NAME
#undef TM_OF
#undef TM_LOAD2

#define TM_REAL float
#define TM_NAME tm_force_neon_single
#define TM_OF(name) name##_neon_single
#define TM_LOAD2(from) vcvt_f64_f32(vld1_f32(from))
#include "tissue/force_neon_kernel.h"
#undef TM_REAL
#undef TM_NAME
#undef TM_OF
#undef TM_LOAD2
#endif

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
