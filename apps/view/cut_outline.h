/* Outline of a cut: the rim between its wall and the outer surface, drawn as one curve that both share. */
#ifndef VIEW_RIM_H
#define VIEW_RIM_H

#include "picture.h"
#include <stdint.h>

/* --- sides of triangles, sorted by their edges --- */

/* Side `local` runs from corner local to the next one. */
typedef struct view_side {
    uint64_t key; /* lower vertex of the edge in the upper half, higher vertex in the lower half */
    int32_t triangle, local;
} view_side;

/* Returns the sorted sides [3*triangle_count], to be freed. Sides of one edge are adjacent, ordered by triangle.
 * Returns null if memory is exhausted. */
view_side *view_sides_sorted(const uint32_t *index, int32_t triangle_count);
/* Returns one past the last side on the edge of side i. */
static inline int32_t view_sides_end(const view_side *sides, int32_t count, int32_t i) {
    int32_t end = i + 1;
    while (end < count && sides[end].key == sides[i].key) ++end;
    return end;
}

enum { VIEW_RIM_LEVELS = 2 };

/* A segment of the rim between two points. `before` and `after` are the next points along the rim, or the segment's own
 * end where the rim forks or ends. */
typedef struct view_rim_piece {
    int32_t from, to, before, after;
} view_rim_piece;

/* Points of a cut's rim. All zero: no cut. The surface's rim vertices come first, then the middles of the segments,
 * level by level. */
typedef struct view_rim {
    int32_t point_count[VIEW_RIM_LEVELS + 1]; /* vertices; with the first split's middles; with the second's */
    int32_t *vertex;                          /* [point_count[0]] vertices of the surface */
    int32_t *point;                           /* [vertex_count of the surface] point on the rim; -1: none */
    int32_t piece_count[VIEW_RIM_LEVELS];
    view_rim_piece *piece[VIEW_RIM_LEVELS];
    int32_t *first[VIEW_RIM_LEVELS], *next[VIEW_RIM_LEVELS]; /* linked list of the segments that begin at a point */
    float *at;                                               /* [3*points] m */
} view_rim;

/* Finds the rim of this surface, whose triangles must not change. Returns false if memory is exhausted; the rim is then
 * empty. */
bool view_rim_take(view_rim *rim, const view_surface *surface, int levels);
/* Returns the point in the middle of the segment between two points of a level; -1 if there is no such segment. */
int32_t view_rim_middle(const view_rim *rim, int level, int32_t a, int32_t b);
/* Computes `at` from the positions of the surface's vertices. */
void view_rim_lay(view_rim *rim, int levels, const float *place);
void view_rim_free(view_rim *rim);

#endif
