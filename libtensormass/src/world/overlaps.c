/* Overlapped work: what later stages compute from the start of a substep, done by the threads of a job that computes
 * the force. Work that cannot be divided fills one thread; the shares of the job then move to the others, by the
 * measured times. */
#include "world/world_internal.h"

bool tm_overlaps_begin(tm_world *world, int32_t end) {
    world->group_end = end;
    world->overlap_count = 0;
    for (int32_t i = end; i < world->step_count; i++) {
        const tm_stage *stage = &world->entry[i].stage;
        if (stage->overlap && stage->overlap->begin(stage->self, world)) world->overlap[world->overlap_count++] = i;
    }
    return world->overlap_count > 0;
}

bool tm_overlaps_begin_after(tm_world *world, const void *self) {
    int32_t end = 0;
    while (end < world->step_count && world->entry[end].stage.self != self) end++;
    while (end < world->step_count &&
           (world->entry[end].stage.phase <= TM_PHASE_INTEGRATE || world->entry[end].stage.divided))
        end++;
    return tm_overlaps_begin(world, end);
}

void tm_overlaps_work(tm_world *world, int32_t part) {
    const int32_t own = world->profiled;
    const bool timed = world->timing && part == 0;
    for (int32_t i = 0; i < world->overlap_count; i++) {
        const tm_stage *stage = &world->entry[world->overlap[i]].stage;
        if (timed) tm_profile_enter(world, world->overlap[i]);
        stage->overlap->work(stage->self, world, part);
    }
    if (timed && world->overlap_count) tm_profile_enter(world, own);
}
