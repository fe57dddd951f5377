/* Fairing of cut walls in the picture: removed tetrahedra leave a jagged wall, which is drawn smooth. */
#ifndef VIEW_FAIRING_H
#define VIEW_FAIRING_H

#include "picture.h"

/* Maximum displacement of a drawn vertex, as a share of the mean length of its edges. */
#define VIEW_FAIRING_REACH 0.75f

/* Vertices to be faired. All zero: no cut, nothing is done. */
typedef struct view_fairing {
    int32_t count, inner_count; /* moved vertices: those inside the cut first, then those of its rim */
    int32_t *vertex;            /* [count] vertices of the surface */
    int32_t *near_begin, *near; /* [count+1] begins; neighbours (for rim vertices: along the rim) */
    int32_t beside_count;
    int32_t *beside; /* [beside_count] triangles of the outer surface that touch the rim */
    float *across;   /* [4*3*beside_count] vector from each corner to the opposite side, and its maximum displacement */
    int32_t *slot;   /* [vertex_count] of the surface: index in `vertex`, or -1 */
    float *normal;   /* [3*count] normals of the outer surface at the rim */
    float *reach_m, *step_m;
} view_fairing;

/* Finds the vertices to be moved in this surface, whose triangles must not change. Returns false if memory is
 * exhausted; `f` is then empty. */
bool view_fairing_take(view_fairing *f, const view_surface *surface);
/* Fairs from[3*vertex_count] into to[]: the wall by Taubin's smoothing, its rim along itself within the outer surface's
 * tangent planes. The result is invariant under rotation and translation. */
void view_fairing_apply(view_fairing *f, const view_surface *surface, const float *from, float *to);
void view_fairing_free(view_fairing *f);

#endif
