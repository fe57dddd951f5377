/* Where a cut begins: the rim between its wall and the outer surface, drawn as one curve that both end at. */
#ifndef VIEW_RIM_H
#define VIEW_RIM_H

#include "picture.h"
#include <stdint.h>

/* --- sides of triangles, in the order of the edges that they lie on --- */

/* Side `local` runs from corner local to the next one. */
typedef struct view_side {
    uint64_t key; /* lower vertex of the edge in the upper half, higher one in the lower */
    int32_t triangle, local;
} view_side;

/* [3*triangle_count], to be freed; sides of one edge follow each other, by triangle. Null: no memory. */
view_side *view_sides_sorted(const uint32_t *index, int32_t triangle_count);
/* One past the last side on the edge that side i lies on. */
static inline int32_t view_sides_end(const view_side *sides, int32_t count, int32_t i) {
    int32_t end = i + 1;
    while (end < count && sides[end].key == sides[i].key) ++end;
    return end;
}

enum { VIEW_RIM_LEVELS = 2 };

/* A piece of the rim between two of its points; `before` and `after` are the next points along it (its own end, where
 * the rim forks or ends). */
typedef struct view_rim_piece {
    int32_t from, to, before, after;
} view_rim_piece;

/* All zero: nothing was cut. Points are the surface's vertices on the rim, then the middles of the pieces, level by
 * level. */
typedef struct view_rim {
    int32_t point_count[VIEW_RIM_LEVELS + 1]; /* of the vertices; with the middles of the first split; of the second */
    int32_t *vertex;                          /* [point_count[0]] of the surface */
    int32_t *point;                           /* [vertex_count of the surface], -1: not on the rim */
    int32_t piece_count[VIEW_RIM_LEVELS];
    view_rim_piece *piece[VIEW_RIM_LEVELS];
    int32_t *first[VIEW_RIM_LEVELS], *next[VIEW_RIM_LEVELS]; /* pieces that leave from a point: a list */
    float *at;                                               /* [3*points] m */
} view_rim;

/* The rim of this surface; its triangles must stay. False: no memory; it is then empty. */
bool view_rim_take(view_rim *rim, const view_surface *surface, int levels);
/* The middle of the piece between two points of a level, as a point; -1: they are ends of none. */
int32_t view_rim_middle(const view_rim *rim, int level, int32_t a, int32_t b);
/* Fills `at` from where the surface's vertices are. */
void view_rim_lay(view_rim *rim, int levels, const float *place);
void view_rim_free(view_rim *rim);

#endif
