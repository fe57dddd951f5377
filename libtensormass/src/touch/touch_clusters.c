/* Broad phase: boxes of the surface's features in clusters of neighbours, with a box around each cluster. Neighbours
 * are those along a Morton curve through the mesh at rest, body by body. Boxes are of places (touch_gather.c), in
 * single precision, rounded outward. What may be near a box is found by comparing it with the boxes of all clusters,
 * many at a time, then with those of the features of the few that overlap it. */
#include "touch/touch_internal.h"

#include "base/intrinsics.h"

#include <math.h>
#include <stdlib.h>

enum { WIDTH = TM_TOUCH_CLUSTER, NONE = -1 };

/* --- boxes --- */

/* Rounds down by more than the rounding to single precision. */
static float below(double x) { return (float)(x - 2e-7 * fabs(x) - 1e-30); }
static float above(double x) { return (float)(x + 2e-7 * fabs(x) + 1e-30); }

static const tm_touch_bounds nothing = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

static void set_bounds(tm_touch_boxes *boxes, int place, const tm_touch_bounds *b) {
    for (int c = 0; c < 3; c++) boxes->low[c][place] = b->low[c], boxes->high[c][place] = b->high[c];
}

static void get_bounds(const tm_touch_boxes *boxes, int place, tm_touch_bounds *b) {
    for (int c = 0; c < 3; c++) b->low[c] = boxes->low[c][place], b->high[c] = boxes->high[c][place];
}

static void widen(tm_touch_bounds *b, const tm_touch_bounds *by) {
    for (int c = 0; c < 3; c++) {
        b->low[c] = by->low[c] < b->low[c] ? by->low[c] : b->low[c];
        b->high[c] = by->high[c] > b->high[c] ? by->high[c] : b->high[c];
    }
}

static tm_touch_bounds around(const tm_touching *t, int kind, int32_t item) {
    int32_t vertex[3];
    const int count = tm_touch_vertices(t, kind, item, vertex);
    tm_touch_bounds b;
    for (int c = 0; c < 3; c++) {
        double low = t->place_m[3 * (int64_t)vertex[0] + c], high = low;
        for (int j = 1; j < count; j++) {
            const double x = t->place_m[3 * (int64_t)vertex[j] + c];
            low = law_min(low, x), high = law_max(high, x);
        }
        b.low[c] = below(low), b.high[c] = above(high);
    }
    return b;
}

tm_touch_bounds tm_touch_bounds_around(const double low[3], const double high[3], double grow_m) {
    tm_touch_bounds b;
    for (int c = 0; c < 3; c++) b.low[c] = below(low[c] - grow_m), b.high[c] = above(high[c] + grow_m);
    return b;
}

#ifdef TM_HAS_AVX2
/* Eight boxes: 1 in the lanes where an axis keeps them apart from the bounds. */
TM_AVX2 static inline __m256 apart(const tm_touch_boxes *boxes, int axis, int first, const tm_touch_bounds *b) {
    return _mm256_or_ps(
        _mm256_cmp_ps(_mm256_loadu_ps(boxes->low[axis] + first), _mm256_broadcast_ss(b->high + axis), _CMP_NLE_UQ),
        _mm256_cmp_ps(_mm256_loadu_ps(boxes->high[axis] + first), _mm256_broadcast_ss(b->low + axis), _CMP_NGE_UQ));
}

TM_AVX2 static uint32_t compare_wide(const tm_touch_boxes *boxes, const tm_touch_bounds *b) {
    uint32_t bits = 0;
    for (int first = 0; first < WIDTH; first += 8) {
        const __m256 no =
            _mm256_or_ps(_mm256_or_ps(apart(boxes, 0, first, b), apart(boxes, 1, first, b)), apart(boxes, 2, first, b));
        bits |= (uint32_t)(~_mm256_movemask_ps(no) & 0xff) << first;
    }
    return bits;
}
#endif

static uint32_t compare_plain(const tm_touch_boxes *boxes, const tm_touch_bounds *b) {
    int32_t hit[WIDTH];
    uint32_t bits = 0;
    for (int k = 0; k < WIDTH; k++)
        hit[k] = (boxes->low[0][k] <= b->high[0]) & (boxes->low[1][k] <= b->high[1]) &
                 (boxes->low[2][k] <= b->high[2]) & (boxes->high[0][k] >= b->low[0]) &
                 (boxes->high[1][k] >= b->low[1]) & (boxes->high[2][k] >= b->low[2]);
    for (int k = 0; k < WIDTH; k++) bits |= (uint32_t)hit[k] << k;
    return bits;
}

/* Returns a bit for each of the boxes that overlaps these bounds. */
static uint32_t compare(const tm_touch_clusters *c, const tm_touch_boxes *boxes, const tm_touch_bounds *b) {
#ifdef TM_HAS_AVX2
    if (c->wide) return compare_wide(boxes, b);
#endif
    (void)c;
    return compare_plain(boxes, b);
}

/* --- clusters --- */

static int32_t cluster_of(int32_t slot) { return slot / WIDTH; }

/* Computes the box of a cluster from those of its features. */
static void bound(tm_touch_clusters *c, int32_t cluster) {
    tm_touch_bounds all = nothing, one;
    for (int k = 0; k < WIDTH; k++) {
        get_bounds(&c->of[cluster].box, k, &one);
        widen(&all, &one);
    }
    set_bounds(c->around + cluster / WIDTH, cluster % WIDTH, &all);
}

void tm_touch_clusters_build(tm_touching *t, int kind, const int32_t *item, int32_t count) {
    tm_touch_clusters *c = t->clusters + kind;
    for (int64_t i = 0; i < c->items; i++) c->slot[i] = NONE;
    for (int32_t i = 0; i < count; i++) c->slot[item[i]] = 0;
    int32_t used = 0;
    for (int32_t i = 0; i < c->order_count; i++)
        for (int32_t k = c->order[i] * c->together; k < (c->order[i] + 1) * c->together; k++) {
            if (c->slot[k] == NONE) continue;
            const tm_touch_bounds b = around(t, kind, k);
            c->slot[k] = used;
            c->of[cluster_of(used)].item[used % WIDTH] = k;
            set_bounds(&c->of[cluster_of(used)].box, used % WIDTH, &b);
            used++;
        }
    c->count = (used + WIDTH - 1) / WIDTH;
    for (; used % WIDTH; used++) set_bounds(&c->of[cluster_of(used)].box, used % WIDTH, &nothing);
    for (int32_t k = 0; k < c->count; k++) bound(c, k);
    for (int32_t k = c->count; k % WIDTH; k++) set_bounds(c->around + k / WIDTH, k % WIDTH, &nothing);
}

/* With a bit for each of the features. */
void tm_touch_clusters_list(tm_touch_clusters *c, const int32_t *item, int32_t count) {
    for (int32_t i = 0; i < count; i++) {
        const int32_t slot = c->slot[item[i]], cluster = cluster_of(slot);
        if (!c->fresh[cluster]) c->listed[c->listed_count++] = cluster;
        c->fresh[cluster] |= (uint16_t)(1u << slot % WIDTH);
    }
}

void tm_touch_clusters_forget(tm_touch_clusters *c) {
    for (int32_t i = 0; i < c->listed_count; i++) c->fresh[c->listed[i]] = 0;
    c->listed_count = 0;
}

void tm_touch_clusters_move(tm_touching *t, int kind, const int32_t *item, int32_t count) {
    tm_touch_clusters *c = t->clusters + kind;
    for (int32_t i = 0; i < count; i++) {
        const tm_touch_bounds b = around(t, kind, item[i]);
        set_bounds(&c->of[cluster_of(c->slot[item[i]])].box, c->slot[item[i]] % WIDTH, &b);
    }
    tm_touch_clusters_list(c, item, count);
    for (int32_t i = 0; i < c->listed_count; i++) bound(c, c->listed[i]);
    tm_touch_clusters_forget(c);
}

/* --- finding --- */

int32_t tm_touch_clusters_find(const tm_touch_clusters *c, const tm_touch_bounds *b, int32_t *found) {
    int32_t count = 0;
    for (int32_t first = 0; first < c->count; first += WIDTH)
        for (uint32_t near = compare(c, c->around + first / WIDTH, b); near; near &= near - 1) {
            const tm_touch_cluster *of = c->of + first + __builtin_ctz(near);
            for (uint32_t hit = compare(c, &of->box, b); hit; hit &= hit - 1)
                found[count++] = of->item[__builtin_ctz(hit)];
        }
    return count;
}

/* Tries the features of one cluster that have a bit, with these bounds, with those of a cluster near them. */
static void try_clusters(const tm_touching *t, const tm_touch_clusters *c, int32_t cluster,
                         const tm_touch_bounds bounds[WIDTH], const tm_touch_cluster *near, tm_touch_try *try,
                         tm_touch_lists *to) {
    for (uint32_t own = c->fresh[cluster]; own; own &= own - 1) {
        const int place = __builtin_ctz(own);
        for (uint32_t hit = compare(c, &near->box, bounds + place); hit; hit &= hit - 1)
            try(t, to, c->of[cluster].item[place], near->item[__builtin_ctz(hit)]);
    }
}

/* Computes bounds around the features of a cluster that have a bit. Returns those around all. */
static tm_touch_bounds bounds_of(const tm_touch_clusters *c, int32_t cluster, double grow_m,
                                 tm_touch_bounds bounds[WIDTH]) {
    tm_touch_bounds all = nothing;
    for (uint32_t own = c->fresh[cluster]; own; own &= own - 1) {
        tm_touch_bounds *one = bounds + __builtin_ctz(own);
        get_bounds(&c->of[cluster].box, __builtin_ctz(own), one);
        for (int k = 0; k < 3; k++) one->low[k] -= (float)grow_m, one->high[k] += (float)grow_m;
        widen(&all, one);
    }
    return all;
}

void tm_touch_clusters_try(const tm_touching *t, int kind, int against, int32_t part, int32_t parts, double grow_m,
                           tm_touch_try *try, tm_touch_lists *to) {
    const tm_touch_clusters *c = t->clusters + kind, *others = t->clusters + against;
    for (int32_t i = part; i < c->listed_count; i += parts) {
        tm_touch_bounds bounds[WIDTH];
        const tm_touch_bounds all = bounds_of(c, c->listed[i], grow_m, bounds);
        for (int32_t first = 0; first < others->count; first += WIDTH)
            for (uint32_t near = compare(others, others->around + first / WIDTH, &all); near; near &= near - 1)
                try_clusters(t, c, c->listed[i], bounds, others->of + first + __builtin_ctz(near), try, to);
    }
}

/* --- creation --- */

/* Spreads 21 bits, two zeros between each. */
static uint64_t spread(uint64_t x) {
    x = (x | x << 32) & 0x1f00000000ffff, x = (x | x << 16) & 0x1f0000ff0000ff, x = (x | x << 8) & 0x100f00f00f00f00f;
    x = (x | x << 4) & 0x10c30c30c30c30c3;
    return (x | x << 2) & 0x1249249249249249;
}

typedef struct placed {
    uint64_t code;
    int32_t body, item;
} placed;

static int before(const void *a, const void *b) {
    const placed *p = a, *q = b;
    if (p->body != q->body) return p->body < q->body ? -1 : 1;
    if (p->code != q->code) return p->code < q->code ? -1 : 1;
    return p->item < q->item ? -1 : 1;
}

/* Returns the body of a feature's first vertex, and its place on a curve through a cube. */
static placed place_of(const tm_touching *t, int kind, int32_t item, const double low_m[3], double size_m) {
    const tm_mesh *mesh = t->world->tissue->mesh;
    const int32_t v = kind == TM_TOUCH_FACES   ? mesh->tet[4 * (int64_t)item]
                      : kind == TM_TOUCH_EDGES ? mesh->edge[2 * (int64_t)item]
                                               : item;
    const bool used = mesh->vertex_tet_begin[v + 1] > mesh->vertex_tet_begin[v];
    placed p = {.item = item,
                .body = t->tet_body && used ? t->tet_body[mesh->vertex_tet[mesh->vertex_tet_begin[v]]] : 0};
    for (int c = 0; c < 3; c++)
        p.code |= spread((uint64_t)(2097151 * law_clamp((mesh->rest_m[3 * (int64_t)v + c] - low_m[c]) / size_m, 0, 1)))
                  << c;
    return p;
}

static bool set_order(const tm_touching *t, int kind, tm_touch_clusters *c) {
    const tm_mesh *mesh = t->world->tissue->mesh;
    double low_m[3] = {INFINITY, INFINITY, INFINITY}, size_m = 1e-30;
    for (int64_t i = 0; i < 3 * (int64_t)mesh->vertex_count; i++) low_m[i % 3] = law_min(low_m[i % 3], mesh->rest_m[i]);
    for (int64_t i = 0; i < 3 * (int64_t)mesh->vertex_count; i++)
        size_m = law_max(size_m, mesh->rest_m[i] - low_m[i % 3]);
    tm_pool scratch = {0};
    placed *all = TM_ALLOC(&scratch, placed, c->order_count);
    for (int32_t i = 0; all && i < c->order_count; i++) all[i] = place_of(t, kind, i, low_m, size_m);
    if (all) qsort(all, (size_t)c->order_count, sizeof *all, before);
    for (int32_t i = 0; all && i < c->order_count; i++) c->order[i] = all[i].item;
    tm_pool_release(&scratch);
    return all != NULL;
}

bool tm_touch_clusters_init(tm_touching *t, tm_pool *pool, int kind, int32_t order_count, int together, int64_t most) {
    tm_touch_clusters *c = t->clusters + kind;
    const int64_t clusters = (most + WIDTH - 1) / WIDTH + 1;
    c->wide = t->world->wide;
    c->order_count = order_count, c->together = together, c->items = (int64_t)order_count * together;
    c->order = TM_ALLOC(pool, int32_t, order_count);
    c->slot = TM_ALLOC(pool, int32_t, c->items);
    c->of = TM_ALLOC(pool, tm_touch_cluster, clusters);
    c->around = TM_ALLOC(pool, tm_touch_boxes, (clusters + WIDTH - 1) / WIDTH);
    c->listed = TM_ALLOC(pool, int32_t, clusters);
    c->fresh = TM_ALLOC(pool, uint16_t, clusters);
    return !pool->failed && set_order(t, kind, c);
}
