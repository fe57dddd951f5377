/* The reference loop, compiled with the flags of any other file. */
#include "naive.h"

#define NAIVE(name) naive_plain_##name
#include "naive_loop.h"
