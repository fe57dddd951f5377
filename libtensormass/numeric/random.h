/* Random numbers, equal on all platforms. The caller owns the state; the upper bits are better. */
#ifndef NUM_RANDOM_H
#define NUM_RANDOM_H

#include <stdint.h>

/* Linear congruential generator; any state is valid. */
static inline uint32_t num_random32(uint32_t *state) { return *state = *state * 1664525u + 1013904223u; }
static inline uint64_t num_random64(uint64_t *state) {
    return *state = *state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
}

/* Xorshift; the state must not be 0. */
static inline uint64_t num_xorshift64(uint64_t *state) {
    *state ^= *state << 13, *state ^= *state >> 7, *state ^= *state << 17;
    return *state;
}

/* Converts 64 random bits to [0,1). */
static inline double num_unit(uint64_t bits) { return (double)(bits >> 11) / 9007199254740992.0; }

#endif
