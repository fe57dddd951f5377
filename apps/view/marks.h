/* Scene data that messages do not contain: title, supports, fibre directions, regions. */
#ifndef VIEW_MARKS_H
#define VIEW_MARKS_H

#include <stdbool.h>
#include <stdint.h>

typedef struct view_marks {
    char title[96];
    char held_by[128]; /* names of the supports for the legend; empty: none has a name */
    int32_t vertex_count, tet_count;
    uint8_t *support_of; /* [vertex_count] of the mesh: 0 free, else fixed; null: none fixed, or not drawn */
    float *rest_m;       /* [3*vertex_count] */
    float *fibre;        /* [3*tet_count] unit vectors in the undeformed tissue; null: none, or not drawn */
    uint8_t *region;     /* [tet_count], up to VIEW_REGIONS; null: one region */
    int32_t *face;       /* with fibres or regions, [4*4*tet_count], ascending: the faces of each tetrahedron as three
                            ascending vertices and 2 * tetrahedron, + 1 if they run clockwise seen from outside */
} view_marks;

/* Returns the tetrahedron with this face, or -1. Of two, returns the one whose outward normal agrees with the corners'
 * order: the other was cut away. */
int32_t view_marks_tet(const view_marks *m, const int32_t corner[3]);

#endif
