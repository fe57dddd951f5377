/* Number type of headers that are compiled twice. The simulation defines LAW_REAL as `double`, the controller's core as
 * `float`, before it includes one; a translation unit has only one of them. Those headers, here and in contact_law/,
 * include only the C library's types, use `sqrt`-free arithmetic, and have no state and no allocation. */
#ifndef LAW_NUMBER_H
#define LAW_NUMBER_H

#include <stdbool.h>
#include <stdint.h>

#ifndef LAW_REAL
#error "set LAW_REAL to double or float before a header of numeric or law"
#endif
/* A controller's flash is small: it defines this so that each function of the law exists once. */
#ifndef LAW_CALL
#define LAW_CALL inline
#endif

typedef LAW_REAL law_real;
#define LAW(number) ((law_real)(number))

/* fmax and fmin would be calls, because of NaN and signed zero. */
static inline law_real law_max(law_real a, law_real b) { return a > b ? a : b; }
static inline law_real law_min(law_real a, law_real b) { return a < b ? a : b; }
static inline law_real law_clamp(law_real x, law_real low, law_real high) {
    return x < low ? low : x > high ? high : x;
}

/* Returns 0 below -1, 1 above 1, smooth between; ramp(t) + ramp(-t) = 1. */
static LAW_CALL law_real law_ramp(law_real t) {
    const law_real q = law_clamp(LAW(0.5) * (t + LAW(1)), LAW(0), LAW(1));
    return q * q * (LAW(3) - LAW(2) * q);
}

#endif
