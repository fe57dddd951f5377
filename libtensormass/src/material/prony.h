/* Viscoelasticity by a Prony series (effect "viscosity"): its coefficients, and its terms for batches of tetrahedra. */
#ifndef TM_PRONY_H
#define TM_PRONY_H

#include "material/material_internal.h"
#include "tensormass/viscosity.h"

enum { TM_COOKIE_VISCOSITY = 0x76697363 };

/* The exact history of a strain that is linear within each step: the integral of exp(-(t_end - t)/time) s(t) dt/time is
 * kept_share * before + old * s_begin + now * s_end. */
typedef struct tm_fading {
    double kept_share, old, now;
} tm_fading;
tm_fading tm_fading_of(double dt_s, double time_s);

/* Computes the long-term shares of shear and of volume. */
static inline void tm_viscosity_relaxed(const tm_viscosity_def *def, double *shear, double *volume) {
    *shear = *volume = 1;
    for (int32_t t = 0; t < def->count; t++) *shear -= def->term[t].shear, *volume -= def->term[t].bulk;
}

/* Initialises the terms of batches, where viscosity and rotation act, and `left`, the batches of the long-term law. The
 * caller owns `kept` of each term (6*TM_LANES*batches and the averaged domains). Returns false without memory. */
bool tm_prony_init(tm_viscous *v, tm_tet_batches *left, tm_pool *pool, const tm_material_field *field,
                   const tm_viscosity_def *def, double *const *kept);

#endif
