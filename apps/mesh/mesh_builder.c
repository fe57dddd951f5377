/* Adds vertices and tetrahedra to a growing mesh; computes its surface and sizes. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mesh_builder.h"

/* Enlarges an array. If memory is exhausted, returns null and sets no_memory; `array` stays valid. */
static void *grow(growing *m, void *array, size_t bytes) {
    void *grown = m->no_memory ? NULL : realloc(array, bytes);
    if (!grown) m->no_memory = true;
    return grown;
}

int growing_add_vertex(growing *m, const double p[3]) {
    if (m->vertex_count == m->vertex_capacity) {
        int room = m->vertex_capacity ? 2 * m->vertex_capacity : 1024;
        double *grown = grow(m, m->vertex, 3 * (size_t)room * sizeof *grown);
        if (!grown) return -1;
        m->vertex = grown;
        m->vertex_capacity = room;
    }
    memcpy(m->vertex + 3 * (size_t)m->vertex_count, p, 3 * sizeof *p);
    return m->vertex_count++;
}

static double volume6(const double *a, const double *b, const double *c, const double *d) {
    double u[3], v[3], w[3];
    for (int i = 0; i < 3; i++) {
        u[i] = b[i] - a[i];
        v[i] = c[i] - a[i];
        w[i] = d[i] - a[i];
    }
    return (u[1] * v[2] - u[2] * v[1]) * w[0] + (u[2] * v[0] - u[0] * v[2]) * w[1] + (u[0] * v[1] - u[1] * v[0]) * w[2];
}

void growing_add_tet(growing *m, int a, int b, int c, int d) {
    if (a < 0 || b < 0 || c < 0 || d < 0) return;
    if (m->tet_count == m->tet_capacity) {
        int room = m->tet_capacity ? 2 * m->tet_capacity : 1024;
        int *tets = grow(m, m->tet, 4 * (size_t)room * sizeof *tets);
        if (tets) m->tet = tets;
        int *regions = grow(m, m->region, (size_t)room * sizeof *regions);
        if (!regions) return;
        m->region = regions;
        m->tet_capacity = room;
    }
    const double *x = m->vertex;
    bool swap = volume6(x + 3 * a, x + 3 * b, x + 3 * c, x + 3 * d) < 0;
    int *t = m->tet + 4 * (size_t)m->tet_count;
    t[0] = a;
    t[1] = b;
    t[2] = swap ? d : c;
    t[3] = swap ? c : d;
    m->region[m->tet_count++] = 0;
}

void growing_free(growing *m) {
    free(m->vertex);
    free(m->tet);
    free(m->region);
    free(m->fibre);
    free(m->face);
    free(m->face_group);
    *m = (growing){0};
}

static double area2_squared(const double *a, const double *b, const double *c) {
    double u[3], v[3];
    for (int i = 0; i < 3; i++) {
        u[i] = b[i] - a[i];
        v[i] = c[i] - a[i];
    }
    double x = u[1] * v[2] - u[2] * v[1], y = u[2] * v[0] - u[0] * v[2], z = u[0] * v[1] - u[1] * v[0];
    return x * x + y * y + z * z;
}

void growing_face_normal(const growing *m, const int f[3], double n[3]) {
    const double *a = m->vertex + 3 * (size_t)f[0], *b = m->vertex + 3 * (size_t)f[1],
                 *c = m->vertex + 3 * (size_t)f[2];
    for (int k = 0; k < 3; k++) {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        n[k] = (b[i] - a[i]) * (c[j] - a[j]) - (b[j] - a[j]) * (c[i] - a[i]);
    }
    double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    for (int k = 0; k < 3; k++) n[k] /= length;
}

double growing_tet_size(const double *a, const double *b, const double *c, const double *d) {
    double areas = area2_squared(b, c, d) + area2_squared(a, c, d) + area2_squared(a, b, d) + area2_squared(a, b, c);
    return volume6(a, b, c, d) / sqrt(areas); /* altitude = 6V / 2A */
}

typedef struct side {
    int sorted[3], as_is[3], tet;
} side;

static int by_vertices(const void *a, const void *b) {
    const side *x = a, *y = b;
    for (int i = 0; i < 3; i++)
        if (x->sorted[i] != y->sorted[i]) return x->sorted[i] < y->sorted[i] ? -1 : 1;
    return x->tet < y->tet ? -1 : x->tet > y->tet;
}

typedef struct edge {
    int from, to;
} edge;

static int by_ends(const void *a, const void *b) {
    const edge *x = a, *y = b;
    return x->from != y->from ? (x->from < y->from ? -1 : 1) : (x->to < y->to ? -1 : x->to > y->to);
}

static bool find_edges(const growing *m, edge *e, size_t n) {
    for (size_t i = 0; i < n; i++) e[i] = (edge){m->face[i], m->face[i % 3 == 2 ? i - 2 : i + 1]};
    qsort(e, n, sizeof *e, by_ends);
    for (size_t i = 0; i < n; i++) {
        edge back = {e[i].to, e[i].from};
        if (i && by_ends(&e[i], &e[i - 1]) == 0) return false;
        if (!bsearch(&back, e, n, sizeof *e, by_ends)) return false;
    }
    return true;
}

/* Walks once around each vertex from its first triangle; the walk must visit all of its triangles. */
static bool turns_meet_all(const growing *m, const edge *e, size_t n, int *fan, int *count, int *corner) {
    for (int v = 0; v < m->vertex_count; v++) fan[v] = -1, count[v] = 0;
    for (size_t i = 0; i < n; i++) {
        count[m->face[i]]++;
        fan[m->face[i]] = (int)i;
    }
    for (size_t i = 0; i < n; i++) {
        edge key = {m->face[i], m->face[i % 3 == 2 ? i - 2 : i + 1]};
        corner[(edge *)bsearch(&key, e, n, sizeof *e, by_ends) - e] = (int)i;
    }
    for (int v = 0; v < m->vertex_count; v++) {
        if (fan[v] < 0) continue;
        int turns = 0, at = fan[v];
        do {
            /* edge previous -> v; its opposite v -> previous starts the neighbour */
            int previous = m->face[at % 3 == 0 ? at + 2 : at - 1];
            edge key = {v, previous};
            at = corner[(edge *)bsearch(&key, e, n, sizeof *e, by_ends) - e];
            turns++;
        } while (at != fan[v] && turns <= count[v]);
        if (turns != count[v]) return false;
    }
    return true;
}

/* Returns whether every directed edge and its opposite occur once, with one fan of triangles around each vertex. */
static bool closed_manifold(growing *m) {
    size_t n = 3 * (size_t)m->face_count;
    edge *e = grow(m, NULL, (n + 1) * sizeof *e);
    int *fan = grow(m, NULL, ((size_t)m->vertex_count + 1) * sizeof *fan);
    int *count = grow(m, NULL, ((size_t)m->vertex_count + 1) * sizeof *count);
    int *corner = grow(m, NULL, (n + 1) * sizeof *corner); /* start of the sorted edge in `face` */
    bool good = !m->no_memory && find_edges(m, e, n) && turns_meet_all(m, e, n, fan, count, corner);
    free(e);
    free(fan);
    free(corner);
    free(count);
    return good;
}

bool growing_find_surface(growing *m) {
    static const int opposite[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
    size_t n = 4 * (size_t)m->tet_count;
    side *s = grow(m, NULL, (n + 1) * sizeof *s);
    int *face = grow(m, m->face, 3 * (n + 1) * sizeof *face);
    if (face) m->face = face;
    int *group = grow(m, m->face_group, (n + 1) * sizeof *group);
    if (group) m->face_group = group;
    if (!group) {
        free(s);
        return false;
    }
    for (size_t f = 0; f < n; f++) {
        const int *t = m->tet + f / 4 * 4;
        for (int i = 0; i < 3; i++) s[f].as_is[i] = s[f].sorted[i] = t[opposite[f % 4][i]];
        s[f].tet = (int)(f / 4);
        int *v = s[f].sorted, spare;
        for (int pass = 0; pass < 2; pass++)
            for (int i = 0; i < 2; i++)
                if (v[i] > v[i + 1]) spare = v[i], v[i] = v[i + 1], v[i + 1] = spare;
    }
    qsort(s, n, sizeof *s, by_vertices);
    m->face_count = 0;
    for (size_t f = 0; f < n; f++) {
        bool before = f && memcmp(s[f].sorted, s[f - 1].sorted, sizeof s[f].sorted) == 0;
        bool after = f + 1 < n && memcmp(s[f].sorted, s[f + 1].sorted, sizeof s[f].sorted) == 0;
        if (before || after) continue;
        memcpy(m->face + 3 * (size_t)m->face_count, s[f].as_is, sizeof s[f].as_is);
        m->face_group[m->face_count++] = 0;
    }
    free(s);
    return closed_manifold(m);
}
