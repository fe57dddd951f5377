/* Blocks of a nonlinear law's force pass. */
#include "world/law_blocks.h"

enum { REALS = 12 * TM_LANES };           /* of a batch */
static const double TWICE_MAX = 1.0 / 16; /* largest share of the batches that partitions compute twice */

static int32_t smaller(int32_t a, int32_t b) { return a < b ? a : b; }
static int32_t larger(int32_t a, int32_t b) { return a > b ? a : b; }

/* Fills first and end; place / REALS is a corner's batch. */
static void find_needs(tm_law_blocks *b, const tm_tet_batches *packs, const int32_t *place) {
    const tm_mesh *mesh = packs->mesh;
    const int32_t n = mesh->vertex_count, *begin = mesh->vertex_tet_begin;
    b->first[n] = packs->count, b->end[0] = 0;
    for (int32_t v = n - 1; v >= 0; v--) {
        b->first[v] = b->first[v + 1];
        for (int32_t i = begin[v]; i < begin[v + 1]; i++) b->first[v] = smaller(b->first[v], place[i] / REALS);
    }
    for (int32_t v = 0; v < n; v++) {
        b->end[v + 1] = b->end[v];
        for (int32_t i = begin[v]; i < begin[v + 1]; i++) b->end[v + 1] = larger(b->end[v + 1], place[i] / REALS + 1);
    }
    b->first[0] = 0, b->end[n] = packs->count; /* a tetrahedron without a vertex here does not exist */
}

/* Returns the most batches that are in use at once. */
static int32_t ring_size(const tm_law_blocks *b, int32_t vertices) {
    int32_t most = 1;
    for (int32_t v = 0; v < vertices; v++)
        most = larger(most, b->end[smaller(v + TM_LAW_BLOCK, vertices)] - b->first[v]);
    return most;
}

bool tm_law_blocks_init(tm_law_blocks *b, tm_pool *pool, const tm_tet_batches *packs, const int32_t *place,
                        int32_t partitions, bool single) {
    const tm_mesh *mesh = packs->mesh;
    const int64_t corners = 4 * (int64_t)mesh->tet_count;
    b->first = TM_ALLOC(pool, int32_t, mesh->vertex_count + 1);
    b->end = TM_ALLOC(pool, int32_t, mesh->vertex_count + 1);
    if (pool->failed) return false;
    find_needs(b, packs, place);
    b->ring = ring_size(b, mesh->vertex_count);
    b->on = (partitions - 1) * (double)b->ring <= TWICE_MAX * packs->count;
    if (!b->on) return true;
    b->place = TM_ALLOC(pool, int32_t, corners);
    b->part = TM_ALLOC(pool, tm_law_ring, partitions + 1);
    for (int32_t p = 0; p <= partitions && !pool->failed; p++)
        b->part[p].corner_N = TM_ALLOC(pool, double, (single ? REALS / 2 : REALS) * (int64_t)b->ring);
    for (int64_t i = 0; i < corners && !pool->failed; i++)
        b->place[i] = place[i] / REALS % b->ring * REALS + place[i] % REALS;
    return !pool->failed;
}

/* Begins a pass over a partition's vertices. */
static void begin_part(const tm_law_blocks *b, const tm_world *world, const tm_range *range, tm_law_ring *part) {
    const int32_t p = range->partition, count = world->partition_count;
    const int32_t next = p < count - 1 ? world->partition[p + 1].force.begin : world->tissue->mesh->vertex_count;
    part->next = b->first[range->begin], part->own_end = b->first[next], part->beyond = 0;
}

const void *tm_law_blocks_compute(tm_law_blocks *b, const tm_world *world, const tm_range *range, int32_t begin,
                                  int32_t end, tm_law_stress stress, const void *self) {
    const int32_t p = range->partition;
    tm_law_ring *part = b->part + p;
    if (begin == (p < world->partition_count ? world->partition[p].force.begin : 0)) begin_part(b, world, range, part);
    while (part->next < b->end[end]) {
        const int32_t slot = part->next % b->ring, from = part->next;
        int32_t to = smaller(b->end[end], from + b->ring - slot);
        if (from < part->own_end) to = smaller(to, part->own_end);
        const int32_t beyond = stress(self, from, to, part->corner_N, slot);
        if (from < part->own_end) part->beyond += beyond;
        part->next = to;
    }
    return part->corner_N;
}

void tm_law_blocks_begin(tm_law_blocks *b, int32_t partitions) {
    for (int32_t p = 0; p <= partitions; p++) b->part[p].beyond = 0;
}

int32_t tm_law_blocks_beyond(const tm_law_blocks *b, int32_t partitions) {
    int32_t count = 0;
    for (int32_t p = 0; p <= partitions; p++) count += b->part[p].beyond;
    return count;
}

void tm_law_sum(const tm_mesh *mesh, const void *corner_N, const int32_t *place, int32_t begin, int32_t end,
                double *TM_RESTRICT force_N) {
    const int32_t *first = mesh->vertex_tet_begin;
    const double *corner = corner_N;
    for (int32_t v = begin; v < end; v++) {
        double x = 0, y = 0, z = 0;
        for (int32_t i = first[v]; i < first[v + 1]; i++) {
            const double *pull = corner + place[i];
            x -= pull[0], y -= pull[TM_LANES], z -= pull[2 * TM_LANES];
        }
        force_N[3 * v] = x, force_N[3 * v + 1] = y, force_N[3 * v + 2] = z;
    }
}

/* Sums are double. */
void tm_law_sum_single(const tm_mesh *mesh, const void *corner_N, const int32_t *place, int32_t begin, int32_t end,
                       double *TM_RESTRICT force_N) {
    const int32_t *first = mesh->vertex_tet_begin;
    const float *corner = corner_N;
    for (int32_t v = begin; v < end; v++) {
        double x = 0, y = 0, z = 0;
        for (int32_t i = first[v]; i < first[v + 1]; i++) {
            const float *pull = corner + place[i];
            x -= (double)pull[0], y -= (double)pull[TM_LANES], z -= (double)pull[2 * TM_LANES];
        }
        force_N[3 * v] = x, force_N[3 * v + 1] = y, force_N[3 * v + 2] = z;
    }
}
