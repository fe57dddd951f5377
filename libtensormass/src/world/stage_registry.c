/* The list of stages: their order and dependencies, and their notification of changes. */
#include "world/world_internal.h"

#include <math.h>
#include <string.h>

/* --- the length of the step --- */

/* Returns the step that the stages and one more (or null) allow: their stiffnesses k/(4 m) add. An adaptive step leaves
 * a share of the tissue's stiffness free at every level, and that bounds theirs. *least: the stage of the lowest limit.
 */
static double step_limit(const tm_world *world, const tm_stage *more, const tm_stage **least) {
    const double own =
        isfinite(world->guaranteed_step_s) ? 1 / (world->guaranteed_step_s * world->guaranteed_step_s) : 0;
    double sum = 0;
    *least = NULL;
    for (int32_t i = 0; i <= world->stage_count; i++) {
        const tm_stage *stage = i < world->stage_count ? &world->entry[i].stage : more;
        if (!stage || !(stage->step_limit_s > 0)) continue;
        sum += fmax(1 / (stage->step_limit_s * stage->step_limit_s) - own, 0);
        if (!*least || stage->step_limit_s < (*least)->step_limit_s) *least = stage;
    }
    if (!*least) return HUGE_VAL;
    const double only_s = (*least)->step_limit_s; /* of one stage: to the last bit */
    const double limit_s = fmin(1 / sqrt(own + sum) * (1 + 1e-12), only_s);
    return world->adaptive ? sqrt((1 - TM_ADAPTIVE_MARGIN * TM_ADAPTIVE_MARGIN) / sum) : limit_s;
}

static tm_status check_limits(const tm_world *world, const tm_stage *more, double dt_s, tm_error *error) {
    const tm_stage *least;
    const double limit_s = step_limit(world, more, &least);
    if (dt_s <= limit_s) return TM_OK;
    return tm_fail(error, TM_ERR_STEP, -1, "time step %.6g s is above %.6g s, the limit of stage %s; lower the step",
                   dt_s, limit_s, least->name);
}

tm_status tm_world_check_step(const tm_world *world, double dt_s, tm_error *error) {
    if (!isfinite(dt_s) || !(dt_s > 0))
        return tm_fail(error, TM_ERR_STEP, -1, "time step %g s; give a positive one", dt_s);
    if (dt_s > world->guaranteed_step_s && !world->adaptive)
        return tm_fail(error, TM_ERR_STEP, world->guaranteed_tet,
                       "time step %.6g s is above the guaranteed critical step %.6g s, set by "
                       "tetrahedron %d; lower the step or repair that tetrahedron",
                       dt_s, world->guaranteed_step_s, world->guaranteed_tet);
    return check_limits(world, NULL, dt_s, error);
}

/* --- stages --- */

/* Notifies all stages but the integrator, which both callers notify first. */
static void notify_stages(tm_world *world) {
    world->revision = world->tissue->surface.revision;
    for (int32_t i = 0; i < world->stage_count; i++) {
        const tm_stage *stage = &world->entry[i].stage;
        if (stage->step_changed && stage->step_changed != tm_stage_integrate_changed)
            stage->step_changed(stage->self, world);
    }
}

void tm_world_changed(tm_world *world) {
    tm_stage_integrate_changed(NULL, world);
    notify_stages(world);
}

void tm_world_cut(tm_world *world) {
    const int32_t *vertex, count = tm_cut_touched(world->tissue, &vertex);
    tm_stage_integrate_refresh(world, vertex, count);
    notify_stages(world);
}

static int32_t find_stage(const tm_world *world, const char *name) {
    for (int32_t i = 0; i < world->stage_count; i++)
        if (!strcmp(world->entry[i].stage.name, name)) return i;
    return -1;
}

/* The same for a stage, not a substage. */
static int32_t find_whole(const tm_world *world, const char *name) {
    const int32_t at = find_stage(world, name);
    return at >= 0 && world->entry[at].stage.substage_of ? -1 : at;
}

/* Returns the stage that depends on `name`; -1: none. */
static int32_t find_dependent(const tm_world *world, const char *name) {
    for (int32_t i = 0; i < world->stage_count; i++)
        for (int k = 0; k < TM_MAX_NEEDS && world->entry[i].stage.needs[k]; k++)
            if (!strcmp(world->entry[i].stage.needs[k], name)) return i;
    return -1;
}

int32_t tm_world_stage_index(const tm_world *world, const void *self) {
    for (int32_t i = 0; i < world->stage_count; i++)
        if (world->entry[i].stage.self == self && !world->entry[i].stage.substage_of) return i;
    return TM_NO_STAGE;
}

static tm_status check_needs(const tm_world *world, const tm_stage *stage, tm_error *error) {
    for (int k = 0; k < TM_MAX_NEEDS && stage->needs[k]; k++)
        if (find_whole(world, stage->needs[k]) < 0)
            return tm_fail(error, TM_ERR_ARGUMENT, -1, "stage %s requires stage %s, which is missing; add %s first",
                           stage->name, stage->needs[k], stage->needs[k]);
    if (stage->substage_of && find_whole(world, stage->substage_of) < 0)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "stage %s is a substage of stage %s, which is missing; add %s first",
                       stage->name, stage->substage_of, stage->substage_of);
    const int32_t before = stage->runs_before ? find_stage(world, stage->runs_before) : -1;
    if (stage->runs_before && (before < 0 || world->entry[before].stage.phase != stage->phase))
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "stage %s runs before stage %s, which is missing or in another phase; add %s first", stage->name,
                       stage->runs_before, stage->runs_before);
    return TM_OK;
}

/* Returns the index for a stage: after all of its phase, or before the stage that it names. */
static int32_t place_for(const tm_world *world, const tm_stage *stage) {
    if (stage->runs_before) return find_stage(world, stage->runs_before);
    int32_t at = world->stage_count;
    while (at > 0 && world->entry[at - 1].stage.phase > stage->phase) at--;
    return at;
}

tm_status tm_world_add_stage(tm_world *world, const tm_stage *given, int64_t bytes, tm_error *error) {
    TM_REQUIRE(world, "world is null", TM_ERR_ARGUMENT);
    TM_REQUIRE(given && given->size >= offsetof(tm_stage, checkpoint) && given->size <= sizeof *given,
               "stage is null, or its size is not sizeof(tm_stage)", TM_ERR_ARGUMENT);
    tm_stage mine = {0}, *stage = &mine;
    memcpy(stage, given, given->size);
    TM_REQUIRE(stage->name && stage->phase >= TM_PHASE_BEGIN && stage->phase <= TM_PHASE_ON_DEMAND &&
                   (stage->run || stage->range) == (stage->phase != TM_PHASE_ON_DEMAND) &&
                   !(stage->run && stage->range),
               "stage has no name, no phase, or not one of run and range", TM_ERR_ARGUMENT);
    TM_REQUIRE((!stage->divided || stage->range) && (!stage->overlap || stage->run),
               "stage is divided without range, or overlaps without run", TM_ERR_ARGUMENT);
    TM_REQUIRE(!stage->substage_of || !stage->destroy, "stage is a substage and has a destroy function",
               TM_ERR_ARGUMENT);
    TM_REQUIRE(!stage->checkpoint == !stage->rollback && !stage->snapshot == !stage->restore,
               "stage has one of a pair of hooks without the other", TM_ERR_ARGUMENT);
    tm_status status = check_limits(world, stage, world->adaptive ? world->long_step_s : world->state.dt_s, error);
    if (!status) status = check_needs(world, stage, error);
    if (status) return status;
    if (find_stage(world, stage->name) >= 0)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "the world already has stage %s; add it once, with all its settings",
                       stage->name);
    if (world->stage_count == TM_MAX_STAGES)
        return tm_fail(error, TM_ERR_LIMIT, -1, "stage %s would be number %d and %d is the limit; leave an effect out",
                       stage->name, world->stage_count + 1, TM_MAX_STAGES);
    const int32_t at = place_for(world, stage);
    memmove(world->entry + at + 1, world->entry + at, sizeof world->entry[0] * (size_t)(world->stage_count - at));
    world->stage_count++;
    world->step_count += stage->phase != TM_PHASE_ON_DEMAND;
    world->entry[at] = (struct tm_stage_entry){.stage = *stage, .bytes = bytes};
    if (stage->step_changed) stage->step_changed(stage->self, world);
    return TM_OK;
}

/* --- stages that change few displacements --- */

const tm_few tm_changes_none = {0};

void tm_world_set_divides(tm_world *world, const char *stage) { world->entry[find_stage(world, stage)].divides = true; }

void tm_world_set_few(tm_world *world, const char *stage, const tm_few *few) {
    const int32_t at = find_stage(world, stage);
    if (at >= 0) world->entry[at].few = few;
}

bool tm_world_changes_few(const tm_world *world, int32_t slot) {
    for (; slot < world->step_count; slot++) {
        const tm_few *few = world->entry[slot].few;
        if (!few || (few->applies && !few->applies(world->entry[slot].stage.self))) return false;
    }
    return true;
}

bool tm_world_few_are_bounded(const tm_world *world, int32_t slot) {
    bool bounded = true;
    for (; slot < world->step_count; slot++) {
        const tm_few *few = world->entry[slot].few;
        bounded &= !few || !few->is_bounded || few->is_bounded(world->entry[slot].stage.self, world);
    }
    return bounded;
}

/* --- the list --- */

void tm_profile_enter(tm_world *world, int32_t slot) {
    const double now_s = tm_clock_s();
    if (world->profiled != TM_NO_STAGE) world->entry[world->profiled].seconds += now_s - world->profiled_since_s;
    world->profiled = slot;
    world->profiled_since_s = now_s;
}

static tm_stage take_out(tm_world *world, int32_t at) {
    const tm_stage stage = world->entry[at].stage;
    memmove(world->entry + at, world->entry + at + 1, sizeof world->entry[0] * (size_t)(world->stage_count - at - 1));
    world->stage_count--;
    world->step_count -= stage.phase != TM_PHASE_ON_DEMAND;
    if (stage.self && stage.self == world->support) world->support = NULL, world->supports_set++;
    return stage;
}

/* Removes a stage with its substages, and returns it; substages have no memory of their own. */
static tm_stage take_whole(tm_world *world, int32_t at) {
    const tm_stage stage = take_out(world, at);
    for (int32_t i = world->stage_count - 1; i >= 0; i--)
        if (world->entry[i].stage.substage_of && !strcmp(world->entry[i].stage.substage_of, stage.name))
            take_out(world, i);
    return stage;
}

tm_status tm_world_add_stages(tm_world *world, const tm_stage *stage, int32_t count, void *self, int64_t bytes,
                              tm_error *error) {
    for (int32_t i = 0; i < count; i++) {
        tm_stage mine = stage[i];
        mine.size = sizeof mine, mine.self = self;
        const tm_status status = tm_world_add_stage(world, &mine, i == 0 ? bytes : 0, error);
        if (status && i > 0) take_whole(world, find_stage(world, stage[0].name));
        if (status) return status;
    }
    return TM_OK;
}

tm_status tm_world_remove_stage(tm_world *world, const char *name, tm_error *error) {
    TM_REQUIRE(world && name, "world or name is null", TM_ERR_ARGUMENT);
    const int32_t at = find_stage(world, name);
    if (at < 0)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "the world has no stage %s; tm_world_stages lists them", name);
    const int32_t dependent = find_dependent(world, name);
    if (dependent >= 0)
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "stage %s cannot be removed, because stage %s requires it; remove %s first", name,
                       world->entry[dependent].stage.name, world->entry[dependent].stage.name);
    const char *whole = world->entry[at].stage.substage_of;
    if (whole)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "stage %s is a substage of stage %s; remove %s", name, whole, whole);
    const tm_stage stage = take_whole(world, at);
    if (stage.destroy) stage.destroy(stage.self);
    return TM_OK;
}

int32_t tm_world_stages(const tm_world *world, tm_stage_report report[TM_MAX_STAGES]) {
    TM_REQUIRE(world && report, "world or report is null", 0);
    for (int32_t i = 0; i < world->stage_count; i++) {
        const struct tm_stage_entry *slot = world->entry + i;
        report[i] = (tm_stage_report){.name = slot->stage.name,
                                      .phase = slot->stage.phase,
                                      .bytes = slot->bytes,
                                      .runs = slot->runs,
                                      .seconds = slot->seconds,
                                      .divided = slot->stage.divided || slot->divides,
                                      .overlaps = slot->stage.overlap,
                                      .provider = slot->stage.range == tm_stage_force ? world->force.stage : NULL};
    }
    return world->stage_count;
}

void tm_world_remove_all_stages(tm_world *world) {
    while (world->stage_count > 0) { /* stages that depend on others first, else the last */
        int32_t at = world->stage_count - 1;
        while (at > 0 && find_dependent(world, world->entry[at].stage.name) >= 0) at--;
        const tm_stage stage = take_out(world, at);
        if (stage.destroy) stage.destroy(stage.self);
    }
}
