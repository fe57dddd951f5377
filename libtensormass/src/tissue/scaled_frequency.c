/* What mass scaling does to the lowest frequencies: Rayleigh's quotients of the shapes in which tissue gives way to its
 * own weight (one inverse iteration from a translation), by conjugate gradients. */
#include "tissue/tissue_internal.h"

#include <math.h>
#include <string.h>

enum { MOST_ITERATIONS = 5000 };
static const double RESIDUAL = 1e-3; /* the quotient is good to its square */

typedef struct gradients {
    tm_pool pool;
    const tm_tissue *tissue;
    int32_t n;
    double *diagonal; /* of K; 0: held, or without mass */
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
    for (int i = 0; i < 6; i++) *arrays[i] = TM_TAKE(&g->pool, double, g->n);
    for (int32_t i = 0; !g->pool.failed && i < g->n; i++)
        if (!fixed[i] && tissue->own_mass_kg[i / 3] > 0)
            g->diagonal[i] = tissue->graph.vertex_tensor[9 * (int64_t)(i / 3) + 4 * (i % 3)];
    return !g->pool.failed;
}

static void precondition(gradients *g) {
    for (int32_t i = 0; i < g->n; i++) g->z[i] = g->diagonal[i] > 0 ? g->r[i] / g->diagonal[i] : 0;
}

/* Kp, held components left out. */
static void apply(gradients *g) {
    tm_tissue_force(g->tissue, g->p, g->Kp);
    for (int32_t i = 0; i < g->n; i++) g->Kp[i] = g->diagonal[i] > 0 ? -g->Kp[i] : 0;
}

/* K x = own mass along `axis`. */
static bool sag(gradients *g, int axis) {
    memset(g->x, 0, sizeof(double) * (size_t)g->n);
    for (int32_t i = 0; i < g->n; i++)
        g->r[i] = i % 3 == axis && g->diagonal[i] > 0 ? g->tissue->own_mass_kg[i / 3] : 0;
    precondition(g);
    memcpy(g->p, g->z, sizeof(double) * (size_t)g->n);
    double rz = product(g, g->r, g->z);
    const double enough = RESIDUAL * RESIDUAL * rz;
    for (int k = 0; k < MOST_ITERATIONS && rz > enough; k++) {
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
            own_Hz[axis] = frequency(&g, tissue->own_mass_kg);
            scaled_Hz[axis] = frequency(&g, tissue->mass_kg);
        } else
            status = tm_fail(error, TM_ERR_CONVERGENCE, -1,
                             "the tissue does not come to rest under its own weight: its supports leave it free to "
                             "move; hold every piece of it");
    }
    tm_pool_release(&g.pool);
    return status;
}
