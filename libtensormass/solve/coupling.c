/* Builds the coupling of a hybrid model, and stores its state. See coupling.h. */
#include "coupling.h"

#include <math.h>
#include <string.h>

enum {
    WHOLE_BELOW = 96, /* components: below it nothing is saved */
    POWERS = 2,       /* applications of K^-1 C to the first modes: they rotate towards the softest ones */
    SOLVE_STEPS = 20, /* of conjugate gradients for K^-1, which is nearly diagonal and needs few digits */
    FIRST = 8,        /* substeps between full forces; one more per PER components, at most LAST */
    PER = 40,
    LAST = 64,
    CHANGES = 7 /* updates of the full force in single, between two in double */
};
/* Makes W slightly too small: rounding in single precision must not make R negative where it is zero. */
static const double SHRINK = 1 - 1e-6;
static const double NOTHING = 1e-10; /* relative to the largest pivot: the mode is linearly dependent */

/* --- memory --- */

static void *carve(char **at, size_t bytes) {
    void *p = *at;
    *at = (char *)((uintptr_t)*at + (bytes + 63) / 64 * 64);
    return p;
}

static size_t lay_out(tms_coupling *c, int32_t blocks, char *memory) {
    char *at = memory;
    const size_t n = (size_t)c->n, padded = (size_t)c->padded;
    c->begin = carve(&at, 4 * (n / 3 + 1));
    c->neighbour = carve(&at, 4 * (size_t)blocks);
    c->block = carve(&at, 48 * (size_t)blocks);
    c->smooth = carve(&at, 4 * padded * (size_t)c->rank);
    c->shape = carve(&at, 4 * n * (size_t)c->rank);
    c->along = carve(&at, 4 * (size_t)c->rank);
    c->moved = carve(&at, 4 * padded);
    c->answer = carve(&at, 4 * (padded + 1));
    c->spread = carve(&at, 16 * (n / 3));
    c->single = carve(&at, c->rank ? 2 * n * (n + 1) : 0);
    double **list[] = {&c->whole_m, &c->whole_N, &c->saved_m, &c->saved_N, &c->change_m};
    for (int i = 0; i < 5; i++) *list[i] = carve(&at, 8 * n);
    return (size_t)(at - memory);
}

/* --- K --- */

/* Fills the blocks of each interface vertex, the diagonal one first; only counts if `c` has no memory yet. The system
 * has only the lower triangle, so both of each pair are written. */
static int32_t fill_blocks(tms_coupling *c, const tms_system *s, int32_t *count) {
    const int32_t vertices = c->n / 3;
    int32_t blocks = 0;
    memset(count, 0, 4 * (size_t)vertices);
    for (int pass = 0; pass < (c->history ? 2 : 1); pass++) {
        for (int32_t v = 0; v < vertices; v++) {
            int32_t last = -1;
            for (int32_t k = s->begin[3 * v]; k < s->begin[3 * v + 1]; k++) {
                const int32_t w = s->row[k] / 3;
                if (w == last) continue;
                last = w;
                if (pass) c->neighbour[c->begin[v] + count[v]] = w;
                count[v]++;
                if (w == v) continue;
                if (pass) c->neighbour[c->begin[w] + count[w]] = v;
                count[w]++;
            }
        }
        blocks = 0;
        for (int32_t v = 0; v < vertices; v++) {
            if (c->history && !pass) c->begin[v] = blocks;
            blocks += (count[v] + 1) / 2 * 2;
            if (!pass && c->history) count[v] = 0;
        }
        if (c->history && !pass) c->begin[vertices] = blocks;
    }
    return blocks;
}

static float *entry(const tms_coupling *c, int32_t row, int32_t column) {
    int32_t k = c->begin[row / 3];
    while (c->neighbour[k] != column / 3) k++;
    return c->block + 24 * (int64_t)(k / 2) + 8 * (column % 3) + 4 * (k % 2) + row % 3;
}

static void fill_values(const tms_coupling *c, const tms_system *s) {
    for (int32_t j = 0; j < s->n; j++)
        for (int32_t k = s->begin[j]; k < s->begin[j + 1]; k++)
            *entry(c, s->row[k], j) = *entry(c, j, s->row[k]) = (float)s->value[k];
}

/* --- W --- */

/* Data for the construction of W. */
typedef struct maker {
    const tms_coupling *c;
    const tms_system *K;
    double *x, *y, *z, *zero; /* [n] scratch, and zeros */
    double *shape, *given;    /* [rank][n] orthonormal; C times them */
    double *gram;             /* [rank][rank] */
} maker;

/* out += K v. */
static void add_near(const tms_system *K, const double *v, double *out) {
    for (int32_t j = 0; j < K->n; j++)
        for (int32_t k = K->begin[j]; k < K->begin[j + 1]; k++) {
            out[K->row[k]] += K->value[k] * v[j];
            if (K->row[k] != j) out[j] += K->value[k] * v[K->row[k]];
        }
}

/* out := C v. */
static void give_way(const maker *m, const double *v, double *out) {
    tms_whole_force(m->c->schur, m->zero, v, m->c->n, out); /* -S v */
    add_near(m->K, v, out);
}

/* v := approximately K^-1 b. Jacobi's preconditioner: the diagonal is the first entry of its column. */
static void solve_near(const maker *m, const double *b, double *v) {
    const int32_t n = m->c->n;
    const tms_system *K = m->K;
    double *r = m->x, *p = m->y, *q = m->z, rho = 0;
    memset(v, 0, 8 * (size_t)n);
    memset(p, 0, 8 * (size_t)n);
    memcpy(r, b, 8 * (size_t)n);
    for (int step = 0; step < SOLVE_STEPS; step++) {
        double now = 0;
        for (int32_t i = 0; i < n; i++) now += r[i] * r[i] / K->value[K->begin[i]];
        if (!(now > 0)) return;
        for (int32_t i = 0; i < n; i++) p[i] = r[i] / K->value[K->begin[i]] + (rho > 0 ? now / rho * p[i] : 0);
        rho = now;
        memset(q, 0, 8 * (size_t)n);
        add_near(K, p, q);
        const double along = rho / tms_dot(p, q, n);
        for (int32_t i = 0; i < n; i++) v[i] += along * p[i], r[i] -= along * q[i];
    }
}

/* Assigns the interface's vertices to the nearest of some that are far from each other: each group and axis is a
 * mode. */
static void first_shapes(const maker *m, const double *rest_m, const int32_t *interface) {
    const int32_t n = m->c->n, vertices = n / 3;
    double *far = m->x;
    for (int32_t v = 0; v < vertices; v++) far[v] = INFINITY;
    memset(m->shape, 0, 8 * (size_t)m->c->rank * (size_t)n);
    int32_t *group = (int32_t *)m->y, seed = 0;
    for (int32_t g = 0; g < (m->c->rank + 2) / 3; g++) {
        const double *at = rest_m + interface[3 * seed] / 3 * 3;
        for (int32_t v = 0; v < vertices; v++) {
            double off = 0;
            for (int i = 0; i < 3; i++) {
                const double d = rest_m[interface[3 * v] / 3 * 3 + i] - at[i];
                off += d * d;
            }
            if (off < far[v]) far[v] = off, group[v] = g;
        }
        seed = 0;
        for (int32_t v = 1; v < vertices; v++)
            if (far[v] > far[seed]) seed = v;
    }
    for (int32_t d = 0; d < n; d++)
        if (3 * group[d / 3] + d % 3 < m->c->rank) m->shape[(int64_t)(3 * group[d / 3] + d % 3) * n + d] = 1;
}

/* Gram-Schmidt, applied twice; a linearly dependent mode becomes zero. */
static void orthonormalise(double *shape, int32_t count, int32_t n) {
    for (int32_t j = 0; j < count; j++) {
        double *v = shape + (int64_t)j * n;
        const double before = tms_dot(v, v, n);
        for (int twice = 0; twice < 2; twice++)
            for (int32_t i = 0; i < j; i++) {
                const double *u = shape + (int64_t)i * n, along = tms_dot(u, v, n);
                for (int32_t d = 0; d < n; d++) v[d] -= along * u[d];
            }
        const double size = tms_dot(v, v, n), unit = size > NOTHING * before && size > 0 ? 1 / sqrt(size) : 0;
        for (int32_t d = 0; d < n; d++) v[d] *= unit;
    }
}

/* W := C V (V^T C V)^(-1/2), with Cholesky's factor of the middle; V is `shape`, C V is `given`. */
static void factor_shapes(const maker *m, tms_coupling *c) {
    const int32_t n = c->n, r = c->rank;
    double most = 0;
    for (int32_t i = 0; i < r; i++)
        for (int32_t j = 0; j <= i; j++) {
            const double *vi = m->shape + (int64_t)i * n, *vj = m->shape + (int64_t)j * n,
                         *ci = m->given + (int64_t)i * n, *cj = m->given + (int64_t)j * n;
            m->gram[i * r + j] = 0.5 * (tms_dot(vi, cj, n) + tms_dot(vj, ci, n));
            if (i == j) most = fmax(most, m->gram[i * r + i]);
        }
    for (int32_t j = 0; j < r; j++) {
        double *L = m->gram + (int64_t)j * r, *w = m->given + (int64_t)j * n;
        for (int32_t i = 0; i < j; i++) { /* row j of L, and column j of W, from the previous columns */
            const double *Li = m->gram + (int64_t)i * r, *wi = m->given + (int64_t)i * n;
            for (int32_t k = 0; k < i; k++) L[i] -= L[k] * Li[k];
            L[i] = Li[i] > 0 ? L[i] / Li[i] : 0;
            for (int32_t d = 0; d < n; d++) w[d] -= L[i] * wi[d];
        }
        double pivot = L[j];
        for (int32_t k = 0; k < j; k++) pivot -= L[k] * L[k];
        L[j] = pivot > NOTHING * most ? sqrt(pivot) : 0;
        const double unit = L[j] > 0 ? 1 / L[j] : 0;
        for (int32_t d = 0; d < n; d++) w[d] *= unit;
        for (int32_t d = 0; d < n; d++) c->smooth[(int64_t)j * c->padded + d] = (float)(SHRINK * w[d]);
    }
}

static bool make_smooth(tms_coupling *c, const tms_system *K, const double *rest_m, const int32_t *interface) {
    const size_t n = (size_t)c->n, r = (size_t)c->rank;
    double *memory = tms_alloc_zeroed(4 * n + 2 * n * r + r * r, 8);
    if (!memory) return false;
    const maker m = {.c = c,
                     .K = K,
                     .x = memory,
                     .y = memory + n,
                     .z = memory + 2 * n,
                     .zero = memory + 3 * n,
                     .shape = memory + 4 * n,
                     .given = memory + 4 * n + n * r,
                     .gram = memory + 4 * n + 2 * n * r};
    first_shapes(&m, rest_m, interface);
    for (int pass = 0; pass <= POWERS; pass++) {
        orthonormalise(m.shape, c->rank, c->n);
        for (size_t j = 0; j < r; j++) {
            give_way(&m, m.shape + j * n, m.given + j * n);
            if (pass < POWERS) solve_near(&m, m.given + j * n, m.shape + j * n);
        }
    }
    for (size_t i = 0; i < n * r; i++) c->shape[i] = (float)m.shape[i % r * n + i / r];
    factor_shapes(&m, c);
    tms_free(memory);
    return true;
}

/* --- construction --- */

static tm_status make(tms_coupling *c, const tm_tissue *condensed, const int32_t *interface, tm_error *error) {
    const tm_mesh *mesh = tm_tissue_mesh(condensed);
    const size_t dofs = 3 * (size_t)mesh->vertex_count;
    uint8_t *others = tms_alloc(dofs);
    int32_t *count = tms_alloc(4 * (size_t)(c->n + 1));
    tms_system K = {0};
    tm_status status =
        others && count ? TM_OK : tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the interface; use a coarser mesh");
    if (status == TM_OK) {
        memset(others, 1, dofs);
        for (int32_t i = 0; i < c->n; i++) others[interface[i]] = 0;
        status = tms_system_assemble(condensed, others, &K, error);
    }
    if (status == TM_OK) {
        const int32_t blocks = fill_blocks(c, &K, count);
        c->bytes = (int64_t)lay_out(c, blocks, NULL);
        c->history = tms_alloc_zeroed((size_t)c->bytes, 1);
        if (c->history) {
            lay_out(c, blocks, c->history);
            fill_blocks(c, &K, count);
            fill_values(c, &K);
            for (int64_t i = 0; c->rank && i < (int64_t)c->n * (c->n + 1) / 2; i++) c->single[i] = (float)c->schur[i];
        }
        if (!c->history || (c->rank && !make_smooth(c, &K, mesh->rest_m, interface)))
            status = tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the interface; use a coarser mesh");
    }
    tms_system_destroy(&K);
    tms_free(others);
    tms_free(count);
    return status;
}

tm_status tms_coupling_create(const tm_tissue *condensed, const int32_t *interface, int32_t n, const double *schur,
                              const double *given_N, tms_coupling *coupling, tm_error *error) {
    tms_coupling c = {
        .n = n, .padded = (n + 15) / 16 * 16, .schur = schur, .prescribed_N = given_N, .every = 1, .age = -1};
    if (n >= WHOLE_BELOW) {
        c.rank = 16 * (int32_t)ceil(sqrt(n) / 8);
        c.every = FIRST + (n - WHOLE_BELOW) / PER < LAST ? FIRST + (n - WHOLE_BELOW) / PER : LAST;
    }
    const tm_status status = make(&c, condensed, interface, error);
    *coupling = c;
    return status;
}

void tms_coupling_destroy(tms_coupling *c) {
    tms_free(c->history);
    *c = (tms_coupling){0};
}

static void compute_whole(tms_coupling *c, const double *u_m, const double *u_prev_m) {
    const bool anew = c->age < 0 || c->changes >= CHANGES;
    for (int32_t i = 0; i < c->n; i++) {
        const double middle = 0.5 * (u_m[i] + u_prev_m[i]);
        c->change_m[i] = middle - c->whole_m[i];
        c->whole_m[i] = middle;
    }
    if (anew)
        tms_whole_force(c->schur, c->prescribed_N, c->whole_m, c->n, c->whole_N);
    else
        tms_whole_change(c->single, c->change_m, c->n, c->whole_N);
    c->changes = anew ? 0 : c->changes + 1;
    c->age = 0;
}

void tms_coupling_force(tms_coupling *c, const double *u_m, const double *u_prev_m, double *force_N) {
    if (c->every == 1) {
        tms_whole_force(c->schur, c->prescribed_N, u_m, c->n, force_N);
        return;
    }
    if (c->age < 0 || ++c->age >= c->every) compute_whole(c, u_m, u_prev_m);
    for (int32_t i = 0; i < c->n; i++) c->moved[i] = (float)(u_m[i] - c->whole_m[i]);
    tms_follow(c);
    for (int32_t i = 0; i < c->n; i++) force_N[i] = c->whole_N[i] - (double)c->answer[i];
}

double tms_coupling_steady(tms_coupling *c, double *steady_N) {
    double at_zero = 0;
    memcpy(steady_N, c->prescribed_N, 8 * (size_t)c->n);
    if (c->every == 1) return 0;
    for (int32_t i = 0; i < c->n; i++) c->moved[i] = (float)c->whole_m[i];
    tms_follow(c);
    for (int32_t i = 0; i < c->n; i++) {
        steady_N[i] = c->whole_N[i] + (double)c->answer[i];
        at_zero += 0.5 * c->whole_m[i] * (steady_N[i] - c->prescribed_N[i]);
    }
    return at_zero;
}

/* --- state --- */

void tms_coupling_forget(tms_coupling *c) {
    c->age = -1;
    c->changes = 0;
}

void tms_coupling_checkpoint(tms_coupling *c) {
    c->saved_age = c->age;
    c->saved_changes = c->changes;
    memcpy(c->saved_m, c->whole_m, 8 * (size_t)c->n);
    memcpy(c->saved_N, c->whole_N, 8 * (size_t)c->n);
}

void tms_coupling_rollback(tms_coupling *c) {
    c->age = c->saved_age;
    c->changes = c->saved_changes;
    memcpy(c->whole_m, c->saved_m, 8 * (size_t)c->n);
    memcpy(c->whole_N, c->saved_N, 8 * (size_t)c->n);
}

int64_t tms_coupling_snapshot(const tms_coupling *c, void *buffer) {
    const int32_t head[2] = {c->age, c->changes};
    const size_t bytes = 8 * (size_t)c->n;
    if (buffer) {
        char *to = memcpy(buffer, head, sizeof head);
        memcpy(to + sizeof head, c->whole_m, bytes);
        memcpy(to + sizeof head + bytes, c->whole_N, bytes);
    }
    return (int64_t)(sizeof head + 2 * bytes);
}

bool tms_coupling_restore(tms_coupling *c, const void *buffer, int64_t bytes, bool apply) {
    int32_t head[2];
    const char *whole = (const char *)buffer + sizeof head;
    if (bytes != tms_coupling_snapshot(c, NULL)) return false;
    memcpy(head, buffer, sizeof head);
    const size_t n = (size_t)c->n;
    const bool fits = head[0] >= -1 && head[0] < c->every && head[1] >= 0 && head[1] <= CHANGES &&
                      tms_are_below(whole, n, 1e6) && tms_are_below(whole + 8 * n, n, INFINITY);
    if (!fits || !apply) return fits;
    c->age = head[0];
    c->changes = head[1];
    memcpy(c->whole_m, whole, 8 * n);
    memcpy(c->whole_N, whole + 8 * n, 8 * n);
    return true;
}
