/* Longest-edge bisection (Rivara): halves an edge only if it is the longest of every tetrahedron around it. The mesh
 * stays conformal, and shapes do not degrade with repeated halving. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mesh_builder.h"

typedef struct bag {
    int *item, count, capacity;
} bag;

typedef struct work {
    growing *m;
    bag *around; /* tetrahedra of each vertex, unordered */
    int vertex_capacity, *parent, parent_capacity, *midpoint, first_new;
} work;

static bool put(bag *b, int item) {
    if (b->count == b->capacity) {
        int room = b->capacity ? 2 * b->capacity : 8, *grown = realloc(b->item, (size_t)room * sizeof *grown);
        if (!grown) return false;
        b->item = grown;
        b->capacity = room;
    }
    b->item[b->count++] = item;
    return true;
}

static void take(bag *b, int item) {
    for (int i = 0; i < b->count; i++)
        if (b->item[i] == item) {
            b->item[i] = b->item[--b->count];
            return;
        }
}

typedef struct edge {
    int a, b; /* a < b */
    double square;
} edge;

static bool longer(const edge *x, const edge *y) {
    if (x->square != y->square) return x->square > y->square;
    return x->a != y->a ? x->a < y->a : x->b < y->b;
}

static edge longest_edge(const growing *m, int tet) {
    const int *v = m->tet + 4 * (size_t)tet;
    edge best = {-1, -1, -1};
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < i; j++) {
            edge e = {v[i] < v[j] ? v[i] : v[j], v[i] < v[j] ? v[j] : v[i], 0};
            const double *p = m->vertex + 3 * (size_t)e.a, *q = m->vertex + 3 * (size_t)e.b;
            for (int k = 0; k < 3; k++) e.square += (p[k] - q[k]) * (p[k] - q[k]);
            if (best.a < 0 || longer(&e, &best)) best = e;
        }
    return best;
}

double growing_longest_edge_m(const growing *m, int tet) { return sqrt(longest_edge(m, tet).square); }

static int corner_of(const growing *m, int tet, int vertex) {
    for (int k = 0; k < 4; k++)
        if (m->tet[4 * (size_t)tet + (size_t)k] == vertex) return k;
    return -1;
}

static int new_vertex(work *w, const edge *e) {
    double p[3];
    const double *a = w->m->vertex + 3 * (size_t)e->a, *b = w->m->vertex + 3 * (size_t)e->b;
    for (int k = 0; k < 3; k++) p[k] = 0.5 * (a[k] + b[k]);
    int v = growing_add_vertex(w->m, p);
    if (v < 0) return -1;
    if (v >= w->vertex_capacity) {
        int room = 2 * w->vertex_capacity;
        bag *bags = realloc(w->around, (size_t)room * sizeof *bags);
        if (bags) w->around = bags;
        int *ends = realloc(w->midpoint, 2 * (size_t)room * sizeof *ends);
        if (ends) w->midpoint = ends;
        if (!bags || !ends) return -1;
        memset(w->around + w->vertex_capacity, 0, (size_t)(room - w->vertex_capacity) * sizeof *bags);
        w->vertex_capacity = room;
    }
    w->midpoint[2 * (v - w->first_new)] = e->a;
    w->midpoint[2 * (v - w->first_new) + 1] = e->b;
    return v;
}

/* Halves a tetrahedron: it keeps the half at e.a, a new one gets the half at e.b. Both inherit orientation, region and
 * parent. */
static bool halve(work *w, int tet, const edge *e, int middle) {
    growing *m = w->m;
    int v[4];
    memcpy(v, m->tet + 4 * (size_t)tet, sizeof v);
    int at_a = corner_of(m, tet, e->a), at_b = corner_of(m, tet, e->b), fresh = m->tet_count;
    m->tet[4 * (size_t)tet + (size_t)at_b] = middle;
    v[at_a] = middle;
    growing_add_tet(m, v[0], v[1], v[2], v[3]);
    if (m->no_memory) return false;
    memcpy(m->tet + 4 * (size_t)fresh, v, sizeof v);
    m->region[fresh] = m->region[tet];
    if (fresh >= w->parent_capacity) {
        int *grown = realloc(w->parent, 2 * (size_t)w->parent_capacity * sizeof *grown);
        if (!grown) return false;
        w->parent = grown;
        w->parent_capacity *= 2;
    }
    w->parent[fresh] = w->parent[tet];
    take(&w->around[e->b], tet);
    if (!put(&w->around[middle], tet)) return false;
    for (int k = 0; k < 4; k++)
        if (!put(&w->around[v[k]], fresh)) return false;
    return true;
}

/* Halves the longest edge at the end of the path of ever longer edges from `tet`. */
static bool halve_near(work *w, int tet) {
    edge e = longest_edge(w->m, tet);
    const bag *near;
    for (bool climbing = true; climbing;) {
        climbing = false;
        near = &w->around[e.a];
        for (int i = 0; i < near->count && !climbing; i++) {
            if (corner_of(w->m, near->item[i], e.b) < 0) continue;
            edge other = longest_edge(w->m, near->item[i]);
            if (longer(&other, &e)) {
                e = other;
                climbing = true;
            }
        }
    }
    bag ring = {0};
    bool good = true;
    for (int i = 0; i < near->count && good; i++)
        if (corner_of(w->m, near->item[i], e.b) >= 0) good = put(&ring, near->item[i]);
    int middle = good ? new_vertex(w, &e) : -1;
    for (int i = 0; i < ring.count && good; i++) good = middle >= 0 && halve(w, ring.item[i], &e, middle);
    free(ring.item);
    return good && middle >= 0;
}

static bool start(work *w) {
    growing *m = w->m;
    w->first_new = m->vertex_count;
    w->vertex_capacity = 2 * m->vertex_count + 16;
    w->parent_capacity = 2 * m->tet_count + 16;
    w->around = calloc((size_t)w->vertex_capacity, sizeof *w->around);
    w->parent = malloc((size_t)w->parent_capacity * sizeof *w->parent);
    w->midpoint = malloc(2 * (size_t)w->vertex_capacity * sizeof *w->midpoint);
    if (!w->around || !w->parent || !w->midpoint) return false;
    for (int t = 0; t < m->tet_count; t++) {
        w->parent[t] = t;
        for (int k = 0; k < 4; k++)
            if (!put(&w->around[m->tet[4 * (size_t)t + (size_t)k]], t)) return false;
    }
    return true;
}

bool growing_bisect(growing *m, growing_wanted_fn *wanted, const void *context, int limit, int **parent,
                    int **midpoint) {
    work w = {.m = m};
    bool good = start(&w);
    for (int t = 0; good && t < m->tet_count; t++) /* new halves are appended, so the loop reaches them later */
        while (good) {
            if (!wanted(m, t, growing_longest_edge_m(m, t), context)) break;
            good = m->tet_count < limit && halve_near(&w, t);
        }
    for (int v = 0; w.around && v < w.vertex_capacity; v++) free(w.around[v].item);
    free(w.around);
    if (!good && m->tet_count < limit) m->no_memory = true;
    *parent = w.parent;
    *midpoint = w.midpoint;
    return good;
}
