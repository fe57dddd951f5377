/* Hashed grid of the broad phase: boxes in cells, and marks of cells where something has changed. */
#include "touch/touch_internal.h"

#include <string.h>

enum { ENTRIES_A_FACE = 24, MIN_BUCKETS = 64 };

bool tm_touch_grid_init(tm_touch_grid *g, tm_pool *pool, const tm_mesh *mesh) {
    g->capacity = ENTRIES_A_FACE * mesh->surface_count + 4 * mesh->tet_count + 4096;
    g->max_buckets = MIN_BUCKETS;
    while (g->max_buckets < 4 * mesh->surface_count && g->max_buckets < 1 << 20) g->max_buckets *= 2;
    g->begin = TM_ALLOC(pool, int32_t, g->max_buckets + 1);
    g->bucket = TM_ALLOC(pool, int32_t, g->capacity);
    g->key = TM_ALLOC(pool, int64_t, g->capacity);
    g->sorted_key = TM_ALLOC(pool, int64_t, g->capacity);
    g->item = TM_ALLOC(pool, int32_t, g->capacity);
    g->sorted = TM_ALLOC(pool, int32_t, g->capacity);
    g->box = TM_ALLOC(pool, tm_touch_box, mesh->edge_count);
    return !pool->failed;
}

/* Adds an item to all cells of its box. Returns false if the grid is full. */
static bool insert(tm_touch_grid *g, int32_t item, const tm_touch_box *b) {
    const tm_touch_cells c = tm_touch_cells_of(g->cell_m, b);
    if (c.count > g->capacity - g->count) return false;
    for (int64_t z = c.low[2]; z <= c.high[2]; z++)
        for (int64_t y = c.low[1]; y <= c.high[1]; y++)
            for (int64_t x = c.low[0]; x <= c.high[0]; x++) {
                g->key[g->count] = tm_touch_key(x, y, z);
                g->item[g->count++] = item;
            }
    return true;
}

/* Sorts the entries by bucket, in their order. */
static void sort_cells(tm_touch_grid *g) {
    g->buckets = MIN_BUCKETS;
    while (g->buckets < g->count && g->buckets < g->max_buckets) g->buckets *= 2;
    memset(g->begin, 0, sizeof *g->begin * ((size_t)g->buckets + 1));
    for (int32_t i = 0; i < g->count; i++) g->begin[(g->bucket[i] = tm_touch_bucket(g, g->key[i])) + 1]++;
    for (int32_t b = 0; b < g->buckets; b++) g->begin[b + 1] += g->begin[b];
    for (int32_t i = g->count - 1; i >= 0; i--) { /* from the end: begin[b+1] counts down to the bucket's begin */
        const int32_t at = --g->begin[g->bucket[i] + 1];
        g->sorted[at] = g->item[i], g->sorted_key[at] = g->key[i];
    }
    /* now begin[b+1] is the begin of bucket b */
    memmove(g->begin, g->begin + 1, sizeof *g->begin * (size_t)g->buckets);
    g->begin[g->buckets] = g->count;
}

/* Cells double until all boxes fit. */
bool tm_touch_grid_fill(tm_touch_grid *g, int32_t count) {
    bool whole = true;
    g->count = 0;
    for (int32_t i = 0; i < count; i++) {
        if (insert(g, i, g->box + i)) continue;
        whole = g->cell_m < 1;
        if (!whole) break;
        g->cell_m *= 2, g->count = 0, i = -1;
    }
    sort_cells(g);
    return whole;
}

/* --- marks --- */

void tm_touch_mark(tm_touch_marks *m, const tm_touch_box *b) {
    const tm_touch_cells c = tm_touch_cells_of(m->cell_m, b);
    if (c.count > TM_TOUCH_MARKS) {
        memset(m->bit, 0xff, sizeof m->bit);
        return;
    }
    for (int64_t z = c.low[2]; z <= c.high[2]; z++)
        for (int64_t y = c.low[1]; y <= c.high[1]; y++)
            for (int64_t x = c.low[0]; x <= c.high[0]; x++) {
                const uint32_t at = tm_touch_hash(tm_touch_key(x, y, z)) % TM_TOUCH_MARKS;
                m->bit[at / 64] |= (uint64_t)1 << at % 64;
            }
}

bool tm_touch_is_marked(const tm_touch_marks *m, const tm_touch_box *b) {
    const tm_touch_cells c = tm_touch_cells_of(m->cell_m, b);
    if (c.count > TM_TOUCH_MARKS) return true;
    for (int64_t z = c.low[2]; z <= c.high[2]; z++)
        for (int64_t y = c.low[1]; y <= c.high[1]; y++)
            for (int64_t x = c.low[0]; x <= c.high[0]; x++) {
                const uint32_t at = tm_touch_hash(tm_touch_key(x, y, z)) % TM_TOUCH_MARKS;
                if (m->bit[at / 64] >> at % 64 & 1) return true;
            }
    return false;
}
