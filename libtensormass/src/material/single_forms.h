/* Includes TM_KERNEL once for each form in single precision, with TM_FLOATS set. The includer defines TM_KERNEL, and
 * TM_FORM(form, x), the name of x in the form plain, avx2 or neon. No guard: two files have kernels of their own. */
#include "base/intrinsics.h"

#pragma GCC diagnostic ignored "-Wpsabi" /* vectors never cross a call: every function that takes them is inlined */

#define TM_FLOATS
#define TM_NAME(x) TM_FORM(plain, x)
#define TM_TARGET
#define TM_WIDTH 4
#include TM_KERNEL
#undef TM_NAME
#undef TM_TARGET
#undef TM_WIDTH

#ifdef TM_HAS_AVX2
#define TM_NAME(x) TM_FORM(avx2, x)
#define TM_TARGET __attribute__((target("avx2")))
#define TM_WIDTH 8
#include TM_KERNEL
#undef TM_NAME
#undef TM_TARGET
#undef TM_WIDTH
#endif

#ifdef TM_HAS_NEON
#define TM_NEON_FORM
#define TM_NAME(x) TM_FORM(neon, x)
#define TM_TARGET
#define TM_WIDTH 4
#include TM_KERNEL
#undef TM_NAME
#undef TM_TARGET
#undef TM_WIDTH
#undef TM_NEON_FORM
#endif
#undef TM_FLOATS
