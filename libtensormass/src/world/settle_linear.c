/* Settles linear tissue: K u = f_ext by the conjugate gradient method, preconditioned by the 3x3 vertex tensors. Seen
 * as dynamic relaxation, its mass, damping and step are chosen anew each step so that the energy falls the most. */
#include "world/pressure.h"
#include "world/settle_internal.h"
#include "world/vertex_blocks.h"

#include <math.h>

/* Inverts the vertex tensor's free part; fixed components get 0. */
static void invert_vertex(const tm_tissue *tissue, int32_t v, const uint8_t *fixed, double inverse[9]) {
    double K[9];
    tm_tissue_vertex_tensor(tissue, v, K);
    for (int i = 0; i < 3; i++) {
        if (!fixed[i]) continue;
        for (int j = 0; j < 3; j++) K[3 * i + j] = K[3 * j + i] = 0;
        K[4 * i] = 1;
    }
    double row[9];
    for (int i = 0; i < 3; i++) vcross(K + 3 * ((i + 1) % 3), K + 3 * ((i + 2) % 3), row + 3 * i);
    const double det = vdot(K, row);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) inverse[3 * i + j] = fixed[i] || fixed[j] ? 0 : row[3 * j + i] / det;
}

/* residual := f_ext - K u on the free components; sets the relative residual. */
static void true_residual(tm_relaxation *x) {
    const double *u = x->world->state.u_m;
    tm_tissue_force(x->world->tissue, u, x->image);
    const double forces = fmax(tm_settle_largest(x->external, NULL, x->n), tm_settle_largest(x->image, NULL, x->n));
    const double reference = fmax(forces, tm_force_scale_at(&x->scale, u, x->n));
    for (int32_t i = 0; i < x->n; i++) x->residual[i] = x->fixed[i] ? 0 : x->external[i] + x->image[i];
    const double most = tm_settle_largest(x->residual, NULL, x->n);
    x->relative = most > 0 ? most / reference : 0;
}

/* One restart of the recurrence: until the recurred residual reaches the tolerance or stops falling. */
static tm_status relax_linear_once(tm_relaxation *x, double reference, tm_error *error) {
    double *u = x->world->state.u_m;
    tm_blocks_apply(x->inverse, x->residual, x->n, x->step);
    double rz = tm_product(x->residual, x->step, x->n);
    while (rz > 0) {
        tm_tissue_force(x->world->tissue, x->step, x->image);
        for (int32_t i = 0; i < x->n; i++)
            if (x->fixed[i]) x->image[i] = 0;
        const double curvature = -tm_product(x->step, x->image, x->n);
        if (!(curvature > 0)) break;
        const double length = rz / curvature;
        for (int32_t i = 0; i < x->n; i++) {
            u[i] += length * x->step[i];
            x->residual[i] += length * x->image[i];
        }
        tm_blocks_apply(x->inverse, x->residual, x->n, x->scaled);
        const double next = tm_product(x->residual, x->scaled, x->n);
        const double carry = next / rz;
        for (int32_t i = 0; i < x->n; i++) x->step[i] = x->scaled[i] + carry * x->step[i];
        rz = next;
        x->relative = tm_settle_largest(x->residual, NULL, x->n) / reference;
        if (++x->steps >= x->def->max_steps || !tm_settle_goes_on(x)) return tm_settle_not_converged(x, error);
        if (!(x->relative > 0.5 * x->def->tolerance)) break;
    }
    return TM_OK;
}

static tm_status relax_linear(tm_relaxation *x, tm_error *error) {
    const tm_tissue *tissue = x->world->tissue;
    for (int32_t v = 0; v < x->n / 3; v++) invert_vertex(tissue, v, x->fixed + 3 * v, x->inverse + 9 * (int64_t)v);
    double best = HUGE_VAL;
    for (int idle = 0;;) {
        true_residual(x);
        if (x->relative <= x->def->tolerance) return TM_OK;
        idle = x->relative < 0.5 * best ? 0 : idle + 1;
        best = fmin(best, x->relative);
        if (!isfinite(x->relative) || idle > 4) return tm_settle_not_converged(x, error);
        const double reference = tm_settle_largest(x->residual, NULL, x->n) / x->relative;
        const tm_status status = relax_linear_once(x, reference, error);
        if (status) return status;
    }
}

/* Linear tissue under pressures: solved anew with their forces at the last solution, until that is one. */
static tm_status relax_pressed(tm_relaxation *x, tm_error *error) {
    enum { ROUNDS = 100 };
    tm_status status = TM_OK;
    for (int round = 0; round < ROUNDS && !status; round++) {
        tm_settle_find_loads(x->world, x->external);
        tm_pressure_add(x->world, x->world->state.u_m, x->external);
        true_residual(x);
        if (round > 0 && x->relative <= 2 * x->def->tolerance) return TM_OK;
        status = relax_linear(x, error);
    }
    return status ? status : tm_settle_not_converged(x, error);
}

tm_status tm_settle_linear(tm_relaxation *x, bool pressed, tm_error *error) {
    return pressed ? relax_pressed(x, error) : relax_linear(x, error);
}
