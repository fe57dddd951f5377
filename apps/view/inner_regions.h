/* Regions inside the largest one, of a log or a running simulation: messages tell the organ's surface alone, the
 * scene's mesh what lies within. */
#ifndef VIEW_INSIDE_H
#define VIEW_INSIDE_H

#include "picture.h"
#include "tensormass/mesh.h"

typedef struct view_inside {
    int32_t vertex_count, tet_count; /* of the mesh */
    float *rest_m;                   /* [3*vertex_count] */
    int32_t *tet, *tet_neighbour;    /* [4*tet_count] as the mesh has them */
    int32_t face_count;
    int32_t *face;     /* [3*face_count] between two regions, seen from outside the smaller one */
    int32_t *side_of;  /* [2*face_count] the tetrahedra on its sides */
    uint8_t *kind;     /* [face_count] view_kind_of the smaller one */
    uint8_t *alive;    /* [tet_count] by the message: what its triangles enclose */
    uint8_t *blocked;  /* [4*tet_count] the message has this face */
    int32_t *flood;    /* [tet_count] scratch */
    int32_t *index;    /* [vertex_count] in the surface shown, -1: not in it */
    int32_t told;      /* vertices that the message has; those after them are found from theirs */
    uint32_t topology; /* of the message that all of it is for; 0: none yet */
    view_surface shown;
} view_inside;

/* Faces between regions of `mesh`. False: no memory; it is then empty. */
bool view_inside_take(view_inside *in, const tm_mesh *mesh);
/* `shown`: what is inside (by the picture's marks, which know faces), then the surface that was told. Vertices that the
 * surface has not move as those of the surface about them: the mean of their displacements, weighted by distance^-4 at
 * rest. False: no memory. */
bool view_inside_show(view_inside *in, const view_picture *picture);
void view_inside_free(view_inside *in);

#endif
