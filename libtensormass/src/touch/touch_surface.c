/* Features of the tissue's surface: faces, vertices, and edges with their two faces. */
#include "touch/touch_internal.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

bool tm_touch_surface_init(tm_touch_surface *surface, tm_pool *pool, const tm_tissue *tissue) {
    const tm_mesh *mesh = tissue->mesh;
    /* a face is on the surface or has two active tetrahedra, so at most 4 faces a tetrahedron are */
    const int64_t faces = tissue->cuttable ? 4 * (int64_t)mesh->tet_count : mesh->surface_count;
    surface->max_faces = (int32_t)faces;
    surface->face = TM_ALLOC(pool, int32_t, faces);
    surface->before = TM_ALLOC(pool, int32_t, faces);
    surface->vertex = TM_ALLOC(pool, int32_t, mesh->vertex_count);
    surface->body = TM_ALLOC(pool, int32_t, mesh->vertex_count);
    surface->edge = TM_ALLOC(pool, int32_t, mesh->edge_count);
    surface->of_edge = TM_ALLOC(pool, int32_t, 2 * (int64_t)mesh->edge_count);
    return !pool->failed;
}

/* Returns the mesh's edges of a face; edge j leads from its vertex j to the next. */
static void edges_of(const tm_mesh *mesh, int32_t face, int32_t edge[3]) {
    static const int8_t edge_of[4][4] = {{0, 0, 1, 2}, {0, 0, 3, 4}, {1, 3, 0, 5}, {2, 4, 5, 0}};
    const int8_t *local = tm_face_vertex[face % 4];
    for (int j = 0; j < 3; j++)
        edge[j] = mesh->tet_edge[6 * (int64_t)(face / 4) + edge_of[local[j]][local[(j + 1) % 3]]];
}

enum { INSIDE = -1, WAS_OUTSIDE = -2 };

static void add_face(tm_touching *t, int32_t face) {
    tm_touch_surface *s = &t->surface;
    int32_t v[3], edge[3];
    tm_touch_triangle(t, face, v);
    edges_of(t->world->tissue->mesh, face, edge);
    s->face[s->face_count++] = face;
    for (int j = 0; j < 3; j++) {
        int32_t *of = s->of_edge + 2 * (int64_t)edge[j];
        t->fresh[TM_TOUCH_VERTICES].is[v[j]] |= s->body[v[j]] == INSIDE;
        s->body[v[j]] = tm_touch_body(t, face);
        of[of[0] >= 0] = face;
    }
}

static void list_vertices(tm_touching *t) {
    tm_touch_surface *s = &t->surface;
    for (int32_t v = 0; v < t->world->tissue->mesh->vertex_count; v++) {
        if (s->body[v] >= 0) s->vertex[s->vertex_count++] = v;
        if (s->body[v] != WAS_OUTSIDE) continue;
        s->body[v] = INSIDE, t->fresh[TM_TOUCH_VERTICES].is[v] = 1;
    }
}

/* Makes a face that came or went fresh, and its edges. */
static void mark_change(tm_touching *t, int32_t face, bool went) {
    int32_t edge[3];
    edges_of(t->world->tissue->mesh, face, edge);
    if (went)
        t->fresh[TM_TOUCH_FACES].is[face] = 1;
    else
        tm_touch_add_fresh(t, TM_TOUCH_FACES, face);
    for (int j = 0; j < 3; j++)
        if (tm_touch_is_on_surface(&t->surface, edge[j]))
            tm_touch_add_fresh(t, TM_TOUCH_EDGES, edge[j]);
        else
            t->fresh[TM_TOUCH_EDGES].is[edge[j]] = 1;
}

/* Finds the faces that are in one list alone; both lists ascend. */
static void mark_changes(tm_touching *t, int32_t before_count) {
    const tm_touch_surface *s = &t->surface;
    for (int32_t i = 0, k = 0; i < s->face_count || k < before_count;) {
        const int32_t now = i < s->face_count ? s->face[i] : INT32_MAX;
        const int32_t then = k < before_count ? s->before[k] : INT32_MAX;
        if (now != then) mark_change(t, now < then ? now : then, then < now);
        i += now <= then, k += then <= now;
    }
}

void tm_touch_surface_build(tm_touching *t) {
    tm_touch_surface *s = &t->surface;
    const tm_tissue *tissue = t->world->tissue;
    const tm_mesh *mesh = tissue->mesh;
    const int32_t before_count = s->face_count;
    memcpy(s->before, s->face, sizeof *s->face * (size_t)before_count);
    s->face_count = s->vertex_count = s->edge_count = 0;
    for (int32_t v = 0; v < mesh->vertex_count; v++) s->body[v] = s->body[v] >= 0 ? WAS_OUTSIDE : INSIDE;
    for (int64_t i = 0; i < 2 * (int64_t)mesh->edge_count; i++) s->of_edge[i] = -1;
    if (tissue->face_slot)
        for (int32_t f = 0; f < 4 * mesh->tet_count; f++) {
            if (tissue->face_slot[f] >= 0) add_face(t, f);
        }
    else
        for (int32_t i = 0; i < tissue->surface.count; i++) add_face(t, tissue->surface.face[i]);
    list_vertices(t);
    double sum = 0;
    for (int32_t e = 0; e < mesh->edge_count; e++) {
        if (!tm_touch_is_on_surface(s, e)) continue;
        double d[3];
        vsub(mesh->rest_m + 3 * mesh->edge[2 * e], mesh->rest_m + 3 * mesh->edge[2 * e + 1], d);
        sum += vnorm(d);
        s->edge[s->edge_count++] = e;
    }
    s->mean_edge_m = s->edge_count ? sum / s->edge_count : 0;
    t->revision = tissue->surface.revision;
    mark_changes(t, before_count);
    t->clustered = false;
}
