/* Stage "rotation": the difference between the corotational law and the linear one, for tetrahedra that have rotated or
 * strained beyond the threshold. The choice of batches to check affects time only: a tetrahedron below the threshold
 * adds nothing, not even a zero. The energy that steps generate is kept from step to step (conserve.c). */
#include <string.h>

#include "tissue/tangent.h"
#include "world/conserve.h"
#include "world/divided_batches.h"
#include "world/viscosity.h"

typedef struct turner {
    tm_rotation rotation; /* the stage's self */
    tm_world *world;
    tm_relaxing whole;   /* with averaged dilatation */
    double *increment_m; /* [partition_count] */
    tm_divided_batches divided;
    tm_nonlinear law; /* the interface to other components */
} turner;

static void see(void *context, int32_t partition) {
    turner *t = context;
    tm_tet_batches_mark_seen(&t->rotation, t->world->state.u_m, partition, t->world->partition_count);
}

static void go(void *context, int32_t partition) {
    turner *t = context;
    t->increment_m[partition] =
        tm_tet_batches_increment(&t->rotation, t->world->state.u_m, partition, t->world->partition_count);
    tm_conserve_clear(&t->rotation.conserving, partition, t->world->partition_count);
}

/* Of tissue in single precision: settling computes in double, so that it comes below any tolerance. */
static void choose_precision(turner *t) {
    tm_rotation *r = &t->rotation;
    const bool plain = t->world->tissue->plain, settling = t->world->settling;
    const tm_rotation_kernel kernel = settling ? tm_rotation_choose(plain) : tm_single_rotation_choose(plain);
    if (kernel == r->kernel) return;
    r->kernel = kernel;
    t->divided.corner_force = settling ? tm_corner_force_choose(plain) : tm_single_corner_force_choose(plain);
    r->conserving.valid = false; /* what it stores has the other rounding */
}

static void run(void *self, tm_world *world) {
    turner *t = self;
    tm_rotation *r = &t->rotation;
    if (r->done_by_viscosity) return;
    if (r->batches.single) choose_precision(t);
    if (r->whole) {
        tm_conserve_whole(&r->conserving, world);
        return;
    }
    if (tm_tet_batches_wait(r)) {
        tm_partitions_run(world, see, t);
        tm_tet_batches_seen(r);
    }
    tm_partitions_run(world, go, t);
    double way_m = t->increment_m[0];
    for (int32_t p = 1; p < world->partition_count; p++) way_m = t->increment_m[p] > way_m ? t->increment_m[p] : way_m;
    tm_tet_batches_list(r, way_m);
    tm_divided_batches_run(&t->divided);
    tm_conserve(&r->conserving, world);
    r->idle += r->list_count - r->active;
}

static int64_t snapshot(void *self, void *buffer) {
    turner *t = self;
    return tm_conserve_snapshot(&t->rotation.conserving, buffer);
}

static bool restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply) {
    turner *t = self;
    (void)world;
    return tm_conserve_restore(&t->rotation.conserving, buffer, bytes, apply);
}

static void step_changed(void *self, tm_world *world) {
    turner *t = self;
    (void)world;
    tm_conserve_restart(&t->rotation.conserving);
}

static void checkpoint(void *self) {
    turner *t = self;
    tm_conserve_checkpoint(&t->rotation.conserving);
}

static void rollback(void *self, tm_world *world) {
    turner *t = self;
    (void)world;
    tm_conserve_rollback(&t->rotation.conserving);
}

static void destroy(void *self) {
    turner *t = self;
    if (t->rotation.whole) tm_world_set_force(t->world, NULL);
    if (t->world->nonlinear == &t->law) t->world->nonlinear = NULL;
    tm_pool pool = t->rotation.pool;
    tm_pool_release(&pool);
}

/* --- interface to other components --- */

static double law_energy(const void *self, const double *u_m) { return tm_rotation_energy(self, u_m); }

static void law_force(const void *self, const double *u_m, double *force_N) {
    const tm_rotation *r = self;
    tm_ranges_clear(&r->where, force_N);
    tm_rotation_choose(r->tissue->plain)(&r->batches, r->every, r->batches.count, u_m, force_N, NULL);
    tm_nodal_dilatation_add(&r->nodal_dilatation, &r->batches, r->tissue->plain, u_m, force_N);
}

static const double *law_added(const void *self) {
    const tm_conserving *c = &((const tm_rotation *)self)->conserving;
    return c->share != 0 ? c->push_N : NULL;
}

static bool law_take_tangent(const void *self, tm_tangent *tangent, tm_pool *pool) {
    return tm_tangent_init(tangent, pool, self);
}

static void law_add_tangent(const void *self, const double *u_m, int32_t begin, int32_t end, tm_tangent *tangent) {
    tm_rotation_tangent_add(self, u_m, begin, end, tangent);
}

static tm_nonlinear law_of(tm_rotation *r) {
    return (tm_nonlinear){.self = r,
                          .where = &r->where,
                          .energy = law_energy,
                          .force = law_force,
                          .added_N = law_added,
                          .take_tangent = law_take_tangent,
                          .add_tangent = law_add_tangent,
                          .scratch_N = r->scratch_N,
                          .relaxing = &tm_corotated_relaxing};
}

/* --- creation --- */

/* Allocates memory for threads, or for the complete law in passes. */
static bool init_passes(turner *t, tm_pool *pool, tm_world *world) {
    tm_rotation *r = &t->rotation;
    t->world = world;
    t->increment_m = TM_ALLOC(pool, double, world->partition_count);
    if (pool->failed) return false;
    if (tm_nodal_dilatation_is_on(&r->nodal_dilatation)) {
        if (!tm_relaxing_init_elastic(&t->whole, pool, world, r)) return false;
        r->whole = &t->whole;
        return true;
    }
    return tm_divided_batches_init(&t->divided, pool, world, r);
}

static bool init(turner *t, tm_pool *pool, tm_world *world) {
    const tm_tissue *tissue = world->tissue;
    tm_rotation *r = &t->rotation;
    const tm_material_field field = tm_rotation_field(tissue);
    if (!tm_tet_batches_init(&r->batches, pool, &field)) return false;
    if (tissue->has_single_law) {
        if (!tm_single_rotation_init(&r->batches, pool)) return false;
        r->rounding_m = tm_single_rounding_m(tissue->mesh);
    }
    if (!tm_effect_vertices(&r->where, pool, &field, TM_REGION_ROTATION, 0)) return false;
    const int64_t n = 3 * (int64_t)tm_ranges_length(&r->where), first = 3 * (int64_t)tm_ranges_first(&r->where);
    if (!tm_nodal_dilatation_init(&r->nodal_dilatation, pool, &field, r->batches.count)) return false;
    r->seen_m = tm_shifted(TM_ALLOC(pool, double, n), sizeof(double), first);
    r->reach_m = TM_ALLOC(pool, double, r->batches.count);
    r->spread_1_m = TM_ALLOC(pool, double, r->batches.count);
    r->list = TM_ALLOC(pool, int32_t, r->batches.count);
    r->every = TM_ALLOC(pool, int32_t, r->batches.count);
    r->scratch_N = tm_shifted(TM_ALLOC(pool, double, n), sizeof(double), first);
    if (pool->failed) return false;
    r->elastic = r->every, r->elastic_count = r->batches.count;
    for (int32_t p = 0; p < r->batches.count; p++) {
        r->every[p] = p;
        r->spread_1_m[p] = tm_tet_batch_spread(&r->batches, p);
    }
    return tm_conserve_init(&r->conserving, pool, world, r) && init_passes(t, pool, world);
}

tm_status tm_stage_rotation(tm_world *world, tm_rotation **rotation, tm_error *error) {
    TM_REQUIRE(world, "world is null", TM_ERR_ARGUMENT);
    const tm_tissue *tissue = world->tissue;
    if (!(tissue->rotation > 0))
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "rotation: the tissue's guaranteed step is that of linear tissue; set rotation in the tissue's "
                       "definition");
    for (int32_t i = 0; i < world->stage_count; i++)
        if (!strcmp(world->entry[i].stage.name, "viscosity"))
            return tm_fail(
                error, TM_ERR_ARGUMENT, -1,
                "rotation: stage viscosity was added first and has the history variables of linear tissue; add "
                "rotation before viscosity");
    for (int32_t i = 0; i < world->stage_count; i++)
        if (!strcmp(world->entry[i].stage.name, "patch"))
            return tm_fail(
                error, TM_ERR_ARGUMENT, -1,
                "rotation: stage patch was added first and has the compliance of linear tissue; add rotation before "
                "patch");
    tm_pool pool = {0};
    turner *t = TM_ALLOC(&pool, turner, 1);
    if (!t || !init(t, &pool, world)) {
        tm_pool_release(&pool);
        return tm_fail_memory(error, "rotation stage");
    }
    tm_rotation *r = &t->rotation;
    r->pool = pool;
    r->tissue = tissue;
    r->threshold = tissue->rotation;
    r->kernel = r->batches.single ? tm_single_rotation_choose(tissue->plain) : tm_rotation_choose(tissue->plain);
    const tm_stage stage = {.size = sizeof stage,
                            .name = "rotation",
                            .phase = TM_PHASE_FORCE,
                            .run = run,
                            .destroy = destroy,
                            .step_changed = step_changed,
                            .self = r,
                            .snapshot = snapshot,
                            .restore = restore,
                            .checkpoint = checkpoint,
                            .rollback = rollback};
    const tm_status status = tm_world_add_stage(world, &stage, pool.bytes, error);
    if (status) {
        tm_pool_release(&pool);
        return status;
    }
    tm_world_set_divides(world, stage.name);
    t->law = law_of(r);
    world->nonlinear = &t->law;
    if (r->whole) tm_world_set_force(world, &(tm_force_provider){.stage = "rotation"});
    if (rotation) *rotation = r;
    return TM_OK;
}

tm_rotation_report tm_rotation_last(const tm_rotation *rotation) {
    TM_REQUIRE(rotation, "rotation is null", (tm_rotation_report){0});
    return (tm_rotation_report){rotation->batches.count, rotation->list_count, rotation->active};
}

double tm_rotation_energy(const tm_rotation *rotation, const double *u_m) {
    TM_REQUIRE(rotation && u_m, "rotation or u_m is null", 0);
    return tm_rotation_sum_energy(&rotation->batches, u_m) +
           tm_nodal_dilatation_energy(&rotation->nodal_dilatation, &rotation->batches, u_m);
}

void tm_rotation_force(const tm_rotation *rotation, const double *u_m, double *force_N) {
    TM_REQUIRE(rotation && u_m && force_N, "rotation, u_m or force_N is null", );
    memset(force_N, 0, sizeof(double) * 3 * (size_t)rotation->tissue->mesh->vertex_count);
    law_force(rotation, u_m, force_N);
}
