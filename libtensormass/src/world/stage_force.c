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

/* --- a provider of some bodies --- */

/* Continues the pass over the vertices [first, last) of bodies, or of what a partition has of them. */
static void follow(tm_world *world, const tm_range *range, int32_t first, int32_t last, const double *u_m) {
    tm_partition *p = world->partition + range->partition;
    const tm_tissue *tissue = world->tissue;
    const int32_t begin = range->begin > first ? range->begin : first, end = range->end < last ? range->end : last;
    if (first < p->force.begin) first = p->force.begin;
    if (last > p->force.end) last = p->force.end;
    if (begin == first) {
        p->piece = p->force;
        p->piece.begin = first, p->piece.end = last;
        if (first > p->force.begin) p->piece.halo_count = 0; /* a body begins here */
    }
    if (u_m)
        tissue->force(&tissue->graph, &p->piece, begin, end, u_m, world->state.force_N);
    else
        memset(world->state.force_N + 3 * (int64_t)begin, 0, 3 * sizeof(double) * (size_t)(end - begin));
}

/* Computes the bodies of the provider and those between them, each by its own displacement. */
static void divided(tm_world *world, const tm_range *range) {
    const tm_force_provider *provider = &world->force;
    const tm_ranges *where = provider->where;
    int32_t at = 0;
    for (int32_t i = 0; i <= where->count; i++) {
        const int32_t begin = i < where->count ? where->end[2 * i] : world->tissue->mesh->vertex_count;
        const int32_t end = i < where->count ? where->end[2 * i + 1] : begin;
        if (at < range->end && begin > range->begin && at < begin) follow(world, range, at, begin, world->state.u_m);
        if (begin < range->end && end > range->begin) follow(world, range, begin, end, provider->u_m);
        at = end;
    }
}

/* Energy accounting needs the tensors' force of all. */
static void divided_accounted(tm_world *world, const tm_range *range) {
    const tm_ranges *where = world->force.where;
    elastic(world, range);
    for (int32_t i = 0, begin, end; tm_ranges_next(where, &i, range->begin, range->end, &begin, &end);)
        memset(world->state.force_N + 3 * (int64_t)begin, 0, 3 * sizeof(double) * (size_t)(end - begin));
}

void tm_stage_force(void *self, tm_world *world, const tm_range *range) {
    const tm_force_provider *provider = &world->force;
    (void)self;
    if (provider->where && world->internal_N && !provider->u_m)
        divided_accounted(world, range);
    else if (provider->where)
        divided(world, range);
    else if (provider->range)
        provider->range(provider->self, world, range);
    else if (provider->stage)
        none(world, range);
    else
        elastic(world, range);
}

void tm_world_set_force(tm_world *world, const tm_force_provider *provider) {
    world->force = provider ? *provider : (tm_force_provider){0};
}
