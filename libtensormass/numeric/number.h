/* The number type of headers that are compiled twice: the simulation sets LAW_REAL to `double`, the controller's core
 * to `float`, before it includes one. A translation unit knows one of the two. Those headers, here and in contact_law/,
 * include nothing but the C library's types and `sqrt`-free arithmetic, hold no state and allocate nothing.
 */
#ifndef LAW_NUMBER_H
#define LAW_NUMBER_H

#include <stdbool.h>
#include <stdint.h>

#ifndef LAW_REAL
#error "set LAW_REAL to double or float before a header of numeric or law"
#endif
/* A controller's flash is small: there it is set so that a function of the law is in it once. */
#ifndef LAW_CALL
#define LAW_CALL inline
#endif

typedef LAW_REAL law_real;
#define LAW(number) ((law_real)(number))

/* fmax and fmin are calls, for the sake of NaN and signed zero. */
static inline law_real law_max(law_real a, law_real b) { return a > b ? a : b; }
static inline law_real law_min(law_real a, law_real b) { return a < b ? a : b; }
static inline law_real law_clamp(law_real x, law_real low, law_real high) {
    return x < low ? low : x > high ? high : x;
}

/* 0 below -1, 1 above 1, smooth between; ramp(t) + ramp(-t) = 1. */
static LAW_CALL law_real law_ramp(law_real t) {
    const law_real q = law_clamp(LAW(0.5) * (t + LAW(1)), LAW(0), LAW(1));
    return q * q * (LAW(3) - LAW(2) * q);
}

#endif
