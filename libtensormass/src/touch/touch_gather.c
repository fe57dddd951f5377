/* Broad phase: lists of pairs of features that may come within reach, found by a hashed grid and kept while they are
 * proven complete.
 *
 * A pair in reach is nearer than `reach_m`. The lists hold every pair nearer than reach_m + margin_m at the gathering.
 * A point of a feature moves no farther than the farthest of its vertices, so a pair that is not in the lists is not in
 * reach as long as no vertex of the surface is farther than margin_m / 2 from its place at the gathering. That is
 * measured only when the integrator's bound of all travel since the last measurement has used up the rest. */
#include "touch/touch_internal.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

enum { ENTRIES_A_FACE = 24 };

bool tm_touch_gather_init(tm_touching *t, tm_pool *pool) {
    const tm_mesh *mesh = t->world->tissue->mesh;
    tm_touch_grid *g = &t->grid;
    g->capacity = ENTRIES_A_FACE * mesh->surface_count + 4 * mesh->tet_count + 4096;
    g->buckets = 1024;
    while (g->buckets < 4 * mesh->surface_count && g->buckets < 1 << 20) g->buckets *= 2;
    g->begin = TM_ALLOC(pool, int32_t, g->buckets + 1);
    g->bucket = TM_ALLOC(pool, int32_t, g->capacity);
    g->key = TM_ALLOC(pool, int64_t, g->capacity);
    g->sorted_key = TM_ALLOC(pool, int64_t, g->capacity);
    g->item = TM_ALLOC(pool, int32_t, g->capacity);
    g->sorted = TM_ALLOC(pool, int32_t, g->capacity);
    g->box = TM_ALLOC(pool, tm_touch_box, mesh->edge_count);
    t->vf.pair = TM_ALLOC(pool, tm_touch_pair, t->def.max_candidates);
    t->ee.pair = TM_ALLOC(pool, tm_touch_pair, t->def.max_candidates);
    t->gathered_u_m = TM_ALLOC(pool, double, 3 * (int64_t)mesh->vertex_count);
    return !pool->failed;
}

/* --- the grid --- */

static tm_touch_box around(const tm_touching *t, const int32_t *vertex, int count, double grow_m) {
    tm_touch_box b = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (int j = 0; j < count; j++) {
        double x[3];
        tm_touch_at(t->world, vertex[j], x);
        for (int c = 0; c < 3; c++) b.low[c] = law_min(b.low[c], x[c]), b.high[c] = law_max(b.high[c], x[c]);
    }
    for (int c = 0; c < 3; c++) b.low[c] -= grow_m, b.high[c] += grow_m;
    return b;
}

static int64_t cell_of(const tm_touch_grid *g, double x_m) {
    return (int64_t)floor(law_clamp(x_m / g->cell_m, -1e6, 1e6)) + 1000000;
}
static int64_t key_of(int64_t x, int64_t y, int64_t z) { return x | y << 21 | z << 42; }
static int32_t bucket_of(const tm_touch_grid *g, int64_t key) {
    const uint64_t mixed = (uint64_t)key * 0x9e3779b97f4a7c15u;
    return (int32_t)(mixed >> 40) & (g->buckets - 1);
}

/* Adds an item to all cells of its box. Returns false if the grid is full. */
static bool insert(tm_touch_grid *g, int32_t *count, int32_t item, const tm_touch_box *b) {
    int64_t low[3], high[3];
    for (int c = 0; c < 3; c++) low[c] = cell_of(g, b->low[c]), high[c] = cell_of(g, b->high[c]);
    const double cells =
        (double)(high[0] - low[0] + 1) * (double)(high[1] - low[1] + 1) * (double)(high[2] - low[2] + 1);
    if (cells > g->capacity - *count) return false;
    for (int64_t z = low[2]; z <= high[2]; z++)
        for (int64_t y = low[1]; y <= high[1]; y++)
            for (int64_t x = low[0]; x <= high[0]; x++) {
                g->key[*count] = key_of(x, y, z);
                g->item[(*count)++] = item;
            }
    return true;
}

/* Sorts the entries by bucket, in their order. */
static void sort_cells(tm_touch_grid *g, int32_t count) {
    memset(g->begin, 0, sizeof *g->begin * ((size_t)g->buckets + 1));
    for (int32_t i = 0; i < count; i++) g->begin[(g->bucket[i] = bucket_of(g, g->key[i])) + 1]++;
    for (int32_t b = 0; b < g->buckets; b++) g->begin[b + 1] += g->begin[b];
    for (int32_t i = count - 1; i >= 0; i--) { /* from the end: begin[b+1] counts down to the bucket's begin */
        const int32_t at = --g->begin[g->bucket[i] + 1];
        g->sorted[at] = g->item[i], g->sorted_key[at] = g->key[i];
    }
    /* now begin[b+1] is the begin of bucket b */
    memmove(g->begin, g->begin + 1, sizeof *g->begin * (size_t)g->buckets);
    g->begin[g->buckets] = count;
}

/* --- the pair's own thickness --- */

static void add(tm_touching *t, tm_touch_list *list, int32_t a, int32_t b, double thickness_m) {
    if (list->count == t->def.max_candidates) {
        t->report.overflowed = true;
        return;
    }
    list->pair[list->count++] = (tm_touch_pair){.a = a, .b = b, .thickness_m = thickness_m, .wake_m = t->odometer_m};
}

/* Returns the thickness between features at a distance at rest; below 0: they are one fold, and do not touch.
 * `behind`: the way from one to the other at rest leads through tissue. */
static double thickness(const tm_touching *t, bool same_body, double rest_m, bool behind) {
    const double full = t->def.thickness_m;
    if (same_body && behind && rest_m < 4 * full) return -1;
    return law_min(full, same_body ? 0.5 * rest_m : rest_m);
}

static void rest_normal(const tm_mesh *mesh, const int32_t *v, double n[3]) {
    double ab[3], ac[3];
    vsub(mesh->rest_m + 3 * v[1], mesh->rest_m + 3 * v[0], ab);
    vsub(mesh->rest_m + 3 * v[2], mesh->rest_m + 3 * v[0], ac);
    vcross(ab, ac, n);
    vunit(n, n);
}

static void try_vertex_face(tm_touching *t, int32_t v, int32_t f) {
    const int32_t *w = t->surface.triangle + 3 * f, body = t->surface.body[v],
                  other = tm_touch_body(t, t->surface.face[f]);
    if (v == w[0] || v == w[1] || v == w[2] || !tm_touch_enabled(t, body, other)) return;
    double p[3], x[3][3];
    tm_touch_at(t->world, v, p);
    for (int j = 0; j < 3; j++) tm_touch_at(t->world, w[j], x[j]);
    if (tm_touch_point_triangle(p, x[0], x[1], x[2]).distance_m > t->reach_m + t->margin_m) return;
    const double *rest = t->world->tissue->mesh->rest_m;
    double n[3];
    rest_normal(t->world->tissue->mesh, w, n);
    const tm_touch_closest c = tm_touch_point_triangle(rest + 3 * v, rest + 3 * w[0], rest + 3 * w[1], rest + 3 * w[2]);
    const double h = thickness(t, body == other, c.distance_m, vdot(c.offset, n) < 0);
    if (h >= 0) add(t, &t->vf, v, f, h);
}

static void try_edges(tm_touching *t, int32_t a, int32_t b) {
    const tm_mesh *mesh = t->world->tissue->mesh;
    const int32_t *va = mesh->edge + 2 * a, *vb = mesh->edge + 2 * b;
    const int32_t body = t->surface.body[va[0]], other = t->surface.body[vb[0]];
    if (va[0] == vb[0] || va[0] == vb[1] || va[1] == vb[0] || va[1] == vb[1] || !tm_touch_enabled(t, body, other))
        return;
    double x[4][3], s, r, n[3] = {0, 0, 0}, from[3], to[3];
    bool inside;
    for (int j = 0; j < 2; j++) tm_touch_at(t->world, va[j], x[j]), tm_touch_at(t->world, vb[j], x[2 + j]);
    if (tm_touch_segments(x[0], x[1], x[2], x[3], &s, &r, &inside) > t->reach_m + t->margin_m) return;
    const double *y[4] = {mesh->rest_m + 3 * va[0], mesh->rest_m + 3 * va[1], mesh->rest_m + 3 * vb[0],
                          mesh->rest_m + 3 * vb[1]};
    const double rest_m = tm_touch_segments(y[0], y[1], y[2], y[3], &s, &r, &inside);
    for (int k = 0; k < 2; k++) {
        double one[3];
        rest_normal(mesh, t->surface.triangle + 3 * t->surface.of_edge[2 * (int64_t)a + k], one);
        vmadd(n, 1, one, n);
    }
    for (int c = 0; c < 3; c++) {
        from[c] = y[0][c] + s * (y[1][c] - y[0][c]);
        to[c] = y[2][c] + r * (y[3][c] - y[2][c]) - from[c];
    }
    const double h = thickness(t, body == other, rest_m, vdot(to, n) < 0);
    if (h >= 0) add(t, &t->ee, a, b, h);
}

/* --- gathering --- */

/* Orders a list by a, then b: heap sort, without memory. */
static bool before(const tm_touch_pair *p, const tm_touch_pair *q) { return p->a != q->a ? p->a < q->a : p->b < q->b; }

static void sift(tm_touch_pair *pair, int32_t at, int32_t count) {
    const tm_touch_pair moving = pair[at];
    for (int32_t child; (child = 2 * at + 1) < count; at = child) {
        if (child + 1 < count && before(pair + child, pair + child + 1)) child++;
        if (!before(&moving, pair + child)) break;
        pair[at] = pair[child];
    }
    pair[at] = moving;
}

static void sort(tm_touch_list *list) {
    tm_touch_pair *pair = list->pair;
    for (int32_t i = list->count / 2 - 1; i >= 0; i--) sift(pair, i, list->count);
    for (int32_t end = list->count - 1; end > 0; end--) {
        const tm_touch_pair last = pair[end];
        pair[end] = pair[0], pair[0] = last;
        sift(pair, 0, end);
    }
}

/* Doubles the cells of a full grid. Returns false, and flags it, if that does not help any more. */
static bool coarsen(tm_touching *t) {
    if (t->grid.cell_m < 1) {
        t->grid.cell_m *= 2;
        return true;
    }
    t->report.overflowed = true;
    return false;
}

static bool is_in(const tm_touch_box *b, const double p[3]) {
    return p[0] >= b->low[0] && p[0] <= b->high[0] && p[1] >= b->low[1] && p[1] <= b->high[1] && p[2] >= b->low[2] &&
           p[2] <= b->high[2];
}

static void gather_faces(tm_touching *t) {
    tm_touch_grid *g = &t->grid;
    const tm_touch_surface *s = &t->surface;
    int32_t count = 0;
    for (int32_t f = 0; f < s->face_count; f++) g->box[f] = around(t, s->triangle + 3 * f, 3, t->reach_m + t->margin_m);
    for (int32_t f = 0; f < s->face_count; f++)
        if (!insert(g, &count, f, g->box + f) && coarsen(t)) count = 0, f = -1;
    sort_cells(g, count);
    for (int32_t i = 0; i < s->vertex_count; i++) {
        double p[3];
        tm_touch_at(t->world, s->vertex[i], p);
        const int64_t key = key_of(cell_of(g, p[0]), cell_of(g, p[1]), cell_of(g, p[2]));
        const int32_t bucket = bucket_of(g, key);
        for (int32_t k = g->begin[bucket]; k < g->begin[bucket + 1]; k++)
            if (g->sorted_key[k] == key && is_in(g->box + g->sorted[k], p))
                try_vertex_face(t, s->vertex[i], g->sorted[k]);
    }
    sort(&t->vf);
}

/* Returns whether this is the lowest cell that both boxes share: each pair is tried there alone. */
static bool is_first_cell(const tm_touch_grid *g, int64_t key, const tm_touch_box *a, const tm_touch_box *b) {
    int64_t cell[3];
    for (int c = 0; c < 3; c++) {
        if (a->high[c] < b->low[c] || b->high[c] < a->low[c]) return false;
        cell[c] = cell_of(g, law_max(a->low[c], b->low[c]));
    }
    return key == key_of(cell[0], cell[1], cell[2]);
}

static void gather_edges(tm_touching *t) {
    tm_touch_grid *g = &t->grid;
    const tm_touch_surface *s = &t->surface;
    const int32_t *end = t->world->tissue->mesh->edge;
    const double grow_m = 0.5 * (t->reach_m + t->margin_m);
    int32_t count = 0;
    for (int32_t i = 0; i < s->edge_count; i++) g->box[i] = around(t, end + 2 * s->edge[i], 2, grow_m);
    for (int32_t i = 0; i < s->edge_count; i++)
        if (!insert(g, &count, i, g->box + i) && coarsen(t)) count = 0, i = -1;
    sort_cells(g, count);
    for (int32_t bucket = 0; bucket < g->buckets; bucket++)
        for (int32_t i = g->begin[bucket]; i < g->begin[bucket + 1]; i++)
            for (int32_t k = i + 1; k < g->begin[bucket + 1]; k++) {
                const int32_t a = g->sorted[i], b = g->sorted[k];
                if (g->sorted_key[k] == g->sorted_key[i] && is_first_cell(g, g->sorted_key[i], g->box + a, g->box + b))
                    try_edges(t, s->edge[a], s->edge[b]);
            }
    sort(&t->ee);
}

/* For tests: every pair. */
static void gather_all(tm_touching *t) {
    const tm_touch_surface *s = &t->surface;
    for (int32_t i = 0; i < s->vertex_count; i++)
        for (int32_t f = 0; f < s->face_count; f++) try_vertex_face(t, s->vertex[i], f);
    for (int32_t i = 0; i < s->edge_count; i++)
        for (int32_t k = i + 1; k < s->edge_count; k++) try_edges(t, s->edge[i], s->edge[k]);
}

/* Widens the margin while gatherings follow each other closely. Rows do not depend on it. */
static void adapt_margin(tm_touching *t) {
    const double least_m = law_max(2 * t->def.thickness_m, 0.25 * t->surface.mean_edge_m);
    const bool often = t->gathered && t->since < 8, seldom = !t->gathered || t->since > 64;
    t->margin_m = law_clamp(t->margin_m * (often ? 2 : seldom ? 0.5 : 1), least_m, 4 * least_m);
    t->since = 0;
}

static void gather(tm_touching *t) {
    adapt_margin(t);
    memcpy(t->gathered_u_m, t->world->state.u_m, sizeof(double) * 3 * (size_t)t->world->tissue->mesh->vertex_count);
    t->vf.count = t->ee.count = 0;
    t->odometer_m = t->moved_m = 0;
    t->grid.cell_m = t->surface.mean_edge_m + t->reach_m + t->margin_m;
    if (t->all_pairs) {
        gather_all(t);
    } else {
        gather_faces(t);
        gather_edges(t);
    }
    t->gathered = true;
    t->report.gathers++;
}

/* Returns how far the farthest vertex is from its place at the gathering, m. */
static double farthest_m(const tm_touching *t) {
    double most2 = 0;
    for (int32_t i = 0; i < t->surface.vertex_count; i++) {
        double d[3];
        vsub(t->world->state.u_m + 3 * t->surface.vertex[i], t->gathered_u_m + 3 * t->surface.vertex[i], d);
        most2 = law_max(most2, vdot(d, d));
    }
    return sqrt(most2);
}

static void wake_all(tm_touch_list *list) {
    for (int32_t i = 0; i < list->count; i++) list->pair[i].wake_m = 0;
}

void tm_touch_update(tm_touching *t) {
    const tm_world *world = t->world;
    if (t->revision != world->tissue->surface.revision) tm_touch_surface_build(t);
    if (t->maybe_moved || world->settling) { /* no bound of what the caller did */
        wake_all(&t->vf), wake_all(&t->ee);
        t->moved_m = INFINITY;
        t->maybe_moved = false;
    } else {
        const double travel_m = tm_max_increment_m(world);
        t->odometer_m += 2 * travel_m;
        t->moved_m += travel_m;
    }
    t->since++;
    if (t->gathered && t->moved_m > 0.5 * t->margin_m) t->moved_m = farthest_m(t);
    if (!t->gathered || !(t->moved_m <= 0.5 * t->margin_m)) gather(t);
}
