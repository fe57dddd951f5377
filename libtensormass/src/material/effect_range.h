/* Where an effect acts: in some bodies of a tissue, or in all (tm_tissue_def.region_effects). Bodies share no vertex,
 * so an effect's vertices and tetrahedra are a few ranges, and it reads, writes and stores nothing of the others. */
#ifndef TM_EFFECT_RANGE_H
#define TM_EFFECT_RANGE_H

#include <string.h>

#include "base/base_internal.h"
#include "material/material_field.h"

/* Ascending ranges of vertices, or of tetrahedra. */
typedef struct tm_ranges {
    int32_t count;
    const int32_t *end; /* [2*count] begin and end of each */
} tm_ranges;

/* Lists the vertices where all effects of `with` (a sum of tm_region_effect) act, and none of `without`. Returns false
 * without memory. */
bool tm_effect_vertices(tm_ranges *ranges, tm_pool *pool, const tm_material_field *field, int with, int without);
/* The same for tetrahedra; a range ends where the next region has other effects. */
bool tm_effect_tets(tm_ranges *ranges, tm_pool *pool, const tm_material_field *field, int with, int without);
/* Return whether these effects all act in all regions; whether they all act in some region. */
bool tm_effect_is_everywhere(const tm_material_field *field, int effects);
bool tm_effects_meet(const tm_material_field *field, int effects);

/* Finds the next part of [first, last) that is in a range. Start with *i = 0. Returns false if none is left. */
static inline bool tm_ranges_next(const tm_ranges *ranges, int32_t *i, int32_t first, int32_t last, int32_t *begin,
                                  int32_t *end) {
    while (*i < ranges->count && ranges->end[2 * *i + 1] <= first) ++*i;
    if (*i == ranges->count || ranges->end[2 * *i] >= last) return false;
    *begin = ranges->end[2 * *i] > first ? ranges->end[2 * *i] : first;
    *end = ranges->end[2 * *i + 1] < last ? ranges->end[2 * *i + 1] : last;
    ++*i;
    return true;
}

/* The numbers that an array of the ranges' vertices needs, and the first of them. Arrays reach from the first to the
 * last vertex, and are indexed by the mesh's vertices (tm_shifted). */
static inline int32_t tm_ranges_first(const tm_ranges *r) { return r->count ? r->end[0] : 0; }
static inline int32_t tm_ranges_length(const tm_ranges *r) {
    return r->count ? r->end[2 * r->count - 1] - r->end[0] : 0;
}

/* Returns the ranges; null if they hold all `count` items. */
static inline const tm_ranges *tm_ranges_within(const tm_ranges *r, int32_t count) {
    return r->count == 1 && tm_ranges_length(r) == count ? NULL : r;
}

/* Sets the vectors of the ranges' vertices to zero. */
static inline void tm_ranges_clear(const tm_ranges *r, double *vectors) {
    for (int32_t i = 0; i < r->count; i++)
        memset(vectors + 3 * (int64_t)r->end[2 * i], 0,
               3 * sizeof(double) * (size_t)(r->end[2 * i + 1] - r->end[2 * i]));
}

/* Returns the array whose element `first` is the first one of `array`. */
static inline void *tm_shifted(void *array, size_t element, int64_t first) {
    return array ? (void *)((uintptr_t)array - element * (uintptr_t)first) : NULL;
}

#endif
