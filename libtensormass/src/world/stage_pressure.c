/* Stage "pressure": pressures on surface triangles, along the inward normals of the deformed surface. A vertex gathers
 * from its triangles, ascending, so that results are bit-identical to those of one thread. A triangle whose tetrahedron
 * is removed bears nothing. */
#include "world/pressure.h"

#include <math.h>
#include <string.h>

typedef struct pressure {
    tm_pool pool;
    int32_t vertex_count;
    const int32_t *vertex; /* [vertex_count] with a triangle, ascending */
    const int32_t *begin;  /* [vertex_count+1] of their triangles */
    const int32_t *of;     /* [3*count] triangles around each vertex, ascending */
    int32_t count;
    const int32_t *corner;  /* [3*count] normals outward */
    const int32_t *tet;     /* [count] */
    const double *sixth_Pa; /* [count] */
} pressure;

/* Computes a corner's force, a third of the pressure times the area, inward. */
static void corner_force(const pressure *p, const tm_mesh *mesh, int32_t i, const double *u_m, double force_N[3]) {
    double x[3][3], a[3], b[3];
    for (int k = 0; k < 9; k++) {
        const int64_t dof = 3 * (int64_t)p->corner[3 * (int64_t)i + k / 3] + k % 3;
        x[k / 3][k % 3] = mesh->rest_m[dof] + u_m[dof];
    }
    vsub(x[1], x[0], a);
    vsub(x[2], x[0], b);
    vcross(a, b, force_N);
    vscale(-p->sixth_Pa[i], force_N, force_N);
}

static void add(const pressure *p, const tm_tissue *tissue, const double *u_m, int32_t begin, int32_t end,
                double *force_N) {
    int32_t low = 0, high = p->vertex_count;
    while (low < high) {
        const int32_t middle = low + (high - low) / 2;
        if (p->vertex[middle] < begin)
            low = middle + 1;
        else
            high = middle;
    }
    for (int32_t v = low; v < p->vertex_count && p->vertex[v] < end; v++)
        for (int32_t k = p->begin[v]; k < p->begin[v + 1]; k++) {
            double f[3];
            if (!tissue->alive[p->tet[p->of[k]]]) continue;
            corner_force(p, tissue->mesh, p->of[k], u_m, f);
            for (int i = 0; i < 3; i++) force_N[3 * (int64_t)p->vertex[v] + i] += f[i];
        }
}

void tm_stage_pressure_run(void *self, tm_world *world, const tm_range *range) {
    add(self, world->tissue, world->state.u_m, range->begin, range->end, world->state.force_N);
}

bool tm_world_has_pressure(const tm_world *world) {
    for (int32_t i = 0; i < world->stage_count; i++)
        if (world->entry[i].stage.range == tm_stage_pressure_run) return true;
    return false;
}

void tm_pressure_add(const tm_world *world, const double *u_m, double *force_N) {
    for (int32_t i = 0; i < world->stage_count; i++)
        if (world->entry[i].stage.range == tm_stage_pressure_run)
            add(world->entry[i].stage.self, world->tissue, u_m, 0, world->tissue->mesh->vertex_count, force_N);
}

/* The force on a corner is -p/6 N, N = (b - a) x (c - a), and dN/dx_j = [e_j] of the edge e_j opposite. The symmetric
 * part of that has blocks between different corners only: p/12 [e_j - e_i]. */
static void add_tangent(const pressure *p, const tm_tissue *tissue, const double *u_m, tm_tangent *tangent) {
    for (int32_t t = 0; t < p->count; t++) {
        const int32_t *v = p->corner + 3 * (int64_t)t;
        double x[3][3], edge[3][3];
        if (!tissue->alive[p->tet[t]]) continue;
        for (int k = 0; k < 9; k++)
            x[k / 3][k % 3] = tissue->mesh->rest_m[3 * (int64_t)v[k / 3] + k % 3] + u_m[3 * (int64_t)v[k / 3] + k % 3];
        for (int k = 0; k < 3; k++) vsub(x[(k + 2) % 3], x[(k + 1) % 3], edge[k]);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                double e[3];
                if (v[i] >= v[j]) continue;
                vsub(edge[j], edge[i], e);
                vscale(0.5 * p->sixth_Pa[t], e, e);
                const double K[9] = {0, -e[2], e[1], e[2], 0, -e[0], -e[1], e[0], 0};
                tm_tangent_add_pair(tissue, v[i], v[j], K, tangent);
            }
    }
}

void tm_pressure_add_tangent(const tm_world *world, const double *u_m, tm_tangent *tangent) {
    for (int32_t i = 0; i < world->stage_count; i++)
        if (world->entry[i].stage.range == tm_stage_pressure_run)
            add_tangent(world->entry[i].stage.self, world->tissue, u_m, tangent);
}

/* --- the step --- */

static double edge_stretch(const tm_tissue *tissue, int32_t tet) {
    const tm_material *m = tm_tissue_tet_material(tissue, tet);
    return m->law == TM_LAW_LINEAR ? TM_STRETCH_DEFAULT : m->stretch_max;
}

/* Returns 1/s2, a bound of the largest eigenvalue of M^-1 L, L the symmetric part of minus the derivative of all
 * forces. Its blocks are p/12 [e_j - e_i] (add_tangent), so that a triangle adds at most p/12 sum_j |e_j - e_i| to the
 * diagonal at its corner i. Tissue that may be cut, or is bounded by tetrahedra, has it by tetrahedra: each then bears
 * its triangles on its own mass. */
static bool stiffness(const pressure *p, const tm_tissue *tissue, double *most_1_s2) {
    const tm_mesh *mesh = tissue->mesh;
    const bool alone = tissue->cuttable || tissue->extra_mass_kg || tissue->required_mass_kg;
    tm_pool pool = {0};
    double *sum = TM_ALLOC(&pool, double, alone ? 4 * (int64_t)mesh->tet_count : mesh->vertex_count);
    *most_1_s2 = 0;
    for (int32_t t = 0; t < p->count && sum; t++) {
        const int32_t *v = p->corner + 3 * (int64_t)t, tet = p->tet[t];
        const double scale = 0.5 * fabs(p->sixth_Pa[t]) * edge_stretch(tissue, tet);
        double edge[3][3];
        for (int k = 0; k < 3; k++)
            vsub(mesh->rest_m + 3 * (int64_t)v[(k + 2) % 3], mesh->rest_m + 3 * (int64_t)v[(k + 1) % 3], edge[k]);
        for (int i = 0; i < 3; i++) {
            double a[3], b[3];
            int k = 0;
            while (mesh->tet[4 * (int64_t)tet + k] != v[i]) k++;
            vsub(edge[(i + 1) % 3], edge[i], a);
            vsub(edge[(i + 2) % 3], edge[i], b);
            double *at = sum + (alone ? 4 * (int64_t)tet + k : v[i]);
            *at += scale * (sqrt(vdot(a, a)) + sqrt(vdot(b, b)));
            const double mass = alone ? tm_tissue_tet_material(tissue, tet)->density_kg_m3 * mesh->volume_m3[tet] / 4
                                      : tissue->mass_kg[v[i]];
            if (mass > 0) *most_1_s2 = fmax(*most_1_s2, *at / mass);
        }
    }
    tm_pool_release(&pool);
    return sum;
}

/* --- creation --- */

static void destroy(void *self) {
    tm_pool pool = ((pressure *)self)->pool;
    tm_pool_release(&pool);
}

static bool fill(pressure *p, tm_pool *pool, const tm_mesh *mesh, const double *pressure_Pa) {
    int32_t *corner = TM_ALLOC(pool, int32_t, 3 * (int64_t)p->count), *tet = TM_ALLOC(pool, int32_t, p->count);
    int32_t *of = TM_ALLOC(pool, int32_t, 3 * (int64_t)p->count), *vertex = TM_ALLOC(pool, int32_t, mesh->vertex_count);
    int32_t *begin = TM_ALLOC(pool, int32_t, mesh->vertex_count + 1);
    double *sixth = TM_ALLOC(pool, double, p->count);
    tm_pool scratch = {0};
    int32_t *first = TM_ALLOC(&scratch, int32_t, mesh->vertex_count + 1);
    const bool good = !pool->failed && !scratch.failed;
    if (good) {
        for (int32_t t = 0, i = 0; t < mesh->surface_count; t++) {
            if (pressure_Pa[t] == 0) continue;
            memcpy(corner + 3 * (int64_t)i, mesh->surface + 3 * (int64_t)t, 3 * sizeof *corner);
            tet[i] = mesh->surface_face[t] / 4;
            sixth[i++] = pressure_Pa[t] / 6;
        }
        for (int64_t k = 0; k < 3 * (int64_t)p->count; k++) first[corner[k] + 1]++;
        for (int32_t v = 0; v < mesh->vertex_count; v++) {
            if (first[v + 1] > 0) vertex[p->vertex_count] = v, begin[p->vertex_count++] = first[v];
            first[v + 1] += first[v];
        }
        begin[p->vertex_count] = first[mesh->vertex_count];
        for (int32_t i = 0; i < 3 * p->count; i++) of[first[corner[i]]++] = i / 3;
    }
    tm_pool_release(&scratch);
    p->corner = corner, p->tet = tet, p->of = of, p->vertex = vertex, p->begin = begin, p->sixth_Pa = sixth;
    return good;
}

tm_status tm_stage_pressure(tm_world *world, const double *pressure_Pa, tm_error *error) {
    TM_REQUIRE(world && pressure_Pa, "world or pressure_Pa is null", TM_ERR_ARGUMENT);
    const tm_mesh *mesh = world->tissue->mesh;
    int32_t count = 0;
    for (int32_t t = 0; t < mesh->surface_count; t++) {
        if (!isfinite(pressure_Pa[t]))
            return tm_fail(error, TM_ERR_ARGUMENT, t, "pressure: %g Pa on triangle %d; give a finite number",
                           pressure_Pa[t], (int)t);
        count += pressure_Pa[t] != 0;
    }
    tm_pool pool = {0};
    pressure *p = TM_ALLOC(&pool, pressure, 1);
    if (p) p->count = count;
    if (!p || !fill(p, &pool, mesh, pressure_Pa)) {
        tm_pool_release(&pool);
        return tm_fail_memory(error, "pressure stage");
    }
    p->pool = pool;
    double more_1_s2;
    if (!stiffness(p, world->tissue, &more_1_s2)) {
        destroy(p);
        return tm_fail_memory(error, "pressure stage");
    }
    const double g = world->guaranteed_step_s, tissue_1_s2 = isfinite(g) ? 4 / (g * g) : 0;
    const tm_stage stage = {.size = sizeof stage,
                            .step_limit_s = count ? 2 / sqrt(tissue_1_s2 + more_1_s2) : 0,
                            .name = "pressure",
                            .phase = TM_PHASE_LOAD,
                            .range = tm_stage_pressure_run,
                            .divided = true,
                            .destroy = destroy,
                            .self = p};
    const tm_status status = tm_world_add_stage(world, &stage, pool.bytes, error);
    if (status) destroy(p);
    return status;
}
