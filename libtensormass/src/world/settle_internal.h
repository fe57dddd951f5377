/* State of settling that its ways share: linear (settle_linear.c), Newton's method (settle_newton.c), and the stages
 * themselves (settle_stages.c). */
#ifndef TM_SETTLE_INTERNAL_H
#define TM_SETTLE_INTERNAL_H

#include "world/settle_newton.h"

typedef struct tm_relaxation {
    tm_pool pool;
    tm_world *world;
    const tm_settle_def *def;
    int32_t n;        /* components */
    uint8_t *fixed;   /* [n] prescribed, or without mass */
    double *external; /* [n] */
    double *start_u, *start_u_prev;
    double *residual, *step, *image, *scaled; /* [n] */
    double *inverse; /* [9*vertex_count] linear: inverse vertex tensors of the free components */
    double *mass;    /* [vertex_count] else: fictitious masses, kg per s2 */
    tm_force_scale scale;
    int32_t load_steps;
    int64_t steps;
    double relative, held_friction;
} tm_relaxation;

/* Returns the largest magnitude of a [n], of components that are not fixed; fixed may be NULL. */
double tm_settle_largest(const double *a, const uint8_t *fixed, int32_t n);
/* Calls the caller's progress every 128 steps; returns false where it ends settling. */
bool tm_settle_goes_on(const tm_relaxation *x);
/* Returns TM_ERR_CONVERGENCE and writes why. */
tm_status tm_settle_not_converged(const tm_relaxation *x, tm_error *error);
/* Runs one phase of the stages that take part in settling. */
void tm_settle_run_phase(tm_world *world, tm_phase phase);

/* Finds the equilibrium of linear tissue under forces, loads and supports; with pressures, which follow the surface,
 * anew until their forces no longer change. u_m is the start, with the supports' values. */
tm_status tm_settle_linear(tm_relaxation *x, bool pressed, tm_error *error);
/* Runs Newton's method from start_u to the supports' values, which are in u_m. */
tm_status tm_settle_nonlinear(tm_relaxation *x, const tm_settle_def *def, bool turns_only, tm_error *error);
/* Relaxes with the stages, contact included. */
tm_status tm_settle_stages(tm_relaxation *x, tm_error *error);

#endif
