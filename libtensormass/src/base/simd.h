/* Which vectors a build may use beside the plain form; which of them a processor has is asked at run time. */
#ifndef TM_SIMD_H
#define TM_SIMD_H

/* Not by gcc for Windows: it does not align what it spills (gcc bug 54412). */
#if defined(__x86_64__) && (defined(__clang__) || (defined(__GNUC__) && !defined(_WIN32)))
#define TM_HAS_AVX2 1
#define TM_AVX2 __attribute__((target("avx2,fma")))
#else
#define TM_AVX2
#endif
/* Of arrays that never overlap: told so, the compiler keeps sums in registers. */
#define TM_RESTRICT restrict

#ifdef __aarch64__
#define TM_HAS_NEON 1
#endif

#endif
