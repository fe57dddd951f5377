/* The corrections of the listed batches, divided among the world's threads (divided_batches.c). */
#ifndef TM_DIVIDED_BATCHES_H
#define TM_DIVIDED_BATCHES_H

#include "material/material_internal.h"
#include "world/world_internal.h"

typedef struct tm_divided_batches {
    tm_rotation *rotation;
    tm_world *world;
    tm_corner_force_kernel corner_force;
    bool pays, overlaps;
    double *before; /* [parts + 1] fraction of the list before each part */
    double *took_s; /* [parts] time since the fractions were last adapted, after `runs` jobs */
    int32_t runs;
    int64_t listing; /* the list's number at the last division */
    int32_t *first;  /* [vertex_count] first batch that has the vertex */
    int32_t *lowest; /* [batches] lowest first batch of its vertices */
    int32_t *active; /* [parts] batches with a correction */
    /* Of batches that straddle, part after part: index in the list, batch, corner forces and lanes that have any. */
    int32_t *late_begin; /* [parts + 1] */
    int32_t *late, *late_batch;
    double *late_J;   /* energies */
    double *corner_N; /* [12*TM_LANES] each */
    uint8_t *who;
    int32_t capacity;
} tm_divided_batches;

/* Allocates from the pool; nothing for one thread. Returns false without memory. */
bool tm_divided_batches_init(tm_divided_batches *d, tm_pool *pool, tm_world *world, tm_rotation *rotation);
/* Adds the corrections of the listed batches to the rotation's now_N, and sets batch_J and `active`: the bits of
 * rotation->kernel over the list. */
void tm_divided_batches_run(tm_divided_batches *d);

#endif
