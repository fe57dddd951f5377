/* Directions along which a potential rises from one set of vertices to another. */
#ifndef TM_SIM_LAPLACE_H
#define TM_SIM_LAPLACE_H

#include "tensormass/mesh.h"

/* Laplace's equation on the mesh's linear tetrahedra: the potential is 0 where low[vertex_count] marks, 1 where
 * high[vertex_count] does (and not low), free of flux elsewhere on the surface. fibre[3*tet_count] := unit vectors
 * along its gradient; tetrahedra in which it is constant take their neighbours'. Rules of the kind: Bayer and others,
 * "A novel rule-based algorithm for assigning myocardial fiber orientation", Ann Biomed Eng 40:2243 (2012).
 * TM_ERR_MESH: a piece of the mesh has not both (`entity` a vertex of it). TM_ERR_MEMORY. TM_ERR_LIMIT: no solution
 * within vertex_count iterations. */
tm_status sim_laplace(const tm_mesh *mesh, const uint8_t *low, const uint8_t *high, double *fibre, tm_error *error);

/* `passes` times: each tetrahedron's axis becomes the mean of its own and its neighbours' across faces, either way
 * round, of length 1. False: no memory. */
bool sim_smooth_axes(const tm_mesh *mesh, int passes, double *fibre);

#endif
