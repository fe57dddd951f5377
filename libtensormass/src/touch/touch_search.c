/* Search of the pairs of fresh features. Fresh faces or edges are listed first, then the others near them, and a hashed
 * grid of these finds pairs. Features far from all fresh ones cost a look at the flags of their vertices. */
#include "touch/touch_internal.h"

#include <math.h>
#include <string.h>

static void place(const tm_touching *t, int32_t vertex, double x[3]) {
    for (int c = 0; c < 3; c++) x[c] = t->world->tissue->mesh->rest_m[3 * vertex + c] + t->gathered_u_m[3 * vertex + c];
}

/* --- boxes --- */

static const tm_touch_box nothing = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

static void widen(tm_touch_box *box, const double low[3], const double high[3]) {
    for (int c = 0; c < 3; c++)
        box->low[c] = law_min(box->low[c], low[c]), box->high[c] = law_max(box->high[c], high[c]);
}

static tm_touch_box grown(const tm_touch_box *box, double grow_m) {
    tm_touch_box b = *box;
    for (int c = 0; c < 3; c++) b.low[c] -= grow_m, b.high[c] += grow_m;
    return b;
}

static tm_touch_box around(const tm_touching *t, const int32_t *vertex, int count) {
    tm_touch_box b = nothing;
    for (int j = 0; j < count; j++) {
        double x[3];
        place(t, vertex[j], x);
        widen(&b, x, x);
    }
    return b;
}

static bool overlap(const tm_touch_box *a, const tm_touch_box *b) {
    bool meet = true;
    for (int c = 0; c < 3; c++) meet &= a->low[c] <= b->high[c] && b->low[c] <= a->high[c];
    return meet;
}

/* --- features near fresh ones --- */

bool tm_touch_is_fresh_face(const tm_touching *t, int32_t face) {
    int32_t w[3];
    tm_touch_triangle(t, face, w);
    return t->fresh[w[0]] | t->fresh[w[1]] | t->fresh[w[2]] | t->fresh_face[face];
}

bool tm_touch_is_fresh_edge(const tm_touching *t, int32_t edge) {
    const int32_t *end = t->world->tissue->mesh->edge + 2 * (int64_t)edge;
    return t->fresh[end[0]] | t->fresh[end[1]] | t->fresh_edge[edge];
}

/* Lists a feature with its box, grown. */
static const tm_touch_box *list(tm_touching *t, int32_t index, const tm_touch_box *box, double grow_m) {
    t->near[t->near_count] = index;
    t->grid.box[t->near_count] = grown(box, grow_m);
    return t->grid.box + t->near_count++;
}

/* Lists a fresh feature, widens the region of all of them, and notes the extent of the largest feature. */
static void list_fresh(tm_touching *t, int32_t index, const tm_touch_box *box, double grow_m) {
    for (int c = 0; c < 3; c++) t->extent_m = law_max(t->extent_m, box->high[c] - box->low[c]);
    const tm_touch_box *wide = list(t, index, box, grow_m);
    widen(&t->region, wide->low, wide->high);
    t->fresh_count = t->near_count;
}

static void begin(tm_touching *t) {
    memset(t->marks.bit, 0, sizeof t->marks.bit);
    t->near_count = t->fresh_count = 0;
    t->region = nothing;
}

/* Flags the vertices of all features whose boxes, grown, may overlap the region: a feature reaches no farther than the
 * largest extent. */
static void flag_vertices(tm_touching *t, double grow_m) {
    const tm_touch_box wide = grown(&t->region, t->extent_m + grow_m);
    for (int32_t i = 0; i < t->surface.vertex_count; i++) {
        double x[3];
        place(t, t->surface.vertex[i], x);
        t->in_region[t->surface.vertex[i]] = tm_touch_is_in(&wide, x);
    }
}

/* Lists a feature if its box, grown, is in a marked cell of the region. */
static void list_near(tm_touching *t, int32_t index, const tm_touch_box *box, double grow_m) {
    const tm_touch_box b = grown(box, grow_m);
    if (overlap(&b, &t->region) && tm_touch_is_marked(&t->marks, &b)) list(t, index, box, grow_m);
}

/* --- vertices and faces --- */

/* Lists fresh faces, and those near a fresh vertex. */
static void list_faces(tm_touching *t) {
    const tm_touch_surface *s = &t->surface;
    const double grow_m = t->reach_m + t->margin_m;
    int32_t w[3];
    begin(t);
    for (int32_t i = 0; i < s->vertex_count; i++) {
        if (!t->fresh[s->vertex[i]]) continue;
        const tm_touch_box point = around(t, s->vertex + i, 1);
        tm_touch_mark(&t->marks, &point);
    }
    for (int32_t f = 0; f < s->face_count; f++) {
        if (!tm_touch_is_fresh_face(t, s->face[f])) continue;
        tm_touch_triangle(t, s->face[f], w);
        const tm_touch_box box = around(t, w, 3);
        list_fresh(t, f, &box, grow_m);
    }
    flag_vertices(t, grow_m);
    for (int32_t f = 0; f < s->face_count; f++) {
        tm_touch_triangle(t, s->face[f], w);
        if (!(t->in_region[w[0]] & t->in_region[w[1]] & t->in_region[w[2]]) || tm_touch_is_fresh_face(t, s->face[f]))
            continue;
        const tm_touch_box box = around(t, w, 3);
        list_near(t, f, &box, grow_m);
    }
}

static void search_at(tm_touching *t, int32_t v) {
    const tm_touch_grid *g = &t->grid;
    double p[3];
    int64_t cell[3];
    place(t, v, p);
    for (int c = 0; c < 3; c++) cell[c] = tm_touch_cell(g->cell_m, p[c]);
    const int64_t key = tm_touch_key(cell[0], cell[1], cell[2]);
    const int32_t bucket = tm_touch_bucket(g, key);
    for (int32_t k = g->begin[bucket]; k < g->begin[bucket + 1]; k++) {
        const int32_t at = g->sorted[k];
        if (g->sorted_key[k] == key && (t->fresh[v] || at < t->fresh_count) && tm_touch_is_in(g->box + at, p))
            tm_touch_try_vertex_face(t, v, t->surface.face[t->near[at]]);
    }
}

void tm_touch_search_faces(tm_touching *t) {
    const tm_touch_surface *s = &t->surface;
    list_faces(t);
    if (!tm_touch_grid_fill(&t->grid, t->near_count)) t->report.overflowed = true;
    for (int32_t i = 0; i < s->vertex_count; i++)
        if (t->in_region[s->vertex[i]]) search_at(t, s->vertex[i]);
}

/* --- edges --- */

/* Lists fresh edges, and those near one. */
static void list_edges(tm_touching *t) {
    const tm_touch_surface *s = &t->surface;
    const int32_t *end = t->world->tissue->mesh->edge;
    const double grow_m = 0.5 * (t->reach_m + t->margin_m);
    begin(t);
    for (int32_t i = 0; i < s->edge_count; i++) {
        if (!tm_touch_is_fresh_edge(t, s->edge[i])) continue;
        const tm_touch_box box = around(t, end + 2 * (int64_t)s->edge[i], 2);
        list_fresh(t, i, &box, grow_m);
        tm_touch_mark(&t->marks, t->grid.box + t->near_count - 1);
    }
    flag_vertices(t, grow_m);
    for (int32_t i = 0; i < s->edge_count; i++) {
        const int32_t *v = end + 2 * (int64_t)s->edge[i];
        if (!(t->in_region[v[0]] & t->in_region[v[1]]) || tm_touch_is_fresh_edge(t, s->edge[i])) continue;
        const tm_touch_box box = around(t, v, 2);
        list_near(t, i, &box, grow_m);
    }
}

/* Returns whether this is the lowest cell that both boxes share: each pair is tried there alone. */
static bool is_first_cell(const tm_touch_grid *g, int64_t key, const tm_touch_box *a, const tm_touch_box *b) {
    int64_t cell[3];
    if (!overlap(a, b)) return false;
    for (int c = 0; c < 3; c++) cell[c] = tm_touch_cell(g->cell_m, law_max(a->low[c], b->low[c]));
    return key == tm_touch_key(cell[0], cell[1], cell[2]);
}

/* Tries the pairs of a fresh edge in one cell; those of two fresh edges once, from the first. */
static void search_cell(tm_touching *t, int32_t at, int64_t key) {
    const tm_touch_grid *g = &t->grid;
    const int32_t bucket = tm_touch_bucket(g, key), edge = t->surface.edge[t->near[at]];
    for (int32_t k = g->begin[bucket]; k < g->begin[bucket + 1]; k++) {
        const int32_t other = g->sorted[k];
        if (other <= at && other < t->fresh_count) continue;
        if (g->sorted_key[k] != key || !is_first_cell(g, key, g->box + at, g->box + other)) continue;
        const int32_t b = t->surface.edge[t->near[other]];
        tm_touch_try_edges(t, edge < b ? edge : b, edge < b ? b : edge);
    }
}

void tm_touch_search_edges(tm_touching *t) {
    list_edges(t);
    if (!tm_touch_grid_fill(&t->grid, t->near_count)) t->report.overflowed = true;
    for (int32_t at = 0; at < t->fresh_count; at++) {
        const tm_touch_cells c = tm_touch_cells_of(t->grid.cell_m, t->grid.box + at);
        for (int64_t z = c.low[2]; z <= c.high[2]; z++)
            for (int64_t y = c.low[1]; y <= c.high[1]; y++)
                for (int64_t x = c.low[0]; x <= c.high[0]; x++) search_cell(t, at, tm_touch_key(x, y, z));
    }
}
