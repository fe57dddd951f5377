/* SIMD forms that a build may use in addition to the plain one; those of the processor are found at run time. */
#ifndef TM_SIMD_H
#define TM_SIMD_H

/* Not by gcc for Windows: it misaligns spilled vectors (gcc bug 54412). TM_PLAIN_ONLY: builds that need one form. */
#if !defined(TM_PLAIN_ONLY) && defined(__x86_64__) && (defined(__clang__) || (defined(__GNUC__) && !defined(_WIN32)))
#define TM_HAS_AVX2 1
#define TM_AVX2 __attribute__((target("avx2,fma")))
#else
#define TM_AVX2
#endif
/* For arrays that never overlap: lets the compiler keep sums in registers. */
#define TM_RESTRICT restrict

#ifdef __aarch64__
#define TM_HAS_NEON 1
#endif

#endif
