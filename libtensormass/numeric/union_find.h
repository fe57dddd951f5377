/* Union-find over an array of parents; initialise it with parent[i] = i. */
#ifndef LAW_UNION_FIND_H
#define LAW_UNION_FIND_H

#include <stdint.h>

/* Returns the root of i's set; halves paths on the way. */
static inline int32_t law_root(int32_t *parent, int32_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

/* Joins two sets; the lower root becomes the root of both. */
static inline void law_join(int32_t *parent, int32_t a, int32_t b) {
    a = law_root(parent, a), b = law_root(parent, b);
    parent[a > b ? a : b] = a > b ? b : a;
}

#endif
