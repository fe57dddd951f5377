/* Surface and ties as single-precision rows, for viewers; only for scenes with `rendering`. */
#ifndef TM_SIM_PICTURE_H
#define TM_SIM_PICTURE_H

#include "sim.h"

typedef struct sim_picture {
    int32_t vertex_count, triangle_count;
    int32_t *vertex_id;    /* [vertex_count] numbers of the mesh file, ascending */
    float **vertex_m;      /* [vertex_count][3] current positions */
    int32_t **triangle;    /* [triangle_count][3] indices into vertex_m */
    int8_t *triangle_kind; /* [triangle_count] 0: on the uncut surface, 1: exposed by a cut */
    int32_t revision;      /* revision of the numbered surface */
    int32_t tie_total;     /* ties of the scene */
    int32_t tie_count;     /* those that hold */
    int32_t *tie_id;       /* [tie_count] their numbers */
    float **tie_m;         /* [tie_count][6] their ends */

    /* private */
    int32_t *slot_of; /* [mesh vertices] index into the picture, -1: not on the surface */
    int32_t *of_file; /* [mesh vertices] mesh number of each vertex of the file; null: equal */
    size_t bytes;
} sim_picture;

/* Returns the tissue in its current state; the next call overwrites it. */
const sim_picture *sim_picture_now(sim *s);

#endif
