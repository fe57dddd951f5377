/* Hashed grid of the broad phase. It stays filled: a feature is replaced where its place changes. Each is in one cell,
 * that of its ball's middle, of the first level whose cells are as large as the ball, and cells double from level to
 * level. So balls that overlap another have their middles in its box widened by half a cell. The last level is one
 * cell. */
#include "touch/touch_internal.h"

#include <string.h>

enum { NONE = -1, LAST = TM_TOUCH_LEVELS - 1 };

bool tm_touch_grid_init(tm_touch_grid *g, tm_pool *pool, int64_t items, int32_t usual) {
    g->items = items;
    g->buckets = 64;
    while (g->buckets < usual && g->buckets < 1 << 20) g->buckets *= 2;
    g->head = TM_ALLOC(pool, int32_t, g->buckets);
    g->node = TM_ALLOC(pool, tm_touch_node, items);
    if (!pool->failed) tm_touch_grid_clear(g, 1);
    return !pool->failed;
}

void tm_touch_grid_clear(tm_touch_grid *g, double cell_m) {
    g->cell_m = cell_m;
    memset(g->count, 0, sizeof g->count);
    for (int32_t i = 0; i < g->buckets; i++) g->head[i] = NONE;
    for (int64_t i = 0; i < g->items; i++) g->node[i].key = NONE;
}

static int64_t key_of(int level, int64_t x, int64_t y, int64_t z) {
    return x | y << 20 | z << 40 | (int64_t)level << 60;
}

static int32_t *bucket_of(const tm_touch_grid *g, int64_t key) {
    return g->head + ((uint32_t)(((uint64_t)key * 0x9e3779b97f4a7c15u) >> 40) & (uint32_t)(g->buckets - 1));
}

static int level_of(int64_t key) { return (int)(key >> 60); }

void tm_touch_grid_remove(tm_touch_grid *g, int32_t item) {
    tm_touch_node *node = g->node + item;
    if (node->key == NONE) return;
    int32_t *at = bucket_of(g, node->key);
    while (*at != item) at = &g->node[*at].next;
    *at = node->next;
    g->count[level_of(node->key)]--;
    node->key = NONE;
}

void tm_touch_grid_set(tm_touch_grid *g, int32_t item, const tm_touch_ball *ball) {
    double cell_m = g->cell_m;
    int level = 0;
    int64_t cell[3] = {0};
    for (; level < LAST && !(2 * ball->radius_m <= cell_m); level++) cell_m *= 2; /* NaN: the last */
    for (int c = 0; c < 3 && level < LAST; c++) cell[c] = tm_touch_cell(cell_m, ball->middle[c]);
    const int64_t key = key_of(level, cell[0], cell[1], cell[2]);
    g->node[item].ball = *ball;
    if (g->node[item].key == key) return;
    tm_touch_grid_remove(g, item);
    int32_t *head = bucket_of(g, key);
    g->node[item].next = *head, *head = item;
    g->node[item].key = key;
    g->count[level]++;
}

static bool overlap(const tm_touch_ball *a, const tm_touch_ball *b) {
    double d2 = 0;
    for (int c = 0; c < 3; c++) d2 += (a->middle[c] - b->middle[c]) * (a->middle[c] - b->middle[c]);
    const double sum = a->radius_m + b->radius_m;
    return !(d2 > sum * sum * (1 + 1e-9));
}

typedef struct search {
    const tm_touch_grid *grid;
    const tm_touch_ball *ball;
    int32_t *found, count;
} search;

static void find_in_cell(search *s, int64_t key) {
    for (int32_t item = *bucket_of(s->grid, key); item != NONE; item = s->grid->node[item].next) {
        const tm_touch_node *node = s->grid->node + item;
        if (node->key == key && overlap(&node->ball, s->ball)) s->found[s->count++] = item;
    }
}

/* Looks at all of a level: where the grid has fewer buckets than the ball has cells. */
static void find_in_all(search *s, int level) {
    for (int32_t b = 0; b < s->grid->buckets; b++)
        for (int32_t item = s->grid->head[b]; item != NONE; item = s->grid->node[item].next) {
            const tm_touch_node *node = s->grid->node + item;
            if (level_of(node->key) == level && overlap(&node->ball, s->ball)) s->found[s->count++] = item;
        }
}

static void find_in_level(search *s, int level, double cell_m) {
    int64_t low[3], high[3];
    double cells = 1;
    const double reach_m = (s->ball->radius_m + 0.5 * cell_m) * (1 + 1e-9);
    for (int c = 0; c < 3; c++) {
        low[c] = tm_touch_cell(cell_m, s->ball->middle[c] - reach_m),
        high[c] = tm_touch_cell(cell_m, s->ball->middle[c] + reach_m);
        cells *= (double)(high[c] - low[c] + 1);
    }
    if (cells > s->grid->buckets) {
        find_in_all(s, level);
        return;
    }
    for (int64_t z = low[2]; z <= high[2]; z++)
        for (int64_t y = low[1]; y <= high[1]; y++)
            for (int64_t x = low[0]; x <= high[0]; x++) find_in_cell(s, key_of(level, x, y, z));
}

int32_t tm_touch_grid_find(const tm_touch_grid *g, const tm_touch_ball *ball, int32_t *found) {
    search s = {.grid = g, .ball = ball, .found = found};
    double cell_m = g->cell_m;
    for (int level = 0; level < LAST; level++, cell_m *= 2)
        if (g->count[level]) find_in_level(&s, level, cell_m);
    if (g->count[LAST]) find_in_cell(&s, key_of(LAST, 0, 0, 0));
    return s.count;
}
