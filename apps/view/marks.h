/* What the scene knows and the messages do not tell: its title, where tissue is held, which way its fibres run. */
#ifndef VIEW_MARKS_H
#define VIEW_MARKS_H

#include <stdbool.h>
#include <stdint.h>

typedef struct view_marks {
    char title[96];
    char held_by[128]; /* the supports' names, for the legend; empty: none has a name */
    int32_t vertex_count, tet_count;
    uint8_t *support_of; /* [vertex_count] of the mesh: 0 free, else held; null: nothing held, or not to be drawn */
    float *rest_m;       /* [3*vertex_count] */
    float *fibre;        /* [3*tet_count] unit vectors at rest; null: none, or not to be drawn */
    uint8_t *region;     /* [tet_count], up to VIEW_REGIONS; null: one */
    int32_t *face; /* with fibres or regions, [4*4*tet_count]: every tetrahedron's faces, three vertices ascending and
                      2 * tetrahedron, + 1 where they run clockwise as seen from outside it; in ascending order */
} view_marks;

/* The tetrahedron with this face: of two the one whose outside the corners run round, since the other is cut away.
 * -1: none. */
int32_t view_marks_tet(const view_marks *m, const int32_t corner[3]);

#endif
