/* Where instruments are against the tissue's surface: for waypoints above it, and for remarks. Not for the step. */
#ifndef TM_SIM_SURFACE_H
#define TM_SIM_SURFACE_H

#include "sim.h"

/* How far a sphere of this radius goes from `from_m` along the unit vector `along` until it touches the tissue at rest,
 * m; negative: never. 0: it touches at once. */
double sim_way_to_touch(const tm_mesh *mesh, const double from_m[3], const double along[3], double radius_m);
/* Distance from a point to the surface as it is now, m. */
double sim_surface_distance(const sim *s, const double point_m[3]);
/* In a tetrahedron of the tissue at rest. */
bool sim_is_inside(const tm_mesh *mesh, const double point_m[3]);

/* Warnings about a scene that is valid and probably not meant. 0, or a status where the scene is strict. */
tm_status sim_warn(const sim *s);
/* The same of the model's substeps. */
tm_status sim_warn_timing(const sim *s);

#endif
