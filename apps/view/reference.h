/* Where each bit of tissue was when it was first seen: textures are laid out there, so that they stick to it. */
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

/* Of every vertex, into at_m[3*vertex_count]. One that a cut laid open is new: it gets the place that it had when its
 * neighbours were first seen, by their mean displacement. False: no memory. */
bool view_references_update(view_references *r, const view_surface *surface, float *at_m);
void view_references_free(view_references *r);
/* 0..1 there: patches, and larger ones. */
void view_reference_mottle(const float at_m[3], float grain_m, float mottle[2]);

#endif
