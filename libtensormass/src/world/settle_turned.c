/* Rest of tissue that turns: Newton's method on the whole nonlinear problem, with conjugate gradients inside.
 *
 * Supports and loads come on little by little: f(s) = f - (1 - s) r0 and u(s) = u0 + s (u1 - u0) where they prescribe,
 * r0 what the state at the start lacks, so that the start is at rest for s = 0. An increment whose Newton steps do not
 * settle is taken back and halved. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "world/settle_turned.h"

enum { NEWTON_STEPS = 30, HALVINGS = 30 };

typedef struct newton {
    tm_pool pool;
    const tm_rotation *rotation;
    const tm_tissue *tissue;
    const tm_turned_rest *rest;
    const tm_settle_def *def;
    int32_t n;
    tm_tangent tangent;
    double *load, *force, *turned;                   /* [n] external at s; internal; its correction */
    double *residual, *step, *image, *scaled, *move; /* [n] */
    double *last, *first, *lack, *inverse; /* [n] u at the last s, at s = 0; r0; [3n] inverse vertex tensors */
    double reference;                      /* residual that counts as 1 */
    int64_t steps;
    double relative;
} newton;

static double largest(const double *a, int32_t n) {
    double most = 0;
    for (int32_t i = 0; i < n; i++) most = fmax(most, fabs(a[i]));
    return most;
}

static double product(const double *a, const double *b, int32_t n) {
    double sum = 0;
    for (int32_t i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

/* Residual at u, and how large it is beside what pulls and pushes. */
static double look(newton *w, const double *u) {
    tm_tissue_force(w->tissue, u, w->force);
    tm_rotation_force(w->rotation, u, w->turned);
    for (int32_t i = 0; i < w->n; i++) w->force[i] += w->turned[i];
    for (int32_t i = 0; i < w->n; i++) w->residual[i] = w->rest->held[i] ? 0 : w->load[i] + w->force[i];
    const double most = largest(w->residual, w->n);
    const double beside = fmax(largest(w->rest->external_N, w->n), largest(w->force, w->n));
    w->relative = most > 0 ? most / fmax(beside, DBL_MIN) : 0;
    return sqrt(product(w->residual, w->residual, w->n));
}

static double potential(const newton *w, const double *u) {
    return tm_tissue_energy(w->tissue, u) + tm_rotation_energy(w->rotation, u) - product(w->load, u, w->n);
}

/* --- the tangent's system --- */

static void invert(newton *w) {
    for (int32_t v = 0; v < w->n / 3; v++) {
        double K[9], minor[9], *inverse = w->inverse + 9 * (int64_t)v;
        const uint8_t *held = w->rest->held + 3 * v;
        memcpy(K, w->tangent.graph.vertex_tensor + 9 * (int64_t)v, sizeof K);
        for (int i = 0; i < 9; i++)
            if (held[i / 3] || held[i % 3]) K[i] = i % 4 ? 0 : 1;
        for (int i = 0; i < 3; i++) vcross(K + 3 * ((i + 1) % 3), K + 3 * ((i + 2) % 3), minor + 3 * i);
        const double det = vdot(K, minor), size = K[0] + K[4] + K[8];
        const bool good = K[0] > 0 && minor[8] > 0 && det > 1e-9 * size * size * size;
        for (int i = 0; i < 9; i++)
            inverse[i] = held[i / 3] || held[i % 3] ? 0 : good ? minor[3 * (i % 3) + i / 3] / det : i % 4 ? 0 : 1;
    }
}

static void precondition(const newton *w, const double *r, double *z) {
    for (int32_t v = 0; v < w->n / 3; v++)
        for (int i = 0; i < 3; i++) z[3 * v + i] = vdot(w->inverse + 9 * (int64_t)v + 3 * i, r + 3 * v);
}

/* move := about K^-1 residual on the free components; where K is not positive, as far as it is. The residual is used
 * up. */
static tm_status solve(newton *w, double accuracy, tm_error *error) {
    const int32_t n = w->n;
    invert(w);
    precondition(w, w->residual, w->step);
    double rz = product(w->residual, w->step, n);
    const double enough = accuracy * accuracy * rz;
    for (int32_t i = 0; i < n; i++)
        if (!w->rest->held[i]) w->move[i] = 0;
    for (bool first = true; rz > enough; first = false) {
        tm_force_pass(w->tangent.force, &w->tangent.graph, w->step, w->image);
        for (int32_t i = 0; i < n; i++)
            if (w->rest->held[i]) w->image[i] = 0;
        const double curvature = -product(w->step, w->image, n);
        if (!(curvature > 0)) {
            for (int32_t i = 0; i < n && first; i++) w->move[i] += w->step[i];
            return TM_OK;
        }
        const double length = rz / curvature;
        for (int32_t i = 0; i < n; i++) {
            w->move[i] += length * w->step[i];
            w->residual[i] += length * w->image[i];
        }
        precondition(w, w->residual, w->scaled);
        const double next = product(w->residual, w->scaled, n), carry = next / rz;
        for (int32_t i = 0; i < n; i++) w->step[i] = w->scaled[i] + carry * w->step[i];
        rz = next;
        const bool told = w->def->progress && w->steps % 128 == 0;
        if (++w->steps >= w->def->max_steps ||
            (told && !w->def->progress(w->def->user, w->steps, fmax(w->relative, w->def->tolerance))))
            return tm_fail(error, TM_ERR_CONVERGENCE, -1,
                           "the residual is %g after %lld steps, not %g; allow more steps, a larger tolerance, or "
                           "hold the tissue better",
                           w->relative, (long long)w->steps, w->def->tolerance);
    }
    return TM_OK;
}

/* --- one increment --- */

/* u += the move, halved until energy or residual falls. False: neither does. */
static bool descend(newton *w, double *u) {
    const double before = potential(w, u), lack = look(w, u), slope = product(w->residual, w->move, w->n);
    double length = 1;
    memcpy(w->scaled, u, sizeof(double) * (size_t)w->n);
    for (int k = 0; k < HALVINGS; k++, length *= 0.5) {
        for (int32_t i = 0; i < w->n; i++) u[i] = w->scaled[i] + (w->rest->held[i] ? 0 : length * w->move[i]);
        const double now = look(w, u);
        if (now < lack * (1 - 1e-4 * length)) return true;
        if (potential(w, u) < before - 1e-4 * length * fabs(slope)) return true;
    }
    memcpy(u, w->scaled, sizeof(double) * (size_t)w->n);
    look(w, u);
    return false;
}

/* Newton's steps at one s; converged: *rests. */
static tm_status settle_here(newton *w, double *u, double tolerance, bool *rests, tm_error *error) {
    *rests = false;
    for (int k = 0; k < NEWTON_STEPS; k++) {
        look(w, u);
        *rests = w->relative <= tolerance;
        if (*rests || !isfinite(w->relative)) return TM_OK;
        tm_rotation_tangent(w->rotation, u, &w->tangent);
        const tm_status status = solve(w, fmax(fmin(0.1, w->relative), 1e-6), error);
        if (status) return status;
        if (!descend(w, u)) return TM_OK;
    }
    return TM_OK;
}

/* First guess of the next s: the tangent's answer to what supports and loads do. */
static tm_status predict(newton *w, double *u, double from, double to, tm_error *error) {
    const tm_turned_rest *rest = w->rest;
    for (int32_t i = 0; i < w->n; i++) {
        w->load[i] = rest->external_N[i] - (1 - to) * w->lack[i];
        w->move[i] = rest->held[i] ? (to - from) * (rest->target_m[i] - w->first[i]) : 0;
    }
    look(w, u);
    tm_rotation_tangent(w->rotation, u, &w->tangent);
    tm_force_pass(w->tangent.force, &w->tangent.graph, w->move, w->image);
    for (int32_t i = 0; i < w->n; i++)
        if (!rest->held[i]) w->residual[i] += w->image[i];
    const tm_status status = solve(w, 1e-3, error);
    for (int32_t i = 0; i < w->n && !status; i++) u[i] += w->move[i];
    return status;
}

static tm_status march(newton *w, double *u, tm_error *error) {
    const size_t bytes = sizeof(double) * (size_t)w->n;
    const tm_settle_def *def = w->def;
    double s = 0, increment = 1;
    bool rests = false;
    tm_status status = TM_OK;
    while (s < 1 && !status) {
        const double next = fmin(s + increment, 1);
        memcpy(w->last, u, bytes);
        status = predict(w, u, s, next, error);
        if (!status) status = settle_here(w, u, next < 1 ? fmax(1e-4, def->tolerance) : def->tolerance, &rests, error);
        if (status || rests) {
            s = next;
            increment *= 2;
            continue;
        }
        memcpy(u, w->last, bytes);
        increment *= 0.5;
        if (increment < 1e-3)
            status = tm_fail(error, TM_ERR_CONVERGENCE, -1,
                             "the residual is %g at %.3g of supports and loads and does not fall to %g; move the "
                             "supports in smaller steps, or allow a larger tolerance",
                             w->relative, next, def->tolerance);
    }
    return status;
}

static bool take(newton *w) {
    double **vector[] = {&w->load,   &w->force, &w->turned, &w->residual, &w->step, &w->image,
                         &w->scaled, &w->move,  &w->last,   &w->first,    &w->lack};
    for (size_t i = 0; i < sizeof vector / sizeof vector[0]; i++) *vector[i] = TM_TAKE(&w->pool, double, w->n);
    w->inverse = TM_TAKE(&w->pool, double, 3 * (int64_t)w->n);
    return tm_tangent_take(&w->tangent, &w->pool, w->rotation);
}

tm_status tm_settle_turned(const tm_rotation *rotation, const tm_turned_rest *rest, const tm_settle_def *def,
                           double *u_m, tm_settle_result *result, tm_error *error) {
    newton w = {.rotation = rotation, .tissue = rotation->tissue, .rest = rest, .def = def};
    w.n = 3 * w.tissue->mesh->vertex_count;
    if (!take(&w)) {
        tm_pool_release(&w.pool);
        return tm_fail_memory(error, "settling");
    }
    const size_t bytes = sizeof(double) * (size_t)w.n;
    memcpy(w.first, u_m, bytes);
    memcpy(w.load, rest->external_N, bytes);
    look(&w, u_m);
    memcpy(w.lack, w.residual, bytes);
    bool moves = false;
    for (int32_t i = 0; i < w.n; i++) moves = moves || (rest->held[i] && rest->target_m[i] != u_m[i]);
    const tm_status status = moves || w.relative > def->tolerance ? march(&w, u_m, error) : TM_OK;
    *result = (tm_settle_result){w.steps, w.relative, 0};
    tm_pool_release(&w.pool);
    return status;
}
