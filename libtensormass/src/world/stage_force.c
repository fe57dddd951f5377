/* Stage "force": the internal force. Of tissue whose whole law another stage computes 0, and the tensors' force for the
 * account of energy alone. */
#include "world/world_internal.h"

#include <string.h>

void tm_stage_force(void *self, tm_world *world, const tm_range *range) {
    (void)self;
    const tm_tissue *tissue = world->tissue;
    const int64_t begin = 3 * (int64_t)range->begin;
    const size_t bytes = 3 * sizeof(double) * (size_t)(range->end - range->begin);
    double *of = world->whole_law ? world->internal_N : world->state.force_N;
    if (of)
        tissue->force(&tissue->graph, &world->part[range->part].force, range->begin, range->end, world->state.u_m, of);
    if (world->whole_law)
        memset(world->state.force_N + begin, 0, bytes);
    else if (world->internal_N)
        memcpy(world->internal_N + begin, of + begin, bytes);
}
