/* Between settle.c and Newton's method. */
#ifndef TM_SETTLE_NEWTON_H
#define TM_SETTLE_NEWTON_H

#include "tissue/tangent.h"
#include "tissue/tissue_internal.h"
#include "world/world_internal.h"

/* --- the way of the supports while tissue settles: turned ones go round, not straight through --- */

/* One rigid motion, a screw: about `axis` through `centre_m` by `angle`, and `slide_m` along it. With an angle below
 * TM_SETTLE_STRAIGHT: straight on by `shift_m`. */
typedef struct tm_screw {
    double axis[3], angle, centre_m[3], slide_m, shift_m[3];
} tm_screw;

typedef struct tm_settle_path {
    const tm_mesh *mesh;
    const uint8_t *fixed;   /* [3*vertex_count] */
    const double *target_m; /* [3*vertex_count] where held components shall be */
    double *first_m;        /* [3*vertex_count] displacements at the start */
    int32_t *component_of;  /* [vertex_count] part that moves as one, -1: straight on, component by component */
    int32_t component_count;
    tm_screw *component;     /* [partition_count] */
    double largest_rotation; /* rad, of all parts */
    bool rotation_of;        /* a piece was, as a body */
} tm_settle_path;

/* Plans the way from u_m to target_m. Vertices that are held along two axes or three and joined by edges move as one
 * part, as if what is free stayed where it is. Where a whole piece of tissue is turned, u_m is turned with it first, as
 * a body. False: no memory. */
bool tm_settle_path_build(tm_settle_path *path, tm_pool *pool, const tm_tissue *tissue, const uint8_t *fixed,
                          const double *target_m, double *u_m);
/* u_m of held components, at s from 0 (the start) to 1 (the target). */
void tm_settle_path_at(const tm_settle_path *path, double s, double *u_m);

/* --- what counts as a large force while tissue settles --- */

/* What forces are large or small beside, where none is left at rest: a body that was turned or moved as a whole. */
typedef struct tm_force_scale {
    double stiffness_N_m; /* the largest entry of vertex tensors */
    double size_m;        /* diagonal of the mesh's bounds */
} tm_force_scale;
tm_force_scale tm_force_scale_of(const tm_tissue *tissue);
/* The least force that counts as 1 in a residual: 1e-4 of the stiffness times the largest displacement, above what
 * rounding leaves at a tolerance of 1e-10; and 1e-9 of the stiffness times the size. */
double tm_force_scale_at(const tm_force_scale *scale, const double *u_m, int32_t n);

typedef struct tm_newton_rest {
    const uint8_t *fixed;     /* [3*vertex_count] prescribed, or without mass */
    const double *external_N; /* [3*vertex_count] */
    const double *target_m;   /* [3*vertex_count] where held components shall be */
    bool turns_only;          /* nothing is done where no support turns */
} tm_newton_rest;

/* From u_m, the state now, to the rest; on failure u_m is somewhere between. result: steps and residual. */
tm_status tm_settle_newton(const tm_world *world, const tm_newton_rest *rest, const tm_settle_def *def, double *u_m,
                           tm_settle_result *result, tm_error *error);

#endif
