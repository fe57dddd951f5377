/* Distance of instruments from the tissue's surface: for waypoints above it, and for remarks. Not used in the step. */
#ifndef TM_SIM_SURFACE_H
#define TM_SIM_SURFACE_H

#include "sim.h"

/* Returns how far a sphere of this radius moves from `from_m` along the unit vector `along` to its first touch of the
 * undeformed tissue, m. 0: it touches at once; negative: never. */
double sim_way_to_touch(const tm_mesh *mesh, const double from_m[3], const double along[3], double radius_m);
/* Returns the distance from a point to the current surface, m. */
double sim_surface_distance(const sim *s, const double point_m[3]);
/* Returns whether the point is in a tetrahedron of the undeformed tissue. */
bool sim_is_inside(const tm_mesh *mesh, const double point_m[3]);

bool sim_is_in_tet(const tm_mesh *mesh, int32_t tet, const double point_m[3]);
/* Returns the distance from a point to the undeformed surface of a body, m; tet_body: body of each tetrahedron. */
double sim_body_distance(const tm_mesh *mesh, const int32_t *tet_body, int32_t body, const double point_m[3]);

/* Warns about a scene that is valid but probably a mistake. Returns 0, or a status if the scene is strict. */
tm_status sim_warn(const sim *s);
/* The same for the model's substeps. */
tm_status sim_warn_timing(const sim *s);

#endif
