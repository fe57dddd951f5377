/* Tangents of nonlinear laws, assembled on the tissue's graph. */
#ifndef TM_TANGENT_H
#define TM_TANGENT_H

#include "material/material_internal.h"
#include "tissue/tissue_internal.h"

/* A copy of the tissue's tensors to which corotated tangents are added. Its lists are the tissue's own. */
typedef struct tm_tangent {
    tm_force_graph graph;
    tm_force_kernel force;
    tm_nodal_dilatation nodal_dilatation; /* its own evaluation */
    double *gradient;                     /* [3*most members of a domain] */
    bool definite;                        /* without the stress terms: R K R^T of each tetrahedron */
} tm_tangent;
/* Allocates the tensors. Returns false without memory. */
bool tm_tangent_take_tensors(tm_tangent *tangent, tm_pool *pool, const tm_tissue *tissue);
/* The same with averaged dilatation, of which it has its own evaluation. */
bool tm_tangent_take_averaged(tm_tangent *tangent, tm_pool *pool, const tm_tissue *tissue,
                              const tm_nodal_dilatation *averages);
/* Adds the tangent of averaged dilatation at the last evaluation, minus the tensors': the share of the domains that
 * the tetrahedra [begin, end) are of all. */
void tm_tangent_add_domains(const tm_tissue *tissue, int32_t begin, int32_t end, tm_tangent *tangent);
/* Sets them to the tissue's own. */
void tm_tangent_begin(const tm_tissue *tissue, tm_tangent *tangent);
/* Adds to the block of vertices k <= l that share a tetrahedron. */
void tm_tangent_add_pair(const tm_tissue *tissue, int32_t k, int32_t l, const double K[9], tm_tangent *tangent);
/* Adds a tetrahedron's d2W/dF2 (symmetric 9x9, J). */
void tm_tangent_add_tet(const tm_tissue *tissue, int32_t tet, const double A[81], tm_tangent *tangent);
/* Returns the field of the stage "rotation": without smoothing, if no body that rotates has it. */
tm_material_field tm_rotation_field(const tm_tissue *tissue);
bool tm_tangent_init(tm_tangent *tangent, tm_pool *pool, const tm_rotation *rotation);

/* Computes the complete tangent at u_m; _add: the corotated part of the tetrahedra [begin, end). */
void tm_rotation_tangent(const tm_rotation *rotation, const double *u_m, tm_tangent *tangent);
void tm_rotation_tangent_add(const tm_rotation *rotation, const double *u_m, int32_t begin, int32_t end,
                             tm_tangent *tangent);

#endif
