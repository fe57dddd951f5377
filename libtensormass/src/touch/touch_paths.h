/* Paths of vertices in a substep, as known by now: straight from u to u_next. */
#ifndef TM_TOUCH_PATHS_H
#define TM_TOUCH_PATHS_H

#include "base/vec.h"
#include "touch/touch_internal.h"

static inline void tm_touch_motion(const tm_touching *t, int32_t vertex, double d[3]) {
    vsub(t->world->state.u_next_m + 3 * (int64_t)vertex, t->world->state.u_m + 3 * (int64_t)vertex, d);
}
/* Computes the place of a vertex at a share of the substep. */
static inline void tm_touch_place_at(const tm_touching *t, int32_t vertex, double share, double x[3]) {
    const double *rest = t->world->tissue->mesh->rest_m + 3 * (int64_t)vertex,
                 *u = t->world->state.u_m + 3 * (int64_t)vertex, *next = t->world->state.u_next_m + 3 * (int64_t)vertex;
    for (int c = 0; c < 3; c++) x[c] = rest[c] + u[c] + share * (next[c] - u[c]);
}
/* Computes its places at the start and at the end. */
static inline void tm_touch_ends(const tm_touching *t, int32_t vertex, double from[3], double to[3]) {
    const double *rest = t->world->tissue->mesh->rest_m + 3 * (int64_t)vertex,
                 *u = t->world->state.u_m + 3 * (int64_t)vertex, *next = t->world->state.u_next_m + 3 * (int64_t)vertex;
    for (int c = 0; c < 3; c++) from[c] = rest[c] + u[c], to[c] = from[c] + (next[c] - u[c]);
}
/* Computes the cubic in the share of the substep of the volume between four vertices: that of the vectors from the
 * first to the others. */
void tm_touch_volume(const tm_touching *touching, const int32_t vertex[4], double cubic[4]);
double tm_touch_volume_at(const double cubic[4], double share);
/* Stores the ends of the parts of [0, 1] in which the cubic ascends or descends. Returns the count of parts. */
int tm_touch_volume_parts(const double cubic[4], double end[4]);
/* Returns whether the cubic changes its sign. */
bool tm_touch_volume_crosses(const double cubic[4]);
/* Returns where the cubic changes its sign between two shares. */
double tm_touch_volume_root(const double cubic[4], double low, double high);

#endif
