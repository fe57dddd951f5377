/* Stage "force": the internal force. */
#include "world/world_internal.h"

#include <string.h>

void tm_stage_force_run(void *self, tm_world *world) {
    (void)self;
    tm_tissue_force(world->tissue, world->state.u_m, world->state.force_N);
    if (world->internal_N)
        memcpy(world->internal_N, world->state.force_N, 3 * sizeof(double) * (size_t)world->tissue->mesh->vertex_count);
}
