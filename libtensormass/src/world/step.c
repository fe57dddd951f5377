/* The step: every stage in its turn, and all or nothing. */
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

/* Every stage in its turn; tm_phase is the table of contents. Divided stages that follow each other run together, and
 * look at what they made of the displacements while it is in the cache; then the few that others change are looked at.
 */
static void substep(tm_world *world) {
    int32_t looked = TM_NO_SLOT; /* behind the stages whose displacements have been looked at, up to the last ones */
    for (int32_t i = 0, end; i < world->step_count; i = end) {
        for (end = i; end < world->step_count && world->slot[end].stage.divided; end++) {
        }
        if (end > i) {
            looked = tm_world_changes_few(world, end) ? end : TM_NO_SLOT;
            tm_parts_run_stages(world, i, end, looked != TM_NO_SLOT);
        } else {
            if (world->timing) tm_world_charge(world, i);
            tm_stage_do(&world->slot[i].stage, world);
            end = i + 1;
        }
    }
    if (world->timing) tm_world_charge(world, TM_NO_SLOT);
    if (looked != TM_NO_SLOT)
        world->unsound |= !tm_world_few_are_bounded(world, looked);
    else if (!world->unsound)
        tm_parts_look(world);
}

/* What has died away to nothing becomes nothing: tissue at rest in its own shape would end among the denormals, on
 * which many processors are ten times slower, and never leave them. Tied to the step's number, so that bits do not
 * depend on how steps are grouped into calls. */
enum { FLUSH_EVERY = 256 };
static void flush(const tm_state *s, int32_t n) {
    const double tiny = 1e-60; /* above 1e-44 m nothing changes, below 1e-76 m nothing is left */
    double *const array[3] = {s->u_m, s->u_prev_m, s->u_next_m}; /* the last: of the dead, which nobody writes again */
    for (int a = 0; a < 3; a++)
        for (int32_t i = 0; i < n; i++) array[a][i] = (array[a][i] + tiny) - tiny;
}

/* --- all or nothing --- */

static void keep(tm_world *world) {
    const size_t bytes = sizeof(double) * 3 * (size_t)world->tissue->mesh->vertex_count;
    memcpy(world->keep_u_m, world->state.u_m, bytes);
    memcpy(world->keep_u_prev_m, world->state.u_prev_m, bytes);
    memcpy(world->keep_force_N, world->state.force_N, bytes);
    world->keep_step = world->state.step;
    world->keep_time_s = world->state.time_s;
    world->unsound = false;
    tm_cut_begin(world->tissue);
    for (int32_t i = 0; i < world->stage_count; i++)
        if (world->slot[i].stage.keep) world->slot[i].stage.keep(world->slot[i].stage.self);
}

static void give_back(tm_world *world) {
    const size_t bytes = sizeof(double) * 3 * (size_t)world->tissue->mesh->vertex_count;
    const bool cut = tm_cut_give_back(world->tissue);
    memcpy(world->state.u_m, world->keep_u_m, bytes);
    memcpy(world->state.force_N, world->keep_force_N, bytes);
    world->state.step = world->keep_step;
    world->state.time_s = world->keep_time_s;
    if (cut) tm_world_cut(world);
    memcpy(world->state.u_prev_m, world->keep_u_prev_m, bytes); /* after the masses, which stop what weighs nothing */
    for (int32_t i = 0; i < world->stage_count; i++)
        if (world->slot[i].stage.give_back) world->slot[i].stage.give_back(world->slot[i].stage.self, world);
}

tm_status tm_world_step(tm_world *world, int32_t count) {
    TM_REQUIRE(world && count >= 0, "world is null or count is negative", TM_ERR_ARGUMENT);
    tm_state *s = &world->state;
    const int32_t n = 3 * world->tissue->mesh->vertex_count;
    tm_parts_begin(world, count); /* first: the others wake while this one keeps what was */
    if (world->revision != world->tissue->surface.revision) tm_world_changed(world); /* cut by the caller since */
    keep(world);
    tm_stage_integrate_still(world);
    for (int32_t i = 0; i < count && !world->unsound; i++) {
        world->look_at_dead = i == 0 || i == count - 1;
        substep(world);
        rotate(s);
        if (s->step % FLUSH_EVERY == 0) flush(s, n);
    }
    tm_parts_end(world);
    if (world->unsound) {
        give_back(world);
        return TM_ERR_UNSTABLE;
    }
    for (int32_t i = 0; i < world->stage_count; i++) world->slot[i].runs += count;
    return TM_OK;
}
