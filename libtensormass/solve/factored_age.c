/* Age of a factor of nonlinear tissue: how far its compliance is from that of the tangent now.
 *
 * The tangent's is found by conjugate gradients on its forces, with the factor, turned with the tissue, as
 * preconditioner: the first iteration gives the second order of the change, the fourth the second digit. */
#include "factored.h"

#include <math.h>
#include <string.h>

/* Motion after which tangents are compared, relative to that which requires a new factor of rotating tissue.
 * Differences that require a new factor: some frames after the last one, and at once. */
static const double LOOKS_AFTER = 0.3, AGE_MAX = 0.02, AGE_AT_ONCE = 0.1;
enum { RENEWS_AFTER = 12, ITERATIONS = 4, AXES = 3, PROBED = 4 };

/* Fields [AXES][3*vertex_count], one for each axis of the force. */
typedef struct comparison {
    const tms_engine *e;
    tm_tissue *now;
    tms_work *work;
    double *turn;                                /* [9*vertex_count] rotations since the factor */
    double *force, *left, *along, *image, *next; /* forces, what of them is left, direction, its image; C left */
} comparison;

/* Spreads a unit force along each axis over the first needed vertices, which are the nearest to the tip: a load on the
 * complete patch hardly changes where its middle does. */
static void spread(const tms_engine *e, const tms_compliance_request *request, double *force) {
    const int64_t n = 3 * (int64_t)e->vertex_count;
    for (int t = 0; t < TM_MAX_INSTRUMENTS; t++) {
        const int32_t count = request->needed[t] < PROBED ? request->needed[t] : PROBED;
        for (int32_t i = 0; i < AXES * count; i++) {
            const int32_t dof = 3 * request->vertex[t][i / AXES] + i % AXES;
            if (!e->fixed[dof]) force[i % AXES * n + dof] += 1.0 / count;
        }
    }
}

/* Computes the rotation of every vertex since the factor. */
static void find_turns(const tms_engine *e, const double *u_m, double *turn) {
    const tm_mesh *mesh = tm_tissue_mesh(e->tissue);
    for (int32_t v = 0; v < e->vertex_count; v++) {
        double from[9], to[9], *Q = turn + 9 * (int64_t)v;
        tms_vertex_frame(mesh, e->base, e->at_m, v, from);
        tms_vertex_frame(mesh, e->base, u_m, v, to);
        for (int i = 0; i < 9; i++) {
            const double *a = to + i / 3 * 3, *b = from + i % 3 * 3;
            Q[i] = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        }
    }
}

/* next := Q C Q^T left. */
static bool precondition(const comparison *c) {
    const tms_engine *e = c->e;
    const int64_t dofs = 3 * (int64_t)e->vertex_count, n = e->system.n;
    double *rhs = tms_work_rhs(c->work);
    for (int64_t i = 0; i < AXES * n; i++) {
        const int32_t dof = e->system.dof[i % n];
        const double *Q = c->turn + 9 * (int64_t)(dof / 3), *r = c->left + i / n * dofs + dof / 3 * 3;
        rhs[i] = Q[dof % 3] * r[0] + Q[3 + dof % 3] * r[1] + Q[6 + dof % 3] * r[2];
    }
    const double *x = tms_work_solve(c->work);
    if (!x) return false;
    memset(c->next, 0, AXES * (size_t)dofs * sizeof *c->next);
    for (int64_t i = 0; i < AXES * n; i++) {
        const int32_t dof = e->system.dof[i % n];
        for (int k = 0; k < 3; k++) {
            const int32_t to = dof / 3 * 3 + k;
            if (!e->fixed[to]) c->next[i / n * dofs + to] += c->turn[9 * (int64_t)(dof / 3) + 3 * k + dof % 3] * x[i];
        }
    }
    return true;
}

static double product(const double *a, const double *b, int64_t n) {
    double sum = 0;
    for (int64_t i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

/* One iteration for one axis: `rz` is left.next. Returns what it adds to the compliance; NAN: not positive. */
static double iterate(const comparison *c, int axis, double rz, double carry) {
    const int64_t n = 3 * (int64_t)c->e->vertex_count;
    double *left = c->left + axis * n, *along = c->along + axis * n, *next = c->next + axis * n;
    for (int64_t i = 0; i < n; i++) along[i] = next[i] + carry * along[i];
    tm_tissue_force(c->now, along, c->image);
    for (int64_t i = 0; i < n; i++)
        if (c->e->fixed[i]) c->image[i] = 0;
    const double stiff = -product(along, c->image, n);
    if (!(stiff > 0)) return NAN;
    for (int64_t i = 0; i < n; i++) left[i] += rz / stiff * c->image[i];
    return rz / stiff * product(c->force + axis * n, along, n);
}

/* Returns the largest relative difference over the axes. */
static double compare(const comparison *c) {
    const int64_t n = 3 * (int64_t)c->e->vertex_count;
    double before[AXES], now[AXES] = {0}, rz[AXES], age = 0;
    for (int k = 0; k < ITERATIONS; k++) {
        if (!precondition(c)) return 1;
        for (int axis = 0; axis < AXES; axis++) {
            const double last = k ? rz[axis] : 0;
            rz[axis] = product(c->left + axis * n, c->next + axis * n, n);
            if (k == 0) before[axis] = rz[axis];
            if (!(rz[axis] > 1e-6 * before[axis])) continue;
            now[axis] += iterate(c, axis, rz[axis], k ? rz[axis] / last : 0);
        }
    }
    for (int axis = 0; axis < AXES; axis++) {
        if (!(before[axis] > 0)) continue;
        const double off = fabs(now[axis] / before[axis] - 1);
        age = off <= 1 ? fmax(age, off) : 1;
    }
    return age;
}

double tms_engine_age(const tms_engine *e, const tms_compliance_request *request) {
    const size_t bytes = 3 * (size_t)e->vertex_count * sizeof(double);
    double age = 1, *fields = tms_alloc_zeroed(4 * AXES + 1 + 3, bytes);
    comparison c = {.e = e, .work = tms_work_create(e->solver, AXES)};
    if (fields && c.work && tms_engine_partial_tissue(e, e->base, request->u_m, &c.now)) {
        const size_t n = 3 * (size_t)e->vertex_count;
        c.force = fields, c.left = fields + AXES * n, c.along = fields + 2 * AXES * n, c.next = fields + 3 * AXES * n;
        c.image = fields + 4 * AXES * n, c.turn = c.image + n;
        spread(e, request, c.force);
        memcpy(c.left, c.force, AXES * bytes);
        find_turns(e, request->u_m, c.turn);
        age = compare(&c);
        tm_tissue_destroy(c.now);
    }
    tms_work_destroy(c.work);
    tms_free(fields);
    return age;
}

bool tms_engine_has_aged(tms_engine *e, const tms_compliance_request *request) {
    double moved = 0;
    for (int32_t i = 0; i < 3 * e->vertex_count; i++) moved = fmax(moved, fabs(request->u_m[i] - e->looked_m[i]));
    if (moved > LOOKS_AFTER * e->moved_on_m) {
        e->age = tms_engine_age(e, request);
        memcpy(e->looked_m, request->u_m, 3 * (size_t)e->vertex_count * sizeof *e->looked_m);
    }
    return !(e->age <= (request->frame - e->frame < RENEWS_AFTER ? AGE_AT_ONCE : AGE_MAX));
}
