/* Stage "force": the internal force. */
#include "internal.h"

void tm_stage_force_run(void *self, tm_world *world) {
    (void)self;
    tm_tissue_force(world->tissue, world->state.u_m, world->state.force_N);
}
