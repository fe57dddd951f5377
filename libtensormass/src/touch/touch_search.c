/* Search of the pairs of fresh features: those with a fresh vertex, and those that a cut changed. They are listed from
 * their vertices, replaced in the grids, and taken in groups of neighbours. The features near a group are found once,
 * and each of the group is compared with them. So a search costs what is fresh. */
#include "touch/touch_internal.h"

#include <math.h>
#include <string.h>

/* --- boxes and balls --- */

static int corners_of(const tm_touching *t, int kind, int32_t item, int32_t vertex[3]) {
    const tm_mesh *mesh = t->world->tissue->mesh;
    if (kind == TM_TOUCH_FACES) {
        tm_touch_triangle(t, item, vertex);
        return 3;
    }
    if (kind == TM_TOUCH_VERTICES) {
        vertex[0] = item;
        return 1;
    }
    vertex[0] = mesh->edge[2 * (int64_t)item], vertex[1] = mesh->edge[2 * (int64_t)item + 1];
    return 2;
}

static const tm_touch_box nothing = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};

static tm_touch_box around(const tm_touching *t, int kind, int32_t item) {
    int32_t vertex[3];
    const int count = corners_of(t, kind, item, vertex);
    tm_touch_box b = nothing;
    for (int j = 0; j < count; j++)
        for (int c = 0; c < 3; c++) {
            const double x = t->place_m[3 * (int64_t)vertex[j] + c];
            b.low[c] = law_min(b.low[c], x), b.high[c] = law_max(b.high[c], x);
        }
    return b;
}

static tm_touch_ball ball_around(const tm_touch_box *box) {
    tm_touch_ball ball;
    double d2 = 0;
    for (int c = 0; c < 3; c++) {
        ball.middle[c] = 0.5 * (box->low[c] + box->high[c]);
        d2 += (box->high[c] - box->low[c]) * (box->high[c] - box->low[c]);
    }
    ball.radius_m = 0.5 * sqrt(d2);
    return ball;
}

/* --- fresh features --- */

void tm_touch_add_fresh(tm_touching *t, int kind, int32_t item) {
    tm_touch_fresh *fresh = t->fresh + kind;
    if (!fresh->is[item]) fresh->list[fresh->count++] = item;
    fresh->is[item] = 1;
}

/* Lists the faces and edges of a vertex. Faces that are not in the grid are inside, or of a cut and listed by it. */
static void list_around(tm_touching *t, int32_t v) {
    const tm_mesh *mesh = t->world->tissue->mesh;
    for (int32_t i = mesh->vertex_tet_begin[v]; i < mesh->vertex_tet_begin[v + 1]; i++)
        for (int32_t f = 4 * mesh->vertex_tet[i]; f < 4 * mesh->vertex_tet[i] + 4; f++)
            if (mesh->tet[f] != v && tm_touch_grid_has(t->grid + TM_TOUCH_FACES, f))
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
    const double cell_m = law_max(1.5 * s->mean_edge_m, t->reach_m);
    for (int kind = 0; kind < TM_TOUCH_KINDS; kind++) tm_touch_grid_clear(t->grid + kind, cell_m);
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
    for (int kind = 0; kind < TM_TOUCH_KINDS; kind++) memset(t->fresh[kind].is, 0, (size_t)t->grid[kind].items);
}

/* --- groups of neighbours --- */

/* Returns the cell of a feature, whatever its size. Features with the same are a group. */
static uint64_t group_of(const tm_touch_grid *g, int32_t item) {
    uint64_t cell = 0;
    for (int c = 0; c < 3; c++) cell = cell << 20 | (uint64_t)tm_touch_cell(g->cell_m, g->node[item].ball.middle[c]);
    return cell;
}

static int32_t bucket_of(uint64_t group) {
    return (int32_t)(group * 0x9e3779b97f4a7c15u >> (64 - TM_TOUCH_GROUP_BITS));
}

/* Sorts the fresh features by bucket. */
static void sort_groups(const tm_touch_grid *g, tm_touch_fresh *fresh) {
    enum { BUCKETS = 1 << TM_TOUCH_GROUP_BITS };
    memset(fresh->begin, 0, sizeof *fresh->begin * (BUCKETS + 1));
    for (int32_t i = 0; i < fresh->count; i++) fresh->begin[bucket_of(group_of(g, fresh->list[i])) + 1]++;
    for (int32_t k = 0; k < BUCKETS; k++) fresh->begin[k + 1] += fresh->begin[k];
    for (int32_t i = fresh->count - 1; i >= 0; i--) /* from the end: begin[k+1] counts down to the begin of bucket k */
        fresh->sorted[--fresh->begin[bucket_of(group_of(g, fresh->list[i])) + 1]] = fresh->list[i];
    memmove(fresh->begin, fresh->begin + 1, sizeof *fresh->begin * BUCKETS);
    fresh->begin[BUCKETS] = fresh->count;
}

/* Moves the group of the first feature to the front; returns its size. */
static int32_t take_group(const tm_touch_grid *g, int32_t *item, int32_t count) {
    const uint64_t group = group_of(g, item[0]);
    int32_t taken = 1;
    for (int32_t i = 1; i < count; i++) {
        if (group_of(g, item[i]) != group) continue;
        const int32_t other = item[taken];
        item[taken++] = item[i], item[i] = other;
    }
    return taken;
}

/* --- comparing --- */

/* Pads a count to complete vectors. */
enum { WIDTH = 16 };

/* Stores the boxes of the features found, relative to a middle, grown beyond rounding to float. */
static void store_boxes(const tm_touching *t, int kind, const double middle[3], double grow_m, tm_touch_near *near) {
    for (int32_t i = 0; i < near->count; i++) {
        const tm_touch_box box = around(t, kind, near->item[i]);
        for (int c = 0; c < 3; c++) {
            const double low = box.low[c] - middle[c] - grow_m, high = box.high[c] - middle[c] + grow_m;
            near->low[c][i] = (float)(low - 1e-6 * fabs(low)), near->high[c][i] = (float)(high + 1e-6 * fabs(high));
        }
    }
}

/* Adds a pair, each once: of a fresh vertex and a fresh face from the vertex, of two fresh edges from the lower one. */
static void try_pair(tm_touching *t, int kind, int32_t item, int32_t other) {
    if (kind == TM_TOUCH_VERTICES)
        tm_touch_try_vertex_face(t, item, other);
    else if (kind == TM_TOUCH_FACES && !t->fresh[TM_TOUCH_VERTICES].is[other])
        tm_touch_try_vertex_face(t, other, item);
    else if (kind == TM_TOUCH_EDGES && !(other <= item && t->fresh[TM_TOUCH_EDGES].is[other]))
        tm_touch_try_edges(t, item < other ? item : other, item < other ? other : item);
}

/* Sets hit[k] where box first + k overlaps this one; returns whether any does. */
static bool compare(const tm_touch_near *near, int32_t first, const float low[3], const float high[3],
                    int32_t hit[WIDTH]) {
    const float *l0 = near->low[0] + first, *l1 = near->low[1] + first, *l2 = near->low[2] + first;
    const float *h0 = near->high[0] + first, *h1 = near->high[1] + first, *h2 = near->high[2] + first;
    int32_t any = 0;
    for (int k = 0; k < WIDTH; k++) {
        hit[k] = (l0[k] <= high[0]) & (l1[k] <= high[1]) & (l2[k] <= high[2]) & (h0[k] >= low[0]) & (h1[k] >= low[1]) &
                 (h2[k] >= low[2]);
        any |= hit[k];
    }
    return any;
}

static void try_near(tm_touching *t, int kind, int32_t item, const double middle[3], const tm_touch_near *near) {
    const tm_touch_box box = around(t, kind, item);
    float low[3], high[3];
    int32_t hit[WIDTH];
    for (int c = 0; c < 3; c++) {
        const double l = box.low[c] - middle[c], h = box.high[c] - middle[c];
        low[c] = (float)(l - 1e-6 * fabs(l)), high[c] = (float)(h + 1e-6 * fabs(h));
    }
    for (int32_t first = 0; first < near->count; first += WIDTH) {
        if (!compare(near, first, low, high, hit)) continue;
        for (int32_t k = 0; k < WIDTH && first + k < near->count; k++)
            if (hit[k]) try_pair(t, kind, item, near->item[first + k]);
    }
}

static void search_group(tm_touching *t, int kind, int against, const int32_t *item, int32_t count,
                         tm_touch_near *near) {
    const double grow_m = t->reach_m + t->margin_m;
    tm_touch_box all = nothing;
    for (int32_t i = 0; i < count; i++) {
        const tm_touch_box box = around(t, kind, item[i]);
        for (int c = 0; c < 3; c++)
            all.low[c] = law_min(all.low[c], box.low[c]), all.high[c] = law_max(all.high[c], box.high[c]);
    }
    tm_touch_ball ball = ball_around(&all);
    ball.radius_m += grow_m;
    near->count = tm_touch_grid_find(t->grid + against, &ball, near->item);
    store_boxes(t, against, ball.middle, grow_m, near);
    for (int32_t i = 0; i < count; i++) try_near(t, kind, item[i], ball.middle, near);
}

static void search(tm_touching *t, int kind, int against, tm_touch_near *near) {
    tm_touch_fresh *fresh = t->fresh + kind;
    sort_groups(t->grid + kind, fresh);
    for (int32_t k = 0; k < 1 << TM_TOUCH_GROUP_BITS; k++)
        for (int32_t i = fresh->begin[k]; i < fresh->begin[k + 1];) {
            const int32_t count = take_group(t->grid + kind, fresh->sorted + i, fresh->begin[k + 1] - i);
            search_group(t, kind, against, fresh->sorted + i, count, near);
            i += count;
        }
}

/* Moves the fresh features to their places in the grid. */
static void place_features(tm_touching *t, int kind) {
    for (int32_t i = 0; i < t->fresh[kind].count; i++) {
        const tm_touch_box box = around(t, kind, t->fresh[kind].list[i]);
        const tm_touch_ball ball = ball_around(&box);
        tm_touch_grid_set(t->grid + kind, t->fresh[kind].list[i], &ball);
    }
}

void tm_touch_search_faces(tm_touching *t) {
    place_features(t, TM_TOUCH_VERTICES);
    place_features(t, TM_TOUCH_FACES);
    search(t, TM_TOUCH_VERTICES, TM_TOUCH_FACES, &t->near[0]);
    if (t->fresh[TM_TOUCH_VERTICES].count < t->surface.vertex_count)
        search(t, TM_TOUCH_FACES, TM_TOUCH_VERTICES, &t->near[0]);
}

void tm_touch_search_edges(tm_touching *t) {
    place_features(t, TM_TOUCH_EDGES);
    search(t, TM_TOUCH_EDGES, TM_TOUCH_EDGES, &t->near[1]);
}
