/* World: state, the list of stages, the step. */
#include "cut/cut_internal.h"

#include <math.h>
#include <string.h>

tm_world_def tm_world_def_default(void) {
    return (tm_world_def){
        .cookie = TM_COOKIE_WORLD, .size = sizeof(tm_world_def), .step_fraction = 0.9, .damped = true};
}

static const double LARGEST_DISPLACEMENT_M = 1e6;

/* --- the step --- */

static void rotate(tm_state *s) {
    double *oldest = s->u_prev_m;
    s->u_prev_m = s->u_m;
    s->u_m = s->u_next_m;
    s->u_next_m = oldest;
    s->step++;
    s->time_s += s->dt_s;
}

void tm_world_charge(tm_world *world, int32_t slot) {
    const double now_s = tm_clock_s();
    if (world->charged != TM_NO_SLOT) world->slot[world->charged].seconds += now_s - world->charged_since_s;
    world->charged = slot;
    world->charged_since_s = now_s;
}

/* Every stage in its turn; tm_phase is the table of contents. */
static void substep(tm_world *world) {
    for (int32_t i = 0; i < world->step_count; i++) {
        if (world->timing) tm_world_charge(world, i);
        world->slot[i].stage.run(world->slot[i].stage.self, world);
    }
    if (world->timing) tm_world_charge(world, TM_NO_SLOT);
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

/* No displacement is beyond 1e6 m, infinite or no number. Magnitudes of doubles are ordered as their bits are, so that
 * adding what is left from the largest one allowed to the topmost bit sets that bit for all beyond. Looked at after
 * every substep: whole words are an instruction less than comparisons. */
static bool sound(const double *u, int32_t n) {
    uint64_t largest, word, beyond = 0;
    memcpy(&largest, &LARGEST_DISPLACEMENT_M, sizeof largest);
    for (int32_t i = 0; i < n; i++) {
        memcpy(&word, u + i, sizeof word);
        beyond |= (word & INT64_MAX) + (INT64_MAX - largest);
    }
    return !(beyond >> 63);
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
    world->tissue->undo_count = 0;
    world->tissue->kept_revision = world->tissue->surface.revision;
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
    if (world->revision != world->tissue->surface.revision) tm_world_changed(world); /* cut by the caller since */
    keep(world);
    tm_stage_integrate_still(world);
    for (int32_t i = 0; i < count; i++) {
        substep(world);
        rotate(s);
        if (world->unsound || !sound(s->u_m, n)) {
            give_back(world);
            return TM_ERR_UNSTABLE;
        }
        if (s->step % FLUSH_EVERY == 0) flush(s, n);
    }
    for (int32_t i = 0; i < world->stage_count; i++) world->slot[i].runs += count;
    return TM_OK;
}

/* --- the length of the step --- */

static bool allows(const tm_stage *stage, double dt_s) {
    return !(stage->step_limit_s > 0) || dt_s <= stage->step_limit_s;
}

static tm_status above_limit(const tm_stage *stage, double dt_s, tm_error *error) {
    return tm_fail(error, TM_ERR_STEP, -1,
                   "time step %.6g s is above %.6g s, the longest that stage %s allows; lower the step", dt_s,
                   stage->step_limit_s, stage->name);
}

tm_status tm_world_check_step(const tm_world *world, double dt_s, tm_error *error) {
    if (!isfinite(dt_s) || !(dt_s > 0))
        return tm_fail(error, TM_ERR_STEP, -1, "time step %g s; give a positive one", dt_s);
    if (dt_s > world->guaranteed_step_s)
        return tm_fail(error, TM_ERR_STEP, world->guaranteed_tet,
                       "time step %.6g s is above the guaranteed critical step %.6g s, set by "
                       "tetrahedron %d; lower the step or mend that tetrahedron",
                       dt_s, world->guaranteed_step_s, world->guaranteed_tet);
    for (int32_t i = 0; i < world->stage_count; i++)
        if (!allows(&world->slot[i].stage, dt_s)) return above_limit(&world->slot[i].stage, dt_s, error);
    return TM_OK;
}

/* --- stages --- */

/* The integrator is told first, by both callers. */
static void tell_the_others(tm_world *world) {
    world->revision = world->tissue->surface.revision;
    for (int32_t i = 0; i < world->stage_count; i++) {
        const tm_stage *stage = &world->slot[i].stage;
        if (stage->step_changed && stage->step_changed != tm_stage_integrate_changed)
            stage->step_changed(stage->self, world);
    }
}

void tm_world_changed(tm_world *world) {
    tm_stage_integrate_changed(NULL, world);
    tell_the_others(world);
}

void tm_world_cut(tm_world *world) {
    const int32_t *vertex, count = tm_cut_touched(world->tissue, &vertex);
    tm_stage_integrate_refresh(world, vertex, count);
    tell_the_others(world);
}

static int32_t find_stage(const tm_world *world, const char *name) {
    for (int32_t i = 0; i < world->stage_count; i++)
        if (!strcmp(world->slot[i].stage.name, name)) return i;
    return -1;
}

/* The same of a whole stage, not of a part. */
static int32_t find_whole(const tm_world *world, const char *name) {
    const int32_t at = find_stage(world, name);
    return at >= 0 && world->slot[at].stage.part_of ? -1 : at;
}

/* The stage that leans on `name`; -1: none. */
static int32_t find_leaning(const tm_world *world, const char *name) {
    for (int32_t i = 0; i < world->stage_count; i++)
        for (int k = 0; k < TM_MAX_NEEDS && world->slot[i].stage.needs[k]; k++)
            if (!strcmp(world->slot[i].stage.needs[k], name)) return i;
    return -1;
}

int32_t tm_world_slot_of(const tm_world *world, const void *self) {
    for (int32_t i = 0; i < world->stage_count; i++)
        if (world->slot[i].stage.self == self && !world->slot[i].stage.part_of) return i;
    return TM_NO_SLOT;
}

static tm_status check_needs(const tm_world *world, const tm_stage *stage, tm_error *error) {
    for (int k = 0; k < TM_MAX_NEEDS && stage->needs[k]; k++)
        if (find_whole(world, stage->needs[k]) < 0)
            return tm_fail(error, TM_ERR_ARGUMENT, -1, "stage %s leans on stage %s, which is not there; add that first",
                           stage->name, stage->needs[k]);
    if (stage->part_of && find_whole(world, stage->part_of) < 0)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "stage %s is a part of stage %s, which is not there; add that first",
                       stage->name, stage->part_of);
    const int32_t before = stage->before ? find_stage(world, stage->before) : -1;
    if (stage->before && (before < 0 || world->slot[before].stage.phase != stage->phase))
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "stage %s runs before stage %s, which is not there or of another phase; add that first",
                       stage->name, stage->before);
    return TM_OK;
}

/* Behind all of its phase, or before the one it names. */
static int32_t place_for(const tm_world *world, const tm_stage *stage) {
    if (stage->before) return find_stage(world, stage->before);
    int32_t at = world->stage_count;
    while (at > 0 && world->slot[at - 1].stage.phase > stage->phase) at--;
    return at;
}

tm_status tm_world_add_stage(tm_world *world, const tm_stage *given, int64_t bytes, tm_error *error) {
    TM_REQUIRE(world, "world is null", TM_ERR_ARGUMENT);
    TM_REQUIRE(given && given->size >= offsetof(tm_stage, keep) && given->size <= sizeof *given,
               "stage is null or its size is not sizeof(tm_stage)", TM_ERR_ARGUMENT);
    tm_stage mine = {0}, *stage = &mine;
    memcpy(stage, given, given->size);
    TM_REQUIRE(stage->name && stage->phase >= TM_PHASE_BEGIN && stage->phase <= TM_PHASE_BETWEEN &&
                   !stage->run == (stage->phase == TM_PHASE_BETWEEN),
               "stage has no name, no run or no phase", TM_ERR_ARGUMENT);
    TM_REQUIRE(!stage->part_of || !stage->destroy, "stage is a part and has a destroy of its own", TM_ERR_ARGUMENT);
    TM_REQUIRE(!stage->keep == !stage->give_back && !stage->snapshot == !stage->restore,
               "stage has one of a pair of hooks without the other", TM_ERR_ARGUMENT);
    const tm_status status = allows(stage, world->state.dt_s) ? check_needs(world, stage, error)
                                                              : above_limit(stage, world->state.dt_s, error);
    if (status) return status;
    if (find_stage(world, stage->name) >= 0)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "stage %s is there already; give it everything at once",
                       stage->name);
    if (world->stage_count == TM_MAX_STAGES)
        return tm_fail(error, TM_ERR_LIMIT, -1, "stage %s would be number %d of at most %d; leave an effect out",
                       stage->name, world->stage_count + 1, TM_MAX_STAGES);
    const int32_t at = place_for(world, stage);
    memmove(world->slot + at + 1, world->slot + at, sizeof world->slot[0] * (size_t)(world->stage_count - at));
    world->stage_count++;
    world->step_count += stage->phase != TM_PHASE_BETWEEN;
    world->slot[at] = (struct tm_stage_slot){.stage = *stage, .bytes = bytes};
    if (stage->run == tm_stage_support_run) world->support = stage->self;
    if (stage->step_changed) stage->step_changed(stage->self, world);
    return TM_OK;
}

static tm_stage take_out(tm_world *world, int32_t at) {
    const tm_stage stage = world->slot[at].stage;
    memmove(world->slot + at, world->slot + at + 1, sizeof world->slot[0] * (size_t)(world->stage_count - at - 1));
    world->stage_count--;
    world->step_count -= stage.phase != TM_PHASE_BETWEEN;
    if (stage.self && stage.self == world->support) world->support = NULL;
    return stage;
}

/* Takes a stage out with its parts, and returns it: they have no memory of their own. */
static tm_stage take_whole(tm_world *world, int32_t at) {
    const tm_stage stage = take_out(world, at);
    for (int32_t i = world->stage_count - 1; i >= 0; i--)
        if (world->slot[i].stage.part_of && !strcmp(world->slot[i].stage.part_of, stage.name)) take_out(world, i);
    return stage;
}

tm_status tm_world_add_stages(tm_world *world, const tm_stage *stage, int32_t count, tm_phase phase, void *self,
                              int64_t bytes, tm_error *error) {
    for (int32_t i = 0; i < count; i++) {
        tm_stage mine = stage[i];
        mine.size = sizeof mine, mine.phase = phase, mine.self = self;
        const tm_status status = tm_world_add_stage(world, &mine, i == 0 ? bytes : 0, error);
        if (status && i > 0) take_whole(world, find_stage(world, stage[0].name));
        if (status) return status;
    }
    return TM_OK;
}

tm_status tm_world_remove_stage(tm_world *world, const char *name, tm_error *error) {
    TM_REQUIRE(world && name, "world or name is null", TM_ERR_ARGUMENT);
    const int32_t at = find_stage(world, name);
    if (at < 0) return tm_fail(error, TM_ERR_ARGUMENT, -1, "no stage %s; see tm_world_stages", name);
    const int32_t leaning = find_leaning(world, name);
    if (leaning >= 0)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "stage %s cannot go: stage %s leans on it; remove %s first", name,
                       world->slot[leaning].stage.name, world->slot[leaning].stage.name);
    const char *whole = world->slot[at].stage.part_of;
    if (whole)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "stage %s is a part of stage %s; remove %s", name, whole, whole);
    const tm_stage stage = take_whole(world, at);
    if (stage.destroy) stage.destroy(stage.self);
    return TM_OK;
}

int32_t tm_world_stages(const tm_world *world, tm_stage_report report[TM_MAX_STAGES]) {
    TM_REQUIRE(world && report, "world or report is null", 0);
    for (int32_t i = 0; i < world->stage_count; i++) {
        const struct tm_stage_slot *slot = world->slot + i;
        report[i] = (tm_stage_report){slot->stage.name, slot->stage.phase, slot->bytes, slot->runs, slot->seconds};
    }
    return world->stage_count;
}

/* --- creation --- */

static bool take(tm_world *world, tm_pool *pool, const tm_world_def *def) {
    const int64_t n = def->tissue->mesh->vertex_count;
    world->state.u_m = TM_TAKE(pool, double, 3 * n);
    world->state.u_prev_m = TM_TAKE(pool, double, 3 * n);
    world->state.u_next_m = TM_TAKE(pool, double, 3 * n);
    world->state.force_N = TM_TAKE(pool, double, 3 * n);
    world->keep_u_m = TM_TAKE(pool, double, 3 * n);
    world->keep_u_prev_m = TM_TAKE(pool, double, 3 * n);
    world->keep_force_N = TM_TAKE(pool, double, 3 * n);
    world->held_scratch = TM_TAKE(pool, uint8_t, 3 * n);
    world->mobility_s2_kg = TM_TAKE(pool, double, n);
    if (def->damped) world->carry = TM_TAKE(pool, double, n);
    return !pool->failed;
}

static tm_status set_up(tm_world *world, const tm_world_def *def, tm_error *error) {
    world->tissue = def->tissue;
    world->revision = def->tissue->surface.revision;
    world->damped = def->damped;
    world->charged = TM_NO_SLOT;
    if (!def->damped)
        for (int32_t t = 0; t < def->tissue->mesh->tet_count; t++)
            if (tm_tissue_tet_material(def->tissue, t)->damping_1_s > 0)
                return tm_fail(error, TM_ERR_ARGUMENT, def->tissue->mesh->region[t],
                               "region %d: damping %g 1/s in an undamped world; ask "
                               "for a damped world or set the damping to 0",
                               def->tissue->mesh->region[t], tm_tissue_tet_material(def->tissue, t)->damping_1_s);
    if (!tm_critical_step_find(def->tissue, &world->guaranteed_step_s, &world->guaranteed_tet))
        return tm_fail_memory(error, "critical step");
    if (def->dt_s == 0 && !(def->step_fraction > 0 && def->step_fraction <= 1))
        return tm_fail(error, TM_ERR_STEP, -1, "step fraction %g; give one above 0 and not above 1",
                       def->step_fraction);
    if (def->dt_s == 0 && world->guaranteed_step_s == HUGE_VAL)
        return tm_fail(error, TM_ERR_STEP, -1, "no living tetrahedron sets a critical step; give a time step");
    const double dt_s = def->dt_s == 0 ? world->guaranteed_step_s * def->step_fraction : def->dt_s;
    tm_status status = tm_world_check_step(world, dt_s, error);
    if (status) return status;
    world->state.dt_s = dt_s;
    const tm_stage force = {
        .size = sizeof(tm_stage), .name = "force", .phase = TM_PHASE_FORCE, .run = tm_stage_force_run};
    const tm_stage integrate = {.size = sizeof(tm_stage),
                                .name = "integrate",
                                .phase = TM_PHASE_INTEGRATE,
                                .step_changed = tm_stage_integrate_changed,
                                .run = def->damped ? tm_stage_integrate_damped_run : tm_stage_integrate_run};
    status = tm_world_add_stage(world, &force, 0, error);
    return status ? status : tm_world_add_stage(world, &integrate, 0, error);
}

tm_status tm_world_create(const tm_world_def *def, tm_world **world, tm_error *error) {
    TM_REQUIRE_DEF(def, TM_COOKIE_WORLD, TM_ERR_ARGUMENT);
    TM_REQUIRE(world && def->tissue, "world or def->tissue is null", TM_ERR_ARGUMENT);
    tm_pool pool = {0};
    tm_world *w = TM_TAKE(&pool, tm_world, 1);
    tm_status status = w && take(w, &pool, def) ? TM_OK : tm_fail_memory(error, "world");
    if (!status) status = set_up(w, def, error);
    if (status) {
        tm_pool_release(&pool);
        return status;
    }
    w->pool = pool;
    *world = w;
    return TM_OK;
}

void tm_world_destroy(tm_world *world) {
    if (!world) return;
    while (world->stage_count > 0) { /* what leans on others first, else the last */
        int32_t at = world->stage_count - 1;
        while (at > 0 && find_leaning(world, world->slot[at].stage.name) >= 0) at--;
        const tm_stage stage = take_out(world, at);
        if (stage.destroy) stage.destroy(stage.self);
    }
    tm_pool pool = world->pool;
    tm_pool_release(&pool);
}

/* --- the rest --- */

#define WORLD_IS_GIVEN(...) TM_REQUIRE(world, "world is null", __VA_ARGS__)

void tm_world_set_timing(tm_world *world, bool on) {
    WORLD_IS_GIVEN();
    world->timing = on;
}
void tm_world_work_of(tm_world *world, const void *self) {
    WORLD_IS_GIVEN();
    if (world->timing) tm_world_charge(world, self ? tm_world_slot_of(world, self) : TM_NO_SLOT);
}
tm_state *tm_world_state(tm_world *world) {
    WORLD_IS_GIVEN(NULL);
    return &world->state;
}
tm_tissue *tm_world_tissue(tm_world *world) {
    WORLD_IS_GIVEN(NULL);
    return world->tissue;
}
double tm_world_step_s(const tm_world *world) {
    WORLD_IS_GIVEN(0);
    return world->state.dt_s;
}
const double *tm_world_mobility_s2_kg(const tm_world *world) {
    WORLD_IS_GIVEN(NULL);
    return world->mobility_s2_kg;
}

static void run_phases(tm_world *world, tm_phase first, tm_phase last) {
    for (int32_t i = 0; i < world->stage_count; i++) {
        const tm_stage *stage = &world->slot[i].stage;
        if (stage->phase >= first && stage->phase <= last) stage->run(stage->self, world);
    }
}

/* The velocity between two steps belongs to their middle: a new step moves that middle, and the velocity with it.
 * Without this half kick (u_prev merely rescaled) random changes of the step feed energy in. */
tm_status tm_world_set_step(tm_world *world, double dt_s, tm_error *error) {
    WORLD_IS_GIVEN(TM_ERR_ARGUMENT);
    const tm_status status = tm_world_check_step(world, dt_s, error);
    if (status) return status;
    tm_state *s = &world->state;
    run_phases(world, TM_PHASE_FORCE, TM_PHASE_LOAD); /* force_N at time_s, which the kick below needs */
    uint8_t *held = world->held_scratch;
    memset(held, 0, 3 * (size_t)world->tissue->mesh->vertex_count);
    tm_support_mask(world, held);
    for (int32_t i = 0; i < 3 * world->tissue->mesh->vertex_count; i++) {
        const double mass = world->tissue->mass_kg[i / 3];
        double v = (s->u_m[i] - s->u_prev_m[i]) / s->dt_s;
        if (!held[i] && mass > 0)
            v += 0.5 * (s->dt_s - dt_s) * (s->force_N[i] - world->tissue->damping_kg_s[i / 3] * v) / mass;
        s->u_prev_m[i] = s->u_m[i] - dt_s * v;
    }
    s->dt_s = dt_s;
    tm_world_changed(world);
    return TM_OK;
}

uint64_t tm_world_hash(const tm_world *world) {
    WORLD_IS_GIVEN(0);
    const size_t bytes = sizeof(double) * 3 * (size_t)world->tissue->mesh->vertex_count;
    return tm_hash(world->state.u_prev_m, bytes, tm_hash(world->state.u_m, bytes, TM_HASH_SEED));
}
