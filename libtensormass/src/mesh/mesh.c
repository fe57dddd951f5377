/* Mesh topology from vertices and tetrahedra: validation, edges, neighbours, surface, shape vectors. */
#include "mesh/mesh_internal.h"

#include <float.h>
#include <math.h>
#include <string.h>

const int8_t tm_face_vertex[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
const int8_t tm_edge_vertex[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};

/* The public mesh, and its pool. */
typedef struct owned_mesh {
    tm_mesh mesh;
    tm_pool pool;
} owned_mesh;

tm_mesh_def tm_mesh_def_default(void) { return (tm_mesh_def){.cookie = TM_COOKIE_MESH, .size = sizeof(tm_mesh_def)}; }

void tm_mesh_destroy(tm_mesh *mesh) {
    if (!mesh) return;
    tm_pool pool = ((owned_mesh *)mesh)->pool;
    tm_pool_release(&pool);
}

/* Returns 6 V; `noise`: the bound below which it may be rounding alone. */
static double six_volume(const double *p0, const double *p1, const double *p2, const double *p3, double *noise) {
    double a[3], b[3], c[3], n[3];
    vsub(p1, p0, a);
    vsub(p2, p0, b);
    vsub(p3, p0, c);
    vcross(a, b, n);
    *noise = 16 * DBL_EPSILON * sqrt(vdot(a, a)) * sqrt(vdot(b, b)) * sqrt(vdot(c, c));
    return vdot(n, c);
}

static tm_status check_vertices(const tm_mesh_def *def, tm_error *error) {
    for (int32_t v = 0; v < def->vertex_count; v++)
        for (int i = 0; i < 3; i++)
            if (!isfinite(def->vertex_m[3 * v + i]) || fabs(def->vertex_m[3 * v + i]) > 1e6)
                return tm_fail(error, TM_ERR_MESH, v,
                               "vertex %d: its %c coordinate is %g, not a finite number below 1e6 m; "
                               "repair the mesh file or its scale",
                               v, "xyz"[i], def -> vertex_m[3 * v + i]);
    return TM_OK;
}

static tm_status check_tet(const tm_mesh_def *def, int32_t t, tm_error *error) {
    const int32_t *v = def->tet + 4 * (int64_t)t;
    for (int i = 0; i < 4; i++) {
        if (v[i] < 0 || v[i] >= def->vertex_count)
            return tm_fail(error, TM_ERR_MESH, t, "tetrahedron %d: it has vertex %d of %d; give indices from 0 to %d",
                           t, v[i], def->vertex_count, def->vertex_count - 1);
        for (int j = 0; j < i; j++)
            if (v[i] == v[j])
                return tm_fail(error, TM_ERR_MESH, t,
                               "tetrahedron %d: it has vertex %d twice; remove it or repair the mesh", t, v[i]);
    }
    double noise;
    const double d = six_volume(def->vertex_m + 3 * (int64_t)v[0], def->vertex_m + 3 * (int64_t)v[1],
                                def->vertex_m + 3 * (int64_t)v[2], def->vertex_m + 3 * (int64_t)v[3], &noise);
    if (!(fabs(d) > noise) || !(fabs(d) > DBL_MIN))
        return tm_fail(error, TM_ERR_MESH, t,
                       "tetrahedron %d (vertices %d %d %d %d): it is flat, its volume is zero; remove it or mesh again",
                       t, v[0], v[1], v[2], v[3]);
    if (d < 0)
        return tm_fail(
            error, TM_ERR_MESH, t,
            "tetrahedron %d (vertices %d %d %d %d): its volume is %g m3, as its vertices are in negative order; "
            "swap two",
            t, v[0], v[1], v[2], v[3], d / 6);
    if (def->region && (def->region[t] < 0 || def->region[t] >= TM_MAX_REGIONS))
        return tm_fail(error, TM_ERR_MESH, t, "tetrahedron %d: region %d; number regions from 0 to %d", t,
                       def->region[t], TM_MAX_REGIONS - 1);
    return TM_OK;
}

/* Stable counting sort of `order` by key[order[i]], 0 <= key < keys; `start` has keys+1 entries. */
static void sort_by(int32_t *order, int32_t *scratch, const int32_t *key, int32_t count, int32_t keys, int32_t *start) {
    memset(start, 0, sizeof(int32_t) * ((size_t)keys + 1));
    for (int32_t i = 0; i < count; i++) start[key[i] + 1]++;
    for (int32_t k = 0; k < keys; k++) start[k + 1] += start[k];
    for (int32_t i = 0; i < count; i++) scratch[start[key[order[i]]]++] = order[i];
    memcpy(order, scratch, sizeof(int32_t) * (size_t)count);
}

/* Work space of the builder, freed when it is done. */
typedef struct work {
    tm_pool pool;
    int32_t *key[3], *order, *scratch, *start;
} work;

static void sort3(int32_t a[3]) {
    if (a[0] > a[1]) {
        int32_t t = a[0];
        a[0] = a[1];
        a[1] = t;
    }
    if (a[1] > a[2]) {
        int32_t t = a[1];
        a[1] = a[2];
        a[2] = t;
    }
    if (a[0] > a[1]) {
        int32_t t = a[0];
        a[0] = a[1];
        a[1] = t;
    }
}

/* Returns the side of a face, given by its ascending vertices, on which a tetrahedron of positive volume is. */
static bool even(const int32_t *tet, int i) {
    const int32_t a = tet[tm_face_vertex[i][0]], b = tet[tm_face_vertex[i][1]], c = tet[tm_face_vertex[i][2]];
    return (a < b) + (b < c) + (c < a) == 2;
}

static bool same_tet(const int32_t *a, const int32_t *b) {
    int shared = 0;
    for (int i = 0; i < 4; i++)
        for (int j = 0; j < 4; j++) shared += a[i] == b[j];
    return shared == 4;
}

static tm_status join_faces(tm_mesh *mesh, const int32_t face[], int32_t count, tm_error *error) {
    const int32_t t0 = face[0] / 4;
    if (count == 1) return TM_OK;
    const int32_t t1 = face[1] / 4;
    if (same_tet(mesh->tet + 4 * (int64_t)t0, mesh->tet + 4 * (int64_t)t1))
        return tm_fail(error, TM_ERR_MESH, t1,
                       "tetrahedron %d: it has the same vertices as tetrahedron %d; remove one of them", t1, t0);
    if (count > 2)
        return tm_fail(error, TM_ERR_MESH, face[2] / 4,
                       "tetrahedron %d: tetrahedra %d and %d share its face, which has two sides; remove the one that "
                       "overlaps",
                       face[2] / 4, t0, t1);
    if (even(mesh->tet + 4 * (int64_t)t0, face[0] % 4) == even(mesh->tet + 4 * (int64_t)t1, face[1] % 4))
        return tm_fail(error, TM_ERR_MESH, t1,
                       "tetrahedron %d: it overlaps tetrahedron %d, on one side of their common face; remove one", t1,
                       t0);
    mesh->tet_neighbour[face[0]] = t1;
    mesh->tet_neighbour[face[1]] = t0;
    return TM_OK;
}

static tm_status build_neighbours(tm_mesh *mesh, work *w, tm_error *error) {
    const int32_t faces = 4 * mesh->tet_count;
    for (int32_t f = 0; f < faces; f++) {
        const int32_t *v = mesh->tet + 4 * (int64_t)(f / 4);
        int32_t a[3];
        for (int i = 0; i < 3; i++) a[i] = v[tm_face_vertex[f % 4][i]];
        sort3(a);
        for (int i = 0; i < 3; i++) w->key[i][f] = a[i];
        w->order[f] = f;
        mesh->tet_neighbour[f] = -1;
    }
    for (int i = 2; i >= 0; i--) sort_by(w->order, w->scratch, w->key[i], faces, mesh->vertex_count, w->start);
    for (int32_t begin = 0, end; begin < faces; begin = end) {
        const int32_t f = w->order[begin];
        for (end = begin + 1; end < faces; end++) {
            const int32_t g = w->order[end];
            if (w->key[0][f] != w->key[0][g] || w->key[1][f] != w->key[1][g] || w->key[2][f] != w->key[2][g]) break;
        }
        tm_status status = join_faces(mesh, w->order + begin, end - begin, error);
        if (status) return status;
    }
    return TM_OK;
}

/* Sorts the 6 tet_count edge records and numbers the different ones; returns how many there are. */
static int32_t number_edges(tm_mesh *mesh, work *w) {
    const int32_t records = 6 * mesh->tet_count;
    for (int32_t r = 0; r < records; r++) {
        const int32_t *v = mesh->tet + 4 * (int64_t)(r / 6);
        const int32_t a = v[tm_edge_vertex[r % 6][0]], b = v[tm_edge_vertex[r % 6][1]];
        w->key[0][r] = a < b ? a : b;
        w->key[1][r] = a < b ? b : a;
        w->order[r] = r;
    }
    sort_by(w->order, w->scratch, w->key[1], records, mesh->vertex_count, w->start);
    sort_by(w->order, w->scratch, w->key[0], records, mesh->vertex_count, w->start);
    int32_t edges = -1;
    for (int32_t i = 0; i < records; i++) {
        const int32_t r = w->order[i], p = i ? w->order[i - 1] : r;
        if (i == 0 || w->key[0][r] != w->key[0][p] || w->key[1][r] != w->key[1][p]) edges++;
        mesh->tet_edge[r] = edges;
    }
    return edges + 1;
}

/* Lists, for each of `items`, the owners with it among their `width` entries, ascending. */
static void invert(const int32_t *entry, int32_t owners, int32_t width, int32_t items, int32_t *begin, int32_t *list) {
    for (int64_t i = 0; i < (int64_t)owners * width; i++) begin[entry[i] + 1]++;
    for (int32_t v = 0; v < items; v++) begin[v + 1] += begin[v];
    for (int32_t t = 0; t < owners; t++)
        for (int32_t i = 0; i < width; i++) list[begin[entry[(int64_t)t * width + i]]++] = t;
    for (int32_t v = items; v > 0; v--) begin[v] = begin[v - 1];
    begin[0] = 0;
}

static tm_status build_edges(tm_mesh *mesh, tm_pool *pool, work *w, tm_error *error) {
    mesh->edge_count = number_edges(mesh, w);
    mesh->edge = TM_ALLOC(pool, int32_t, 2 * (int64_t)mesh->edge_count);
    mesh->edge_tet_begin = TM_ALLOC(pool, int32_t, (int64_t)mesh->edge_count + 1);
    mesh->edge_tet = TM_ALLOC(pool, int32_t, 6 * (int64_t)mesh->tet_count);
    mesh->vertex_edge_begin = TM_ALLOC(pool, int32_t, (int64_t)mesh->vertex_count + 1);
    mesh->vertex_edge = TM_ALLOC(pool, int32_t, 2 * (int64_t)mesh->edge_count);
    if (pool->failed) return tm_fail_memory(error, "mesh");
    for (int32_t r = 0; r < 6 * mesh->tet_count; r++) {
        mesh->edge[2 * mesh->tet_edge[r]] = w->key[0][r];
        mesh->edge[2 * mesh->tet_edge[r] + 1] = w->key[1][r];
    }
    invert(mesh->tet_edge, mesh->tet_count, 6, mesh->edge_count, mesh->edge_tet_begin, mesh->edge_tet);
    invert(mesh->edge, mesh->edge_count, 2, mesh->vertex_count, mesh->vertex_edge_begin, mesh->vertex_edge);
    return TM_OK;
}

static tm_status build_surface(tm_mesh *mesh, tm_pool *pool, tm_error *error) {
    for (int32_t f = 0; f < 4 * mesh->tet_count; f++) mesh->surface_count += mesh->tet_neighbour[f] < 0;
    mesh->surface = TM_ALLOC(pool, int32_t, 3 * (int64_t)mesh->surface_count);
    mesh->surface_face = TM_ALLOC(pool, int32_t, mesh->surface_count);
    if (pool->failed) return tm_fail_memory(error, "mesh");
    int32_t n = 0;
    for (int32_t f = 0; f < 4 * mesh->tet_count; f++) {
        if (mesh->tet_neighbour[f] >= 0) continue;
        for (int i = 0; i < 3; i++)
            mesh->surface[3 * n + i] = mesh->tet[4 * (int64_t)(f / 4) + tm_face_vertex[f % 4][i]];
        mesh->surface_face[n++] = f;
    }
    return TM_OK;
}

static void build_shapes(tm_mesh *mesh) {
    for (int32_t t = 0; t < mesh->tet_count; t++) {
        const int32_t *v = mesh->tet + 4 * (int64_t)t;
        double d[3][3], *alpha = mesh->shape_1_m + 12 * (int64_t)t;
        for (int i = 0; i < 3; i++) vsub(mesh->rest_m + 3 * (int64_t)v[i + 1], mesh->rest_m + 3 * (int64_t)v[0], d[i]);
        for (int i = 0; i < 3; i++) vcross(d[(i + 1) % 3], d[(i + 2) % 3], alpha + 3 * (i + 1));
        double n[3];
        vcross(d[0], d[1], n);
        const double det = vdot(n, d[2]);
        for (int i = 3; i < 12; i++) alpha[i] /= det;
        for (int i = 0; i < 3; i++) alpha[i] = -(alpha[3 + i] + alpha[6 + i] + alpha[9 + i]);
        mesh->volume_m3[t] = det / 6;
    }
}

static tm_status take_and_copy(tm_mesh *mesh, tm_pool *pool, const tm_mesh_def *def, tm_error *error) {
    const int64_t n = def->vertex_count, m = def->tet_count;
    mesh->vertex_count = def->vertex_count;
    mesh->tet_count = def->tet_count;
    mesh->rest_m = TM_ALLOC(pool, double, 3 * n);
    mesh->tet = TM_ALLOC(pool, int32_t, 4 * m);
    mesh->region = TM_ALLOC(pool, int32_t, m);
    mesh->tet_edge = TM_ALLOC(pool, int32_t, 6 * m);
    mesh->tet_neighbour = TM_ALLOC(pool, int32_t, 4 * m);
    mesh->vertex_tet_begin = TM_ALLOC(pool, int32_t, n + 1);
    mesh->vertex_tet = TM_ALLOC(pool, int32_t, 4 * m);
    mesh->shape_1_m = TM_ALLOC(pool, double, 12 * m);
    mesh->volume_m3 = TM_ALLOC(pool, double, m);
    if (pool->failed) return tm_fail_memory(error, "mesh");
    memcpy(mesh->rest_m, def->vertex_m, sizeof(double) * 3 * (size_t)n);
    memcpy(mesh->tet, def->tet, sizeof(int32_t) * 4 * (size_t)m);
    if (def->region) memcpy(mesh->region, def->region, sizeof(int32_t) * (size_t)m);
    mesh->region_count = 1;
    for (int32_t t = 0; t < mesh->tet_count; t++)
        if (mesh->region[t] >= mesh->region_count) mesh->region_count = mesh->region[t] + 1;
    return TM_OK;
}

static tm_status alloc_work(const tm_mesh_def *def, work *w, tm_error *error) {
    const int64_t records = 6 * (int64_t)def->tet_count;
    for (int i = 0; i < 3; i++) w->key[i] = TM_ALLOC(&w->pool, int32_t, records);
    w->order = TM_ALLOC(&w->pool, int32_t, records);
    w->scratch = TM_ALLOC(&w->pool, int32_t, records);
    w->start = TM_ALLOC(&w->pool, int32_t, (int64_t)def->vertex_count + 1);
    return w->pool.failed ? tm_fail_memory(error, "mesh builder") : TM_OK;
}

static tm_status build(tm_mesh *mesh, tm_pool *pool, const tm_mesh_def *def, work *w, tm_error *error) {
    tm_status status = take_and_copy(mesh, pool, def, error);
    if (!status) status = alloc_work(def, w, error);
    if (status) return status;
    invert(mesh->tet, mesh->tet_count, 4, mesh->vertex_count, mesh->vertex_tet_begin, mesh->vertex_tet);
    for (int32_t v = 0; v < mesh->vertex_count; v++)
        if (mesh->vertex_tet_begin[v] == mesh->vertex_tet_begin[v + 1])
            return tm_fail(error, TM_ERR_MESH, v, "vertex %d: it is in no tetrahedron; remove it from the mesh", v);
    status = build_neighbours(mesh, w, error);
    if (!status) status = build_edges(mesh, pool, w, error);
    if (!status) status = build_surface(mesh, pool, error);
    if (!status) build_shapes(mesh);
    return status;
}

/* Builds a mesh. `given` null: original numbering. */
static tm_status make(const tm_mesh_def *def, const int32_t *given, tm_mesh **mesh, tm_error *error) {
    tm_pool pool = {0};
    work w = {0};
    owned_mesh *owned = TM_ALLOC(&pool, owned_mesh, 1);
    tm_status status = owned ? build(&owned->mesh, &pool, def, &w, error) : tm_fail_memory(error, "mesh");
    tm_pool_release(&w.pool);
    if (!status && given) {
        owned->mesh.original_vertex = TM_ALLOC(&pool, int32_t, def->vertex_count);
        if (pool.failed)
            status = tm_fail_memory(error, "mesh");
        else
            memcpy(owned->mesh.original_vertex, given, sizeof *given * (size_t)def->vertex_count);
    }
    if (status) {
        tm_pool_release(&pool);
        return status;
    }
    owned->mesh.bytes = pool.bytes;
    owned->pool = pool;
    *mesh = &owned->mesh;
    return TM_OK;
}

/* Replaces `*mesh` by one with a better order, where its order is poor. On failure there is no mesh. */
static tm_status renumber(const tm_mesh_def *def, tm_mesh **mesh, tm_error *error) {
    tm_pool pool = {0};
    tm_mesh_def better = *def;
    const int32_t *given;
    tm_status status = TM_OK;
    if (!tm_numbering_better(*mesh, &pool, &better, &given)) status = tm_fail_memory(error, "mesh numbering");
    if (status || given) { /* memory may not suffice for two */
        tm_mesh_destroy(*mesh);
        *mesh = NULL;
    }
    if (!status && given) status = make(&better, given, mesh, error);
    tm_pool_release(&pool);
    return status;
}

static tm_status check_def(const tm_mesh_def *def, tm_error *error) {
    if (def->renumber != TM_NUMBERING_ORIGINAL && def->renumber != TM_NUMBERING_IMPROVED)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "renumber is %d; give a value of tm_numbering", (int)def->renumber);
    if (def->vertex_count < 4 || def->tet_count < 1)
        return tm_fail(error, TM_ERR_MESH, -1,
                       "the mesh is empty: %d vertices, %d tetrahedra; give at least one tetrahedron",
                       def->vertex_count, def->tet_count);
    if (def->tet_count > INT32_MAX / 16 || def->vertex_count > INT32_MAX / 16)
        return tm_fail(error, TM_ERR_MESH, -1,
                       "the mesh has %d vertices and %d tetrahedra, and %d is the limit; use a coarser mesh",
                       def->vertex_count, def->tet_count, INT32_MAX / 16);
    return TM_OK;
}

tm_status tm_mesh_create(const tm_mesh_def *def, tm_mesh **mesh, tm_error *error) {
    TM_REQUIRE_DEF(def, TM_COOKIE_MESH, TM_ERR_ARGUMENT);
    TM_REQUIRE(mesh, "mesh is null", TM_ERR_ARGUMENT);
    tm_status status = check_def(def, error);
    if (status) return status;
    TM_REQUIRE(def->vertex_m && def->tet, "def->vertex_m or def->tet is null", TM_ERR_ARGUMENT);
    status = check_vertices(def, error);
    for (int32_t t = 0; t < def->tet_count && !status; t++) status = check_tet(def, t, error);
    tm_mesh *made = NULL;
    if (!status) status = make(def, NULL, &made, error); /* errors are reported in original numbers */
    if (!status && def->renumber == TM_NUMBERING_IMPROVED) status = renumber(def, &made, error);
    if (!status) *mesh = made;
    return status;
}

tm_tet_quality tm_mesh_tet_quality(const tm_mesh *mesh, int32_t tet) {
    TM_REQUIRE(mesh && tet >= 0 && tet < mesh->tet_count, "mesh is null or tet is not one of its tetrahedra",
               (tm_tet_quality){0});
    const int32_t *v = mesh->tet + 4 * (int64_t)tet;
    const double *alpha = mesh->shape_1_m + 12 * (int64_t)tet;
    tm_tet_quality q = {.volume_m3 = mesh->volume_m3[tet], .min_dihedral_rad = 4};
    double longest = 0, inverse_inradius = 0, steepest = 0;
    for (int i = 0; i < 4; i++) {
        /* |alpha_i| is one over the altitude; their sum is one over the inradius. */
        const double a = sqrt(vdot(alpha + 3 * i, alpha + 3 * i));
        inverse_inradius += a;
        if (a > steepest) steepest = a;
        for (int j = 0; j < i; j++) {
            double d[3];
            vsub(mesh->rest_m + 3 * (int64_t)v[i], mesh->rest_m + 3 * (int64_t)v[j], d);
            longest = fmax(longest, vdot(d, d));
            const double b = sqrt(vdot(alpha + 3 * j, alpha + 3 * j));
            const double cosine = -vdot(alpha + 3 * i, alpha + 3 * j) / (a * b);
            const double angle = acos(fmax(-1, fmin(1, cosine)));
            q.min_dihedral_rad = fmin(q.min_dihedral_rad, angle);
            q.max_dihedral_rad = fmax(q.max_dihedral_rad, angle);
        }
    }
    q.aspect = sqrt(longest) * inverse_inradius / (2 * sqrt(6.0));
    q.min_altitude_m = 1 / steepest;
    return q;
}

double tm_mesh_size_m(const tm_mesh *mesh) {
    double sum = 0;
    for (int i = 0; i < 3; i++) {
        double low = HUGE_VAL, high = -HUGE_VAL;
        for (int32_t v = 0; v < mesh->vertex_count; v++)
            low = fmin(low, mesh->rest_m[3 * v + i]), high = fmax(high, mesh->rest_m[3 * v + i]);
        sum += (high - low) * (high - low);
    }
    return sqrt(sum);
}
