/* What settling needs of the stage "viscosity". */
#ifndef TM_VISCOSITY_INTERNAL_H
#define TM_VISCOSITY_INTERNAL_H

#include "material/prony.h"
#include "world/world_internal.h"

bool tm_stage_is_viscosity(const tm_stage *stage);

/* The whole law of tissue that turns (corotated_viscosity.c): elastic, or what a series leaves of it and its terms. */
typedef struct tm_relaxing {
    tm_world *world;
    tm_rotation *rotation;
    const tm_tet_batches *batches; /* of the law that is left when all has relaxed; elastic: the rotation's */
    tm_tet_batches relaxed;
    tm_viscous viscous;
    tm_viscous_passes passes;
    int32_t *slot;   /* [4*tet_count] of pulls in viscous.corner_N, in the order of mesh->vertex_tet */
    int32_t *active; /* [partition_count] packs that have turned */
    /* Timers: calls timed so far; what a call takes, and what elastic tissue would, when last compared. */
    int64_t timed;
    double elastic_s, compared_s;
} tm_relaxing;
/* Numbers that a term keeps. */
int64_t tm_relaxing_kept(const tm_rotation *rotation);
/* False: no memory. */
bool tm_relaxing_init_elastic(tm_relaxing *r, tm_pool *pool, tm_world *world, tm_rotation *rotation);
/* The same; `kept` of each term is the stage's. */
bool tm_relaxing_init(tm_relaxing *r, tm_pool *pool, tm_world *world, tm_rotation *rotation,
                      const tm_viscosity_def *def, double *const *kept);
/* force_N += the whole law's force, of what is left and of the terms; the histories go on. */
void tm_relaxing_force(tm_relaxing *r);
/* Histories by themselves: keep, old and now of each term for one look at u. */
void tm_relaxing_evaluate(const tm_relaxing *r, const tm_fading *fading);

/* While a world settles: its tensors (and what turns) are those of tissue that has relaxed, and the stage is still.
 * Without the stage all three do nothing. */
typedef struct tm_relaxed {
    tm_tissue *tissue;      /* null: nothing relaxes */
    tm_tet_batches batches; /* of tissue that turns: the stage's own */
    tm_nodal_dilatation nodal_dilatation;
    tm_pool pool;
} tm_relaxed;
tm_status tm_relaxed_begin(tm_world *world, tm_relaxed *relaxed, tm_error *error);
/* `rests`: u is the rest, and so the history is that of having been there for ever. */
void tm_relaxed_end(tm_world *world, tm_relaxed *relaxed, bool rests);

#endif
