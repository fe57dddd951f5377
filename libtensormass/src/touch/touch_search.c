/* Search of the pairs of fresh features: those with a fresh vertex, and those that a cut changed. They are listed from
 * their vertices, get new boxes, and are compared with the features in clusters near them. So a search costs what is
 * fresh. Quick features are listed in the same way. */
#include "touch/touch_internal.h"

#include <string.h>

/* --- fresh features --- */

static void add(tm_touch_set *set, int32_t item) {
    if (!set->is[item]) set->list[set->count++] = item;
    set->is[item] = 1;
}

void tm_touch_add_fresh(tm_touching *t, int kind, int32_t item) { add(t->fresh + kind, item); }

/* Adds the faces and edges of a vertex. Faces in no cluster are inside, or of a cut and added by it. */
static void add_around(const tm_touching *t, tm_touch_set set[TM_TOUCH_KINDS], int32_t v) {
    const tm_mesh *mesh = t->world->tissue->mesh;
    for (int32_t i = mesh->vertex_tet_begin[v]; i < mesh->vertex_tet_begin[v + 1]; i++)
        for (int32_t f = 4 * mesh->vertex_tet[i]; f < 4 * mesh->vertex_tet[i] + 4; f++)
            if (mesh->tet[f] != v && tm_touch_clusters_have(t->clusters + TM_TOUCH_FACES, f))
                add(set + TM_TOUCH_FACES, f);
    for (int32_t i = mesh->vertex_edge_begin[v]; i < mesh->vertex_edge_begin[v + 1]; i++)
        if (tm_touch_is_on_surface(&t->surface, mesh->vertex_edge[i])) add(set + TM_TOUCH_EDGES, mesh->vertex_edge[i]);
}

void tm_touch_list_fresh(tm_touching *t) {
    tm_touch_set *vertices = t->fresh + TM_TOUCH_VERTICES;
    vertices->count = 0;
    for (int32_t i = 0; i < t->surface.vertex_count; i++)
        if (vertices->is[t->surface.vertex[i]]) vertices->list[vertices->count++] = t->surface.vertex[i];
    for (int32_t i = 0; i < vertices->count; i++) add_around(t, t->fresh, vertices->list[i]);
}

static void list_all(tm_touch_set *set, const int32_t *item, int32_t count) {
    set->count = count;
    memcpy(set->list, item, sizeof *item * (size_t)count);
    for (int32_t i = 0; i < count; i++) set->is[item[i]] = 1;
}

void tm_touch_list_all(tm_touching *t) {
    const tm_touch_surface *s = &t->surface;
    list_all(t->fresh + TM_TOUCH_VERTICES, s->vertex, s->vertex_count);
    list_all(t->fresh + TM_TOUCH_FACES, s->face, s->face_count);
    list_all(t->fresh + TM_TOUCH_EDGES, s->edge, s->edge_count);
}

static void empty(tm_touch_set set[TM_TOUCH_KINDS]) {
    for (int kind = 0; kind < TM_TOUCH_KINDS; kind++) {
        for (int32_t i = 0; i < set[kind].count; i++) set[kind].is[set[kind].list[i]] = 0;
        set[kind].count = 0;
    }
}

void tm_touch_forget_fresh(tm_touching *t) { empty(t->fresh); }

void tm_touch_forget_removed(tm_touching *t) {
    for (int kind = 0; kind < TM_TOUCH_KINDS; kind++) memset(t->fresh[kind].is, 0, (size_t)t->clusters[kind].items);
}

bool tm_touch_set_init(tm_touching *t, tm_pool *pool, tm_touch_set set[TM_TOUCH_KINDS]) {
    const tm_mesh *mesh = t->world->tissue->mesh;
    const int64_t items[] = {mesh->vertex_count, 4 * (int64_t)mesh->tet_count, mesh->edge_count};
    const int32_t most[] = {mesh->vertex_count, t->surface.max_faces, mesh->edge_count};
    for (int kind = 0; kind < TM_TOUCH_KINDS; kind++) {
        set[kind].is = TM_ALLOC(pool, uint8_t, items[kind]);
        set[kind].list = TM_ALLOC(pool, int32_t, most[kind]);
    }
    return !pool->failed;
}

/* --- quick features --- */

/* For tests: without the clusters. */
static void add_with_quick(tm_touching *t, int kind, const int32_t *item, int32_t count) {
    tm_touch_set *set = t->quick;
    for (int32_t i = 0; i < count; i++) {
        int32_t v[3];
        for (int j = tm_touch_vertices(t, kind, item[i], v) - 1; j >= 0; j--)
            if (set[TM_TOUCH_VERTICES].is[v[j]]) add(set + kind, item[i]);
    }
}

bool tm_touch_list_quick(tm_touching *t, tm_touch_is_quick *is) {
    const tm_touch_surface *s = &t->surface;
    tm_touch_set *set = t->quick;
    empty(set);
    for (int32_t i = 0; i < s->vertex_count; i++)
        if (is(t, s->vertex[i])) add(set + TM_TOUCH_VERTICES, s->vertex[i]);
    if (t->all_pairs) {
        add_with_quick(t, TM_TOUCH_FACES, s->face, s->face_count);
        add_with_quick(t, TM_TOUCH_EDGES, s->edge, s->edge_count);
    } else
        for (int32_t i = 0; i < set[TM_TOUCH_VERTICES].count; i++) add_around(t, set, set[TM_TOUCH_VERTICES].list[i]);
    return set[TM_TOUCH_VERTICES].count > 0;
}

/* --- search on all threads --- */

static void work_part(void *context, int32_t part) {
    tm_touching *t = context;
    tm_touch_lists *to = t->found_by + part;
    to->vf.count = to->ee.count = 0;
    to->vf.overflowed = to->ee.overflowed = false;
    t->work(t, part, t->world->partition_count, to);
}

static bool has_room(const tm_touch_list *list, int32_t more, bool overflowed) {
    return !overflowed && list->count + more <= list->room;
}

static void append(tm_touch_list *list, const tm_touch_list *more) {
    memcpy(list->pair + list->count, more->pair, sizeof *more->pair * (size_t)more->count);
    list->count += more->count;
}

/* Returns false if a list has no room for all. */
static bool divide(tm_touching *t, tm_touch_lists *to) {
    const int32_t parts = t->world->partition_count;
    int32_t vf = 0, ee = 0;
    bool vf_overflowed = false, ee_overflowed = false;
    tm_partitions_run(t->world, work_part, t);
    for (int32_t p = 0; p < parts; p++) {
        vf += t->found_by[p].vf.count, vf_overflowed |= t->found_by[p].vf.overflowed;
        ee += t->found_by[p].ee.count, ee_overflowed |= t->found_by[p].ee.overflowed;
    }
    if (!has_room(&to->vf, vf, vf_overflowed) || !has_room(&to->ee, ee, ee_overflowed)) return false;
    for (int32_t p = 0; p < parts; p++) {
        append(&to->vf, &t->found_by[p].vf);
        append(&to->ee, &t->found_by[p].ee);
    }
    return true;
}

/* The lists are sorted afterwards, so they are the same for any number of threads; where they have no room for all,
 * one thread drops the last ones. */
void tm_touch_divide(tm_touching *t, tm_touch_work *work, tm_touch_lists *to) {
    t->work = work;
    if (!t->found_by || !divide(t, to)) work(t, 0, 1, to);
}

/* --- pairs, each once --- */

static void try_vertex(const tm_touching *t, tm_touch_lists *to, int32_t vertex, int32_t face) {
    tm_touch_try_vertex_face(t, to, vertex, face);
}

/* A fresh vertex tries this face itself. */
static void try_face(const tm_touching *t, tm_touch_lists *to, int32_t face, int32_t vertex) {
    if (!t->fresh[TM_TOUCH_VERTICES].is[vertex]) tm_touch_try_vertex_face(t, to, vertex, face);
}

/* Of two fresh edges the lower one tries. */
static void try_edge(const tm_touching *t, tm_touch_lists *to, int32_t edge, int32_t other) {
    if (other > edge)
        tm_touch_try_edges(t, to, edge, other);
    else if (!t->fresh[TM_TOUCH_EDGES].is[other])
        tm_touch_try_edges(t, to, other, edge);
}

static void search(tm_touching *t, int32_t part, int32_t parts, tm_touch_lists *to) {
    const double grow_m = (t->reach_m + t->margin_m) * (1 + 1e-6);
    tm_touch_clusters_try(t, TM_TOUCH_VERTICES, TM_TOUCH_FACES, part, parts, grow_m, try_vertex, to);
    if (t->fresh[TM_TOUCH_VERTICES].count < t->surface.vertex_count)
        tm_touch_clusters_try(t, TM_TOUCH_FACES, TM_TOUCH_VERTICES, part, parts, grow_m, try_face, to);
    tm_touch_clusters_try(t, TM_TOUCH_EDGES, TM_TOUCH_EDGES, part, parts, grow_m, try_edge, to);
}

static void place_features(tm_touching *t) {
    const tm_touch_surface *s = &t->surface;
    if (!t->clustered) {
        tm_touch_clusters_build(t, TM_TOUCH_VERTICES, s->vertex, s->vertex_count);
        tm_touch_clusters_build(t, TM_TOUCH_FACES, s->face, s->face_count);
        tm_touch_clusters_build(t, TM_TOUCH_EDGES, s->edge, s->edge_count);
    } else
        for (int kind = 0; kind < TM_TOUCH_KINDS; kind++)
            tm_touch_clusters_move(t, kind, t->fresh[kind].list, t->fresh[kind].count);
    t->clustered = true;
}

void tm_touch_search(tm_touching *t) {
    place_features(t);
    for (int kind = 0; kind < TM_TOUCH_KINDS; kind++)
        tm_touch_clusters_list(t->clusters + kind, t->fresh[kind].list, t->fresh[kind].count);
    tm_touch_divide(t, search, &t->near);
    for (int kind = 0; kind < TM_TOUCH_KINDS; kind++) tm_touch_clusters_forget(t->clusters + kind);
}
