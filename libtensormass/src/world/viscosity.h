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
    tm_ranges where; /* its vertices */
    int32_t *slot; /* [4*tet_count] index of each corner force in viscous.corner_N, in the order of mesh->vertex_tet */
    /* Where rotation acts in more bodies than viscosity, while these relax: what the stage "rotation" leaves to it. */
    uint8_t *relaxes; /* [rotation->batches.count], or null: all batches relax */
    int32_t *elastic, elastic_count;
    tm_ranges elastic_where;
    int32_t *active; /* [partition_count] corotated batches */
    /* Timers: number of timed calls; time of a call, and of elastic tissue, at the last comparison. */
    int64_t timed;
    double elastic_s, compared_s;
} tm_relaxing;
/* Returns false without memory. */
bool tm_relaxing_init_elastic(tm_relaxing *r, tm_pool *pool, tm_world *world, tm_rotation *rotation);
/* force_N += force of the complete law, long-term law and terms; advances the histories. */
void tm_relaxing_force(tm_relaxing *r);

struct tm_relaxed;
/* What the stage "viscosity" asks of a nonlinear law (tm_nonlinear.relaxing): the law itself computes its terms, with
 * histories of tetrahedra. self: tm_nonlinear.self. */
struct tm_relaxing_law {
    const char *stage; /* the law's own */
    bool before_force; /* the force of its terms is there before the stage "force" gathers it; else it is added after */
    int64_t (*kept)(const void *self); /* how many numbers a term stores */
    /* Prepares the terms; the stage owns `kept` of each, and the memory. Returns false without memory. */
    bool (*begin)(void *self, tm_pool *pool, tm_world *world, const tm_viscosity_def *def, double *const *kept);
    double (*limit_s)(const void *self); /* step that the terms allow; null: that of the law */
    void (*end)(void *self);             /* the memory is freed after it */
    /* Sets whether the terms act, by the stage "viscosity"; else the law's own stage computes elastic tissue. */
    void (*set)(void *self, tm_world *world, bool relaxes);
    void (*set_step)(void *self, const tm_fading *fading);
    void (*force)(void *self); /* advances the histories */
    /* Advances the histories alone: keep, old and now of each term for one evaluation at u. */
    void (*evaluate)(void *self, const tm_fading *fading);
    /* Prepares the long-term law of tissue whose tensors relax with it (tm_relaxed.tissue); null: those stay. */
    bool (*prepare_rest)(void *self, const tm_tissue *tissue, struct tm_relaxed *relaxed);
    void (*rest)(void *self, struct tm_relaxed *relaxed, bool begins); /* swaps the long-term law in, or out */
};
extern const struct tm_relaxing_law tm_corotated_relaxing;

/* While a world settles, its tensors (and corotated law) are the relaxed ones, and the stage is frozen. Without the
 * stage all three do nothing. */
typedef struct tm_relaxed {
    bool on;                /* false: nothing relaxes */
    double shear, volume;   /* long-term shares */
    tm_tissue *tissue;      /* the relaxed tensors; null: they stay */
    tm_tet_batches batches; /* of corotated tissue: the stage's own */
    tm_nodal_dilatation nodal_dilatation;
    tm_pool pool;
} tm_relaxed;
tm_status tm_relaxed_begin(tm_world *world, tm_relaxed *relaxed, tm_error *error);
/* `rests`: u is the equilibrium; sets the history of having been there forever. */
void tm_relaxed_end(tm_world *world, tm_relaxed *relaxed, bool rests);

#endif
