/* A growing mesh, its surface, its measure. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "growing.h"

static void *grow(void *array, size_t bytes) {
    void *grown = realloc(array, bytes);
    if (!grown) {
        fprintf(stderr, "no memory\n");
        exit(1);
    }
    return grown;
}

int add_vertex(mesh *m, const double p[3]) {
    if (m->vertex_count == m->vertex_room) {
        m->vertex_room = m->vertex_room ? 2 * m->vertex_room : 1024;
        m->vertex = grow(m->vertex, 3 * (size_t)m->vertex_room * sizeof *m->vertex);
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

void add_tet(mesh *m, int a, int b, int c, int d) {
    if (m->tet_count == m->tet_room) {
        m->tet_room = m->tet_room ? 2 * m->tet_room : 1024;
        m->tet = grow(m->tet, 4 * (size_t)m->tet_room * sizeof *m->tet);
        m->region = grow(m->region, (size_t)m->tet_room * sizeof *m->region);
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

void free_mesh(mesh *m) {
    free(m->vertex);
    free(m->tet);
    free(m->region);
    free(m->fibre);
    free(m->face);
    free(m->face_group);
    *m = (mesh){0};
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

void face_normal(const mesh *m, const int f[3], double n[3]) {
    const double *a = m->vertex + 3 * (size_t)f[0], *b = m->vertex + 3 * (size_t)f[1],
                 *c = m->vertex + 3 * (size_t)f[2];
    for (int k = 0; k < 3; k++) {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        n[k] = (b[i] - a[i]) * (c[j] - a[j]) - (b[j] - a[j]) * (c[i] - a[i]);
    }
    double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    for (int k = 0; k < 3; k++) n[k] /= length;
}

double tet_size(const double *a, const double *b, const double *c, const double *d) {
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

/* Every directed edge once, its opposite once, and one fan of triangles around each vertex. */
static bool closed_manifold(const mesh *m) {
    size_t n = 3 * (size_t)m->face_count;
    edge *e = grow(NULL, (n + 1) * sizeof *e);
    int *fan = grow(NULL, ((size_t)m->vertex_count + 1) * sizeof *fan);
    for (size_t i = 0; i < n; i++) e[i] = (edge){m->face[i], m->face[i % 3 == 2 ? i - 2 : i + 1]};
    qsort(e, n, sizeof *e, by_ends);
    bool good = true;
    for (size_t i = 0; i < n && good; i++) {
        edge back = {e[i].to, e[i].from};
        good = (i == 0 || by_ends(&e[i], &e[i - 1]) != 0) && bsearch(&back, e, n, sizeof *e, by_ends) != NULL;
    }
    /* Turn once around each vertex from its first triangle: the turn must meet all of its triangles. */
    int *count = grow(NULL, ((size_t)m->vertex_count + 1) * sizeof *count);
    for (int v = 0; v < m->vertex_count; v++) fan[v] = -1, count[v] = 0;
    for (size_t i = 0; i < n; i++) {
        count[m->face[i]]++;
        fan[m->face[i]] = (int)i;
    }
    int *corner = grow(NULL, (n + 1) * sizeof *corner); /* of the sorted edge: where in `face` it starts */
    for (size_t i = 0; good && i < n; i++) {
        edge key = {m->face[i], m->face[i % 3 == 2 ? i - 2 : i + 1]};
        corner[(edge *)bsearch(&key, e, n, sizeof *e, by_ends) - e] = (int)i;
    }
    for (int v = 0; good && v < m->vertex_count; v++) {
        if (fan[v] < 0) continue;
        int turns = 0, at = fan[v];
        do {
            int previous =
                m->face[at % 3 == 0 ? at + 2
                                    : at - 1]; /* edge previous -> v; its opposite v -> previous starts the neighbour */
            edge key = {v, previous};
            at = corner[(edge *)bsearch(&key, e, n, sizeof *e, by_ends) - e];
            turns++;
        } while (at != fan[v] && turns <= count[v]);
        good = turns == count[v];
    }
    free(e);
    free(fan);
    free(corner);
    free(count);
    return good;
}

bool find_surface(mesh *m) {
    static const int opposite[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
    size_t n = 4 * (size_t)m->tet_count;
    side *s = grow(NULL, (n + 1) * sizeof *s);
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
    m->face = grow(m->face, 3 * (n + 1) * sizeof *m->face);
    m->face_group = grow(m->face_group, (n + 1) * sizeof *m->face_group);
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
