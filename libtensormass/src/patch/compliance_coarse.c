/* Preconditioner for the conjugate gradients of compliance columns: inverse vertex tensors, and a coarse correction z
 * += P (P^T K P)^-1 P^T r, where P moves groups of neighbouring vertices as rigid bodies. Block-diagonal
 * preconditioning alone takes many iterations for the smooth part of a column, which reaches through the complete
 * organ. Together they are a symmetric preconditioner, and remain one if K has changed since: a cut needs no new
 * correction at once. */
#include "patch/patch_internal.h"
#include "tissue/tangent.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

enum { GROUPS_MAX = 40, MODES = 6, VERTICES_PER_GROUP = 8 };
/* A pivot below this share of its diagonal entry: a motion that K does not resist, or that other motions contain. */
static const double PIVOT_MIN = 1e-9;

struct tm_coarse {
    const double *rest_m;
    int32_t vertex_count, groups, n; /* n: unknowns, MODES * groups */
    int32_t *group;                  /* [vertex_count] */
    double *centre_m;                /* [3*groups] */
    double *L;                       /* [n*n] Cholesky factor, lower; a left out unknown has a zero on the diagonal */
    double *y;                       /* [n] */
};

/* Chooses centres, each farthest from those before, and assigns each vertex to the nearest. */
static void divide(tm_coarse *c, double *distance) {
    for (int32_t v = 0; v < c->vertex_count; v++) distance[v] = INFINITY;
    for (int32_t g = 0, next = 0; g < c->groups; g++) {
        const double *at = c->rest_m + 3 * next;
        double farthest = -1;
        vset(at, c->centre_m + 3 * g);
        for (int32_t v = 0; v < c->vertex_count; v++) {
            double d[3];
            vsub(c->rest_m + 3 * v, at, d);
            if (vdot(d, d) < distance[v]) {
                distance[v] = vdot(d, d);
                c->group[v] = g;
            }
            if (distance[v] > farthest) farthest = distance[v], next = v;
        }
    }
}

tm_coarse *tm_coarse_create(tm_pool *pool, const tm_mesh *mesh) {
    tm_coarse *c = TM_ALLOC(pool, tm_coarse, 1);
    if (!c) return NULL;
    c->rest_m = mesh->rest_m;
    c->vertex_count = mesh->vertex_count;
    c->groups = mesh->vertex_count / VERTICES_PER_GROUP;
    if (c->groups > GROUPS_MAX) c->groups = GROUPS_MAX;
    c->n = MODES * c->groups;
    c->group = TM_ALLOC(pool, int32_t, mesh->vertex_count);
    c->centre_m = TM_ALLOC(pool, double, 3 * (int64_t)GROUPS_MAX);
    c->L = TM_ALLOC(pool, double, (int64_t)c->n * c->n);
    c->y = TM_ALLOC(pool, double, c->n);
    double *distance = TM_ALLOC(pool, double, mesh->vertex_count);
    if (pool->failed) return NULL;
    divide(c, distance);
    return c;
}

/* Motions of a vertex by those of its group: u = t + w x (rest - centre), without fixed components. */
static void motions(const tm_coarse *c, const uint8_t *fixed, int32_t v, double R[3][MODES]) {
    double x[3];
    vsub(c->rest_m + 3 * v, c->centre_m + 3 * c->group[v], x);
    const double all[3][MODES] = {{1, 0, 0, 0, x[2], -x[1]}, {0, 1, 0, -x[2], 0, x[0]}, {0, 0, 1, x[1], -x[0], 0}};
    memcpy(R, all, sizeof all);
    for (int i = 0; i < 3; i++)
        if (fixed[3 * v + i]) memset(R[i], 0, sizeof R[i]);
}

/* Adds R_k^T K R_l to the rows of k's group, and for an edge its transpose to those of l's. */
static void add_block(tm_coarse *c, const uint8_t *fixed, int32_t k, int32_t l, const double K[9]) {
    double Rk[3][MODES], Rl[3][MODES], KR[3][MODES];
    motions(c, fixed, k, Rk);
    motions(c, fixed, l, Rl);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < MODES; j++)
            KR[i][j] = K[3 * i] * Rl[0][j] + K[3 * i + 1] * Rl[1][j] + K[3 * i + 2] * Rl[2][j];
    double *to = c->L + MODES * ((int64_t)c->n * c->group[k] + c->group[l]);
    double *back = c->L + MODES * ((int64_t)c->n * c->group[l] + c->group[k]);
    for (int i = 0; i < MODES; i++)
        for (int j = 0; j < MODES; j++) {
            const double sum = Rk[0][i] * KR[0][j] + Rk[1][i] * KR[1][j] + Rk[2][i] * KR[2][j];
            to[(int64_t)c->n * i + j] += sum;
            if (k != l) back[(int64_t)c->n * j + i] += sum;
        }
}

static double dot4(const double *a, const double *b, int32_t n) {
    double sum[4] = {0, 0, 0, 0};
    int32_t i = 0;
    for (; i + 4 <= n; i += 4)
        for (int k = 0; k < 4; k++) sum[k] += a[i + k] * b[i + k];
    for (; i < n; i++) sum[0] += a[i] * b[i];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

static void factor(tm_coarse *c) {
    const int32_t n = c->n;
    for (int32_t i = 0; i < n; i++) {
        double *row = c->L + (int64_t)n * i;
        const double diagonal = row[i];
        for (int32_t j = 0; j < i; j++) {
            const double *other = c->L + (int64_t)n * j;
            row[j] = other[j] > 0 ? (row[j] - dot4(row, other, j)) / other[j] : 0;
        }
        const double pivot = diagonal - dot4(row, row, i);
        row[i] = pivot > PIVOT_MIN * diagonal ? sqrt(pivot) : 0;
    }
}

void tm_coarse_refresh(tm_coarse *c, const tm_force_graph *graph, const uint8_t *fixed) {
    memset(c->L, 0, sizeof(double) * (size_t)c->n * (size_t)c->n);
    for (int32_t begin, end = 0; tm_next_run(graph->active, c->vertex_count, &begin, &end);)
        for (int32_t k = begin; k < end; k++) {
            add_block(c, fixed, k, k, graph->vertex_tensor + 9 * (int64_t)k);
            for (int32_t e = graph->upper_begin[k]; e < graph->upper_end[k]; e++) {
                double K[9];
                tm_edge_read(graph, e, K);
                add_block(c, fixed, k, graph->upper_vertex[e], K);
            }
        }
    factor(c);
}

/* Solves L L^T y = y. */
static void solve(const tm_coarse *c) {
    const int32_t n = c->n;
    double *y = c->y;
    for (int32_t i = 0; i < n; i++) {
        const double *row = c->L + (int64_t)n * i;
        y[i] = row[i] > 0 ? (y[i] - dot4(row, y, i)) / row[i] : 0;
    }
    for (int32_t i = n - 1; i >= 0; i--) {
        const double *row = c->L + (int64_t)n * i;
        if (!(row[i] > 0)) continue;
        y[i] /= row[i];
        for (int32_t j = 0; j < i; j++) y[j] -= row[j] * y[i];
    }
}

/* Adds the correction for the residual r, which is zero at fixed components, to z. */
static void correct(tm_coarse *c, const uint8_t *fixed, const double *r, double *z) {
    memset(c->y, 0, sizeof(double) * (size_t)c->n);
    for (int32_t v = 0; v < c->vertex_count; v++) {
        double x[3], turn[3], *y = c->y + MODES * c->group[v];
        vsub(c->rest_m + 3 * v, c->centre_m + 3 * c->group[v], x);
        vcross(x, r + 3 * v, turn);
        for (int i = 0; i < 3; i++) y[i] += r[3 * v + i], y[3 + i] += turn[i];
    }
    solve(c);
    for (int32_t v = 0; v < c->vertex_count; v++) {
        double x[3], turn[3];
        const double *y = c->y + MODES * c->group[v];
        vsub(c->rest_m + 3 * v, c->centre_m + 3 * c->group[v], x);
        vcross(y + 3, x, turn);
        for (int i = 0; i < 3; i++)
            if (!fixed[3 * v + i]) z[3 * v + i] += y[i] + turn[i];
    }
}

void tm_vertex_inverse(const double tensor[9], const uint8_t fixed[3], double inverse[9]) {
    double K[9], minor[9];
    memcpy(K, tensor, sizeof K);
    memset(inverse, 0, 9 * sizeof *inverse);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            if (fixed[i] || fixed[j]) K[3 * i + j] = i == j;
    for (int i = 0; i < 3; i++) vcross(K + 3 * ((i + 1) % 3), K + 3 * ((i + 2) % 3), minor + 3 * i);
    const double det = vdot(K, minor);
    for (int i = 0; i < 9; i++)
        if (det > 0 && !fixed[i / 3] && !fixed[i % 3]) inverse[i] = minor[3 * (i % 3) + i / 3] / det;
}

void tm_precondition(tm_coarse *c, const double *inverse, const uint8_t *fixed, const double *r, double *z) {
    for (int32_t v = 0; v < c->vertex_count; v++)
        for (int i = 0; i < 3; i++) z[3 * v + i] = vdot(inverse + 9 * (int64_t)v + 3 * i, r + 3 * v);
    correct(c, fixed, r, z);
}
