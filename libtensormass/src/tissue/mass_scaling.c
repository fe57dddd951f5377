/* Selective mass scaling: adds mass only where a chosen step needs it.
 *
 * As in critical_step_weighted.c every K_e is bounded by a diagonal, K_e <= diag(demand_e), for any four weights. A
 * step dt is stable where omega^2 <= 4/dt^2, and so where every vertex has at least dt^2/4 times the sum of demands of
 * its active tetrahedra. The missing mass is added. Demands never change, so the step holds for every subset of
 * tetrahedra, after any cut, with the bits of a fresh build. A few sweeps of the weights move demand from vertices that
 * lack mass to those with a surplus; the smallest total addition is used. */
#include "tissue/tissue_internal.h"

#include <math.h>
#include <string.h>

enum { SWEEPS = 40, IDLE = 6, EVALUATIONS_PER_TET = 12 };
static const double HOT = 0.9, MIN_LOAD = 0.05;

typedef struct scaling {
    tm_pool pool;
    const tm_tissue *tissue;
    double per_demand_s2;     /* dt^2/4, with a margin for rounding */
    double *physical_kg;      /* [vertex_count] of the complete mesh */
    double *load;             /* [vertex_count] demand over mass */
    double *now_kg, *best_kg; /* [4*tet_count] demand, in the order of mesh->tet */
    int64_t evaluations;
} scaling;

static void ask(scaling *s, int32_t tet, const double weight[4]) {
    const double most = tm_element_eigenvalue_over(s->tissue, tet, weight) * s->per_demand_s2;
    for (int k = 0; k < 4; k++) s->now_kg[4 * (int64_t)tet + k] = most * weight[k];
    s->evaluations++;
}

static void demand_evenly(scaling *s) {
    const tm_mesh *mesh = s->tissue->mesh;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        const double even = tm_tissue_tet_material(s->tissue, t)->density_kg_m3 * mesh->volume_m3[t] / 4;
        const double weight[4] = {even, even, even, even};
        for (int k = 0; k < 4; k++) s->physical_kg[mesh->tet[4 * (int64_t)t + k]] += even;
        ask(s, t, weight);
    }
}

/* Computes loads; returns the mass that would have to be added. */
static double balance(scaling *s) {
    const tm_mesh *mesh = s->tissue->mesh;
    double added = 0;
    memset(s->load, 0, sizeof(double) * (size_t)mesh->vertex_count);
    for (int64_t i = 0; i < 4 * (int64_t)mesh->tet_count; i++) s->load[mesh->tet[i]] += s->now_kg[i];
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        added += fmax(0, s->load[v] - s->physical_kg[v]);
        if (s->physical_kg[v] > 0) s->load[v] /= s->physical_kg[v];
    }
    return added;
}

/* Returns false if no vertex lacks mass. */
static bool sweep(scaling *s) {
    const tm_mesh *mesh = s->tissue->mesh;
    bool any = false;
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        double weight[4], hottest = 0;
        for (int k = 0; k < 4; k++) {
            const double load = s->load[mesh->tet[4 * (int64_t)t + k]];
            hottest = fmax(hottest, load);
            weight[k] = s->now_kg[4 * (int64_t)t + k] / fmax(load, MIN_LOAD);
        }
        any |= hottest > 1;
        if (hottest >= HOT) ask(s, t, weight);
    }
    return any;
}

static void checkpoint(tm_tissue *tissue, const double *required_mass_kg) {
    const tm_mesh *mesh = tissue->mesh;
    for (int32_t v = 0; v < mesh->vertex_count; v++)
        for (int32_t i = mesh->vertex_tet_begin[v]; i < mesh->vertex_tet_begin[v + 1]; i++) {
            const int64_t at = 4 * (int64_t)mesh->vertex_tet[i];
            int k = 0;
            while (mesh->tet[at + k] != v) k++;
            tissue->required_mass_kg[i] = required_mass_kg[at + k];
        }
}

bool tm_scaled_demand(tm_tissue *tissue) {
    const tm_mesh *mesh = tissue->mesh;
    const size_t bytes = sizeof(double) * 4 * (size_t)mesh->tet_count;
    scaling s = {.tissue = tissue};
    const double dt = tissue->scaled_step_s;
    s.per_demand_s2 = dt * dt / 4 * (1 + tm_critical_margin(tissue));
    s.physical_kg = TM_ALLOC(&s.pool, double, mesh->vertex_count);
    s.load = TM_ALLOC(&s.pool, double, mesh->vertex_count);
    s.now_kg = TM_ALLOC(&s.pool, double, 4 * (int64_t)mesh->tet_count);
    s.best_kg = TM_ALLOC(&s.pool, double, 4 * (int64_t)mesh->tet_count);
    const bool room = !s.pool.failed;
    if (room) demand_evenly(&s);
    const int64_t enough = EVALUATIONS_PER_TET * (int64_t)mesh->tet_count;
    double least = HUGE_VAL;
    for (int k = 0, idle = 0; room && k < SWEEPS && idle < IDLE && s.evaluations < enough; k++) {
        const double added = balance(&s);
        idle = added < least * (1 - 1e-3) ? 0 : idle + 1;
        if (added < least) {
            least = added;
            memcpy(s.best_kg, s.now_kg, bytes);
        }
        if (!sweep(&s)) break;
    }
    if (room) checkpoint(tissue, s.best_kg);
    tm_pool_release(&s.pool);
    return room;
}

/* --- added mass --- */

bool tm_tissue_mass_scaling(const tm_tissue *tissue, tm_mass_scaling *out) {
    TM_REQUIRE(tissue && out, "tissue or out is null", false);
    *out = (tm_mass_scaling){.step_s = tissue->scaled_step_s, .max_factor_vertex = -1, .max_factor = 1};
    for (int32_t v = 0; v < tissue->mesh->vertex_count; v++) {
        const double own = tissue->physical_mass_kg[v], added = tissue->mass_kg[v] - own;
        out->physical_kg += own;
        out->added_kg += added;
        if (!(added > 0)) continue;
        out->vertices++;
        if (tissue->mass_kg[v] / own <= out->max_factor) continue;
        out->max_factor = tissue->mass_kg[v] / own;
        out->max_factor_vertex = v;
    }
    return tissue->required_mass_kg != NULL;
}

tm_status tm_scaled_check(const tm_tissue *tissue, double most_share, tm_error *error) {
    tm_mass_scaling m;
    if (!tm_tissue_mass_scaling(tissue, &m) || m.added_kg <= most_share * m.physical_kg) return TM_OK;
    const int32_t most = m.max_factor_vertex < 0 ? -1 : tm_mesh_original_vertex(tissue->mesh, m.max_factor_vertex);
    return tm_fail(error, TM_ERR_LIMIT, most,
                   "a step of %.4g s would add %.3g of the physical mass, most at vertex %d (%.3g times its own), and "
                   "%.3g is allowed; take a shorter step, repair the mesh there, or allow more",
                   m.step_s, m.added_kg / m.physical_kg, most, m.max_factor, most_share);
}

/* Effect of mass scaling on the lowest frequencies: Rayleigh quotients of the shapes of tissue under its own weight
 * (one inverse iteration from a translation), by conjugate gradients. */

enum { MAX_ITERATIONS = 5000 };
static const double RESIDUAL = 1e-3; /* the quotient's error is its square */

typedef struct gradients {
    tm_pool pool;
    const tm_tissue *tissue;
    int32_t n;
    double *diagonal; /* of K; 0: fixed, or without mass */
    double *x, *r, *z, *p, *Kp;
} gradients;

static double product(const gradients *g, const double *a, const double *b) {
    double sum = 0;
    for (int32_t i = 0; i < g->n; i++) sum += a[i] * b[i];
    return sum;
}

static bool take(gradients *g, const tm_tissue *tissue, const uint8_t *fixed) {
    g->tissue = tissue;
    g->n = 3 * tissue->mesh->vertex_count;
    double **const arrays[] = {&g->diagonal, &g->x, &g->r, &g->z, &g->p, &g->Kp};
    for (int i = 0; i < 6; i++) *arrays[i] = TM_ALLOC(&g->pool, double, g->n);
    for (int32_t i = 0; !g->pool.failed && i < g->n; i++)
        if (!fixed[i] && tissue->physical_mass_kg[i / 3] > 0)
            g->diagonal[i] = tissue->graph.vertex_tensor[9 * (int64_t)(i / 3) + 4 * (i % 3)];
    return !g->pool.failed;
}

static void precondition(gradients *g) {
    for (int32_t i = 0; i < g->n; i++) g->z[i] = g->diagonal[i] > 0 ? g->r[i] / g->diagonal[i] : 0;
}

/* Computes Kp on the free components. */
static void apply(gradients *g) {
    tm_tissue_force(g->tissue, g->p, g->Kp);
    for (int32_t i = 0; i < g->n; i++) g->Kp[i] = g->diagonal[i] > 0 ? -g->Kp[i] : 0;
}

/* Solves K x = physical mass along `axis`. */
static bool sag(gradients *g, int axis) {
    memset(g->x, 0, sizeof(double) * (size_t)g->n);
    for (int32_t i = 0; i < g->n; i++)
        g->r[i] = i % 3 == axis && g->diagonal[i] > 0 ? g->tissue->physical_mass_kg[i / 3] : 0;
    precondition(g);
    memcpy(g->p, g->z, sizeof(double) * (size_t)g->n);
    double rz = product(g, g->r, g->z);
    const double enough = RESIDUAL * RESIDUAL * rz;
    for (int k = 0; k < MAX_ITERATIONS && rz > enough; k++) {
        apply(g);
        const double curvature = product(g, g->p, g->Kp);
        if (!(curvature > 0)) return false;
        const double step = rz / curvature;
        for (int32_t i = 0; i < g->n; i++) g->x[i] += step * g->p[i], g->r[i] -= step * g->Kp[i];
        precondition(g);
        const double next = product(g, g->r, g->z);
        for (int32_t i = 0; i < g->n; i++) g->p[i] = g->z[i] + next / rz * g->p[i];
        rz = next;
    }
    return rz <= enough;
}

static double frequency(const gradients *g, const double *mass_kg) {
    double inertia = 0;
    for (int32_t i = 0; i < g->n; i++) inertia += mass_kg[i / 3] * g->x[i] * g->x[i];
    return inertia > 0 ? sqrt(2 * tm_tissue_energy(g->tissue, g->x) / inertia) / 6.283185307179586 : 0;
}

tm_status tm_mass_scaling_frequencies(const tm_tissue *tissue, const uint8_t *fixed, double own_Hz[3],
                                      double scaled_Hz[3], tm_error *error) {
    TM_REQUIRE(tissue && fixed && own_Hz && scaled_Hz, "tissue, fixed, own_Hz or scaled_Hz is null", TM_ERR_ARGUMENT);
    gradients g = {0};
    tm_status status = take(&g, tissue, fixed) ? TM_OK : tm_fail_memory(error, "lowest frequencies");
    for (int axis = 0; axis < 3 && !status; axis++) {
        if (sag(&g, axis)) {
            own_Hz[axis] = frequency(&g, tissue->physical_mass_kg);
            scaled_Hz[axis] = frequency(&g, tissue->mass_kg);
        } else
            status = tm_fail(
                error, TM_ERR_CONVERGENCE, -1,
                "the tissue has no equilibrium under its own weight, because its supports leave it free to move; "
                "support every connected piece");
    }
    tm_pool_release(&g.pool);
    return status;
}
