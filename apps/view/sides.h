/* Sides of triangles, in the order of the edges that they lie on. */
#ifndef VIEW_SIDES_H
#define VIEW_SIDES_H

#include <stdint.h>

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

#endif
