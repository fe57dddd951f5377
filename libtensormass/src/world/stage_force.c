/* Stage "force": the internal force. */
#include "world/world_internal.h"

#include <string.h>

void tm_stage_force(void *self, tm_world *world, const tm_range *range) {
    (void)self;
    const tm_tissue *tissue = world->tissue;
    tissue->force(&tissue->graph, &world->part[range->part].force, range->begin, range->end, world->state.u_m,
                  world->state.force_N);
    const int64_t begin = 3 * (int64_t)range->begin;
    if (world->internal_N)
        memcpy(world->internal_N + begin, world->state.force_N + begin,
               3 * sizeof(double) * (size_t)(range->end - range->begin));
}
