/* Viscosity: tissue that relaxes, by a Prony series (docs/viscosity.md).
 *     G(t) = G_0 (1 - sum_i shear_i (1 - exp(-t/time_i))),   kappa(t) with bulk_i.
 * The materials' constants are the instantaneous moduli. The long-term shear modulus is 1 - (sum of `shear`) of its
 * instantaneous value; likewise the bulk modulus with `bulk`. A separate stage: a world without it has no cost. */
#ifndef TENSORMASS_VISCOSITY_H
#define TENSORMASS_VISCOSITY_H

#include "world.h"

#ifdef __cplusplus
extern "C" {
#endif

#define TM_VISCOSITY_TERMS 3
#define TM_VISCOSITY_TIME_MIN_S 1e-6
#define TM_VISCOSITY_TIME_MAX_S 1e6
#define TM_VISCOSITY_SHARES_MAX 0.9999 /* upper limit of each sum of shares: a long-term stiffness must remain */

typedef struct tm_viscosity_term {
    double time_s;      /* of relaxation at constant strain */
    double shear, bulk; /* shares of the instantaneous moduli that relax with it, 0 to 1 */
} tm_viscosity_term;

typedef struct tm_viscosity_def {
    uint32_t cookie, size;
    int32_t count; /* 1 to TM_VISCOSITY_TERMS */
    tm_viscosity_term term[TM_VISCOSITY_TERMS];
} tm_viscosity_def;
TM_API tm_viscosity_def tm_viscosity_def_default(void); /* no term */
/* Checks the terms. TM_ERR_ARGUMENT: count, times or shares out of range; the entity is the term. */
TM_API tm_status tm_viscosity_check(const tm_viscosity_def *def, tm_error *error);

/* Adds the stage "viscosity" and its substages. No term changes the guaranteed step. The tissue starts relaxed at its
 * present displacement. tm_world_settle finds the long-term equilibrium; tangents and patches use the instantaneous
 * stiffness. */
TM_API tm_status tm_stage_viscosity(tm_world *world, const tm_viscosity_def *def, tm_error *error);

#ifdef __cplusplus
}
#endif
#endif
