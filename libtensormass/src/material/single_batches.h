/* Batches of tetrahedra in single precision (tissue.precision), for the passes of steps. Displacements and sums stay
 * double: each edge's difference is taken in double and rounded, so that errors go with the strain, not with the
 * displacement. Settling, tangents, bounds and reported energies use the batches in double. */
#ifndef TM_SINGLE_BATCHES_H
#define TM_SINGLE_BATCHES_H

#include "material/material_internal.h"

/* As tm_tet_batch, tm_fibre_batch and tm_tet_batches, with numbers of half the size. */
typedef struct tm_single_batch {
    int32_t component[4][TM_LANES];
    float shape_1_m[9][TM_LANES];
    float mu_J[TM_LANES], lambda_J[TM_LANES];
} tm_single_batch;

typedef struct tm_single_fibres {
    float dlambda_J[TM_LANES], dmu_J[TM_LANES], beta_J[TM_LANES];
    float fibre[3][TM_LANES];
} tm_single_fibres;

typedef struct tm_single_batches {
    int32_t count;
    const tm_tet_span *span;
    const uint8_t *alive;
    const tm_single_batch *batch;
    /* Of corotated tissue. */
    const tm_single_fibres *fibred;
    const int32_t *fibred_of;
    float begin_1_2, width_1_2;
} tm_single_batches;

/* to[i] := from[i], at most 3e38. */
void tm_narrow(const double *from, int32_t count, float *to);
/* Converts batches without their fibres, from the pool; null without memory. */
const tm_single_batch *tm_single_batch_take(tm_pool *pool, const tm_tet_batches *batches);

#endif
