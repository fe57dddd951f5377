/* Broad phase: lists of pairs of features that may come within reach, found by boxes of clusters and kept while they
 * are proven complete.
 *
 * A pair in reach is nearer than `reach_m`. Each vertex of the surface has a place: where it was when its pairs were
 * last searched. The lists hold every pair that is nearer than reach_m + margin_m in those places. A point of a feature
 * is no farther from its place than the farthest of its vertices, so a pair that is not in the lists is not in reach as
 * long as no vertex is farther than margin_m / 2 from its place. That is measured only when the integrator's bound of
 * all travel since the last measurement has used up the rest.
 *
 * Vertices that are too far are then `fresh`: they get new places, and the pairs of all features with a fresh vertex
 * are searched again, on all threads. So are those of faces, edges and vertices that a cut changed. All others stay in
 * the lists. */
#include "touch/touch_internal.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

static bool init_search(tm_touching *t, tm_pool *pool) {
    const tm_mesh *mesh = t->world->tissue->mesh;
    const int32_t faces = t->surface.max_faces;
    t->most_items = (int32_t)law_max(law_max(faces, mesh->vertex_count), mesh->edge_count);
    t->near_items = TM_ALLOC(pool, int32_t, (int64_t)t->most_items * t->world->partition_count);
    return tm_touch_set_init(t, pool, t->fresh) && tm_touch_set_init(t, pool, t->quick) &&
           tm_touch_clusters_init(t, pool, TM_TOUCH_VERTICES, mesh->vertex_count, 1, mesh->vertex_count) &&
           tm_touch_clusters_init(t, pool, TM_TOUCH_FACES, mesh->tet_count, 4, faces) &&
           tm_touch_clusters_init(t, pool, TM_TOUCH_EDGES, mesh->edge_count, 1, mesh->edge_count);
}

static void init_lists(tm_touch_lists *lists, tm_pool *pool, int32_t room) {
    lists->vf.room = lists->ee.room = room;
    lists->vf.pair = TM_ALLOC(pool, tm_touch_pair, room);
    lists->ee.pair = TM_ALLOC(pool, tm_touch_pair, room);
}

bool tm_touch_gather_init(tm_touching *t, tm_pool *pool) {
    enum { SHARE = 4 }; /* of the pairs: for those that a thread found, and for fast ones */
    const tm_mesh *mesh = t->world->tissue->mesh;
    const int32_t parts = t->world->partition_count;
    if (parts > 1 && !(t->found_by = TM_ALLOC(pool, tm_touch_lists, parts))) return false;
    init_lists(&t->near, pool, t->def.max_candidates);
    init_lists(&t->fast, pool, t->def.max_candidates / SHARE);
    for (int32_t p = 0; t->found_by && p < parts; p++) init_lists(t->found_by + p, pool, t->def.max_candidates / SHARE);
    t->scratch = TM_ALLOC(pool, tm_touch_pair, t->def.max_candidates);
    t->gathered_u_m = TM_ALLOC(pool, double, 3 * (int64_t)mesh->vertex_count);
    t->place_m = TM_ALLOC(pool, double, 3 * (int64_t)mesh->vertex_count);
    t->last_u_m = TM_ALLOC(pool, double, 3 * (int64_t)mesh->vertex_count);
    return init_search(t, pool);
}

/* --- gathering --- */

/* Removes the pairs with fresh features. */
static void drop_fresh(tm_touching *t) {
    const uint8_t *vertices = t->fresh[TM_TOUCH_VERTICES].is, *faces = t->fresh[TM_TOUCH_FACES].is,
                  *edges = t->fresh[TM_TOUCH_EDGES].is;
    int32_t kept = 0;
    for (int32_t i = 0; i < t->near.vf.count; i++) {
        t->near.vf.pair[kept] = t->near.vf.pair[i];
        kept += !vertices[t->near.vf.pair[i].a] && !faces[t->near.vf.pair[i].b];
    }
    t->near.vf.count = kept;
    kept = 0;
    for (int32_t i = 0; i < t->near.ee.count; i++) {
        t->near.ee.pair[kept] = t->near.ee.pair[i];
        kept += !edges[t->near.ee.pair[i].a] && !edges[t->near.ee.pair[i].b];
    }
    t->near.ee.count = kept;
}

/* For tests: every pair, in every substep. */
static void gather_all(tm_touching *t) {
    const tm_touch_surface *s = &t->surface;
    for (int32_t i = 0; i < s->vertex_count; i++)
        for (int32_t f = 0; f < s->face_count; f++) tm_touch_try_vertex_face(t, &t->near, s->vertex[i], s->face[f]);
    for (int32_t i = 0; i < s->edge_count; i++)
        for (int32_t k = i + 1; k < s->edge_count; k++) tm_touch_try_edges(t, &t->near, s->edge[i], s->edge[k]);
}

/* Widens the margin while the complete surface is searched often. Rows do not depend on it. */
static void adapt_margin(tm_touching *t) {
    const double least_m = law_max(2 * t->def.thickness_m, 0.25 * t->surface.mean_edge_m);
    const bool often = t->gathered && t->since < 8, seldom = !t->gathered || t->since > 64;
    t->margin_m = law_clamp(t->margin_m * (often ? 2 : seldom ? 0.5 : 1), least_m, 4 * least_m);
    t->since = 0;
}

static void set_place(tm_touching *t, int32_t v) {
    const double *rest = t->world->tissue->mesh->rest_m, *u = t->world->state.u_m;
    for (int64_t i = 3 * (int64_t)v; i < 3 * (int64_t)v + 3; i++)
        t->gathered_u_m[i] = u[i], t->place_m[i] = rest[i] + u[i];
}

/* Sets new places of fresh vertices and searches the pairs of fresh features. */
static void gather(tm_touching *t) {
    const tm_touch_set *vertices = t->fresh + TM_TOUCH_VERTICES;
    for (int32_t i = 0; i < vertices->count; i++) set_place(t, vertices->list[i]);
    if (t->all_pairs) {
        gather_all(t);
    } else {
        const int32_t kept[2] = {t->near.vf.count, t->near.ee.count};
        tm_touch_search(t);
        tm_touch_list_merge(&t->near.vf, kept[0], t->scratch);
        tm_touch_list_merge(&t->near.ee, kept[1], t->scratch);
    }
    t->report.overflowed |= t->near.vf.overflowed || t->near.ee.overflowed;
    tm_touch_forget_fresh(t);
}

static void gather_complete(tm_touching *t) {
    adapt_margin(t);
    tm_touch_list_all(t);
    t->clustered = false;
    t->near.vf.count = t->near.ee.count = 0;
    t->odometer_m = t->moved_m = 0;
    gather(t);
    t->gathered = true;
    t->report.gathers++;
}

static void gather_fresh(tm_touching *t) {
    tm_touch_list_fresh(t);
    drop_fresh(t);
    gather(t);
}

/* Returns how far the farthest vertex is from its place, m. */
static double farthest_m(const tm_touching *t) {
    double most2 = 0;
    for (int32_t i = 0; i < t->surface.vertex_count; i++) {
        double d[3];
        vsub(t->world->state.u_m + 3 * t->surface.vertex[i], t->gathered_u_m + 3 * t->surface.vertex[i], d);
        if (!t->fresh[TM_TOUCH_VERTICES].is[t->surface.vertex[i]]) most2 = law_max(most2, vdot(d, d));
    }
    return sqrt(most2);
}

/* Makes vertices fresh that are farther than three eighths of the margin from their places. Returns the count of all
 * fresh ones; moved_m is then that of the others. */
static int32_t refresh(tm_touching *t) {
    const double limit2 = 0.140625 * t->margin_m * t->margin_m;
    double most2 = 0;
    int32_t count = 0;
    for (int32_t i = 0; i < t->surface.vertex_count; i++) {
        const int32_t v = t->surface.vertex[i];
        double d[3];
        vsub(t->world->state.u_m + 3 * v, t->gathered_u_m + 3 * v, d);
        const double d2 = vdot(d, d);
        t->fresh[TM_TOUCH_VERTICES].is[v] |= !(d2 <= limit2);
        count += t->fresh[TM_TOUCH_VERTICES].is[v];
        if (!t->fresh[TM_TOUCH_VERTICES].is[v]) most2 = law_max(most2, d2);
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
    most_m = t->maybe_moved || t->world->settling ? sqrt(most_m) : t->increment_m;
    if (t->world->check_removed || t->world->settling) /* the caller may move tissue after the last substep */
        memcpy(t->last_u_m, t->world->state.u_m, bytes);
    t->maybe_moved = false;
    return most_m;
}

void tm_touch_update(tm_touching *t) {
    const tm_world *world = t->world;
    if (t->updated) return;
    t->updated = true;
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
    if (!t->gathered || (moved && 2 * refresh(t) > t->surface.vertex_count))
        gather_complete(t);
    else
        gather_fresh(t);
    if (cut) tm_touch_forget_removed(t);
}
