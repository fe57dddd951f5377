/* Regions inside the largest one, for a log or a running simulation. Messages have only the organ's surface; the inner
 * regions come from the scene's mesh. */
#ifndef VIEW_INSIDE_H
#define VIEW_INSIDE_H

#include "picture.h"
#include "tensormass/mesh.h"

typedef struct view_inside {
    int32_t vertex_count, tet_count; /* of the mesh */
    float *rest_m;                   /* [3*vertex_count] */
    int32_t *tet, *tet_neighbour;    /* [4*tet_count] in the mesh's order */
    int32_t face_count;
    int32_t *face;     /* [3*face_count] between two regions, seen from outside the smaller region */
    int32_t *side_of;  /* [2*face_count] the two adjacent tetrahedra */
    uint8_t *kind;     /* [face_count] view_kind_of the smaller region */
    uint8_t *alive;    /* [tet_count] enclosed by the message's triangles */
    uint8_t *blocked;  /* [4*tet_count] the message has this face as a triangle */
    int32_t *flood;    /* [tet_count] scratch */
    int32_t *index;    /* [vertex_count] index in the surface shown; -1: not in it */
    int32_t told;      /* number of vertices in the message; the positions of the others follow from them */
    uint32_t topology; /* topology of the message that these arrays belong to; 0: none yet */
    view_surface shown;
} view_inside;

/* Finds the faces between regions of `mesh`. Returns false if memory is exhausted; `in` is then empty. */
bool view_inside_take(view_inside *in, const tm_mesh *mesh);
/* Fills `shown`: the inner faces (by the picture's marks, which have all faces), then the message's surface. Inner
 * vertices move by the mean displacement of nearby surface vertices, weighted by distance^-4 at rest. Returns false if
 * memory is exhausted. */
bool view_inside_show(view_inside *in, const view_picture *picture);
void view_inside_free(view_inside *in);

#endif
