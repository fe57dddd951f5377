/* Checks for connected components that the supports leave free to move or rotate. */
#include "world/world_internal.h"

#include <math.h>

#include "libtensormass/numeric/union_find.h"

typedef struct components {
    tm_pool pool;
    const tm_mesh *mesh;
    int32_t *parent; /* [vertex_count] towards the root of its component */
    uint8_t *fixed;  /* [3*vertex_count] */
    uint8_t *seen;   /* [vertex_count] roots already checked */
} components;

/* Returns whether the supports constrain all six rigid motions of the component with root `piece`. */
static bool component_is_constrained(const components *x, int32_t piece) {
    const tm_mesh *mesh = x->mesh;
    double centre[3] = {0, 0, 0}, size = 0, G[36] = {0};
    int32_t count = 0;
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        if (law_root(x->parent, v) != piece) continue;
        for (int i = 0; i < 3; i++) centre[i] += mesh->rest_m[3 * v + i];
        count++;
    }
    for (int i = 0; i < 3; i++) centre[i] /= count;
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        double d[3];
        vsub(mesh->rest_m + 3 * v, centre, d);
        if (law_root(x->parent, v) == piece) size = fmax(size, sqrt(vdot(d, d)));
    }
    for (int32_t i = 0; i < 3 * mesh->vertex_count; i++) {
        if (!x->fixed[i] || law_root(x->parent, i / 3) != piece) continue;
        double d[3], row[6] = {0}, axis[3] = {0, 0, 0};
        axis[i % 3] = row[i % 3] = 1;
        vsub(mesh->rest_m + 3 * (i / 3), centre, d);
        for (int k = 0; k < 3; k++) d[k] /= size;
        vcross(d, axis, row + 3);
        for (int k = 0; k < 36; k++) G[k] += row[k / 6] * row[k % 6];
    }
    tm_diagonalise6(G);
    double least = G[0], most = G[0];
    for (int i = 1; i < 6; i++) {
        least = fmin(least, G[7 * i]);
        most = fmax(most, G[7 * i]);
    }
    return least > 1e-12 * most;
}

static bool find_pieces(components *x, const tm_world *world) {
    const tm_mesh *mesh = x->mesh = world->tissue->mesh;
    x->parent = TM_ALLOC(&x->pool, int32_t, mesh->vertex_count);
    x->fixed = TM_ALLOC(&x->pool, uint8_t, 3 * (int64_t)mesh->vertex_count);
    x->seen = TM_ALLOC(&x->pool, uint8_t, mesh->vertex_count);
    if (x->pool.failed) return false;
    tm_support_mask(world, x->fixed);
    for (int32_t v = 0; v < mesh->vertex_count; v++) x->parent[v] = v;
    for (int32_t t = 0; t < mesh->tet_count; t++)
        for (int i = 1; i < 4 && world->tissue->alive[t]; i++)
            law_join(x->parent, mesh->tet[4 * (int64_t)t + i], mesh->tet[4 * (int64_t)t]);
    return true;
}

tm_status tm_check_constrained(const tm_world *world, const double *load_N, tm_error *error) {
    components x = {0};
    if (!find_pieces(&x, world)) {
        tm_pool_release(&x.pool);
        return tm_fail_memory(error, "looking for detached fragments");
    }
    tm_status status = TM_OK;
    for (int32_t i = 0; i < 3 * x.mesh->vertex_count && !status; i++) {
        const int32_t piece = law_root(x.parent, i / 3);
        if ((load_N && load_N[i] == 0) || world->tissue->mass_kg[i / 3] == 0 || x.seen[piece]) continue;
        x.seen[piece] = 1;
        if (!component_is_constrained(&x, piece))
            status =
                tm_fail(error, TM_ERR_SUPPORT, tm_mesh_original_vertex(x.mesh, i / 3),
                        "vertex %d: %sthe supports leave its connected piece free to move as a rigid body%s; fix three "
                        "vertices that are not in one line",
                        tm_mesh_original_vertex(x.mesh, i / 3), load_N ? "it carries a load and " : "",
                        load_N ? ", so there is no equilibrium" : "");
    }
    tm_pool_release(&x.pool);
    return status;
}

tm_status tm_world_check_constrained(const tm_world *world, tm_error *error) {
    TM_REQUIRE(world, "world is null", TM_ERR_ARGUMENT);
    return tm_check_constrained(world, NULL, error);
}
