/* The surface as single-precision rows, for viewers: scenes with `rendering` only. */
#ifndef TM_SIM_PICTURE_H
#define TM_SIM_PICTURE_H

#include "sim.h"

typedef struct sim_picture {
    int32_t vertex_count, triangle_count;
    int32_t *vertex_id;    /* [vertex_count] the mesh file's numbers, ascending */
    float **vertex_m;      /* [vertex_count][3] now */
    int32_t **triangle;    /* [triangle_count][3] indices into the above */
    int8_t *triangle_kind; /* [triangle_count] 0: of the uncut surface, 1: laid open */
    int32_t revision;      /* of the surface that is numbered */

    /* private */
    int32_t *slot_of; /* [mesh vertices] index into the picture, -1: not on the surface */
    int32_t *of_file; /* [mesh vertices] the mesh's number of each vertex of the file; null: the same */
    size_t bytes;
} sim_picture;

/* The tissue as it is now; rewritten by the next call. */
const sim_picture *sim_picture_now(sim *s);

#endif
