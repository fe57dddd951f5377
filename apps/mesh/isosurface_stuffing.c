/* Isosurface stuffing (Labelle and Shewchuk 2007). Moves points of a body-centred cubic lattice near the surface onto
 * it, and trims the tetrahedra that the surface still cuts. Interior tetrahedra are congruent and as regular as the
 * lattice allows. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mesh_builder.h"

/* A lattice with points in half cells: all even is a cell's corner, all odd its centre. */
typedef struct lattice {
    int n[3]; /* half cells along each axis */
    double low[3], half;
    double *position; /* moved */
    double *value;    /* > 0 inside, 0 on the surface */
    int *vertex;      /* vertex of the mesh, -1: none yet */
} lattice;

/* Returns the index of a lattice point. */
static size_t at(const lattice *l, const int i[3]) {
    return ((size_t)i[2] * (size_t)l->n[1] + (size_t)i[1]) * (size_t)l->n[0] + (size_t)i[0];
}

/* Returns whether i is a point of the lattice: within it, and all coordinates even or all odd. */
static bool is_point(const lattice *l, const int i[3]) {
    for (int k = 0; k < 3; k++)
        if (i[k] < 0 || i[k] >= l->n[k] || ((i[k] ^ i[0]) & 1)) return false;
    return true;
}

/* Finds where the segment from `in` (inside the body) to `out` crosses the surface, by bisection. */
static void cut_point(const growing_solid *body, const double *in, const double *out, double p[3]) {
    double low = 0, high = 1;
    for (int step = 0; step < 50; step++) {
        double middle = 0.5 * (low + high);
        for (int k = 0; k < 3; k++) p[k] = in[k] + middle * (out[k] - in[k]);
        if (body->inside(body->shape, p) > 0)
            low = middle;
        else
            high = middle;
    }
}

/* The 14 neighbours: 6 along the axes (long edges), 8 along the diagonals (short ones). */
static const int neighbour[14][3] = {{2, 0, 0},  {-2, 0, 0},  {0, 2, 0},   {0, -2, 0},  {0, 0, 2},
                                     {0, 0, -2}, {1, 1, 1},   {1, 1, -1},  {1, -1, 1},  {1, -1, -1},
                                     {-1, 1, 1}, {-1, 1, -1}, {-1, -1, 1}, {-1, -1, -1}};

/* Moves a point close to the surface onto it, by the shortest way along an edge. */
static void pull(lattice *l, const growing_solid *body, const int i[3]) {
    size_t me = at(l, i);
    double best = 1e300, target[3] = {0, 0, 0};
    if (l->value[me] == 0) return;
    for (int e = 0; e < 14; e++) {
        int j[3] = {i[0] + neighbour[e][0], i[1] + neighbour[e][1], i[2] + neighbour[e][2]};
        if (!is_point(l, j) || l->value[at(l, j)] * l->value[me] >= 0) continue;
        const double *a = l->position + 3 * me, *b = l->position + 3 * at(l, j);
        double p[3], travel = 0, length = 0;
        cut_point(body, l->value[me] > 0 ? a : b, l->value[me] > 0 ? b : a, p);
        for (int k = 0; k < 3; k++) {
            travel += (p[k] - a[k]) * (p[k] - a[k]);
            length += (b[k] - a[k]) * (b[k] - a[k]);
        }
        double limit = e < 6 ? 0.24999 : 0.41189; /* of Labelle and Shewchuk, table 2 */
        if (travel < limit * limit * length && travel < best) {
            best = travel;
            memcpy(target, p, sizeof target);
        }
    }
    if (best == 1e300) return;
    memcpy(l->position + 3 * me, target, sizeof target);
    l->value[me] = 0;
}

typedef struct cut {
    size_t a, b; /* lattice points, a < b */
    int vertex, next;
} cut;

typedef struct builder {
    growing *m;
    lattice *l;
    const growing_solid *body;
    cut *cuts;
    int cut_count, cut_capacity, *bucket, buckets;
} builder;

/* Returns the mesh vertex of a lattice point, and adds it at the first use. */
static int lattice_vertex(builder *b, size_t p) {
    if (b->l->vertex[p] < 0) b->l->vertex[p] = growing_add_vertex(b->m, b->l->position + 3 * p);
    return b->l->vertex[p];
}

/* Returns the mesh vertex where a lattice edge crosses the surface: one for all tetrahedra around the edge. -1: no
 * memory. */
static int cut_vertex(builder *b, size_t in, size_t out) {
    size_t low = in < out ? in : out, high = in < out ? out : in;
    int *slot = &b->bucket[(low * 31 + high * 17) % (size_t)b->buckets];
    for (int i = *slot; i >= 0; i = b->cuts[i].next)
        if (b->cuts[i].a == low && b->cuts[i].b == high) return b->cuts[i].vertex;
    if (b->cut_count == b->cut_capacity) {
        int room = b->cut_capacity ? 2 * b->cut_capacity : 1024;
        cut *grown = realloc(b->cuts, (size_t)room * sizeof *grown);
        if (!grown) b->m->no_memory = true;
        if (!grown) return -1;
        b->cuts = grown;
        b->cut_capacity = room;
    }
    double p[3];
    cut_point(b->body, b->l->position + 3 * in, b->l->position + 3 * out, p);
    b->cuts[b->cut_count] = (cut){low, high, growing_add_vertex(b->m, p), *slot};
    *slot = b->cut_count;
    return b->cuts[b->cut_count++].vertex;
}

/* Adds a prism a0 a1 a2 - b0 b1 b2 as three tetrahedra. Side diagonals start from a0 before a1 before a2, so they never
 * form a cycle. */
static void add_prism(growing *m, const int a[3], const int b[3]) {
    growing_add_tet(m, a[0], b[0], b[1], b[2]);
    growing_add_tet(m, a[0], a[1], b[1], b[2]);
    growing_add_tet(m, a[0], a[1], a[2], b[2]);
}

/* Adds the part of a lattice tetrahedron inside the body. Quadrilaterals are split from their deeper point: the shorter
 * diagonal, and equal on both sides. */
static void trim(builder *b, const size_t corner[4]) {
    size_t plus[4], minus[4], zero[4];
    int p = 0, n = 0, z = 0;
    for (int i = 0; i < 4; i++) {
        double value = b->l->value[corner[i]];
        if (value > 0)
            plus[p++] = corner[i];
        else if (value < 0)
            minus[n++] = corner[i];
        else
            zero[z++] = corner[i];
    }
    if (p == 0) return;
    for (int pass = 0; pass < 2; pass++) /* deepest first */
        for (int i = 0; i + 1 < p; i++) {
            double d = b->l->value[plus[i + 1]] - b->l->value[plus[i]];
            if (d > 0 || (d == 0 && plus[i + 1] < plus[i])) {
                size_t spare = plus[i];
                plus[i] = plus[i + 1];
                plus[i + 1] = spare;
            }
        }
    int v[4], c[4], k = 0;
    for (int i = 0; i < p; i++) v[i] = lattice_vertex(b, plus[i]);
    if (n == 0 || p == 1) { /* all of it, or one corner */
        for (int i = 0; i < p; i++) c[k++] = v[i];
        for (int i = 0; i < z; i++) c[k++] = lattice_vertex(b, zero[i]);
        for (int i = 0; i < n; i++) c[k++] = cut_vertex(b, plus[0], minus[i]);
        growing_add_tet(b->m, c[0], c[1], c[2], c[3]);
    } else if (p == 3) {
        for (int i = 0; i < 3; i++) c[i] = cut_vertex(b, plus[i], minus[0]);
        add_prism(b->m, v, c);
    } else if (n == 1) { /* a pyramid over v0 v1 c1 c0 */
        int apex = lattice_vertex(b, zero[0]), c0 = cut_vertex(b, plus[0], minus[0]),
            c1 = cut_vertex(b, plus[1], minus[0]);
        growing_add_tet(b->m, apex, v[0], v[1], c1);
        growing_add_tet(b->m, apex, v[0], c1, c0);
    } else { /* a wedge between the triangles of v0 and of v1 */
        int c00 = cut_vertex(b, plus[0], minus[0]), c01 = cut_vertex(b, plus[0], minus[1]);
        int c10 = cut_vertex(b, plus[1], minus[0]), c11 = cut_vertex(b, plus[1], minus[1]);
        growing_add_tet(b->m, v[0], v[1], c10, c11);
        growing_add_tet(b->m, v[0], c00, c10, c11);
        growing_add_tet(b->m, v[0], c00, c01, c11);
    }
}

/* Adds the four tetrahedra around the long edge from centre `i` along `axis`, each with one edge of the square between
 * the two cells. */
static void trim_around(builder *b, const int i[3], int axis) {
    int j[3] = {i[0], i[1], i[2]}, u = (axis + 1) % 3, w = (axis + 2) % 3;
    static const int square[5][2] = {{-1, -1}, {1, -1}, {1, 1}, {-1, 1}, {-1, -1}};
    j[axis] += 2;
    if (!is_point(b->l, j)) return;
    for (int e = 0; e < 4; e++) {
        size_t corner[4] = {at(b->l, i), at(b->l, j), 0, 0};
        bool there = true;
        for (int s = 0; s < 2; s++) {
            int q[3];
            q[axis] = i[axis] + 1;
            q[u] = i[u] + square[e + s][0];
            q[w] = i[w] + square[e + s][1];
            there = there && is_point(b->l, q);
            if (there) corner[2 + s] = at(b->l, q);
        }
        if (there) trim(b, corner);
    }
}

/* Visits every point of the lattice: computes values, then moves points, then trims. */
static void sweep(builder *b, int job) {
    lattice *l = b->l;
    int i[3];
    for (i[2] = 0; i[2] < l->n[2]; i[2]++)
        for (i[1] = 0; i[1] < l->n[1]; i[1]++)
            for (i[0] = 0; i[0] < l->n[0]; i[0]++) {
                if (!is_point(l, i)) continue;
                size_t p = at(l, i);
                if (job == 0) {
                    for (int k = 0; k < 3; k++) l->position[3 * p + (size_t)k] = l->low[k] + l->half * i[k];
                    l->value[p] = b->body->inside(b->body->shape, l->position + 3 * p);
                } else if (job == 1) {
                    pull(l, b->body, i);
                } else if (i[0] & 1) {
                    for (int axis = 0; axis < 3; axis++) trim_around(b, i, axis);
                }
            }
}

void growing_fill(growing *m, const growing_solid *body, double a) {
    lattice l = {.half = 0.5 * a};
    size_t points = 1;
    for (int k = 0; k < 3; k++) {
        l.low[k] = body->low[k] - a;
        l.n[k] = (int)((body->high[k] - body->low[k]) / l.half) + 6;
        points *= (size_t)l.n[k];
    }
    l.position = malloc(3 * points * sizeof *l.position);
    l.value = malloc(points * sizeof *l.value);
    l.vertex = malloc(points * sizeof *l.vertex);
    builder b = {.m = m, .l = &l, .body = body, .buckets = 65536};
    b.bucket = malloc((size_t)b.buckets * sizeof *b.bucket);
    if (l.position && l.value && l.vertex && b.bucket) {
        memset(b.bucket, -1, (size_t)b.buckets * sizeof *b.bucket);
        memset(l.vertex, -1, points * sizeof *l.vertex);
        for (int job = 0; job < 3; job++) sweep(&b, job);
    } else
        m->no_memory = true;
    free(l.position);
    free(l.value);
    free(l.vertex);
    free(b.bucket);
    free(b.cuts);
}
