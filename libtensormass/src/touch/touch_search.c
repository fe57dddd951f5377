/* Search of the pairs of fresh features: those with a fresh vertex, and those that a cut changed. They are listed from
 * their vertices, get new boxes, and are compared with the features in clusters near them. So a search costs what is
 * fresh. */
#include "touch/touch_internal.h"

#include <string.h>

/* --- fresh features --- */

void tm_touch_add_fresh(tm_touching *t, int kind, int32_t item) {
    tm_touch_fresh *fresh = t->fresh + kind;
    if (!fresh->is[item]) fresh->list[fresh->count++] = item;
    fresh->is[item] = 1;
}

/* Lists the faces and edges of a vertex. Faces in no cluster are inside, or of a cut and listed by it. */
static void list_around(tm_touching *t, int32_t v) {
    const tm_mesh *mesh = t->world->tissue->mesh;
    for (int32_t i = mesh->vertex_tet_begin[v]; i < mesh->vertex_tet_begin[v + 1]; i++)
        for (int32_t f = 4 * mesh->vertex_tet[i]; f < 4 * mesh->vertex_tet[i] + 4; f++)
            if (mesh->tet[f] != v && tm_touch_clusters_have(t->clusters + TM_TOUCH_FACES, f))
                tm_touch_add_fresh(t, TM_TOUCH_FACES, f);
    for (int32_t i = mesh->vertex_edge_begin[v]; i < mesh->vertex_edge_begin[v + 1]; i++)
        if (tm_touch_is_on_surface(&t->surface, mesh->vertex_edge[i]))
            tm_touch_add_fresh(t, TM_TOUCH_EDGES, mesh->vertex_edge[i]);
}

void tm_touch_list_fresh(tm_touching *t) {
    tm_touch_fresh *vertices = t->fresh + TM_TOUCH_VERTICES;
    vertices->count = 0;
    for (int32_t i = 0; i < t->surface.vertex_count; i++)
        if (vertices->is[t->surface.vertex[i]]) vertices->list[vertices->count++] = t->surface.vertex[i];
    for (int32_t i = 0; i < vertices->count; i++) list_around(t, vertices->list[i]);
}

static void list_all(tm_touch_fresh *fresh, const int32_t *item, int32_t count) {
    fresh->count = count;
    memcpy(fresh->list, item, sizeof *item * (size_t)count);
    for (int32_t i = 0; i < count; i++) fresh->is[item[i]] = 1;
}

void tm_touch_list_all(tm_touching *t) {
    const tm_touch_surface *s = &t->surface;
    list_all(t->fresh + TM_TOUCH_VERTICES, s->vertex, s->vertex_count);
    list_all(t->fresh + TM_TOUCH_FACES, s->face, s->face_count);
    list_all(t->fresh + TM_TOUCH_EDGES, s->edge, s->edge_count);
}

void tm_touch_forget_fresh(tm_touching *t) {
    for (int kind = 0; kind < TM_TOUCH_KINDS; kind++) {
        tm_touch_fresh *fresh = t->fresh + kind;
        for (int32_t i = 0; i < fresh->count; i++) fresh->is[fresh->list[i]] = 0;
        fresh->count = 0;
    }
}

void tm_touch_forget_removed(tm_touching *t) {
    for (int kind = 0; kind < TM_TOUCH_KINDS; kind++) memset(t->fresh[kind].is, 0, (size_t)t->clusters[kind].items);
}

/* --- pairs, each once --- */

static void try_vertex(tm_touching *t, int32_t vertex, int32_t face) { tm_touch_try_vertex_face(t, vertex, face); }

/* A fresh vertex tries this face itself. */
static void try_face(tm_touching *t, int32_t face, int32_t vertex) {
    if (!t->fresh[TM_TOUCH_VERTICES].is[vertex]) tm_touch_try_vertex_face(t, vertex, face);
}

/* Of two fresh edges the lower one tries. */
static void try_edge(tm_touching *t, int32_t edge, int32_t other) {
    if (other > edge)
        tm_touch_try_edges(t, edge, other);
    else if (!t->fresh[TM_TOUCH_EDGES].is[other])
        tm_touch_try_edges(t, other, edge);
}

static void search(tm_touching *t, int kind, int against, tm_touch_try *try) {
    const double grow_m = t->reach_m + t->margin_m;
    tm_touch_clusters_try(t, kind, against, t->fresh[kind].list, t->fresh[kind].count, grow_m * (1 + 1e-6), try);
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
    search(t, TM_TOUCH_VERTICES, TM_TOUCH_FACES, try_vertex);
    if (t->fresh[TM_TOUCH_VERTICES].count < t->surface.vertex_count)
        search(t, TM_TOUCH_FACES, TM_TOUCH_VERTICES, try_face);
    search(t, TM_TOUCH_EDGES, TM_TOUCH_EDGES, try_edge);
}
