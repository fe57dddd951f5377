/* Derivatives of static equilibrium: its residual at any displacement, and solutions with its tangent.
 *
 * Let r(u, p) be the force on the free components, 0 at rest, and J(u) a quantity. Then dJ/dp = (dJ/du) K^-1 (dr/dp), K
 * = -dr/du, and with K lambda = dJ/du one solution serves all constants p: dJ/dp = lambda . dr/dp. */
#include "world/pressure.h"
#include "world/settle_newton.h"
#include "world/vertex_blocks.h"
#include "world/viscosity.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

typedef struct response {
    tm_pool pool;
    int32_t n;
    tm_tangent tangent;
    uint8_t *fixed;                                     /* [n] prescribed, or without mass */
    double *inverse;                                    /* [3n] inverse vertex tensors of the free components */
    double *residual, *step, *image, *scaled, *correct; /* [n] */
} response;

static tm_status check(const tm_world *world, tm_error *error) {
    if (!tm_settle_is_linear(world))
        return tm_fail(error, TM_ERR_EXCLUDED, -1,
                       "an equilibrium with contact or ties has no smooth derivative; leave them out");
    if (tm_world_has_pressure(world))
        return tm_fail(error, TM_ERR_EXCLUDED, -1,
                       "pressures that follow the surface have no symmetric tangent; use differences of equilibria");
    return TM_OK;
}

/* --- the residual --- */

/* Adds the internal force to the loads in force_N. */
static tm_status add_internal(const tm_world *world, const double *u_m, double *force_N, tm_error *error) {
    const int32_t n = 3 * world->tissue->mesh->vertex_count;
    const tm_nonlinear *law = world->nonlinear;
    tm_pool pool = {0};
    double *force = TM_ALLOC(&pool, double, n);
    if (!force) return tm_fail_memory(error, "static force");
    tm_tissue_force(world->tissue, u_m, force);
    for (int32_t i = 0; i < n; i++) force_N[i] += force[i];
    memset(force, 0, sizeof(double) * (size_t)n);
    if (law) law->force(law->self, u_m, force);
    for (int32_t i = 0; i < n && law; i++) force_N[i] += force[i];
    tm_pool_release(&pool);
    return TM_OK;
}

tm_status tm_world_static_force(tm_world *world, const double *u_m, double *force_N, tm_error *error) {
    TM_REQUIRE(world && u_m && force_N, "world, u_m or force_N is null", TM_ERR_ARGUMENT);
    tm_relaxed relaxed = {0};
    tm_status status = check(world, error);
    if (!status) status = tm_relaxed_begin(world, &relaxed, error);
    if (status) return status;
    world->settling = true;
    tm_settle_find_loads(world, force_N);
    status = add_internal(world, u_m, force_N, error);
    world->settling = false;
    tm_relaxed_end(world, &relaxed, false);
    return status;
}

/* --- solutions with the tangent --- */

/* Allocates, and assembles the tangent at the world's displacement. Returns false without memory. */
static bool begin(response *x, const tm_world *world) {
    const tm_nonlinear *law = world->nonlinear;
    double **vector[] = {&x->residual, &x->step, &x->image, &x->scaled, &x->correct};
    for (size_t i = 0; i < sizeof vector / sizeof *vector; i++) *vector[i] = TM_ALLOC(&x->pool, double, x->n);
    x->inverse = TM_ALLOC(&x->pool, double, 3 * (int64_t)x->n);
    x->fixed = TM_ALLOC(&x->pool, uint8_t, x->n);
    const bool taken = law ? law->take_tangent(law->self, &x->tangent, &x->pool)
                           : tm_tangent_take_tensors(&x->tangent, &x->pool, world->tissue);
    if (!taken || x->pool.failed) return false;
    tm_tangent_begin(world->tissue, &x->tangent);
    if (law) law->add_tangent(law->self, world->state.u_m, 0, world->tissue->mesh->tet_count, &x->tangent);
    tm_support_mask(world, x->fixed);
    for (int32_t i = 0; i < x->n; i++)
        if (world->tissue->mass_kg[i / 3] == 0) x->fixed[i] = 1;
    return true;
}

/* out := -K a on the free components. */
static void apply(response *x, const double *a, double *out) {
    tm_force_pass(x->tangent.force, &x->tangent.graph, a, out);
    for (int32_t i = 0; i < x->n; i++)
        if (x->fixed[i]) out[i] = 0;
}

/* correct := approximately K^-1 residual, which it overwrites. Returns false if K is not positive there. */
static bool solve(response *x, double enough) {
    int64_t left = 1000 + 4 * (int64_t)x->n;
    memset(x->correct, 0, sizeof(double) * (size_t)x->n);
    tm_blocks_apply(x->inverse, x->residual, x->n, x->step);
    double rz = tm_product(x->residual, x->step, x->n);
    while (rz > 0 && tm_product(x->residual, x->residual, x->n) > enough * enough && left-- > 0) {
        apply(x, x->step, x->image);
        const double curvature = -tm_product(x->step, x->image, x->n);
        if (!(curvature > 0)) return false;
        const double length = rz / curvature;
        for (int32_t i = 0; i < x->n; i++) {
            x->correct[i] += length * x->step[i];
            x->residual[i] += length * x->image[i];
        }
        tm_blocks_apply(x->inverse, x->residual, x->n, x->scaled);
        const double next = tm_product(x->residual, x->scaled, x->n), carry = next / rz;
        for (int32_t i = 0; i < x->n; i++) x->step[i] = x->scaled[i] + carry * x->step[i];
        rz = next;
    }
    return true;
}

/* Solves for the free components of x_m, each round from the true residual. */
static tm_status respond(response *x, const double *b_N, double tolerance, double *x_m, tm_error *error) {
    enum { ROUNDS = 4 };
    double first = 0, now = 0;
    for (int32_t i = 0; i < x->n; i++)
        if (!x->fixed[i]) x_m[i] = 0;
    tm_blocks_invert(x->tangent.graph.vertex_tensor, x->fixed, x->n, x->inverse);
    for (int round = 0; round <= ROUNDS; round++) {
        apply(x, x_m, x->residual);
        for (int32_t i = 0; i < x->n; i++) x->residual[i] += b_N && !x->fixed[i] ? b_N[i] : 0;
        now = sqrt(tm_product(x->residual, x->residual, x->n));
        if (!round) first = now;
        if (now <= tolerance * first) return TM_OK;
        if (!isfinite(now) || round == ROUNDS) break;
        if (!solve(x, 0.5 * tolerance * first))
            return tm_fail(error, TM_ERR_CONVERGENCE, -1,
                           "the tangent is not positive at this equilibrium; use differences of equilibria");
        for (int32_t i = 0; i < x->n; i++) x_m[i] += x->fixed[i] ? 0 : x->correct[i];
    }
    return tm_fail(error, TM_ERR_CONVERGENCE, -1,
                   "the residual is %g of the first, above the tolerance of %g; allow more", now / first, tolerance);
}

tm_status tm_world_static_response(tm_world *world, const double *b_N, double tolerance, double *x_m, tm_error *error) {
    TM_REQUIRE(world && x_m && tolerance > 0, "world or x_m is null, or tolerance is not above 0", TM_ERR_ARGUMENT);
    response x = {.n = 3 * world->tissue->mesh->vertex_count};
    tm_relaxed relaxed = {0};
    tm_status status = check(world, error);
    if (!status) status = tm_relaxed_begin(world, &relaxed, error);
    if (status) return status;
    status = begin(&x, world) ? respond(&x, b_N, tolerance, x_m, error) : tm_fail_memory(error, "static response");
    tm_pool_release(&x.pool);
    tm_relaxed_end(world, &relaxed, false);
    return status;
}
