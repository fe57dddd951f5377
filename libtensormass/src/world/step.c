/* The step: runs every stage in turn; a failed call changes nothing. */
#include "world/world_internal.h"

#include <string.h>

/* --- the step --- */

static void rotate(tm_state *s) {
    double *oldest = s->u_prev_m;
    s->u_prev_m = s->u_m;
    s->u_m = s->u_next_m;
    s->u_next_m = oldest;
    s->step++;
    s->time_s += s->dt_s;
}

/* Runs every stage in turn, in the order of tm_phase. Consecutive parallel stages run together, and check their
 * displacements while these are in the cache; then the few that other stages change are checked. */
static void substep(tm_world *world) {
    int32_t looked = TM_NO_STAGE; /* index after the stages whose displacements have been checked */
    for (int32_t i = 0, end; i < world->step_count; i = end) {
        for (end = i; end < world->step_count && world->entry[end].stage.divided; end++) {
        }
        if (end > i) {
            looked = tm_world_changes_few(world, end) ? end : TM_NO_STAGE;
            tm_partitions_run_stages(world, i, end, looked != TM_NO_STAGE);
        } else {
            if (world->timing) tm_profile_enter(world, i);
            tm_stage_do(&world->entry[i].stage, world);
            end = i + 1;
        }
    }
    if (world->timing) tm_profile_enter(world, TM_NO_STAGE);
    if (looked != TM_NO_STAGE)
        world->unstable |= !tm_world_few_are_bounded(world, looked);
    else if (!world->unstable)
        tm_partitions_check_bounded(world);
}

/* Flushes tiny values to zero to avoid denormals. Tissue at rest in its own shape would reach them and stay; on many
 * processors they are ten times slower. Tied to the step's number, so that results do not depend on how steps are
 * grouped into calls. */
enum { FLUSH_EVERY = 256 };
static void flush_denormals(const tm_state *s, int32_t n) {
    const double tiny = 1e-60; /* above 1e-44 m nothing changes, below 1e-76 m nothing is left */
    double *const array[3] = {s->u_m, s->u_prev_m,
                              s->u_next_m}; /* the last: of removed vertices, which are not written again */
    for (int a = 0; a < 3; a++)
        for (int32_t i = 0; i < n; i++) array[a][i] = (array[a][i] + tiny) - tiny;
}

/* --- checkpoint and rollback --- */

static void checkpoint(tm_world *world) {
    const size_t bytes = sizeof(double) * 3 * (size_t)world->tissue->mesh->vertex_count;
    memcpy(world->saved_u_m, world->state.u_m, bytes);
    memcpy(world->saved_u_prev_m, world->state.u_prev_m, bytes);
    memcpy(world->saved_force_N, world->state.force_N, bytes);
    world->saved_step = world->state.step;
    world->saved_time_s = world->state.time_s;
    world->unstable = false;
    tm_cut_begin(world->tissue);
    for (int32_t i = 0; i < world->stage_count; i++)
        if (world->entry[i].stage.checkpoint) world->entry[i].stage.checkpoint(world->entry[i].stage.self);
}

static void rollback(tm_world *world) {
    const size_t bytes = sizeof(double) * 3 * (size_t)world->tissue->mesh->vertex_count;
    const bool cut = tm_cut_rollback(world->tissue);
    memcpy(world->state.u_m, world->saved_u_m, bytes);
    memcpy(world->state.force_N, world->saved_force_N, bytes);
    world->state.step = world->saved_step;
    world->state.time_s = world->saved_time_s;
    if (cut) tm_world_cut(world);
    memcpy(world->state.u_prev_m, world->saved_u_prev_m,
           bytes); /* after the masses, which stop vertices without mass */
    for (int32_t i = 0; i < world->stage_count; i++)
        if (world->entry[i].stage.rollback) world->entry[i].stage.rollback(world->entry[i].stage.self, world);
}

tm_status tm_world_step(tm_world *world, int32_t count) {
    TM_REQUIRE(world && count >= 0, "world is null or count is negative", TM_ERR_ARGUMENT);
    tm_state *s = &world->state;
    const int32_t n = 3 * world->tissue->mesh->vertex_count;
    tm_partitions_begin(world, count); /* first: the workers wake during the checkpoint */
    if (world->revision != world->tissue->surface.revision) tm_world_changed(world); /* cut by the caller since */
    checkpoint(world);
    tm_stage_integrate_freeze_removed(world);
    for (int32_t i = 0; i < count && !world->unstable; i++) {
        world->check_removed = i == 0 || i == count - 1;
        if (world->adaptive) world->parts = tm_adaptive_begin(world);
        for (world->part = 0; world->part < world->parts && !world->unstable; world->part++) {
            substep(world);
            rotate(s);
            if (s->step % FLUSH_EVERY == 0) flush_denormals(s, n);
        }
    }
    tm_partitions_end(world);
    if (world->unstable) {
        rollback(world);
        return TM_ERR_UNSTABLE;
    }
    for (int32_t i = 0; i < world->stage_count; i++) world->entry[i].runs += count;
    return TM_OK;
}
