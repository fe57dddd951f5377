/* Fairing of what a cut laid open, for the picture alone: tetrahedra leave a jagged wall, which is drawn smooth. */
#ifndef VIEW_FAIRING_H
#define VIEW_FAIRING_H

#include "picture.h"

/* No vertex is drawn farther from where it is than this share of its edges' mean length. */
#define VIEW_FAIRING_REACH 0.75f

/* All zero: nothing was cut, and nothing is done. */
typedef struct view_fairing {
    int32_t count, inner_count; /* vertices that are moved: those inside the cut first, then those of its rim */
    int32_t *vertex;            /* [count] of the surface */
    int32_t *near_begin, *near; /* [count+1] into their neighbours; along the rim alone for its own */
    int32_t beside_count;
    int32_t *beside; /* [beside_count] triangles of the outer surface at the rim */
    float *across;   /* [4*3*beside_count] from each of their corners to the side across, and how far it may go */
    int32_t *slot;   /* [vertex_count] of the surface: place in `vertex`, or -1 */
    float *normal;   /* [3*count] of the outer surface, at the rim */
    float *reach_m, *step_m;
} view_fairing;

/* What there is to move in this surface; its triangles must stay. False: no memory; it is then empty. */
bool view_fairing_take(view_fairing *f, const view_surface *surface);
/* Vertices from[3*vertex_count], faired, into to[]: the wall by Taubin's rounds, its rim along itself without leaving
 * the outer surface's tangent planes. Turning or shifting `from` does the same to `to`. */
void view_fairing_apply(view_fairing *f, const view_surface *surface, const float *from, float *to);
void view_fairing_free(view_fairing *f);

#endif
