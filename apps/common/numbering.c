/* Cuthill and McKee's order: breadth first from a vertex at an end of the mesh, neighbours of few neighbours first. */
#include "numbering.h"

#include <stdlib.h>

/* Below so many vertices everything is in the cache in any order (docs/performance.md, "Numbering"). */
enum { WORTH_VERTICES = 1000 };
static const double worth_factor = 3;

/* --- breadth first --- */

typedef struct place {
    double x_m[3];
    int32_t vertex;
} place;

typedef struct walk {
    const tm_mesh *mesh;
    int32_t *rank, *of_rank; /* vertices by place: x, then y, then z */
    int32_t *seen, round;    /* in which round a vertex was seen last, 0: never */
    uint64_t *key;           /* neighbours to come: few neighbours first, then by rank */
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

static bool rank_places(walk *w) {
    const int32_t n = w->mesh->vertex_count;
    place *at = malloc((size_t)n * sizeof *at);
    if (!at) return false;
    for (int32_t v = 0; v < n; v++) {
        for (int k = 0; k < 3; k++) at[v].x_m[k] = w->mesh->rest_m[3 * (int64_t)v + k];
        at[v].vertex = v;
    }
    qsort(at, (size_t)n, sizeof *at, by_place);
    for (int32_t i = 0; i < n; i++) {
        w->of_rank[i] = at[i].vertex;
        w->rank[at[i].vertex] = i;
    }
    free(at);
    return true;
}

/* The piece around `start` into `queue`, level by level. Returns how many vertices, `*depth` how many levels, `*far`
 * the vertex of the last level with the fewest neighbours. */
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

/* Piece after piece, each from an end: the farthest from the farthest, until that gets no farther (George and Liu
 * 1979). */
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

bool app_numbering(const tm_mesh *mesh, int32_t *was) {
    const size_t n = (size_t)mesh->vertex_count;
    walk w = {.mesh = mesh,
              .rank = malloc(n * sizeof *w.rank),
              .of_rank = malloc(n * sizeof *w.of_rank),
              .seen = calloc(n, sizeof *w.seen),
              .key = malloc(n * sizeof *w.key)};
    const bool good = w.rank && w.of_rank && w.seen && w.key && rank_places(&w);
    if (good) order(&w, was);
    free(w.rank);
    free(w.of_rank);
    free(w.seen);
    free(w.key);
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

/* New numbers of the old ones; null: no memory. */
static int32_t *turn_round(const int32_t *was, int32_t n) {
    int32_t *now = malloc((size_t)n * sizeof *now);
    for (int32_t v = 0; now && v < n; v++) now[was[v]] = v;
    return now;
}

bool app_numbering_tets(const tm_mesh *mesh, const int32_t *was, int32_t *was_tet) {
    int32_t *now = turn_round(was, mesh->vertex_count);
    corners *all = malloc((size_t)mesh->tet_count * sizeof *all);
    const bool good = now && all;
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
    free(now);
    free(all);
    return good;
}

/* --- how good an order is --- */

bool app_numbering_measure(const tm_mesh *mesh, app_numbering_figures *out) {
    int32_t *was = malloc((size_t)mesh->vertex_count * sizeof *was);
    int32_t *now = was && app_numbering(mesh, was) ? turn_round(was, mesh->vertex_count) : NULL;
    double sum = 0, renumbered = 0;
    for (int32_t e = 0; now && e < mesh->edge_count; e++) {
        const int32_t k = mesh->edge[2 * (int64_t)e], l = mesh->edge[2 * (int64_t)e + 1];
        sum += l - k;
        renumbered += abs(now[l] - now[k]);
    }
    *out = (app_numbering_figures){.distance = sum / mesh->edge_count, .renumbered = renumbered / mesh->edge_count};
    out->poor = mesh->vertex_count >= WORTH_VERTICES && out->distance > worth_factor * out->renumbered;
    const bool good = now != NULL;
    free(was);
    free(now);
    return good;
}
