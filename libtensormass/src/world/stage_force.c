/* Stage "force": the internal force, by the law set in the world (tm_force_provider). */
#include "world/world_internal.h"

#include <string.h>

/* Computes the force of the tissue's tensors, with a copy for energy accounting. */
static void elastic(tm_world *world, const tm_range *range) {
    const tm_tissue *tissue = world->tissue;
    const int64_t begin = 3 * (int64_t)range->begin;
    const size_t bytes = 3 * sizeof(double) * (size_t)(range->end - range->begin);
    double *force_N = world->state.force_N;
    tissue->force(&tissue->graph, &world->partition[range->partition].force, range->begin, range->end, world->state.u_m,
                  force_N);
    if (world->internal_N) memcpy(world->internal_N + begin, force_N + begin, bytes);
}

/* Sets the force to zero: another stage adds the complete law. Energy accounting still gets the tensors' force. */
static void none(tm_world *world, const tm_range *range) {
    const tm_tissue *tissue = world->tissue;
    const int64_t begin = 3 * (int64_t)range->begin;
    const size_t bytes = 3 * sizeof(double) * (size_t)(range->end - range->begin);
    if (world->internal_N)
        tissue->force(&tissue->graph, &world->partition[range->partition].force, range->begin, range->end,
                      world->state.u_m, world->internal_N);
    memset(world->state.force_N + begin, 0, bytes);
}

void tm_stage_force(void *self, tm_world *world, const tm_range *range) {
    const tm_force_provider *provider = &world->force;
    (void)self;
    if (provider->range)
        provider->range(provider->self, world, range);
    else if (provider->stage)
        none(world, range);
    else
        elastic(world, range);
}

void tm_world_set_force(tm_world *world, const tm_force_provider *provider) {
    world->force = provider ? *provider : (tm_force_provider){0};
}
