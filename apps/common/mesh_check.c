/* Defects of a mesh, all of them, in the tags of its file. */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "mesh_check.h"
#include "mesh_format.h"

static const double largest_m = 1e6; /* of tm_mesh_create: beyond it differences of coordinates lose the millimetres */

typedef struct list {
    app_defect *defect;
    int64_t room, count;
} list;

static void add(list *l, app_defect_kind kind, int32_t vertex, int32_t tet, int32_t other) {
    if (l->count < l->room) l->defect[l->count] = (app_defect){kind, vertex, tet, other};
    l->count++;
}

double app_tet_volume6(const app_mesh *mesh, int32_t tet, double *rounding) {
    const double *p[4];
    double e[3][3], lengths = 1;
    for (int k = 0; k < 4; k++) p[k] = mesh->vertex_m + 3 * (size_t)mesh->tet[4 * (size_t)tet + (size_t)k];
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < 3; i++) e[k][i] = p[k + 1][i] - p[0][i];
        lengths *= sqrt(e[k][0] * e[k][0] + e[k][1] * e[k][1] + e[k][2] * e[k][2]);
    }
    *rounding = 16 * DBL_EPSILON * lengths;
    return (e[0][1] * e[1][2] - e[0][2] * e[1][1]) * e[2][0] + (e[0][2] * e[1][0] - e[0][0] * e[1][2]) * e[2][1] +
           (e[0][0] * e[1][1] - e[0][1] * e[1][0]) * e[2][2];
}

static int32_t repeated_vertex(const int32_t v[4]) {
    for (int k = 0; k < 4; k++)
        for (int l = 0; l < k; l++)
            if (v[k] == v[l]) return v[k];
    return -1;
}

static bool finite_tet(const app_mesh *m, int32_t t) {
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < 3; i++)
            if (!(fabs(m->vertex_m[3 * (size_t)m->tet[4 * t + k] + (size_t)i]) <= largest_m)) return false;
    return true;
}

static void check_vertices(const app_mesh *m, list *l) {
    for (int32_t v = 0; v < m->vertex_count; v++)
        for (int i = 0; i < 3; i++)
            if (!(fabs(m->vertex_m[3 * (size_t)v + (size_t)i]) <= largest_m)) {
                add(l, APP_DEFECT_NOT_FINITE, v, -1, -1);
                break;
            }
}

static void check_shapes(const app_mesh *m, list *l) {
    for (int32_t t = 0; t < m->tet_count; t++) {
        int32_t twice = repeated_vertex(m->tet + 4 * (size_t)t);
        if (twice >= 0) add(l, APP_DEFECT_VERTEX_TWICE, twice, t, -1);
    }
    for (app_defect_kind kind = APP_DEFECT_FLAT; kind <= APP_DEFECT_INVERTED; kind++)
        for (int32_t t = 0; t < m->tet_count; t++) {
            double rounding, volume6 = app_tet_volume6(m, t, &rounding);
            if (repeated_vertex(m->tet + 4 * (size_t)t) >= 0 || !finite_tet(m, t) || volume6 > rounding) continue;
            if ((volume6 < -rounding) == (kind == APP_DEFECT_INVERTED)) add(l, kind, -1, t, -1);
        }
}

typedef struct key {
    int32_t v[4], tet;
    bool even; /* the sorting took an even number of swaps, and so did the face's turn outward: which side the
                  tetrahedron is on */
} key;

static int by_key(const void *a, const void *b) {
    const key *x = a, *y = b;
    for (int i = 0; i < 4; i++)
        if (x->v[i] != y->v[i]) return x->v[i] < y->v[i] ? -1 : 1;
    return x->tet < y->tet ? -1 : x->tet > y->tet;
}

/* The sorted vertices of a tetrahedron without local vertex `without` (4: with all). */
static key key_of(const app_mesh *m, int32_t tet, int without) {
    key out = {{-1, -1, -1, -1}, tet, without % 2 == 0};
    int n = 0;
    for (int k = 0; k < 4; k++) {
        if (k == without) continue;
        int32_t v = m->tet[4 * tet + k];
        int at = n++;
        for (; at > 0 && out.v[at - 1] > v; at--, out.even = !out.even) out.v[at] = out.v[at - 1];
        out.v[at] = v;
    }
    return out;
}

static bool same(const key *a, const key *b) { return memcmp(a->v, b->v, sizeof a->v) == 0; }

static bool upright(const app_mesh *m, int32_t t) {
    double rounding;
    return app_tet_volume6(m, t, &rounding) > rounding;
}

static bool check_sharing(const app_mesh *m, list *l) {
    size_t tets = (size_t)m->tet_count;
    key *sorted = malloc((4 * tets + 1) * sizeof *sorted);
    if (!sorted) return false;
    for (int32_t t = 0; t < m->tet_count; t++) sorted[t] = key_of(m, t, 4);
    qsort(sorted, tets, sizeof *sorted, by_key);
    for (size_t i = 1; i < tets; i++)
        if (same(&sorted[i], &sorted[i - 1])) add(l, APP_DEFECT_TET_TWICE, -1, sorted[i].tet, sorted[i - 1].tet);
    for (size_t f = 0; f < 4 * tets; f++) sorted[f] = key_of(m, (int32_t)(f / 4), (int)(f % 4));
    qsort(sorted, 4 * tets, sizeof *sorted, by_key);
    for (size_t i = 2; i < 4 * tets; i++)
        if (same(&sorted[i], &sorted[i - 2]) && sorted[i].tet != sorted[i - 1].tet)
            add(l, APP_DEFECT_FACE_SHARED, -1, sorted[i].tet, sorted[i - 2].tet);
    for (size_t i = 1; i < 4 * tets; i++)
        if (same(&sorted[i], &sorted[i - 1]) && sorted[i].even == sorted[i - 1].even && upright(m, sorted[i].tet) &&
            upright(m, sorted[i - 1].tet))
            add(l, APP_DEFECT_OVERLAP, -1, sorted[i].tet, sorted[i - 1].tet);
    free(sorted);
    return true;
}

static bool check_used(const app_mesh *m, list *l) {
    uint8_t *used = calloc((size_t)m->vertex_count + 1, 1);
    if (!used) return false;
    for (int64_t i = 0; i < 4 * (int64_t)m->tet_count; i++) used[m->tet[i]] = 1;
    for (int32_t v = 0; v < m->vertex_count; v++)
        if (!used[v]) add(l, APP_DEFECT_UNUSED_VERTEX, v, -1, -1);
    free(used);
    return true;
}

int64_t app_mesh_defects(const app_mesh *mesh, app_defect *defect, int64_t room) {
    list l = {defect, room, 0};
    check_vertices(mesh, &l);
    check_shapes(mesh, &l);
    return check_sharing(mesh, &l) && check_used(mesh, &l) ? l.count : -1;
}

const char *app_defect_name(app_defect_kind kind) {
    static const char *const name[APP_DEFECT_KINDS] = {
        "coordinate not finite", "vertex twice in a tetrahedron", "flat",    "inverted",
        "tetrahedron twice",     "face shared by three",          "overlap", "unused vertex"};
    return name[kind];
}

void app_defect_text(const app_mesh *m, const app_defect *d, char *text, int size) {
    long long vertex = d->vertex >= 0 ? m->vertex_tag[d->vertex] : -1, tet = d->tet >= 0 ? m->tet_tag[d->tet] : -1;
    long long other = d->other >= 0 ? m->tet_tag[d->other] : -1;
    char corners[100] = "";
    if (d->tet >= 0) {
        const int32_t *v = m->tet + 4 * (size_t)d->tet;
        snprintf(corners, sizeof corners, "(vertices %lld %lld %lld %lld) ", (long long)m->vertex_tag[v[0]],
                 (long long)m->vertex_tag[v[1]], (long long)m->vertex_tag[v[2]], (long long)m->vertex_tag[v[3]]);
    }
    size_t room = (size_t)size;
    switch (d->kind) {
    case APP_DEFECT_NOT_FINITE:
        snprintf(text, room,
                 "vertex %lld has a coordinate that is nan, infinite or beyond 1000 km; correct it, or the scale",
                 vertex);
        break;
    case APP_DEFECT_VERTEX_TWICE:
        snprintf(text, room, "tetrahedron %lld %snames vertex %lld twice; remove it, or run tm-mesh repair", tet,
                 corners, vertex);
        break;
    case APP_DEFECT_FLAT:
        snprintf(text, room, "tetrahedron %lld %sis flat; move a vertex, remove it, or run tm-mesh repair", tet,
                 corners);
        break;
    case APP_DEFECT_INVERTED:
        snprintf(text, room, "tetrahedron %lld %sis inverted; swap two of its vertices, or run tm-mesh repair", tet,
                 corners);
        break;
    case APP_DEFECT_TET_TWICE:
        snprintf(text, room,
                 "tetrahedron %lld %shas the vertices of tetrahedron %lld; remove one, or run tm-mesh repair", tet,
                 corners, other);
        break;
    case APP_DEFECT_FACE_SHARED:
        snprintf(text, room, "tetrahedron %lld %sshares a face with tetrahedron %lld and a third; mesh the organ anew",
                 tet, corners, other);
        break;
    case APP_DEFECT_OVERLAP:
        snprintf(text, room,
                 "tetrahedron %lld %soverlaps tetrahedron %lld: both on one side of a face; mesh the organ anew", tet,
                 corners, other);
        break;
    case APP_DEFECT_UNUSED_VERTEX:
        snprintf(text, room, "vertex %lld is in no tetrahedron; remove it, or run tm-mesh repair", vertex);
        break;
    case APP_DEFECT_KINDS: break;
    }
}

tm_status app_mesh_build(const app_mesh *file, tm_mesh **mesh, tm_error *error) {
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = file->vertex_count;
    def.vertex_m = file->vertex_m;
    def.tet_count = file->tet_count;
    def.tet = file->tet;
    def.region = file->region;
    tm_status status = tm_mesh_create(&def, mesh, error);
    if (status != TM_ERR_MESH) return status;
    app_defect first;
    char text[TM_ERROR_MESSAGE_MAX];
    int64_t count = app_mesh_defects(file, &first, 1);
    if (count < 0) return app_mesh_fail(error, TM_ERR_MEMORY, -1, "no memory to check the mesh");
    if (count == 0) return status; /* in the library's own words and numbers */
    app_defect_text(file, &first, text, sizeof text);
    return app_mesh_fail(error, TM_ERR_MESH, first.tet >= 0 ? first.tet : first.vertex, "%s", text);
}
