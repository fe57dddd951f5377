/* Conjugate gradients on edges, with the diagonal as preconditioner. The library's static solver is not used: it solves
 * elasticity, whose matrix contains the Laplacian only for a negative bulk modulus, which it refuses. */
#include "laplace.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "libtensormass/numeric/union_find.h"

#define LAW_REAL double
#include "libtensormass/numeric/vec.h"

typedef struct work {
    const tm_mesh *mesh;
    const uint8_t *low, *high;
    double *weight;                 /* [edge_count] off-diagonal entries, m */
    double *diagonal;               /* [vertex_count] */
    double *value, *rest, *way, *q; /* [vertex_count] */
} work;

static bool is_held(const work *w, int32_t v) { return w->low[v] || w->high[v]; }

/* Checks that each connected component has both ends; its potential is otherwise constant or undefined. */
static tm_status check_pieces(const tm_mesh *m, const uint8_t *low, const uint8_t *high, tm_error *error) {
    int32_t *parent = malloc((size_t)m->vertex_count * sizeof *parent);
    uint8_t *has = calloc((size_t)m->vertex_count, 1);
    tm_status status =
        parent && has ? TM_OK
                      : tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the rule's potential; use a coarser mesh");
    for (int32_t v = 0; v < m->vertex_count && !status; v++) parent[v] = v;
    for (int32_t e = 0; e < m->edge_count && !status; e++) law_join(parent, m->edge[2 * e], m->edge[2 * e + 1]);
    for (int32_t v = 0; v < m->vertex_count && !status; v++) has[law_root(parent, v)] |= low[v] ? 1 : high[v] ? 2 : 0;
    for (int32_t v = 0; v < m->vertex_count && !status; v++)
        if (has[law_root(parent, v)] != 3)
            status = tm_fail(
                error, TM_ERR_MESH, tm_mesh_original_vertex(m, v),
                "the connected piece with vertex %d has no vertex of group '%s'; name groups that every piece has",
                tm_mesh_original_vertex(m, v), has[law_root(parent, v)] & 1 ? "to" : "from");
    free(parent);
    free(has);
    return status;
}

static void assemble(work *w) {
    const tm_mesh *m = w->mesh;
    for (int32_t t = 0; t < m->tet_count; t++)
        for (int k = 0; k < 6; k++) {
            const double *a = m->shape_1_m + 12 * (int64_t)t + 3 * tm_edge_vertex[k][0],
                         *b = m->shape_1_m + 12 * (int64_t)t + 3 * tm_edge_vertex[k][1];
            w->weight[m->tet_edge[6 * (int64_t)t + k]] += m->volume_m3[t] * vdot(a, b);
        }
    for (int32_t e = 0; e < m->edge_count; e++) {
        w->diagonal[m->edge[2 * e]] -= w->weight[e];
        w->diagonal[m->edge[2 * e + 1]] -= w->weight[e];
    }
}

/* out := K x at free vertices, 0 where the potential is prescribed. */
static void apply(const work *w, const double *x, double *out) {
    const tm_mesh *m = w->mesh;
    memset(out, 0, (size_t)m->vertex_count * sizeof *out);
    for (int32_t e = 0; e < m->edge_count; e++) {
        const int32_t i = m->edge[2 * e], j = m->edge[2 * e + 1];
        const double flow = w->weight[e] * (x[j] - x[i]);
        out[i] += flow;
        out[j] -= flow;
    }
    for (int32_t v = 0; v < m->vertex_count; v++)
        if (is_held(w, v)) out[v] = 0;
}

/* Returns the square of the scaled residual: r . r / diagonal. */
static double measure(const work *w) {
    double sum = 0;
    for (int32_t v = 0; v < w->mesh->vertex_count; v++) sum += w->rest[v] * w->rest[v] / w->diagonal[v];
    return sum;
}

static tm_status solve(work *w, tm_error *error) {
    const int32_t n = w->mesh->vertex_count;
    const double tolerance = 1e-16; /* of the square */
    for (int32_t v = 0; v < n; v++) w->value[v] = w->high[v] && !w->low[v] ? 1 : 0;
    apply(w, w->value, w->rest);
    for (int32_t v = 0; v < n; v++) {
        w->rest[v] = -w->rest[v];
        w->way[v] = w->rest[v] / w->diagonal[v];
    }
    double now = measure(w);
    const double enough = tolerance * now;
    for (int32_t i = 0; i < n && now > enough; i++) {
        double bend = 0;
        apply(w, w->way, w->q);
        for (int32_t v = 0; v < n; v++) bend += w->way[v] * w->q[v];
        const double step = now / bend, before = now;
        for (int32_t v = 0; v < n; v++) {
            w->value[v] += step * w->way[v];
            w->rest[v] -= step * w->q[v];
        }
        now = measure(w);
        for (int32_t v = 0; v < n; v++) w->way[v] = w->rest[v] / w->diagonal[v] + now / before * w->way[v];
    }
    return now <= enough ? TM_OK
                         : tm_fail(error, TM_ERR_LIMIT, -1,
                                   "the rule's potential could not be computed; check the mesh (tm-mesh check)");
}

/* Adds the axis `a` to `sum`, with the sign that agrees with `sum`. */
static void add_axis(const double a[3], double sum[3]) {
    const double sign = vdot(a, sum) < 0 ? -1 : 1;
    for (int k = 0; k < 3; k++) sum[k] += sign * a[k];
}

static bool normalise(double v[3]) {
    const double length = vnorm(v);
    for (int k = 0; k < 3 && length > 0; k++) v[k] /= length;
    return length > 0;
}

/* Runs one pass over all tetrahedra (`only_empty`: those without an axis) from `from` into `to`. Returns how many still
 * have none. */
static int32_t pass(const tm_mesh *m, const double *from, double *to, bool only_empty) {
    int32_t empty = 0;
    for (int32_t t = 0; t < m->tet_count; t++) {
        const double *own = from + 3 * (int64_t)t;
        double sum[3] = {own[0], own[1], own[2]};
        for (int k = 0; k < 4 && !(only_empty && vdot(own, own) > 0); k++) {
            const int32_t other = m->tet_neighbour[4 * (int64_t)t + k];
            if (other >= 0) add_axis(from + 3 * (int64_t)other, sum);
        }
        empty += !normalise(sum);
        memcpy(to + 3 * (int64_t)t, sum, sizeof sum);
    }
    return empty;
}

bool sim_smooth_axes(const tm_mesh *mesh, int passes, double *fibre) {
    const size_t bytes = 3 * (size_t)mesh->tet_count * sizeof *fibre;
    double *from = passes ? malloc(bytes) : NULL;
    for (int i = 0; i < passes && from; i++) {
        memcpy(from, fibre, bytes);
        pass(mesh, from, fibre, false);
    }
    free(from);
    return from || !passes;
}

/* Computes the gradient in each tetrahedron; a gradient within rounding gives no direction. */
static bool take_gradient(const work *w, double *fibre) {
    const tm_mesh *m = w->mesh;
    for (int32_t t = 0; t < m->tet_count; t++) {
        double g[3] = {0, 0, 0}, spread = 0;
        for (int k = 0; k < 4; k++) {
            const double *a = m->shape_1_m + 12 * (int64_t)t + 3 * k, value = w->value[m->tet[4 * (int64_t)t + k]];
            spread = fmax(spread, fabs(value - w->value[m->tet[4 * (int64_t)t]]));
            for (int c = 0; c < 3; c++) g[c] += value * a[c];
        }
        if (spread < 1e-7 || !normalise(g)) memset(g, 0, sizeof g);
        memcpy(fibre + 3 * (int64_t)t, g, sizeof g);
    }
    double *from = malloc(3 * (size_t)m->tet_count * sizeof *from);
    int32_t empty = m->tet_count, before = empty + 1;
    for (; from && empty && empty < before;) {
        before = empty;
        memcpy(from, fibre, 3 * (size_t)m->tet_count * sizeof *from);
        empty = pass(m, from, fibre, true);
    }
    for (int32_t t = 0; t < m->tet_count; t++) /* a component's last corner, not reached across a face */
        if (!(vnorm(fibre + 3 * (int64_t)t) > 0)) fibre[3 * (int64_t)t + 2] = 1;
    free(from);
    return from;
}

tm_status sim_laplace(const tm_mesh *mesh, const uint8_t *low, const uint8_t *high, double *fibre, tm_error *error) {
    const size_t n = (size_t)mesh->vertex_count;
    tm_status status = check_pieces(mesh, low, high, error);
    if (status) return status;
    double *all = calloc((size_t)mesh->edge_count + 5 * n, sizeof *all);
    if (!all) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the rule's potential; use a coarser mesh");
    double *v = all + mesh->edge_count;
    work w = {mesh, low, high, all, v, v + n, v + 2 * n, v + 3 * n, v + 4 * n};
    assemble(&w);
    status = solve(&w, error);
    if (!status && !take_gradient(&w, fibre))
        status = tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the rule's fibres; use a coarser mesh");
    free(all);
    return status;
}
