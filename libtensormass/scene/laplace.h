/* Directions along which a potential rises from one set of vertices to another. */
#ifndef TM_SIM_LAPLACE_H
#define TM_SIM_LAPLACE_H

#include "tensormass/mesh.h"

/* Solves Laplace's equation on the mesh's linear tetrahedra. The potential is 0 at vertices marked in low[vertex_count]
 * and 1 where only high[vertex_count] is marked; the rest of the surface has no flux. Sets fibre[3*tet_count] to unit
 * vectors along its gradient; tetrahedra with a constant potential use their neighbours' direction. Such rules: Bayer
 * and others, "A novel rule-based algorithm for assigning myocardial fiber orientation", Ann Biomed Eng 40:2243 (2012).
 * Returns TM_ERR_MESH if a connected component lacks one of the sets (`entity`: one of its vertices), TM_ERR_MEMORY, or
 * TM_ERR_LIMIT without convergence within vertex_count iterations. */
tm_status sim_laplace(const tm_mesh *mesh, const uint8_t *low, const uint8_t *high, double *fibre, tm_error *error);

/* Repeats `passes` times: replaces each tetrahedron's axis by the unit mean of its own and its face neighbours', with
 * signs aligned. Returns false if memory is exhausted. */
bool sim_smooth_axes(const tm_mesh *mesh, int passes, double *fibre);

#endif
