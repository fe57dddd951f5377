/* Renumbers a mesh in Cuthill and McKee's order: breadth first from a vertex at an end of the mesh, neighbours with few
 * neighbours first. Converts between this order and the original one. */
#include "mesh/mesh_internal.h"

#include <stdlib.h>
#include <string.h>

/* Least vertex count worth renumbering: at 64 and 125 vertices a random order costs 0 to 6 % (docs/performance.md,
 * "Numbering"). */
enum { WORTH_VERTICES = 200 };
static const double worth_factor = 3;

/* --- breadth first --- */

typedef struct place {
    double x_m[3];
    int32_t vertex;
} place;

typedef struct walk {
    const tm_mesh *mesh;
    int32_t *rank, *of_rank; /* vertices by position: x, then y, then z */
    int32_t *seen, round;    /* the last round in which a vertex was seen, 0: never */
    uint64_t *key;           /* next neighbours: few neighbours first, then by rank */
} walk;

static int by_place(const void *a, const void *b) {
    const place *p = a, *q = b;
    for (int k = 0; k < 3; k++)
        if (p->x_m[k] != q->x_m[k]) return p->x_m[k] < q->x_m[k] ? -1 : 1;
    return (p->vertex > q->vertex) - (p->vertex < q->vertex);
}

static int by_key(const void *a, const void *b) {
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

static uint64_t key_of(const walk *w, int32_t v) {
    const uint32_t degree = (uint32_t)(w->mesh->vertex_edge_begin[v + 1] - w->mesh->vertex_edge_begin[v]);
    return (uint64_t)degree << 32 | (uint32_t)w->rank[v];
}

static void rank_places(walk *w, place *at) {
    const int32_t n = w->mesh->vertex_count;
    for (int32_t v = 0; v < n; v++) {
        for (int k = 0; k < 3; k++) at[v].x_m[k] = w->mesh->rest_m[3 * (int64_t)v + k];
        at[v].vertex = v;
    }
    qsort(at, (size_t)n, sizeof *at, by_place);
    for (int32_t i = 0; i < n; i++) {
        w->of_rank[i] = at[i].vertex;
        w->rank[at[i].vertex] = i;
    }
}

/* Collects the connected component around `start` into `queue`, level by level. Returns its vertex count; `*depth`:
 * number of levels; `*far`: the vertex of the last level with the fewest neighbours. */
static int32_t spread(walk *w, int32_t start, int32_t *queue, int32_t *depth, int32_t *far) {
    const tm_mesh *m = w->mesh;
    int32_t count = 0, level_end = 1, level_begin = 0;
    w->seen[start] = ++w->round;
    queue[count++] = start;
    *depth = 0;
    for (int32_t i = 0; i < count; i++) {
        if (i == level_end) {
            level_begin = i;
            level_end = count;
            ++*depth;
        }
        size_t keys = 0;
        for (int32_t e = m->vertex_edge_begin[queue[i]]; e < m->vertex_edge_begin[queue[i] + 1]; e++) {
            const int32_t *edge = m->edge + 2 * (int64_t)m->vertex_edge[e];
            const int32_t other = edge[0] == queue[i] ? edge[1] : edge[0];
            if (w->seen[other] == w->round) continue;
            w->seen[other] = w->round;
            w->key[keys++] = key_of(w, other);
        }
        qsort(w->key, keys, sizeof *w->key, by_key);
        for (size_t k = 0; k < keys; k++) queue[count++] = w->of_rank[(uint32_t)w->key[k]];
    }
    *far = queue[level_begin];
    for (int32_t i = level_begin; i < count; i++)
        if (key_of(w, queue[i]) < key_of(w, *far)) *far = queue[i];
    return count;
}

/* Orders component after component, each from an end: the farthest vertex from the farthest, until the distance grows
 * no more (George and Liu 1979). */
static void order(walk *w, int32_t *was) {
    const int32_t n = w->mesh->vertex_count;
    int32_t done = 0;
    for (int32_t i = 0; i < n; i++) {
        int32_t start = w->of_rank[i], depth = -1, count = 0;
        if (w->seen[start]) continue;
        for (int32_t deepest = -1;; deepest = depth) {
            count = spread(w, start, was + done, &depth, &start);
            if (depth <= deepest) break;
        }
        done += count;
    }
    for (int32_t i = 0; i < n / 2; i++) {
        const int32_t spare = was[i];
        was[i] = was[n - 1 - i];
        was[n - 1 - i] = spare;
    }
}

bool tm_mesh_numbering(const tm_mesh *mesh, int32_t *was) {
    TM_REQUIRE(mesh && was, "mesh or was is null", false);
    const int32_t n = mesh->vertex_count;
    tm_pool pool = {0};
    place *at = TM_ALLOC(&pool, place, n);
    walk w = {.mesh = mesh,
              .rank = TM_ALLOC(&pool, int32_t, n),
              .of_rank = TM_ALLOC(&pool, int32_t, n),
              .seen = TM_ALLOC(&pool, int32_t, n),
              .key = TM_ALLOC(&pool, uint64_t, n)};
    const bool good = !pool.failed;
    if (good) rank_places(&w, at);
    if (good) order(&w, was);
    tm_pool_release(&pool);
    return good;
}

/* --- tetrahedra --- */

typedef struct corners {
    int32_t vertex[4], tet; /* ascending new numbers, old number */
} corners;

static int by_corners(const void *a, const void *b) {
    const corners *p = a, *q = b;
    for (int k = 0; k < 4; k++)
        if (p->vertex[k] != q->vertex[k]) return p->vertex[k] < q->vertex[k] ? -1 : 1;
    return 0;
}

/* Inverts a numbering: new numbers of the old ones. */
static void turn_round(const int32_t *was, int32_t n, int32_t *now) {
    for (int32_t v = 0; v < n; v++) now[was[v]] = v;
}

bool tm_mesh_numbering_tets(const tm_mesh *mesh, const int32_t *was, int32_t *was_tet) {
    TM_REQUIRE(mesh && was && was_tet, "mesh, was or was_tet is null", false);
    tm_pool pool = {0};
    int32_t *now = TM_ALLOC(&pool, int32_t, mesh->vertex_count);
    corners *all = TM_ALLOC(&pool, corners, mesh->tet_count);
    const bool good = !pool.failed;
    if (good) turn_round(was, mesh->vertex_count, now);
    for (int32_t t = 0; good && t < mesh->tet_count; t++) {
        all[t].tet = t;
        for (int k = 0; k < 4; k++) {
            int32_t v = now[mesh->tet[4 * (int64_t)t + k]];
            int at = k;
            for (; at > 0 && all[t].vertex[at - 1] > v; at--) all[t].vertex[at] = all[t].vertex[at - 1];
            all[t].vertex[at] = v;
        }
    }
    if (good) qsort(all, (size_t)mesh->tet_count, sizeof *all, by_corners);
    for (int32_t t = 0; good && t < mesh->tet_count; t++) was_tet[t] = all[t].tet;
    tm_pool_release(&pool);
    return good;
}

/* --- quality of an order --- */

/* Computes tm_mesh_numbering's order `was` and its inverse `now` [vertex_count], and the statistics. */
static bool measure(const tm_mesh *mesh, int32_t *was, int32_t *now, tm_numbering_stats *out) {
    if (!tm_mesh_numbering(mesh, was)) return false;
    turn_round(was, mesh->vertex_count, now);
    double sum = 0, renumbered = 0;
    for (int32_t e = 0; e < mesh->edge_count; e++) {
        const int32_t k = mesh->edge[2 * (int64_t)e], l = mesh->edge[2 * (int64_t)e + 1];
        sum += abs(tm_mesh_original_vertex(mesh, l) - tm_mesh_original_vertex(mesh, k));
        renumbered += abs(now[l] - now[k]);
    }
    *out = (tm_numbering_stats){.distance = sum / mesh->edge_count, .renumbered = renumbered / mesh->edge_count};
    out->should_renumber = mesh->vertex_count >= WORTH_VERTICES && out->distance > worth_factor * out->renumbered;
    return true;
}

bool tm_mesh_numbering_measure(const tm_mesh *mesh, tm_numbering_stats *out) {
    TM_REQUIRE(mesh && out, "mesh or out is null", false);
    tm_pool pool = {0};
    int32_t *was = TM_ALLOC(&pool, int32_t, mesh->vertex_count), *now = TM_ALLOC(&pool, int32_t, mesh->vertex_count);
    const bool good = !pool.failed && measure(mesh, was, now, out);
    tm_pool_release(&pool);
    return good;
}

/* --- a mesh in a better order than the original --- */

bool tm_numbering_better(const tm_mesh *mesh, tm_pool *pool, tm_mesh_def *def, const int32_t **given) {
    *given = NULL;
    if (mesh->vertex_count < WORTH_VERTICES) return true;
    const int32_t n = mesh->vertex_count;
    tm_numbering_stats f;
    int32_t *was = TM_ALLOC(pool, int32_t, n), *now = TM_ALLOC(pool, int32_t, n);
    if (pool->failed || !measure(mesh, was, now, &f)) return false;
    if (!f.should_renumber) return true;
    double *vertex_m = TM_ALLOC(pool, double, 3 * (int64_t)n);
    int32_t *tet = TM_ALLOC(pool, int32_t, 4 * (int64_t)mesh->tet_count);
    if (pool->failed) return false;
    for (int32_t v = 0; v < n; v++)
        memcpy(vertex_m + 3 * (int64_t)v, def->vertex_m + 3 * (int64_t)was[v], 3 * sizeof *vertex_m);
    for (int64_t i = 0; i < 4 * (int64_t)mesh->tet_count; i++) tet[i] = now[def->tet[i]];
    def->vertex_m = vertex_m;
    def->tet = tet;
    *given = was;
    return true;
}

int32_t tm_mesh_original_vertex(const tm_mesh *mesh, int32_t vertex) {
    TM_REQUIRE(mesh && vertex >= 0 && vertex < mesh->vertex_count, "mesh is null or vertex is not one of its vertices",
               vertex);
    return mesh->original_vertex ? mesh->original_vertex[vertex] : vertex;
}

/* Copies values per vertex: from index v to its original number, or back. */
static void carry(const tm_mesh *mesh, int32_t components, const double *from, double *to, bool back) {
    const size_t c = (size_t)components;
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        const size_t own = c * (size_t)v, given = c * (size_t)tm_mesh_original_vertex(mesh, v);
        memcpy(to + (back ? own : given), from + (back ? given : own), c * sizeof *to);
    }
}

void tm_mesh_to_original(const tm_mesh *mesh, int32_t components, const double *from, double *to) {
    TM_REQUIRE(mesh && from && to && components > 0, "mesh, from or to is null, or components is not positive", );
    carry(mesh, components, from, to, false);
}

void tm_mesh_from_original(const tm_mesh *mesh, int32_t components, const double *from, double *to) {
    TM_REQUIRE(mesh && from && to && components > 0, "mesh, from or to is null, or components is not positive", );
    carry(mesh, components, from, to, true);
}
