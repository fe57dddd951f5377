/* Stage "rotation": the difference between the corotational law and the linear one, of tetrahedra that have turned or
 * strained beyond the threshold. It keeps nothing that a step depends on: which packs it looks at is a matter of time
 * alone, for a tetrahedron below the threshold adds nothing, not even a zero. */
#include <string.h>

#include "rotation/rotation_internal.h"
#include "world/world_internal.h"

static void run(void *self, tm_world *world) {
    tm_rotation *r = self;
    if (r->left_to_viscosity) return;
    tm_packs_list(r, world->state.u_m);
    r->active = r->kernel(&r->packs, r->list, r->list_count, world->state.u_m, world->state.force_N);
    r->idle += r->list_count - r->active;
    tm_swollen_add(&r->swollen, &r->packs, r->tissue->plain, world->state.u_m, world->state.force_N);
}

static void destroy(void *self) {
    tm_pool pool = ((tm_rotation *)self)->pool;
    tm_pool_release(&pool);
}

bool tm_stage_is_rotation(const tm_stage *stage) { return stage->run == run; }

tm_rotation *tm_world_rotation(const tm_world *world) {
    for (int32_t i = 0; i < world->stage_count; i++)
        if (world->slot[i].stage.run == run) return world->slot[i].stage.self;
    return NULL;
}

static bool take(tm_rotation *r, tm_pool *pool, const tm_tissue *tissue) {
    const int64_t n = 3 * (int64_t)tissue->mesh->vertex_count;
    if (!tm_packs_take(&r->packs, pool, tissue)) return false;
    if (!tm_swollen_take(&r->swollen, pool, tissue, r->packs.count)) return false;
    r->seen_m = TM_TAKE(pool, double, n);
    r->reach_m = TM_TAKE(pool, double, r->packs.count);
    r->spread_1_m = TM_TAKE(pool, double, r->packs.count);
    r->list = TM_TAKE(pool, int32_t, r->packs.count);
    r->every = TM_TAKE(pool, int32_t, r->packs.count);
    r->scratch_N = TM_TAKE(pool, double, n);
    if (pool->failed) return false;
    for (int32_t p = 0; p < r->packs.count; p++) {
        r->every[p] = p;
        r->spread_1_m[p] = tm_pack_spread(tissue->mesh, p);
    }
    return true;
}

tm_status tm_stage_rotation(tm_world *world, tm_rotation **rotation, tm_error *error) {
    TM_REQUIRE(world, "world is null", TM_ERR_ARGUMENT);
    const tm_tissue *tissue = world->tissue;
    if (!(tissue->rotation > 0))
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "rotation: the tissue's guaranteed step is that of tissue that does not turn; set rotation in "
                       "its definition");
    for (int32_t i = 0; i < world->stage_count; i++)
        if (!strcmp(world->slot[i].stage.name, "viscosity"))
            return tm_fail(error, TM_ERR_ARGUMENT, -1,
                           "rotation: stage viscosity keeps histories of tissue that does not turn; add rotation "
                           "before it");
    for (int32_t i = 0; i < world->stage_count; i++)
        if (!strcmp(world->slot[i].stage.name, "patch"))
            return tm_fail(error, TM_ERR_ARGUMENT, -1,
                           "rotation: stage patch knows the stiffness of tissue that does not turn; add rotation "
                           "before it");
    tm_pool pool = {0};
    tm_rotation *r = TM_TAKE(&pool, tm_rotation, 1);
    if (!r || !take(r, &pool, tissue)) {
        tm_pool_release(&pool);
        return tm_fail_memory(error, "rotation stage");
    }
    r->pool = pool;
    r->tissue = tissue;
    r->threshold = tissue->rotation;
    r->kernel = tm_rotation_choose(tissue->plain);
    const tm_stage stage = {
        .size = sizeof stage, .name = "rotation", .phase = TM_PHASE_FORCE, .run = run, .destroy = destroy, .self = r};
    const tm_status status = tm_world_add_stage(world, &stage, pool.bytes, error);
    if (status)
        destroy(r);
    else if (rotation)
        *rotation = r;
    return status;
}

tm_rotation_report tm_rotation_last(const tm_rotation *rotation) {
    TM_REQUIRE(rotation, "rotation is null", (tm_rotation_report){0});
    return (tm_rotation_report){rotation->packs.count, rotation->list_count, rotation->active};
}

double tm_rotation_energy(const tm_rotation *rotation, const double *u_m) {
    TM_REQUIRE(rotation && u_m, "rotation or u_m is null", 0);
    return tm_rotation_sum_energy(&rotation->packs, u_m) + tm_swollen_energy(&rotation->swollen, &rotation->packs, u_m);
}

void tm_rotation_force(const tm_rotation *rotation, const double *u_m, double *force_N) {
    TM_REQUIRE(rotation && u_m && force_N, "rotation, u_m or force_N is null", );
    memset(force_N, 0, sizeof(double) * 3 * (size_t)rotation->tissue->mesh->vertex_count);
    rotation->kernel(&rotation->packs, rotation->every, rotation->packs.count, u_m, force_N);
    tm_swollen_add(&rotation->swollen, &rotation->packs, rotation->tissue->plain, u_m, force_N);
}

double *tm_rotation_scratch(const tm_rotation *rotation) { return rotation->scratch_N; }
