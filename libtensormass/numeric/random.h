/* Random numbers, the same everywhere. The state is the caller's; upper bits are the better ones. */
#ifndef NUM_RANDOM_H
#define NUM_RANDOM_H

#include <stdint.h>

/* Linear congruential: any state will do. */
static inline uint32_t num_random32(uint32_t *state) { return *state = *state * 1664525u + 1013904223u; }
static inline uint64_t num_random64(uint64_t *state) {
    return *state = *state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
}

/* Xorshift: a state other than 0. */
static inline uint64_t num_xorshift64(uint64_t *state) {
    *state ^= *state << 13, *state ^= *state >> 7, *state ^= *state << 17;
    return *state;
}

/* [0,1) of 64 random bits. */
static inline double num_unit(uint64_t bits) { return (double)(bits >> 11) / 9007199254740992.0; }

#endif
