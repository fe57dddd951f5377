/* Selects the surface of a patch: grown from the tool's contact and along its path. */
#include "patch/patch_internal.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

#define NEAR_M 0.02
#define LITTLE 0.1 /* share of the largest reaction below which a row's fans may be incomplete */
#define POOL 384   /* nearest triangles that are candidates for growth */

typedef struct near_triangle {
    double distance_m, load_N; /* load: of the rows on it, if loaded triangles come first */
    int32_t face, vertex[3];
    bool loaded, alongside, chosen; /* alongside: shares a vertex with a loaded one */
} near_triangle;

typedef struct growth {
    near_triangle pool[POOL];
    int32_t count;
    int32_t vertex[TM_PATCH_VERTICES], vertex_count, triangle_count;
    int32_t max_vertices, max_triangles;
} growth;

/* Returns the distance of the centroid of a triangle from the tip's path. */
static double way_distance(const double from[3], const double way[3], const double middle[3]) {
    double to[3], off[3], length2 = vdot(way, way);
    vsub(middle, from, to);
    vmadd(to, -(length2 > 0 ? law_clamp(vdot(to, way) / length2, 0, 1) : 0), way, off);
    return vnorm(off);
}

/* Order of the candidates, of which the nearest POOL are kept: equal distances by name, independent of slots. */
static bool farther(const near_triangle *a, const near_triangle *b) {
    if (a->loaded != b->loaded) return b->loaded;
    if (a->load_N != b->load_N) return a->load_N < b->load_N;
    if (a->alongside != b->alongside) return b->alongside;
    return a->distance_m != b->distance_m ? a->distance_m > b->distance_m : a->face > b->face;
}

static void keep_near(growth *g, const near_triangle *candidate) {
    if (g->count < POOL) {
        g->pool[g->count++] = *candidate;
        return;
    }
    int32_t worst = 0;
    for (int32_t i = 1; i < POOL; i++)
        if (farther(g->pool + i, g->pool + worst)) worst = i;
    if (farther(g->pool + worst, candidate)) g->pool[worst] = *candidate;
}

static bool has_vertex(const growth *g, int32_t vertex) {
    for (int32_t i = 0; i < g->vertex_count; i++)
        if (g->vertex[i] == vertex) return true;
    return false;
}

static int known_corners(const growth *g, const near_triangle *t) {
    int known = 0;
    for (int j = 0; j < 3; j++) known += has_vertex(g, t->vertex[j]);
    return known;
}

static void take(growth *g, near_triangle *t) {
    t->chosen = true;
    g->triangle_count++;
    for (int j = 0; j < 3; j++)
        if (!has_vertex(g, t->vertex[j])) g->vertex[g->vertex_count++] = t->vertex[j];
}

/* Returns the best triangle that fits: loaded ones anywhere, others along an edge of the patch; null if none. */
static near_triangle *next(growth *g) {
    near_triangle *best = NULL;
    for (int32_t i = 0; i < g->count; i++) {
        near_triangle *t = g->pool + i;
        int known = t->chosen ? 0 : known_corners(g, t);
        if (t->chosen || g->vertex_count + 3 - known > g->max_vertices) continue;
        if (g->triangle_count > 0 && known < 2 && !t->loaded) continue;
        if (!best || farther(best, t)) best = t;
    }
    return best;
}

static void sort_int(int32_t *a, int32_t n) {
    for (int32_t i = 1; i < n; i++) {
        int32_t moving = a[i], j = i;
        for (; j > 0 && a[j - 1] > moving; j--) a[j] = a[j - 1];
        a[j] = moving;
    }
}

static int8_t place_of(const tm_patch *patch, int32_t vertex) {
    int8_t i = 0;
    while (patch->vertex[i] != vertex) i++;
    return i;
}

static void write_patch(const growth *g, const double *rest_m, const double *u_m, tm_patch *patch) {
    patch->vertex_count = g->vertex_count;
    patch->triangle_count = 0;
    memcpy(patch->vertex, g->vertex, sizeof(int32_t) * (size_t)g->vertex_count);
    sort_int(patch->vertex, g->vertex_count);
    for (int32_t i = 0; i < 3 * g->vertex_count; i++) {
        int32_t dof = 3 * patch->vertex[i / 3] + i % 3;
        patch->rest_m[i] = rest_m[dof];
        patch->vertex_m[i] = rest_m[dof] + u_m[dof];
    }
    for (int32_t i = 0; i < g->count; i++)
        if (g->pool[i].chosen) patch->face[patch->triangle_count++] = g->pool[i].face;
    sort_int(patch->face, patch->triangle_count);
    for (int32_t k = 0; k < patch->triangle_count; k++)
        for (int32_t i = 0; i < g->count; i++)
            for (int j = 0; j < 3 && g->pool[i].face == patch->face[k]; j++)
                patch->triangle[3 * k + j] = place_of(patch, g->pool[i].vertex[j]);
}

/* Returns whether a corner of the triangle has some of the row's load. */
static bool bears_on(const tm_contact_row *row, const int32_t vertex[3]) {
    for (int j = 0; j < 9; j++)
        if (row->vertex[j / 3] == vertex[j % 3] && row->weight[j / 3] > 0) return true;
    return false;
}

/* Returns whether no corner, and so no part of the triangle, is within NEAR_M of the path. Rejects most of the surface
 * without a square root. */
static bool is_far(const double *rest_m, const double *u_m, const int32_t vertex[3], const double tip_m[3],
                   double way_m) {
    const double beyond_m =
        NEAR_M / 0.9 + way_m; /* t.distance_m contains nine tenths of the nearest corner's distance */
    for (int j = 0; j < 3; j++) {
        double to[3];
        for (int c = 0; c < 3; c++) to[c] = rest_m[3 * vertex[j] + c] + u_m[3 * vertex[j] + c] - tip_m[c];
        if (vdot(to, to) < beyond_m * beyond_m) return false;
    }
    return true;
}

int32_t tm_patch_grow(const double *rest_m, const double *u_m, const tm_surface_view *surface,
                      const tm_capsule *capsule, const double velocity_m_s[3], double horizon_s,
                      const tm_contact_row *row, int32_t row_count, int32_t max_vertices, int32_t max_triangles,
                      bool by_load, bool (*usable)(void *self, int32_t vertex), void *self, bool *fans,
                      tm_patch *patch) {
    growth g = {.max_vertices = max_vertices, .max_triangles = max_triangles};
    double way[3], most_N = 0;
    vscale(horizon_s, velocity_m_s, way);
    const double way_m = vnorm(way);
    for (int32_t k = 0; k < row_count; k++)
        if (row[k].instrument == capsule->instrument) most_N = fmax(most_N, row[k].lambda_N);
    for (int32_t i = 0; i < surface->count; i++) {
        const int32_t *corner = surface->triangle + 3 * i;
        near_triangle t = {.face = surface->face[i]};
        for (int32_t k = 0; k < row_count; k++) {
            if (row[k].face != t.face || row[k].instrument != capsule->instrument || !(row[k].lambda_N > 0)) continue;
            t.loaded = true;
            t.load_N += by_load ? row[k].lambda_N : 0;
        }
        if (!t.loaded && is_far(rest_m, u_m, corner, capsule->tip_m, way_m)) continue;
        double middle[3] = {0, 0, 0}, nearest = INFINITY;
        bool good = true;
        for (int j = 0; j < 3; j++) {
            t.vertex[j] = corner[j];
            double at[3];
            for (int c = 0; c < 3; c++) {
                at[c] = rest_m[3 * t.vertex[j] + c] + u_m[3 * t.vertex[j] + c];
                middle[c] += at[c] / 3;
            }
            nearest = fmin(nearest, way_distance(capsule->tip_m, way, at));
        }
        if (usable && (nearest < NEAR_M))
            good = usable(self, t.vertex[0]) && usable(self, t.vertex[1]) && usable(self, t.vertex[2]);
        /* By its nearest corner, so that the nearest vertices have complete fans: normals are blended over fans. */
        t.distance_m = 0.9 * nearest + 0.1 * way_distance(capsule->tip_m, way, middle);
        for (int32_t k = 0; k < row_count; k++) {
            if (row[k].instrument != capsule->instrument || !(row[k].lambda_N > 0)) continue;
            t.alongside = t.alongside || (row[k].lambda_N > LITTLE * most_N && bears_on(row + k, t.vertex));
        }
        if (good && (t.loaded || t.distance_m < NEAR_M)) keep_near(&g, &t);
    }
    for (near_triangle *t; g.triangle_count < max_triangles && (t = next(&g)) != NULL;) take(&g, t);
    write_patch(&g, rest_m, u_m, patch);
    *fans = true;
    for (int32_t i = 0; i < g.count; i++)
        *fans = *fans && (g.pool[i].chosen || !(g.pool[i].loaded || g.pool[i].alongside));
    return patch->triangle_count;
}

int32_t tm_patch_choose(const double *rest_m, const double *u_m, const tm_surface_view *surface,
                        const tm_capsule *capsule, const double velocity_m_s[3], double horizon_s,
                        const tm_contact_row *row, int32_t row_count, int32_t max_vertices, int32_t max_triangles,
                        tm_patch *patch) {
    TM_REQUIRE(rest_m && u_m && surface && capsule && velocity_m_s && patch && (row || row_count <= 0),
               "an argument is null", 0);
    TM_REQUIRE(max_vertices >= 3 && max_vertices <= TM_PATCH_VERTICES && max_triangles >= 1 &&
                   max_triangles <= TM_PATCH_TRIANGLES,
               "max_vertices or max_triangles is out of range", 0);
    bool fans;
    return tm_patch_grow(rest_m, u_m, surface, capsule, velocity_m_s, horizon_s, row, row_count, max_vertices,
                         max_triangles, false, NULL, NULL, &fans, patch);
}

/* --- vertices for the next patches --- */

#define FAR_M 0.04

typedef struct nearest {
    int32_t count, vertex[TM_COMPLIANCE_REQUEST_MAX];
    double distance_m[TM_COMPLIANCE_REQUEST_MAX];
} nearest;

/* Inserts a vertex in order. It comes once for each of its triangles, always with the same distance. */
static void offer(nearest *n, int32_t vertex, double distance_m) {
    if (n->count == TM_COMPLIANCE_REQUEST_MAX && !(distance_m < n->distance_m[n->count - 1])) return;
    for (int32_t i = 0; i < n->count; i++)
        if (n->vertex[i] == vertex) return;
    int32_t i = n->count < TM_COMPLIANCE_REQUEST_MAX ? n->count++ : n->count - 1;
    for (; i > 0 && n->distance_m[i - 1] > distance_m; i--) {
        n->vertex[i] = n->vertex[i - 1];
        n->distance_m[i] = n->distance_m[i - 1];
    }
    n->vertex[i] = vertex;
    n->distance_m[i] = distance_m;
}

int32_t tm_patch_nearest(const double *rest_m, const double *u_m, const tm_surface_view *surface,
                         const tm_capsule *capsule, const double velocity_m_s[3], double horizon_s,
                         const tm_contact_row *row, int32_t row_count, const double *inner, int32_t vertex_count,
                         int32_t vertex[TM_COMPLIANCE_REQUEST_MAX]) {
    nearest n = {0};
    double way[3];
    vscale(horizon_s, velocity_m_s, way);
    for (int32_t k = 0; k < row_count; k++)
        for (int j = 0; j < 3; j++)
            if (row[k].instrument == capsule->instrument && row[k].lambda_N > 0) offer(&n, row[k].vertex[j], -1);
    for (int32_t i = 0; i < (inner ? vertex_count : 3 * surface->count); i++) {
        double at[3];
        const int32_t v = inner ? i : surface->triangle[i];
        if (inner && !(inner[v] > 0)) continue;
        for (int c = 0; c < 3; c++) at[c] = rest_m[3 * v + c] + u_m[3 * v + c];
        const double distance_m = way_distance(capsule->tip_m, way, at);
        if (distance_m < FAR_M) offer(&n, v, distance_m);
    }
    memcpy(vertex, n.vertex, sizeof(int32_t) * (size_t)n.count);
    return n.count;
}

bool tm_patch_has_outside_load(const tm_patch *patch, double held_N, const tm_contact_row *row, int32_t row_count) {
    TM_REQUIRE(patch && (row || row_count <= 0), "patch or row is null", true);
    const double most = 0.2, least_N = 0.01; /* share of the tool's load; imperceptible force */
    double all = held_N, outside = 0;
    for (int32_t k = 0; k < row_count; k++) {
        if (row[k].instrument != patch->instrument || row[k].lambda_N <= 0) continue;
        all += row[k].lambda_N;
        bool whole = true;
        for (int j = 0; j < 3; j++) {
            bool within = row[k].weight[j] == 0;
            for (int32_t i = 0; i < patch->vertex_count && !within; i++) within = patch->vertex[i] == row[k].vertex[j];
            whole = whole && within;
        }
        outside += whole ? 0 : row[k].lambda_N;
    }
    return outside > law_max(most * all, least_N);
}
