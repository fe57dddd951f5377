/* The force pass of a nonlinear law, block by block of vertices: the stresses of the batches that a block needs, then
 * its sums, so that corner forces stay in a core's cache. A partition computes all batches of its own vertices; those
 * that reach over its ends are computed in both. Corner forces are in a ring of batches, a ring per partition. */
#ifndef TM_LAW_BLOCKS_H
#define TM_LAW_BLOCKS_H

#include "material/material_internal.h"
#include "world/world_internal.h"

enum { TM_LAW_BLOCK = 64 }; /* vertices */

typedef struct tm_law_ring {
    _Alignas(64) double *corner_N; /* [12*TM_LANES*ring], or floats */
    int32_t next;                  /* the next batch to compute */
    int32_t own_end;               /* batches from here on are counted by the following partition */
    int32_t beyond;                /* tetrahedra beyond a limit, each counted by one partition */
} tm_law_ring;

typedef struct tm_law_blocks {
    bool on;              /* else it does not pay, and the rest is not allocated */
    int32_t ring;         /* batches of a ring */
    int32_t *first, *end; /* [vertex_count+1] batches that the vertices from here on, and up to here, need */
    int32_t *place;       /* as of tm_packs_corners, in a ring */
    tm_law_ring *part;    /* [partition_count+1]; the last: of a call for all vertices */
} tm_law_blocks;

/* Computes corner forces of the batches [begin, end) into corner_N, the first as its batch `slot`. Returns how many
 * tetrahedra are beyond a limit. */
typedef int32_t (*tm_law_stress)(const void *self, int32_t begin, int32_t end, void *corner_N, int32_t slot);

/* place: of tm_packs_corners. Returns false without memory. */
bool tm_law_blocks_init(tm_law_blocks *blocks, tm_pool *pool, const tm_tet_batches *packs, const int32_t *place,
                        int32_t partitions, bool single);
/* Computes the batches that the vertices [begin, end) of a range need; returns the partition's ring. */
const void *tm_law_blocks_compute(tm_law_blocks *blocks, const tm_world *world, const tm_range *range, int32_t begin,
                                  int32_t end, tm_law_stress stress, const void *self);
/* Sets the counts to zero; and returns their sum. */
void tm_law_blocks_begin(tm_law_blocks *blocks, int32_t partitions);
int32_t tm_law_blocks_beyond(const tm_law_blocks *blocks, int32_t partitions);

/* force_N := minus the sum of corner forces of the vertices [begin, end), ascending. corner_N: doubles, or floats. */
void tm_law_sum(const tm_mesh *mesh, const void *corner_N, const int32_t *place, int32_t begin, int32_t end,
                double *TM_RESTRICT force_N);
void tm_law_sum_single(const tm_mesh *mesh, const void *corner_N, const int32_t *place, int32_t begin, int32_t end,
                       double *TM_RESTRICT force_N);

#endif
