/* Internal interface of settling: path of supports, force scale, Newton's method. */
#ifndef TM_SETTLE_NEWTON_H
#define TM_SETTLE_NEWTON_H

#include "tissue/tangent.h"
#include "tissue/tissue_internal.h"
#include "world/world_internal.h"

/* --- path of the supports while tissue settles: rotated ones follow an arc --- */

/* A rigid motion as a screw: `angle` about `axis` through `centre_m`, and `slide_m` along it. With an angle below
 * TM_SETTLE_STRAIGHT: the translation `shift_m`. */
typedef struct tm_screw {
    double axis[3], angle, centre_m[3], slide_m, shift_m[3];
} tm_screw;

typedef struct tm_settle_path {
    const tm_mesh *mesh;
    const uint8_t *fixed;   /* [3*vertex_count] */
    const double *target_m; /* [3*vertex_count] targets of fixed components */
    double *first_m;        /* [3*vertex_count] displacements at the start */
    int32_t *component_of;  /* [vertex_count] group that moves as one body, -1: straight, component by component */
    int32_t component_count;
    tm_screw *component;     /* [component_count] */
    double largest_rotation; /* rad, of all groups */
    bool rotation_of;        /* a connected component was rotated as a body */
} tm_settle_path;

/* Plans the path from u_m to target_m. Vertices that are fixed along two or three axes and joined by edges move as one
 * body. Where a complete connected component of tissue rotates, u_m is rotated with it first. Returns false without
 * memory. */
bool tm_settle_path_build(tm_settle_path *path, tm_pool *pool, const tm_tissue *tissue, const uint8_t *fixed,
                          const double *target_m, double *u_m);
/* Writes u_m of fixed components at s from 0 (the start) to 1 (the target). */
void tm_settle_path_at(const tm_settle_path *path, double s, double *u_m);

/* --- scale of forces while tissue settles --- */

/* Scale for forces where none is left at equilibrium, as after a rigid motion. */
typedef struct tm_force_scale {
    double stiffness_N_m; /* the largest entry of vertex tensors */
    double size_m;        /* diagonal of the mesh's bounds */
} tm_force_scale;
tm_force_scale tm_force_scale_of(const tm_tissue *tissue);
/* Returns the least force that counts as 1 in a residual: 1e-4 of the stiffness times the largest displacement, plus
 * 1e-9 of the stiffness times the size. It exceeds rounding at a tolerance of 1e-10. */
double tm_force_scale_at(const tm_force_scale *scale, const double *u_m, int32_t n);

/* --- what settling shares with the response of an equilibrium (settle_response.c) --- */

/* Returns whether the problem is linear, apart from the tissue's law. */
bool tm_settle_is_linear(const tm_world *world);
/* external_N [3*vertex_count] := the external forces but pressures, which follow the surface. */
void tm_settle_find_loads(tm_world *world, double *external_N);

typedef struct tm_newton_rest {
    const uint8_t *fixed;     /* [3*vertex_count] prescribed, or without mass */
    const double *external_N; /* [3*vertex_count] */
    const double *target_m;   /* [3*vertex_count] targets of fixed components */
    bool turns_only;          /* returns at once where no support rotates */
} tm_newton_rest;

/* Finds the equilibrium from the present u_m; on failure u_m is in between. result: steps and residual. */
tm_status tm_settle_newton(const tm_world *world, const tm_newton_rest *rest, const tm_settle_def *def, double *u_m,
                           tm_settle_result *result, tm_error *error);

#endif
