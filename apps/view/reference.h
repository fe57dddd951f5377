/* Reference positions of the tissue when it was first seen. Textures are computed there, so they move with the
 * tissue. */
#ifndef VIEW_REFERENCE_H
#define VIEW_REFERENCE_H

#include "picture.h"

typedef struct view_references {
    int64_t session;
    int32_t count;
    struct view_reference {
        int32_t id;
        float at_m[3];
    } * item; /* [count] ascending by id */
} view_references;

/* Computes the reference position of every vertex, at_m[3*vertex_count]. A vertex exposed by a cut gets its position
 * minus its neighbours' mean displacement. Returns false if memory is exhausted. */
bool view_references_update(view_references *r, const view_surface *surface, float *at_m);
void view_references_free(view_references *r);
/* Computes noise of 0 to 1 at a reference position: small and large patches. */
void view_reference_mottle(const float at_m[3], float grain_m, float mottle[2]);

#endif
