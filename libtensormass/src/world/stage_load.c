/* Stage "load": constant forces on vertices; lumps tractions into such forces. */
#include "world/world_internal.h"

#include <math.h>
#include <string.h>

typedef struct load {
    tm_pool pool;
    double *force_N; /* [3*vertex_count] */
} load;

void tm_stage_load_run(void *self, tm_world *world, const tm_range *range) {
    const double *TM_RESTRICT force = ((const load *)self)->force_N;
    double *TM_RESTRICT f = world->state.force_N;
    for (int32_t i = 3 * range->begin; i < 3 * range->end; i++) f[i] += force[i];
}

static void destroy(void *self) {
    tm_pool pool = ((load *)self)->pool;
    tm_pool_release(&pool);
}

tm_status tm_stage_load(tm_world *world, const double *force_N, tm_error *error) {
    TM_REQUIRE(world && force_N, "world or force_N is null", TM_ERR_ARGUMENT);
    const tm_mesh *mesh = world->tissue->mesh;
    const int32_t n = 3 * mesh->vertex_count;
    for (int32_t i = 0; i < n; i++)
        if (!isfinite(force_N[i]))
            return tm_fail(error, TM_ERR_ARGUMENT, tm_mesh_original_vertex(mesh, i / 3),
                           "load: the %c force on vertex %d is %g; give a finite number", "xyz"[i % 3],
                           tm_mesh_original_vertex(mesh, i / 3), force_N[i]);
    tm_pool pool = {0};
    load *self = TM_ALLOC(&pool, load, 1);
    double *copy = TM_ALLOC(&pool, double, n);
    if (pool.failed) {
        tm_pool_release(&pool);
        return tm_fail_memory(error, "load stage");
    }
    memcpy(copy, force_N, sizeof(double) * (size_t)n);
    self->force_N = copy;
    self->pool = pool;
    const tm_stage stage = {.size = sizeof stage,
                            .name = "load",
                            .phase = TM_PHASE_LOAD,
                            .range = tm_stage_load_run,
                            .divided = true,
                            .destroy = destroy,
                            .self = self};
    const tm_status status = tm_world_add_stage(world, &stage, pool.bytes, error);
    if (status) destroy(self);
    return status;
}

void tm_load_add_traction(const tm_mesh *mesh, const int32_t *triangle, int32_t triangle_count,
                          const double traction_Pa[3], double *force_N) {
    TM_REQUIRE(mesh && traction_Pa && force_N && triangle_count >= 0 && (triangle || triangle_count == 0),
               "an argument is null, or triangle_count is negative", );
    for (int64_t i = 0; i < 3 * (int64_t)triangle_count; i++)
        TM_REQUIRE(triangle[i] >= 0 && triangle[i] < mesh->vertex_count, "triangle names no vertex of the mesh", );
    for (int32_t t = 0; t < triangle_count; t++) {
        const int32_t *v = triangle + 3 * (int64_t)t;
        double a[3], b[3], n[3];
        vsub(mesh->rest_m + 3 * (int64_t)v[1], mesh->rest_m + 3 * (int64_t)v[0], a);
        vsub(mesh->rest_m + 3 * (int64_t)v[2], mesh->rest_m + 3 * (int64_t)v[0], b);
        vcross(a, b, n);
        const double third = sqrt(vdot(n, n)) / 6;
        for (int i = 0; i < 9; i++) force_N[3 * (int64_t)v[i / 3] + i % 3] += third * traction_Pa[i % 3];
    }
}
