/* Stage "support": prescribed displacements, and their reaction forces. */
#include "world/world_internal.h"

#include <math.h>
#include <string.h>

typedef struct support {
    tm_pool pool;
    int32_t count;
    int32_t *dof; /* ascending, each once */
    double *value_m;
    double *reaction_N; /* of the last step, on the tissue */
    double *saved;      /* [2*count] both when the step began */
    int32_t *place;     /* [prescribed] index of the caller's component */
    int32_t prescribed;
} support;

tm_support_def tm_support_def_default(void) {
    return (tm_support_def){.cookie = TM_COOKIE_SUPPORT, .size = sizeof(tm_support_def)};
}

/* Returns the index of the first prescribed component from `dof` on. */
static int32_t first_from(const support *stage, int32_t dof) {
    int32_t low = 0, high = stage->count;
    while (low < high) {
        const int32_t middle = low + (high - low) / 2;
        if (stage->dof[middle] < dof)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

void tm_stage_support_run(void *self, tm_world *world, const tm_range *range) {
    support *stage = self;
    double *u_next = world->state.u_next_m;
    for (int32_t i = first_from(stage, 3 * range->begin); i < stage->count && stage->dof[i] < 3 * range->end; i++) {
        const int32_t d = stage->dof[i];
        const double mobility = world->mobility_s2_kg[d / 3];
        stage->reaction_N[i] = mobility > 0 ? (stage->value_m[i] - u_next[d]) / mobility : 0;
        u_next[d] = stage->value_m[i];
    }
}

void tm_support_impose(const tm_world *world, double *u_m) {
    const support *stage = world->support;
    for (int32_t i = 0; stage && i < stage->count; i++) u_m[stage->dof[i]] = stage->value_m[i];
}

void tm_support_reaction_of_tissue(const tm_world *world, double *reaction_N) {
    const support *stage = world->support;
    for (int32_t i = 0; stage && i < stage->count; i++) reaction_N[stage->dof[i]] += stage->reaction_N[i];
}

/* Where forces of other stages on prescribed components go to. */
typedef struct bearing {
    const support *stage;
    double *reaction_N;
} bearing;

static void bear(void *to, int32_t vertex, const double force_N[3]) {
    const bearing *b = to;
    for (int32_t i = first_from(b->stage, 3 * vertex); i < b->stage->count && b->stage->dof[i] < 3 * vertex + 3; i++)
        b->reaction_N[b->stage->dof[i]] -= force_N[b->stage->dof[i] - 3 * vertex];
}

void tm_support_reaction(const tm_world *world, double *reaction_N) {
    TM_REQUIRE(world && reaction_N, "world or reaction_N is null", );
    bearing b = {world->support, reaction_N};
    tm_support_reaction_of_tissue(world, reaction_N);
    for (int32_t i = 0; b.stage && i < world->stage_count; i++) {
        const tm_few *few = world->entry[i].few;
        if (few && few->forces) few->forces(world->entry[i].stage.self, &b, bear);
    }
}

void tm_support_mask(const tm_world *world, uint8_t *mask) {
    TM_REQUIRE(world && mask, "world or mask is null", );
    const support *stage = world->support;
    for (int32_t i = 0; stage && i < stage->count; i++) mask[stage->dof[i]] = 1;
}

void tm_support_move(tm_world *world, int32_t component, double value_m) {
    TM_REQUIRE(world && world->support, "world is null or has no supports", );
    support *stage = world->support;
    TM_REQUIRE(component >= 0 && component < stage->prescribed, "component is not one of the supports' list", );
    TM_REQUIRE(tm_is_place(value_m), "value_m is not finite or beyond 1e6 m", );
    stage->value_m[stage->place[component]] = value_m;
}

static void destroy(void *self) {
    tm_pool pool = ((support *)self)->pool;
    tm_pool_release(&pool);
}

static tm_status check(const tm_world *world, const tm_support_def *def, tm_error *error) {
    const tm_mesh *mesh = world->tissue->mesh;
    const int32_t dofs = 3 * mesh->vertex_count;
    for (int32_t i = 0; i < def->count; i++) {
        if (def->dof[i] < 0 || def->dof[i] >= dofs)
            return tm_fail(error, TM_ERR_ARGUMENT, i, "support: component %d names dof %d of %d; dof = 3*vertex + axis",
                           i, def->dof[i], dofs);
        if (!isfinite(def->value_m[i]) || fabs(def->value_m[i]) > 1e6)
            return tm_fail(error, TM_ERR_ARGUMENT, tm_mesh_original_vertex(mesh, def->dof[i] / 3),
                           "support: vertex %d is fixed at %g m; give a finite displacement",
                           tm_mesh_original_vertex(mesh, def->dof[i] / 3), def->value_m[i]);
    }
    return TM_OK;
}

/* Fills the stage from the caller's list: ascending, duplicates merged. `seen` [3*vertex_count] is work space, first
 * zero. */
static tm_status fill(support *stage, const tm_support_def *def, const tm_mesh *mesh, int32_t *seen, tm_error *error) {
    const int32_t dofs = 3 * mesh->vertex_count;
    for (int32_t i = 0; i < def->count; i++) {
        const int32_t d = def->dof[i];
        if (seen[d] && def->value_m[seen[d] - 1] != def->value_m[i])
            return tm_fail(error, TM_ERR_SUPPORT, tm_mesh_original_vertex(mesh, d / 3),
                           "support: vertex %d is fixed at %g m and at %g m along %c; remove it from one support",
                           tm_mesh_original_vertex(mesh, d / 3), def->value_m[seen[d] - 1], def->value_m[i],
                           "xyz"[d % 3]);
        if (!seen[d]) seen[d] = i + 1;
    }
    for (int32_t d = 0; d < dofs; d++) {
        if (!seen[d]) continue;
        stage->dof[stage->count] = d;
        stage->value_m[stage->count] = def->value_m[seen[d] - 1];
        seen[d] = stage->count++;
    }
    stage->prescribed = def->count;
    for (int32_t i = 0; i < def->count; i++) stage->place[i] = seen[def->dof[i]];
    return TM_OK;
}

/* Saves the prescribed values, which tm_support_move changes. */
static int64_t snapshot(void *self, void *buffer) {
    const support *stage = self;
    if (buffer) memcpy(buffer, stage->value_m, sizeof(double) * (size_t)stage->count);
    return (int64_t)sizeof(double) * stage->count;
}

static bool restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply) {
    (void)world;
    support *stage = self;
    if (bytes != (int64_t)sizeof(double) * stage->count) return false;
    if (apply) memcpy(stage->value_m, buffer, (size_t)bytes);
    return true;
}

static void checkpoint(void *self) {
    const support *stage = self;
    memcpy(stage->saved, stage->value_m, sizeof(double) * (size_t)stage->count);
    memcpy(stage->saved + stage->count, stage->reaction_N, sizeof(double) * (size_t)stage->count);
}

static void rollback(void *self, tm_world *world) {
    (void)world;
    const support *stage = self;
    memcpy(stage->value_m, stage->saved, sizeof(double) * (size_t)stage->count);
    memcpy(stage->reaction_N, stage->saved + stage->count, sizeof(double) * (size_t)stage->count);
}

tm_status tm_stage_support(tm_world *world, const tm_support_def *def, tm_error *error) {
    TM_REQUIRE_DEF(def, TM_COOKIE_SUPPORT, TM_ERR_ARGUMENT);
    TM_REQUIRE(world && ((def->dof && def->value_m) || def->count <= 0), "world, def->dof or def->value_m is null",
               TM_ERR_ARGUMENT);
    if (def->count < 0)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "support: %d components; give 0 or more", def->count);
    tm_status status = check(world, def, error);
    if (status) return status;
    const int32_t dofs = 3 * world->tissue->mesh->vertex_count;
    tm_pool pool = {0}, work = {0};
    support *self = TM_ALLOC(&pool, support, 1);
    int32_t *dof = TM_ALLOC(&pool, int32_t, def->count), *place = TM_ALLOC(&pool, int32_t, def->count);
    double *value = TM_ALLOC(&pool, double, def->count), *reaction = TM_ALLOC(&pool, double, def->count);
    double *kept = TM_ALLOC(&pool, double, 2 * (int64_t)def->count);
    int32_t *seen = TM_ALLOC(&work, int32_t, dofs);
    if (pool.failed || work.failed) {
        status = tm_fail_memory(error, "support stage");
    } else {
        *self = (support){.dof = dof, .value_m = value, .reaction_N = reaction, .saved = kept, .place = place};
        status = fill(self, def, world->tissue->mesh, seen, error);
    }
    tm_pool_release(&work);
    if (!status) {
        self->pool = pool;
        const tm_stage stage = {.size = sizeof stage,
                                .name = "support",
                                .phase = TM_PHASE_CONSTRAIN,
                                .range = tm_stage_support_run,
                                .divided = true,
                                .destroy = destroy,
                                .self = self,
                                .snapshot = snapshot,
                                .restore = restore,
                                .checkpoint = checkpoint,
                                .rollback = rollback};
        status = tm_world_add_stage(world, &stage, pool.bytes, error);
        if (!status) world->support = self, world->supports_set++;
    }
    if (status) tm_pool_release(&pool);
    return status;
}
