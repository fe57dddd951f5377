/* Features of the tissue's surface: faces, vertices, and edges with their two faces. */
#include "touch/touch_internal.h"

#include <math.h>

#include "base/vec.h"

bool tm_touch_surface_init(tm_touch_surface *surface, tm_pool *pool, const tm_tissue *tissue) {
    const tm_mesh *mesh = tissue->mesh;
    /* a face is on the surface or has two active tetrahedra, so at most 4 faces a tetrahedron are */
    const int64_t faces = tissue->cuttable ? 4 * (int64_t)mesh->tet_count : mesh->surface_count;
    surface->face = TM_ALLOC(pool, int32_t, faces);
    surface->triangle = TM_ALLOC(pool, int32_t, 3 * faces);
    surface->vertex = TM_ALLOC(pool, int32_t, mesh->vertex_count);
    surface->body = TM_ALLOC(pool, int32_t, mesh->vertex_count);
    surface->edge = TM_ALLOC(pool, int32_t, mesh->edge_count);
    surface->of_edge = TM_ALLOC(pool, int32_t, 2 * (int64_t)mesh->edge_count);
    return !pool->failed;
}

static void add_face(tm_touching *t, int32_t face) {
    static const int8_t edge_of[4][4] = {{0, 0, 1, 2}, {0, 0, 3, 4}, {1, 3, 0, 5}, {2, 4, 5, 0}};
    tm_touch_surface *s = &t->surface;
    const tm_mesh *mesh = t->world->tissue->mesh;
    const int8_t *local = tm_face_vertex[face % 4];
    const int32_t at = s->face_count++;
    s->face[at] = face;
    for (int j = 0; j < 3; j++) {
        const int32_t v = mesh->tet[4 * (face / 4) + local[j]];
        const int32_t edge = mesh->tet_edge[6 * (face / 4) + edge_of[local[j]][local[(j + 1) % 3]]];
        s->triangle[3 * at + j] = v;
        s->body[v] = tm_touch_body(t, face);
        int32_t *of = s->of_edge + 2 * (int64_t)edge;
        of[of[0] >= 0] = at;
    }
}

void tm_touch_surface_build(tm_touching *t) {
    tm_touch_surface *s = &t->surface;
    const tm_tissue *tissue = t->world->tissue;
    const tm_mesh *mesh = tissue->mesh;
    s->face_count = s->vertex_count = s->edge_count = 0;
    for (int32_t v = 0; v < mesh->vertex_count; v++) s->body[v] = -1;
    for (int64_t i = 0; i < 2 * (int64_t)mesh->edge_count; i++) s->of_edge[i] = -1;
    if (tissue->face_slot)
        for (int32_t f = 0; f < 4 * mesh->tet_count; f++) {
            if (tissue->face_slot[f] >= 0) add_face(t, f);
        }
    else
        for (int32_t i = 0; i < tissue->surface.count; i++) add_face(t, tissue->surface.face[i]);
    for (int32_t v = 0; v < mesh->vertex_count; v++)
        if (s->body[v] >= 0) s->vertex[s->vertex_count++] = v;
    double sum = 0;
    for (int32_t e = 0; e < mesh->edge_count; e++) {
        if (s->of_edge[2 * (int64_t)e + 1] < 0) continue;
        double d[3];
        vsub(mesh->rest_m + 3 * mesh->edge[2 * e], mesh->rest_m + 3 * mesh->edge[2 * e + 1], d);
        sum += vnorm(d);
        s->edge[s->edge_count++] = e;
    }
    s->mean_edge_m = s->edge_count ? sum / s->edge_count : 0;
    t->revision = tissue->surface.revision;
    t->gathered = false;
}
