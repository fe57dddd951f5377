/* The interface of the stage "viscosity" to settling. */
#ifndef TM_VISCOSITY_INTERNAL_H
#define TM_VISCOSITY_INTERNAL_H

#include "material/prony.h"
#include "world/world_internal.h"

bool tm_stage_is_viscosity(const tm_stage *stage);

/* The complete law of corotated tissue (corotated_viscosity.c): elastic, or long-term law and terms of a series. */
typedef struct tm_relaxing {
    tm_world *world;
    tm_rotation *rotation;
    const tm_tet_batches *batches; /* of the long-term law; elastic: the rotation's */
    tm_tet_batches relaxed;
    tm_viscous viscous;
    tm_viscous_passes passes;
    int32_t *slot; /* [4*tet_count] index of each corner force in viscous.corner_N, in the order of mesh->vertex_tet */
    int32_t *active; /* [partition_count] corotated batches */
    /* Timers: number of timed calls; time of a call, and of elastic tissue, at the last comparison. */
    int64_t timed;
    double elastic_s, compared_s;
} tm_relaxing;
/* Returns how many numbers a term stores. */
int64_t tm_relaxing_kept(const tm_rotation *rotation);
/* Returns false without memory. */
bool tm_relaxing_init_elastic(tm_relaxing *r, tm_pool *pool, tm_world *world, tm_rotation *rotation);
/* The same; the stage owns `kept` of each term. */
bool tm_relaxing_init(tm_relaxing *r, tm_pool *pool, tm_world *world, tm_rotation *rotation,
                      const tm_viscosity_def *def, double *const *kept);
/* force_N += force of the complete law, long-term law and terms; advances the histories. */
void tm_relaxing_force(tm_relaxing *r);
/* Advances the histories alone: keep, old and now of each term for one evaluation at u. */
void tm_relaxing_evaluate(const tm_relaxing *r, const tm_fading *fading);

/* While a world settles, its tensors (and corotated law) are the relaxed ones, and the stage is frozen. Without the
 * stage all three do nothing. */
typedef struct tm_relaxed {
    tm_tissue *tissue;      /* null: nothing relaxes */
    tm_tet_batches batches; /* of corotated tissue: the stage's own */
    tm_nodal_dilatation nodal_dilatation;
    tm_pool pool;
} tm_relaxed;
tm_status tm_relaxed_begin(tm_world *world, tm_relaxed *relaxed, tm_error *error);
/* `rests`: u is the equilibrium; sets the history of having been there forever. */
void tm_relaxed_end(tm_world *world, tm_relaxed *relaxed, bool rests);

#endif
