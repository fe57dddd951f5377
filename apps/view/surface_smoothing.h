/* Smooth surface drawn over a coarse one: normals with creases, and curved triangles between the mesh's vertices. */
#ifndef VIEW_SKIN_H
#define VIEW_SKIN_H

#include "picture.h"

/* Vertex attributes of the shaders. */
typedef struct view_vertex {
    float at_m[3], normal[3];
    float reference_m[3]; /* position when first seen: the colour moves with the tissue */
    float kind;           /* the triangle's view_kind_of; for shapes: view_paint */
    float shade;          /* 0..1, darker in hollows */
    float mottle[2];      /* 0..1 noise of the reference position: patches and large patches */
} view_vertex;

typedef struct view_skin view_skin;

/* Creates a smoothed surface. `levels` 0..2: each splits a triangle in four. `crease_rad`: sharper edges stay sharp.
 * Returns null if memory is exhausted. */
view_skin *view_skin_create(int levels, float crease_rad);
void view_skin_free(view_skin *skin);
/* Updates the smoothed surface to the surface's version, if it differs. `grain_m`: size of the finest speckles. Returns
 * false if memory is exhausted. */
bool view_skin_update(view_skin *skin, const view_surface *surface, float grain_m);
int32_t view_skin_vertices(const view_skin *skin, const view_vertex **vertex);
/* Returns [3*vertex_count] drawn positions of the surface's vertices; a cut's wall is faired. */
float *view_skin_places(const view_skin *skin);
/* Returns the triangles. `*changed` is set if they differ from the last call. */
int32_t view_skin_indices(view_skin *skin, const uint32_t **index, bool *changed);
/* Returns how many of view_skin_indices, at the beginning, are inner faces. */
int32_t view_skin_inside(const view_skin *skin);
/* Returns the triangles before any split, over the same vertices: sufficient for soft shadows. */
int32_t view_skin_coarse_indices(const view_skin *skin, const uint32_t **index);

#endif
