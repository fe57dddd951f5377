/* Partitions of the vertices, one per thread, and their load balancing. The initial ends balance the estimated cost;
 * later ones the time measured for each thread, overlapped tasks included. Each partition computes the complete force
 * on its vertices (tm_force_partition), so results are bit-identical for any ends. */
#include "world/world_internal.h"

enum { ALIGNED = 8 /* vertices: complete cache lines of every array */ };

/* --- initial ends --- */

/* Cost of partitions, in edges: a vertex counts as two, an edge across an end in both partitions. */
typedef struct costs {
    tm_pool pool;
    int32_t count;        /* vertices */
    int32_t *lower_begin; /* [count+1] into lower */
    int32_t *lower;       /* lower neighbours of each vertex, ascending */
    const int32_t *upper_begin;
} costs;

static bool alloc_costs(const tm_tissue *tissue, costs *c) {
    const int32_t n = tissue->graph.vertex_count, pairs = tissue->pair_count;
    *c = (costs){.count = n, .upper_begin = tissue->graph.upper_begin};
    c->lower_begin = TM_ALLOC(&c->pool, int32_t, n + 2);
    c->lower = TM_ALLOC(&c->pool, int32_t, pairs);
    if (c->pool.failed) return false;
    for (int32_t p = 0; p < pairs; p++) c->lower_begin[tissue->pair[2 * (int64_t)p + 1] + 2]++;
    for (int32_t v = 0; v < n; v++) c->lower_begin[v + 2] += c->lower_begin[v + 1];
    for (int32_t p = 0; p < pairs; p++) /* each begin moves to its end, which is the next begin */
        c->lower[c->lower_begin[tissue->pair[2 * (int64_t)p + 1] + 1]++] = tissue->pair[2 * (int64_t)p];
    return true;
}

static int64_t cost_of(const costs *c, int32_t k, int32_t begin) {
    int64_t cost = c->upper_begin[k + 1] - c->upper_begin[k] + 2;
    for (int32_t i = c->lower_begin[k]; i < c->lower_begin[k + 1] && c->lower[i] < begin; i++) cost++;
    return cost;
}

/* Fills partitions one after the other up to this cost; returns false if the last exceeds it. */
static bool set_partition_ends(const costs *c, int64_t most, tm_partition *partition, int32_t count) {
    int32_t k = 0;
    for (int32_t p = 0; p < count; p++) {
        int64_t cost = 0;
        partition[p].force.begin = k;
        for (int32_t v = k; v < c->count; v++) {
            cost += cost_of(c, v, partition[p].force.begin);
            if (cost > most) break;
            if ((v + 1) % ALIGNED == 0 || v + 1 == c->count) k = v + 1;
        }
        partition[p].force.end = k;
    }
    return k == c->count;
}

/* Finds the ends with the smallest maximum cost, to a thousandth, by bisection on that cost. */
static bool divide(const tm_tissue *tissue, tm_partition *partition, int32_t count) {
    partition[0].force = tm_force_whole(&tissue->graph);
    if (count == 1) return true;
    costs c;
    const bool taken = alloc_costs(tissue, &c);
    if (taken) {
        const int64_t all = (int64_t)tissue->pair_count + 2 * (int64_t)c.count;
        int64_t low = all / count, high = 2 * all;
        while (high - low > all / (1000 * (int64_t)count) + 1) {
            const int64_t middle = (low + high) / 2;
            if (set_partition_ends(&c, middle, partition, count))
                high = middle;
            else
                low = middle;
        }
        set_partition_ends(&c, high, partition, count);
    }
    tm_pool_release(&c.pool);
    return taken;
}

/* --- halo --- */

/* Returns whether vertex j, before the partition, has an edge into it. Removed edges count, so a cut never changes the
 * halo. */
static bool reaches(const tm_tissue *tissue, int32_t j, const tm_force_partition *partition) {
    const int32_t first = tissue->graph.upper_begin[j];
    for (int32_t p = tissue->graph.upper_begin[j + 1] - 1; p >= first; p--) {
        const int32_t l = tissue->pair[2 * (int64_t)p + 1];
        if (l < partition->begin) return false;
        if (l < partition->end) return true;
    }
    return false;
}

static void find_halo(const tm_tissue *tissue, tm_partition *partition) {
    partition->force.halo_count = 0;
    for (int32_t j = 0; j < partition->force.begin; j++)
        if (reaches(tissue, j, &partition->force)) partition->halo[partition->force.halo_count++] = j;
    partition->force.halo = partition->halo;
}

bool tm_partition_init(tm_world *world, tm_pool *pool, const tm_tissue *tissue) {
    if (!divide(tissue, world->partition, world->partition_count)) return false;
    for (int32_t p = 1; p < world->partition_count; p++) {
        world->partition[p].halo = TM_ALLOC(pool, int32_t, tissue->graph.vertex_count);
        if (!world->partition[p].halo) return false;
        find_halo(tissue, world->partition + p);
    }
    return true;
}

/* --- load balancing --- */

void tm_partition_set_ends(tm_world *world, const int32_t *end) {
    for (int32_t p = 0; p < world->partition_count; p++) {
        tm_partition *partition = world->partition + p;
        const int32_t begin = p ? end[p - 1] : 0;
        if (begin == partition->force.begin && end[p] == partition->force.end) continue;
        partition->force.begin = begin, partition->force.end = end[p];
        if (p) find_halo(world->tissue, partition);
    }
}

/* Returns the cost of the vertices before k, in edges. Edges across ends are left to the measured time. */
static int64_t cost_before(const tm_force_graph *g, int32_t k) { return g->upper_begin[k] + 2 * (int64_t)k; }

/* Returns the last aligned vertex, from `low` on, with at most this cost before it. */
static int32_t place_of(const tm_force_graph *g, double cost, int32_t low) {
    int32_t a = low / ALIGNED, b = g->vertex_count / ALIGNED;
    while (a < b) {
        const int32_t middle = a + (b - a + 1) / 2;
        if ((double)cost_before(g, middle * ALIGNED) <= cost)
            a = middle;
        else
            b = middle - 1;
    }
    return a * ALIGNED;
}

/* Moves half of each thread's time above the mean to the other partitions. */
static void move(tm_world *world, double mean_s) {
    static const double GAIN = 0.5;
    const tm_force_graph *g = &world->tissue->graph;
    const int32_t count = world->partition_count, n = g->vertex_count;
    const double cost_1_s = (double)cost_before(g, n) / (mean_s * count);
    int32_t end[TM_MAX_THREADS];
    double cost = 0;
    for (int32_t p = 0; p < count; p++) {
        const tm_partition *partition = world->partition + p;
        const double own = (double)(cost_before(g, partition->force.end) - cost_before(g, partition->force.begin)),
                     wanted = own + GAIN * (mean_s - partition->sum_s) * cost_1_s;
        cost += wanted > 0 ? wanted : 0;
        end[p] = p + 1 < count ? place_of(g, cost, p ? end[p - 1] : 0) : n;
    }
    tm_partition_set_ends(world, end);
}

/* Adds the time of one job, capped at twice the usual time, so that a preempted thread hardly moves the ends. */
void tm_partition_record_time(tm_partition *partition, double took_s) {
    const double most = 2 * partition->usual_s;
    partition->sum_s += most > 0 && took_s > most ? most : took_s;
}

void tm_rebalance(tm_world *world) {
    enum { EVERY = 32 };
    static const double ALIKE = 0.01;
    double mean_s = 0, most_s = 0;
    if (++world->job_count < EVERY) return;
    for (int32_t p = 0; p < world->partition_count; p++) {
        const double sum_s = world->partition[p].sum_s;
        mean_s += sum_s / world->partition_count;
        most_s = sum_s > most_s ? sum_s : most_s;
    }
    if (mean_s > 0 && most_s > (1 + ALIKE) * mean_s) move(world, mean_s);
    for (int32_t p = 0; p < world->partition_count; p++) {
        world->partition[p].usual_s = world->partition[p].sum_s / EVERY;
        world->partition[p].sum_s = 0;
    }
    world->job_count = 0;
}
