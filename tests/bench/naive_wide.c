/* The yardstick as a compiler makes it that may use AVX2 and FMA, as the library's best form does: see module.mk. */
#include "naive.h"

#define NAIVE(name) naive_wide_##name
#include "naive_loop.h"
