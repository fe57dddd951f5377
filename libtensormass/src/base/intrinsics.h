/* SIMD intrinsics. A header of its own, because the compiler's takes longer to read than any of our files. */
#ifndef TM_INTRINSICS_H
#define TM_INTRINSICS_H

#include "base/simd.h"
#ifdef TM_HAS_AVX2
#include <immintrin.h>
#endif
#ifdef TM_HAS_NEON
#include <arm_neon.h>
#endif

#endif
