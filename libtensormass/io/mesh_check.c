/* Finds all defects of a mesh, in the tags of its file. */
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/contract.h"
#include "mesh_format.h"
#include "place.h"

static const double largest_m = 1e6; /* limit of tm_mesh_create: beyond it differences of coordinates lose the
                                      * millimetres */

typedef struct list {
    tm_mesh_defect *defect;
    int64_t capacity, count;
} list;

static void add(list *l, tm_mesh_defect_kind kind, int32_t vertex, int32_t tet, int32_t other) {
    if (l->count < l->capacity) l->defect[l->count] = (tm_mesh_defect){kind, vertex, tet, other};
    l->count++;
}

/* Returns six times the volume and its rounding error: tm_mesh_create's own measure of flat. */
static double volume6_of(const tm_mesh_file *mesh, int32_t tet, double *rounding) {
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

static bool finite_tet(const tm_mesh_file *m, int32_t t) {
    for (int k = 0; k < 4; k++)
        for (int i = 0; i < 3; i++)
            if (!(fabs(m->vertex_m[3 * (size_t)m->tet[4 * t + k] + (size_t)i]) <= largest_m)) return false;
    return true;
}

static void check_vertices(const tm_mesh_file *m, list *l) {
    for (int32_t v = 0; v < m->vertex_count; v++)
        for (int i = 0; i < 3; i++)
            if (!(fabs(m->vertex_m[3 * (size_t)v + (size_t)i]) <= largest_m)) {
                add(l, TM_DEFECT_NOT_FINITE, v, -1, -1);
                break;
            }
}

static void check_shapes(const tm_mesh_file *m, list *l) {
    for (int32_t t = 0; t < m->tet_count; t++) {
        int32_t twice = repeated_vertex(m->tet + 4 * (size_t)t);
        if (twice >= 0) add(l, TM_DEFECT_VERTEX_TWICE, twice, t, -1);
    }
    for (tm_mesh_defect_kind kind = TM_DEFECT_FLAT; kind <= TM_DEFECT_INVERTED; kind++)
        for (int32_t t = 0; t < m->tet_count; t++) {
            double rounding, volume6 = volume6_of(m, t, &rounding);
            if (repeated_vertex(m->tet + 4 * (size_t)t) >= 0 || !finite_tet(m, t) || volume6 > rounding) continue;
            if ((volume6 < -rounding) == (kind == TM_DEFECT_INVERTED)) add(l, kind, -1, t, -1);
        }
}

typedef struct key {
    int32_t v[4], tet;
    bool even; /* sorting took an even number of swaps, and the face's outward rotation an even one: the side of the
                * tetrahedron */
} key;

static int by_key(const void *a, const void *b) {
    const key *x = a, *y = b;
    for (int i = 0; i < 4; i++)
        if (x->v[i] != y->v[i]) return x->v[i] < y->v[i] ? -1 : 1;
    return x->tet < y->tet ? -1 : x->tet > y->tet;
}

/* Returns the sorted vertices of a tetrahedron without local vertex `without` (4: all). */
static key key_of(const tm_mesh_file *m, int32_t tet, int without) {
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

static bool upright(const tm_mesh_file *m, int32_t t) {
    double rounding;
    return volume6_of(m, t, &rounding) > rounding;
}

static bool check_sharing(const tm_mesh_file *m, list *l) {
    size_t tets = (size_t)m->tet_count;
    key *sorted = malloc((4 * tets + 1) * sizeof *sorted);
    if (!sorted) return false;
    for (int32_t t = 0; t < m->tet_count; t++) sorted[t] = key_of(m, t, 4);
    qsort(sorted, tets, sizeof *sorted, by_key);
    for (size_t i = 1; i < tets; i++)
        if (same(&sorted[i], &sorted[i - 1])) add(l, TM_DEFECT_TET_TWICE, -1, sorted[i].tet, sorted[i - 1].tet);
    for (size_t f = 0; f < 4 * tets; f++) sorted[f] = key_of(m, (int32_t)(f / 4), (int)(f % 4));
    qsort(sorted, 4 * tets, sizeof *sorted, by_key);
    for (size_t i = 2; i < 4 * tets; i++)
        if (same(&sorted[i], &sorted[i - 2]) && sorted[i].tet != sorted[i - 1].tet)
            add(l, TM_DEFECT_FACE_SHARED, -1, sorted[i].tet, sorted[i - 2].tet);
    for (size_t i = 1; i < 4 * tets; i++)
        if (same(&sorted[i], &sorted[i - 1]) && sorted[i].even == sorted[i - 1].even && upright(m, sorted[i].tet) &&
            upright(m, sorted[i - 1].tet))
            add(l, TM_DEFECT_OVERLAP, -1, sorted[i].tet, sorted[i - 1].tet);
    free(sorted);
    return true;
}

static bool check_used(const tm_mesh_file *m, list *l) {
    uint8_t *used = calloc((size_t)m->vertex_count + 1, 1);
    if (!used) return false;
    for (int64_t i = 0; i < 4 * (int64_t)m->tet_count; i++) used[m->tet[i]] = 1;
    for (int32_t v = 0; v < m->vertex_count; v++)
        if (!used[v]) add(l, TM_DEFECT_UNUSED_VERTEX, v, -1, -1);
    free(used);
    return true;
}

int64_t tm_mesh_file_defects(const tm_mesh_file *mesh, tm_mesh_defect *defect, int64_t room) {
    TM_REQUIRE(mesh && (defect || room <= 0), "mesh or defect is null", 0);
    list l = {defect, room, 0};
    check_vertices(mesh, &l);
    check_shapes(mesh, &l);
    return check_sharing(mesh, &l) && check_used(mesh, &l) ? l.count : -1;
}

const char *tm_mesh_defect_name(tm_mesh_defect_kind kind) {
    static const char *const name[TM_DEFECT_KINDS] = {
        "coordinate not finite", "vertex twice in a tetrahedron", "flat",    "inverted",
        "tetrahedron twice",     "face shared by three",          "overlap", "unused vertex"};
    return name[kind];
}

void tm_mesh_defect_text(const tm_mesh_file *m, const tm_mesh_defect *d, char *text, int size) {
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
    case TM_DEFECT_NOT_FINITE:
        snprintf(text, room,
                 "vertex %lld has a coordinate that is nan, infinite or beyond 1000 km; correct it, or the scale",
                 vertex);
        break;
    case TM_DEFECT_VERTEX_TWICE:
        snprintf(text, room, "tetrahedron %lld %shas vertex %lld twice; remove it, or run tm-mesh repair", tet, corners,
                 vertex);
        break;
    case TM_DEFECT_FLAT:
        snprintf(text, room, "tetrahedron %lld %sis flat; move a vertex, remove it, or run tm-mesh repair", tet,
                 corners);
        break;
    case TM_DEFECT_INVERTED:
        snprintf(text, room, "tetrahedron %lld %sis inverted; swap two of its vertices, or run tm-mesh repair", tet,
                 corners);
        break;
    case TM_DEFECT_TET_TWICE:
        snprintf(text, room,
                 "tetrahedron %lld %shas the vertices of tetrahedron %lld; remove one, or run tm-mesh repair", tet,
                 corners, other);
        break;
    case TM_DEFECT_FACE_SHARED:
        snprintf(text, room, "tetrahedron %lld %sshares a face with tetrahedron %lld and a third; mesh the organ again",
                 tet, corners, other);
        break;
    case TM_DEFECT_OVERLAP:
        snprintf(text, room,
                 "tetrahedron %lld %soverlaps tetrahedron %lld: both are on one side of a face; mesh the organ again",
                 tet, corners, other);
        break;
    case TM_DEFECT_UNUSED_VERTEX:
        snprintf(text, room, "vertex %lld is in no tetrahedron; remove it, or run tm-mesh repair", vertex);
        break;
    case TM_DEFECT_KINDS: break;
    }
}

/* Converts an error of tm_mesh_create to the file's numbers, if its defects allow. */
static tm_status in_its_numbers(const tm_mesh_file *file, tm_error *error) {
    tm_mesh_defect first;
    char text[TM_ERROR_MESSAGE_MAX];
    const int64_t count = tm_mesh_file_defects(file, &first, 1);
    if (count < 0) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory to check the mesh; use a coarser one");
    if (count == 0) return TM_ERR_MESH; /* with the library's message and numbers */
    tm_mesh_defect_text(file, &first, text, sizeof text);
    return tm_fail(error, TM_ERR_MESH, first.tet >= 0 ? first.tet : first.vertex, "%s", text);
}

tm_status tm_mesh_file_build(const tm_mesh_file *file, tm_mesh **mesh, tm_error *error) {
    return tm_mesh_file_build_numbered(file, TM_NUMBERING_ORIGINAL, mesh, error);
}

tm_status tm_mesh_file_build_numbered(const tm_mesh_file *file, tm_numbering renumber, tm_mesh **mesh,
                                      tm_error *error) {
    TM_REQUIRE(file && mesh, "file or mesh is null", TM_ERR_ARGUMENT);
    tm_mesh_def def = tm_mesh_def_default();
    def.vertex_count = file->vertex_count;
    def.vertex_m = file->vertex_m;
    def.tet_count = file->tet_count;
    def.tet = file->tet;
    def.region = file->region;
    def.renumber = renumber;
    tm_status status = tm_mesh_create(&def, mesh, error);
    if (status == TM_ERR_MESH) status = in_its_numbers(file, error);
    return file->path ? tm_io_place(file->path, 0, status, error) : status;
}
