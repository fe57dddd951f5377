/* World: creation, and the functions between steps. */
#include "world/world_internal.h"

#include <math.h>
#include <string.h>

tm_world_def tm_world_def_default(void) {
    return (tm_world_def){
        .cookie = TM_COOKIE_WORLD, .size = sizeof(tm_world_def), .step_fraction = 0.9, .damped = true, .threads = 1};
}

/* --- creation --- */

static bool init(tm_world *world, tm_pool *pool, const tm_world_def *def) {
    const int64_t n = def->tissue->mesh->vertex_count;
    world->state.u_m = TM_ALLOC(pool, double, 3 * n);
    world->state.u_prev_m = TM_ALLOC(pool, double, 3 * n);
    world->state.u_next_m = TM_ALLOC(pool, double, 3 * n);
    world->state.force_N = TM_ALLOC(pool, double, 3 * n);
    world->saved_u_m = TM_ALLOC(pool, double, 3 * n);
    world->saved_u_prev_m = TM_ALLOC(pool, double, 3 * n);
    world->saved_force_N = TM_ALLOC(pool, double, 3 * n);
    world->fixed_scratch = TM_ALLOC(pool, uint8_t, 3 * n);
    world->mobility_s2_kg = TM_ALLOC(pool, double, n);
    const int64_t undamped = pool->bytes;
    if (def->damped) world->inertia = TM_ALLOC(pool, double, n);
    world->inertia_bytes = pool->bytes - undamped;
    return tm_partitions_init(world, pool, def) && !pool->failed;
}

static tm_status set_up(tm_world *world, const tm_world_def *def, tm_error *error) {
    world->tissue = def->tissue;
    world->revision = def->tissue->surface.revision;
    world->damped = def->damped;
    world->wide = tm_force_is_wide(def->tissue->force);
    world->profiled = TM_NO_STAGE;
    world->parts = 1;
    world->largest_m = TM_DISPLACEMENT_MAX * tm_mesh_size_m(def->tissue->mesh);
    if (!def->damped)
        for (int32_t t = 0; t < def->tissue->mesh->tet_count; t++)
            if (tm_tissue_tet_material(def->tissue, t)->damping_1_s > 0)
                return tm_fail(
                    error, TM_ERR_ARGUMENT, def->tissue->mesh->region[t],
                    "region %d has damping %g 1/s and the world is undamped; make a damped world, or set the damping to 0",
                    def->tissue->mesh->region[t], tm_tissue_tet_material(def->tissue, t)->damping_1_s);
    if (!tm_critical_step_find(def->tissue, &world->guaranteed_step_s, &world->guaranteed_tet))
        return tm_fail_memory(error, "critical step");
    if (def->dt_s == 0 && !(def->step_fraction > 0 && def->step_fraction <= 1))
        return tm_fail(error, TM_ERR_STEP, -1, "the step fraction is %g; give a value above 0, at most 1",
                       def->step_fraction);
    if (def->dt_s == 0 && world->guaranteed_step_s == HUGE_VAL)
        return tm_fail(error, TM_ERR_STEP, -1, "no active tetrahedron sets a critical step; give a time step");
    const double dt_s = def->dt_s == 0 ? world->guaranteed_step_s * def->step_fraction : def->dt_s;
    tm_status status = tm_world_check_step(world, dt_s, error);
    if (status) return status;
    world->state.dt_s = dt_s;
    const tm_stage force = {
        .size = sizeof(tm_stage), .name = "force", .phase = TM_PHASE_FORCE, .range = tm_stage_force, .divided = true};
    const tm_stage integrate = {.size = sizeof(tm_stage),
                                .name = "integrate",
                                .phase = TM_PHASE_INTEGRATE,
                                .step_changed = tm_stage_integrate_changed,
                                .range = def->damped ? tm_stage_integrate_damped : tm_stage_integrate,
                                .divided = true};
    status = tm_world_add_stage(world, &force, 0, error);
    if (!status) status = tm_world_add_stage(world, &integrate, world->inertia_bytes, error);
    return status || !world->tissue->stiffest_Pa ? status : tm_stage_law(world, error);
}

tm_status tm_world_create(const tm_world_def *def, tm_world **world, tm_error *error) {
    TM_REQUIRE_DEF(def, TM_COOKIE_WORLD, TM_ERR_ARGUMENT);
    TM_REQUIRE(world && def->tissue, "world or def->tissue is null", TM_ERR_ARGUMENT);
    if (def->threads < 1 || def->threads > TM_MAX_THREADS)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "the world has %d threads; give 1 to %d", (int)def->threads,
                       TM_MAX_THREADS);
    tm_pool pool = {0};
    tm_world *w = TM_ALLOC(&pool, tm_world, 1);
    tm_status status = w && init(w, &pool, def) ? TM_OK : tm_fail_memory(error, "world");
    if (!status) status = set_up(w, def, error);
    if (status) {
        if (w) tm_thread_pool_destroy(w->thread_pool);
        tm_pool_release(&pool);
        return status;
    }
    w->pool = pool;
    *world = w;
    return TM_OK;
}

void tm_world_destroy(tm_world *world) {
    if (!world) return;
    tm_world_remove_all_stages(world);
    tm_thread_pool_destroy(world->thread_pool);
    tm_pool pool = world->pool;
    tm_pool_release(&pool);
}

/* --- the rest --- */

#define WORLD_IS_GIVEN(...) TM_REQUIRE(world, "world is null", __VA_ARGS__)

void tm_world_set_timing(tm_world *world, bool on) {
    WORLD_IS_GIVEN();
    world->timing = on;
}
void tm_world_profile_stage(tm_world *world, const void *self) {
    WORLD_IS_GIVEN();
    if (world->timing) tm_profile_enter(world, self ? tm_world_stage_index(world, self) : TM_NO_STAGE);
}
tm_state *tm_world_state(tm_world *world) {
    WORLD_IS_GIVEN(NULL);
    return &world->state;
}
tm_tissue *tm_world_tissue(tm_world *world) {
    WORLD_IS_GIVEN(NULL);
    return world->tissue;
}
int32_t tm_world_partitions(const tm_world *world) {
    WORLD_IS_GIVEN(0);
    return world->partition_count;
}
double tm_world_largest_displacement_m(const tm_world *world) {
    WORLD_IS_GIVEN(0);
    return world->largest_m;
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
        const tm_stage *stage = &world->entry[i].stage;
        if (stage->phase >= first && stage->phase <= last) tm_stage_do(stage, world);
    }
}

/* The velocity between two steps belongs to their middle: a new step moves that middle, and the velocity with it.
 * Without this half kick (u_prev merely rescaled) random changes of the step feed energy in. */
tm_status tm_world_set_step(tm_world *world, double dt_s, tm_error *error) {
    WORLD_IS_GIVEN(TM_ERR_ARGUMENT);
    if (world->adaptive)
        return tm_fail(error, TM_ERR_EXCLUDED, -1,
                       "a world with an adaptive step chooses its own; create one without to set the step");
    const tm_status status = tm_world_check_step(world, dt_s, error);
    if (!status) tm_world_change_step(world, dt_s);
    return status;
}

void tm_world_change_step(tm_world *world, double dt_s) {
    tm_state *s = &world->state;
    world->evaluating = true;
    run_phases(world, TM_PHASE_FORCE, TM_PHASE_LOAD); /* force_N at time_s, for the kick below */
    world->evaluating = false;
    uint8_t *fixed = world->fixed_scratch;
    memset(fixed, 0, 3 * (size_t)world->tissue->mesh->vertex_count);
    tm_support_mask(world, fixed);
    for (int32_t i = 0; i < 3 * world->tissue->mesh->vertex_count; i++) {
        const double mass = world->tissue->mass_kg[i / 3];
        double v = (s->u_m[i] - s->u_prev_m[i]) / s->dt_s;
        if (!fixed[i] && mass > 0)
            v += 0.5 * (s->dt_s - dt_s) * (s->force_N[i] - world->tissue->damping_kg_s[i / 3] * v) / mass;
        s->u_prev_m[i] = s->u_m[i] - dt_s * v;
    }
    s->dt_s = dt_s;
    tm_world_changed(world);
}

uint64_t tm_world_hash(const tm_world *world) {
    WORLD_IS_GIVEN(0);
    const size_t bytes = sizeof(double) * 3 * (size_t)world->tissue->mesh->vertex_count;
    return tm_hash(world->state.u_prev_m, bytes, tm_hash(world->state.u_m, bytes, TM_HASH_SEED));
}
