/* Broad phase: lists of pairs of features that may come within reach, found by a hashed grid and kept while they are
 * proven complete.
 *
 * A pair in reach is nearer than `reach_m`. Each vertex of the surface has a place: where it was when its pairs were
 * last searched. The lists hold every pair that is nearer than reach_m + margin_m in those places. A point of a feature
 * is no farther from its place than the farthest of its vertices, so a pair that is not in the lists is not in reach as
 * long as no vertex is farther than margin_m / 2 from its place. That is measured only when the integrator's bound of
 * all travel since the last measurement has used up the rest.
 *
 * Vertices that are too far are then `fresh`: they get new places, and the pairs of all features with a fresh vertex
 * are searched again. So are those of faces, edges and vertices that a cut changed. All others stay in the lists. */
#include "touch/touch_internal.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

bool tm_touch_gather_init(tm_touching *t, tm_pool *pool) {
    const tm_mesh *mesh = t->world->tissue->mesh;
    t->vf.pair = TM_ALLOC(pool, tm_touch_pair, t->def.max_candidates);
    t->ee.pair = TM_ALLOC(pool, tm_touch_pair, t->def.max_candidates);
    t->scratch = TM_ALLOC(pool, tm_touch_pair, t->def.max_candidates);
    t->gathered_u_m = TM_ALLOC(pool, double, 3 * (int64_t)mesh->vertex_count);
    t->last_u_m = TM_ALLOC(pool, double, 3 * (int64_t)mesh->vertex_count);
    t->fresh = TM_ALLOC(pool, uint8_t, mesh->vertex_count);
    t->fresh_face = TM_ALLOC(pool, uint8_t, 4 * (int64_t)mesh->tet_count);
    t->fresh_edge = TM_ALLOC(pool, uint8_t, mesh->edge_count);
    t->near = TM_ALLOC(pool, int32_t, mesh->edge_count);
    return tm_touch_grid_init(&t->grid, pool, mesh);
}

static tm_touch_box around(const tm_touching *t, const int32_t *vertex, int count, double grow_m) {
    const double *rest = t->world->tissue->mesh->rest_m;
    tm_touch_box b = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    for (int j = 0; j < count; j++)
        for (int c = 0; c < 3; c++) {
            const double x = rest[3 * vertex[j] + c] + t->gathered_u_m[3 * vertex[j] + c];
            b.low[c] = law_min(b.low[c], x), b.high[c] = law_max(b.high[c], x);
        }
    for (int c = 0; c < 3; c++) b.low[c] -= grow_m, b.high[c] += grow_m;
    return b;
}

/* --- fresh features --- */

static bool is_fresh_face(const tm_touching *t, int32_t face) {
    int32_t w[3];
    tm_touch_triangle(t, face, w);
    return t->fresh[w[0]] | t->fresh[w[1]] | t->fresh[w[2]] | t->fresh_face[face];
}

static bool is_fresh_edge(const tm_touching *t, int32_t edge) {
    const int32_t *end = t->world->tissue->mesh->edge + 2 * (int64_t)edge;
    return t->fresh[end[0]] | t->fresh[end[1]] | t->fresh_edge[edge];
}

/* Removes the pairs with fresh features. */
static void drop_fresh(tm_touching *t) {
    int32_t kept = 0;
    for (int32_t i = 0; i < t->vf.count; i++) {
        t->vf.pair[kept] = t->vf.pair[i];
        kept += !t->fresh[t->vf.pair[i].a] && !is_fresh_face(t, t->vf.pair[i].b);
    }
    t->vf.count = kept;
    kept = 0;
    for (int32_t i = 0; i < t->ee.count; i++) {
        t->ee.pair[kept] = t->ee.pair[i];
        kept += !is_fresh_edge(t, t->ee.pair[i].a) && !is_fresh_edge(t, t->ee.pair[i].b);
    }
    t->ee.count = kept;
}

/* --- vertices and faces --- */

/* Collects the indices of fresh faces, and of those near a fresh vertex. */
static int32_t near_faces(tm_touching *t) {
    const tm_touch_surface *s = &t->surface;
    int32_t count = 0;
    memset(t->marks.bit, 0, sizeof t->marks.bit);
    for (int32_t i = 0; i < s->vertex_count; i++) {
        if (!t->fresh[s->vertex[i]]) continue;
        const tm_touch_box point = around(t, s->vertex + i, 1, 0);
        tm_touch_mark(&t->marks, &point);
    }
    for (int32_t f = 0; f < s->face_count; f++) {
        int32_t w[3];
        tm_touch_triangle(t, s->face[f], w);
        t->grid.box[f] = around(t, w, 3, t->reach_m + t->margin_m);
        if (is_fresh_face(t, s->face[f]) || tm_touch_is_marked(&t->marks, t->grid.box + f)) t->near[count++] = f;
    }
    return count;
}

static void gather_at(tm_touching *t, int32_t v) {
    const tm_touch_grid *g = &t->grid;
    double p[3];
    int64_t cell[3];
    for (int c = 0; c < 3; c++) {
        p[c] = t->world->tissue->mesh->rest_m[3 * v + c] + t->gathered_u_m[3 * v + c];
        cell[c] = tm_touch_cell(g->cell_m, p[c]);
    }
    const int64_t key = tm_touch_key(cell[0], cell[1], cell[2]);
    const int32_t bucket = tm_touch_bucket(g, key);
    for (int32_t k = g->begin[bucket]; k < g->begin[bucket + 1]; k++) {
        if (g->sorted_key[k] != key || !tm_touch_is_in(g->box + g->sorted[k], p)) continue;
        const int32_t face = t->surface.face[g->sorted[k]];
        if (t->fresh[v] || is_fresh_face(t, face)) tm_touch_try_vertex_face(t, v, face);
    }
}

static void gather_faces(tm_touching *t) {
    const tm_touch_surface *s = &t->surface;
    const int32_t kept = t->vf.count;
    if (!tm_touch_grid_fill(&t->grid, t->near, near_faces(t))) t->report.overflowed = true;
    for (int32_t i = 0; i < s->vertex_count; i++) gather_at(t, s->vertex[i]);
    tm_touch_list_merge(&t->vf, kept, t->scratch);
}

/* --- edges --- */

/* Collects the indices of fresh edges, and of those near one. */
static int32_t near_edges(tm_touching *t) {
    const tm_touch_surface *s = &t->surface;
    const int32_t *end = t->world->tissue->mesh->edge;
    const double grow_m = 0.5 * (t->reach_m + t->margin_m);
    int32_t count = 0;
    memset(t->marks.bit, 0, sizeof t->marks.bit);
    for (int32_t i = 0; i < s->edge_count; i++) {
        t->grid.box[i] = around(t, end + 2 * (int64_t)s->edge[i], 2, grow_m);
        if (is_fresh_edge(t, s->edge[i])) tm_touch_mark(&t->marks, t->grid.box + i);
    }
    for (int32_t i = 0; i < s->edge_count; i++)
        if (tm_touch_is_marked(&t->marks, t->grid.box + i)) t->near[count++] = i;
    return count;
}

/* Returns whether this is the lowest cell that both boxes share: each pair is tried there alone. */
static bool is_first_cell(const tm_touch_grid *g, int64_t key, const tm_touch_box *a, const tm_touch_box *b) {
    int64_t cell[3];
    for (int c = 0; c < 3; c++) {
        if (a->high[c] < b->low[c] || b->high[c] < a->low[c]) return false;
        cell[c] = tm_touch_cell(g->cell_m, law_max(a->low[c], b->low[c]));
    }
    return key == tm_touch_key(cell[0], cell[1], cell[2]);
}

static void gather_edges(tm_touching *t) {
    const tm_touch_grid *g = &t->grid;
    const tm_touch_surface *s = &t->surface;
    const int32_t kept = t->ee.count;
    if (!tm_touch_grid_fill(&t->grid, t->near, near_edges(t))) t->report.overflowed = true;
    for (int32_t bucket = 0; bucket < g->buckets; bucket++)
        for (int32_t i = g->begin[bucket]; i < g->begin[bucket + 1]; i++) {
            const int32_t a = g->sorted[i];
            const bool fresh = is_fresh_edge(t, s->edge[a]);
            for (int32_t k = i + 1; k < g->begin[bucket + 1]; k++) {
                const int32_t b = g->sorted[k];
                if (g->sorted_key[k] == g->sorted_key[i] && (fresh || is_fresh_edge(t, s->edge[b])) &&
                    is_first_cell(g, g->sorted_key[i], g->box + a, g->box + b))
                    tm_touch_try_edges(t, s->edge[a], s->edge[b]);
            }
        }
    tm_touch_list_merge(&t->ee, kept, t->scratch);
}

/* For tests: every pair, in every substep. */
static void gather_all(tm_touching *t) {
    const tm_touch_surface *s = &t->surface;
    for (int32_t i = 0; i < s->vertex_count; i++)
        for (int32_t f = 0; f < s->face_count; f++) tm_touch_try_vertex_face(t, s->vertex[i], s->face[f]);
    for (int32_t i = 0; i < s->edge_count; i++)
        for (int32_t k = i + 1; k < s->edge_count; k++) tm_touch_try_edges(t, s->edge[i], s->edge[k]);
}

/* --- gathering --- */

/* Widens the margin while the complete surface is searched often. Rows do not depend on it. */
static void adapt_margin(tm_touching *t) {
    const double least_m = law_max(2 * t->def.thickness_m, 0.25 * t->surface.mean_edge_m);
    const bool often = t->gathered && t->since < 8, seldom = !t->gathered || t->since > 64;
    t->margin_m = law_clamp(t->margin_m * (often ? 2 : seldom ? 0.5 : 1), least_m, 4 * least_m);
    t->since = 0;
}

/* Sets new places of fresh vertices and searches their pairs. */
static void gather(tm_touching *t) {
    for (int32_t i = 0; i < t->surface.vertex_count; i++)
        if (t->fresh[t->surface.vertex[i]])
            memcpy(t->gathered_u_m + 3 * t->surface.vertex[i], t->world->state.u_m + 3 * t->surface.vertex[i],
                   3 * sizeof(double));
    t->grid.cell_m = t->surface.mean_edge_m + t->reach_m + t->margin_m;
    t->marks.cell_m = t->grid.cell_m;
    if (t->all_pairs) {
        gather_all(t);
    } else {
        gather_faces(t);
        gather_edges(t);
    }
    const tm_mesh *mesh = t->world->tissue->mesh;
    memset(t->fresh, 0, (size_t)mesh->vertex_count);
    memset(t->fresh_face, 0, 4 * (size_t)mesh->tet_count);
    memset(t->fresh_edge, 0, (size_t)mesh->edge_count);
}

static void gather_complete(tm_touching *t) {
    adapt_margin(t);
    memset(t->fresh, 1, (size_t)t->world->tissue->mesh->vertex_count);
    t->vf.count = t->ee.count = 0;
    t->odometer_m = t->moved_m = 0;
    gather(t);
    t->gathered = true;
    t->report.gathers++;
}

/* Returns how far the farthest vertex is from its place, m. */
static double farthest_m(const tm_touching *t) {
    double most2 = 0;
    for (int32_t i = 0; i < t->surface.vertex_count; i++) {
        double d[3];
        vsub(t->world->state.u_m + 3 * t->surface.vertex[i], t->gathered_u_m + 3 * t->surface.vertex[i], d);
        if (!t->fresh[t->surface.vertex[i]]) most2 = law_max(most2, vdot(d, d));
    }
    return sqrt(most2);
}

/* Makes vertices fresh that are farther than a quarter of the margin from their places. Returns the count of all
 * fresh ones; moved_m is then that of the others. */
static int32_t refresh(tm_touching *t) {
    const double limit2 = 0.0625 * t->margin_m * t->margin_m;
    double most2 = 0;
    int32_t count = 0;
    for (int32_t i = 0; i < t->surface.vertex_count; i++) {
        const int32_t v = t->surface.vertex[i];
        double d[3];
        vsub(t->world->state.u_m + 3 * v, t->gathered_u_m + 3 * v, d);
        const double d2 = vdot(d, d);
        t->fresh[v] |= !(d2 <= limit2);
        count += t->fresh[v];
        if (!t->fresh[v]) most2 = law_max(most2, d2);
    }
    t->moved_m = sqrt(most2);
    return count;
}

/* Returns a bound of how far a vertex of the surface has moved since the last substep, m: measured if the caller may
 * have moved it. */
static double travel_m(tm_touching *t) {
    const size_t bytes = sizeof(double) * 3 * (size_t)t->world->tissue->mesh->vertex_count;
    double most_m = 0;
    if (t->maybe_moved || t->world->settling)
        for (int32_t i = 0; i < t->surface.vertex_count; i++) {
            double d[3];
            vsub(t->world->state.u_m + 3 * t->surface.vertex[i], t->last_u_m + 3 * t->surface.vertex[i], d);
            most_m = law_max(most_m, vdot(d, d));
        }
    most_m = t->maybe_moved || t->world->settling ? sqrt(most_m) : tm_max_increment_m(t->world);
    memcpy(t->last_u_m, t->world->state.u_m, bytes);
    t->maybe_moved = false;
    return most_m;
}

void tm_touch_update(tm_touching *t) {
    const tm_world *world = t->world;
    const bool cut = t->revision != world->tissue->surface.revision;
    if (cut) tm_touch_surface_build(t);
    const double travel = travel_m(t);
    t->odometer_m += 2 * travel;
    t->moved_m += travel;
    t->since++;
    if (t->all_pairs) t->gathered = false;
    if (t->gathered && t->moved_m > 0.5 * t->margin_m) t->moved_m = farthest_m(t);
    const bool moved = !(t->moved_m <= 0.5 * t->margin_m);
    if (t->gathered && !cut && !moved) return;
    if (!t->gathered || (moved && 2 * refresh(t) > t->surface.vertex_count)) {
        gather_complete(t);
    } else {
        drop_fresh(t);
        gather(t);
    }
}
