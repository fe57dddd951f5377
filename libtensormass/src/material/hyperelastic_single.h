/* Nonlinear laws in single precision (tissue.precision): the pass of the step alone. Displacements stay double: each
 * edge's difference is taken in double and rounded, so that errors go with the strain, not with the displacement.
 * Settling, tangents, energies and bounds use the double pass. */
#ifndef TM_HYPERELASTIC_SINGLE_H
#define TM_HYPERELASTIC_SINGLE_H

#include "material/hyperelastic.h"
#include "material/single_batches.h"

/* As tm_law_pack and tm_hyperelastic, with numbers of half the size. */
typedef struct tm_single_laws {
    float I3_max[TM_LANES];
    float constant[TM_LAW_CONSTANTS][TM_LANES];
    float dlambda_J[TM_LANES], dmu_J[TM_LANES], beta_J[TM_LANES];
    float fibre[3][TM_LANES];
    int32_t law[TM_LANES];
    uint32_t laws;
} tm_single_laws;

typedef struct tm_single_law {
    tm_single_batches packs;
    const tm_single_laws *law; /* [packs.count] */
} tm_single_law;

/* Initialises from the pool; returns false without memory. */
bool tm_single_law_init(tm_single_law *s, tm_pool *pool, const tm_hyperelastic *h);

/* As tm_hyper_force, with corner_N in single. */
typedef int32_t (*tm_single_force)(const tm_single_law *s, int32_t begin, int32_t end, const double *u_m,
                                   float *corner_N);
/* 0 plain, 1 AVX2 or NEON; null: not supported by this processor. */
tm_single_force tm_single_force_form(int form);
tm_single_force tm_single_force_choose(bool plain);

#endif
