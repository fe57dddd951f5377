/* The reference loop, compiled with AVX2 and FMA as the library's best form: see module.mk. */
#include "naive.h"

#define NAIVE(name) naive_wide_##name
#include "naive_loop.h"
