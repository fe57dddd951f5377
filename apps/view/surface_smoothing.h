/* The smooth skin drawn over a coarse surface: normals that know creases, and curved triangles between the mesh's own
 * vertices. */
#ifndef VIEW_SKIN_H
#define VIEW_SKIN_H

#include "picture.h"

/* What the shaders read, per vertex. */
typedef struct view_vertex {
    float at_m[3], normal[3];
    float reference_m[3]; /* where this bit of tissue was when first seen: its colour sticks to it */
    float kind;           /* the triangle's (view_kind_of); of shapes: view_paint */
    float shade;          /* 0..1, darker in hollows */
    float mottle[2];      /* 0..1 noise of the reference position: patches and large patches */
} view_vertex;

typedef struct view_skin view_skin;

/* `levels` 0..2: each draws four triangles for one. `crease_rad`: edges sharper than this stay edges. Null: no memory.
 */
view_skin *view_skin_create(int levels, float crease_rad);
void view_skin_free(view_skin *skin);
/* Brings the skin up to the surface's version; does nothing when it is. `grain_m`: size of the finest speckles. False:
 * no memory. */
bool view_skin_update(view_skin *skin, const view_surface *surface, float grain_m);
int32_t view_skin_vertices(const view_skin *skin, const view_vertex **vertex);
/* [3*vertex_count] where the surface's vertices are drawn: a cut's wall is faired. */
float *view_skin_places(const view_skin *skin);
/* `*changed` tells whether the triangles are others than at the last call. */
int32_t view_skin_indices(view_skin *skin, const uint32_t **index, bool *changed);
/* Of view_skin_indices, so many come first that lie inside. */
int32_t view_skin_inside(const view_skin *skin);
/* The triangles before any split, over the same vertices: good enough for soft shadows. */
int32_t view_skin_coarse_indices(const view_skin *skin, const uint32_t **index);

#endif
