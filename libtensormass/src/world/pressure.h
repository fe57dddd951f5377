/* Pressures that follow the surface, for settling. */
#ifndef TM_PRESSURE_H
#define TM_PRESSURE_H

#include "tissue/tangent.h"
#include "world/world_internal.h"

tm_stage_range tm_stage_pressure_run;
bool tm_world_has_pressure(const tm_world *world);
/* force_N [3*vertex_count] += the force of all pressures at u_m. */
void tm_pressure_add(const tm_world *world, const double *u_m, double *force_N);
/* Adds the symmetric part of minus its derivative. */
void tm_pressure_add_tangent(const tm_world *world, const double *u_m, tm_tangent *tangent);

#endif
