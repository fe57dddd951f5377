/* Parallel stages. Stages that compute vertices one by one run together, a few hundred vertices at a time while they
 * are in the cache. Each partition has a thread of its own, and computes its vertices completely (tm_force_partition),
 * so results are bit-identical for any number of partitions. */
#include "world/world_internal.h"

#include <string.h>

/* Minimum tetrahedra per thread; fewer do not repay synchronisation. */
enum { MIN_TETS = 2000, BLOCK = 512 };

bool tm_partitions_init(tm_world *world, tm_pool *pool, const tm_world_def *def) {
    const tm_tissue *tissue = def->tissue;
    const int32_t worth = tissue->alive_count / MIN_TETS;
    const int32_t wanted = def->threads < worth ? def->threads : worth;
    world->partition_count = wanted > 1 ? wanted : 1;
    world->partition = TM_ALLOC(pool, tm_partition, world->partition_count + 1);
    if (!world->partition) return false;
    if (!tm_partition_init(world, pool, tissue)) return false;
    world->partition[world->partition_count].force = tm_force_whole(&tissue->graph);
    for (int32_t p = 0; p <= world->partition_count; p++)
        world->partition[p].force.ring = TM_ALLOC(pool, double, 4 * (int64_t)TM_FORCE_RING);
    world->parallel_for = def->parallel_for;
    world->parallel_for_user = def->parallel_for_user;
    if (world->partition_count == 1 || def->parallel_for) return !pool->failed;
    world->thread_pool = tm_thread_pool_create(world->partition_count);
    return !pool->failed && world->thread_pool;
}

/* --- running --- */

/* Returns whether no displacement exceeds `largest_m`, is infinite or NaN. Magnitudes of doubles are ordered like their
 * bits: adding the distance from the largest allowed one to the topmost bit sets that bit for all larger ones. Runs
 * after every substep; integers take one instruction less than comparisons. */
static inline __attribute__((always_inline)) bool are_bounded(const double *u, int32_t n, double largest_m) {
    uint64_t largest, word, beyond = 0;
    memcpy(&largest, &largest_m, sizeof largest);
    for (int32_t i = 0; i < n; i++) {
        memcpy(&word, u + i, sizeof word);
        beyond |= (word & INT64_MAX) + (INT64_MAX - largest);
    }
    return !(beyond >> 63);
}

/* The compiler checks four at a time. */
TM_AVX2 static bool are_bounded_wide(const double *u, int32_t n, double largest_m) {
    return are_bounded(u, n, largest_m);
}

static void check_range(const tm_world *world, tm_partition *partition, int32_t begin, int32_t end) {
    const double *u = world->state.u_next_m + 3 * (int64_t)begin;
    const int32_t n = 3 * (end - begin);
    if (!(world->wide ? are_bounded_wide(u, n, world->largest_m) : are_bounded(u, n, world->largest_m)))
        partition->unstable = true;
}

/* Checks the new displacements. Removed vertices are moved only by the caller, between calls: they are checked in the
 * first and the last substep. */
static void check_all(const tm_world *world, tm_partition *partition, int32_t begin, int32_t end) {
    enum { GAP = 64 }; /* vertices: skipping fewer removed ones does not pay */
    const uint64_t *active = world->tissue->graph.active;
    if (world->check_removed) {
        check_range(world, partition, begin, end);
        return;
    }
    for (int32_t from, to = begin; tm_next_run(active, end, &from, &to);) {
        for (int32_t next, last = to; tm_next_run(active, end, &next, &last) && next - to < GAP;) to = last;
        check_range(world, partition, from, to);
    }
}

bool tm_vertex_is_bounded(const tm_world *world, int32_t vertex) {
    return are_bounded(world->state.u_next_m + 3 * (int64_t)vertex, 3, world->largest_m);
}

double tm_max_increment_m(const tm_world *world) {
    double way_m = 0;
    for (int32_t p = 0; p < world->partition_count; p++)
        if (world->partition[p].force.end > world->partition[p].force.begin &&
            !(world->partition[p].max_increment_m <= way_m))
            way_m = world->partition[p].max_increment_m;
    return way_m;
}

typedef struct stages {
    tm_world *world;
    int32_t begin, end;         /* indices */
    bool look, timed, overlaps; /* timed: by the clock, for load balancing */
} stages;

/* The first partition attributes time for all of them. */
static void run_part(void *context, int32_t number) {
    const stages *s = context;
    tm_world *world = s->world;
    tm_partition *partition = world->partition + number;
    const bool timed = world->timing && number == 0;
    const double since_s = s->timed ? tm_clock_s() : 0;
    if (partition->unstable)
        partition->unstable = false; /* writes only on change: a store invalidates the line in other cores */
    if (s->overlaps) tm_overlaps_work(world, number);
    for (int32_t begin = partition->force.begin; begin < partition->force.end;) {
        const tm_range range = {number, begin,
                                begin + BLOCK < partition->force.end ? begin + BLOCK : partition->force.end};
        for (int32_t i = s->begin; i < s->end; i++) {
            if (timed) tm_profile_enter(world, i);
            world->entry[i].stage.range(world->entry[i].stage.self, world, &range);
        }
        if (s->look) check_all(world, partition, range.begin, range.end);
        begin = range.end;
    }
    if (timed && world->partition_count > 1)
        tm_profile_enter(world, TM_NO_STAGE); /* from here on it waits for others */
    if (s->timed) tm_partition_record_time(partition, tm_clock_s() - since_s);
}

/* Attributes the wait for other threads to all stages that ran, in the ratio of the caller's own times: not to the last
 * stage alone. */
static void profile_wait(tm_world *world, const double *before_s) {
    const double wait_s = tm_clock_s() - world->profiled_since_s;
    double own_s[TM_MAX_STAGES] = {0}, sum_s = 0;
    for (int32_t i = 0; i < world->stage_count; i++) {
        own_s[i] = world->entry[i].seconds - before_s[i]; /* 0 of those that did not run */
        sum_s += own_s[i];
    }
    for (int32_t i = 0; i < world->stage_count && sum_s > 0; i++) world->entry[i].seconds += wait_s * own_s[i] / sum_s;
}

static void check_partition(void *context, int32_t number) {
    tm_world *world = context;
    tm_partition *partition = world->partition + number;
    partition->unstable = false;
    check_all(world, partition, partition->force.begin, partition->force.end);
}

void tm_partitions_run(tm_world *world, void (*work)(void *context, int32_t part), void *context) {
    if (world->partition_count == 1)
        work(context, 0);
    else if (world->parallel_for && !world->evaluating)
        world->parallel_for(world->parallel_for_user, work, context, world->partition_count);
    else if (world->has_thread_pool)
        tm_thread_pool_run(world->thread_pool, work, context);
    else
        for (int32_t p = 0; p < world->partition_count; p++) work(context, p);
}

/* Runs work that checks displacements, and collects the results. Other work keeps the result of the last check, even of
 * a failed step. */
static void check_partitions(tm_world *world, void (*work)(void *context, int32_t part), void *context) {
    tm_partitions_run(world, work, context);
    for (int32_t p = 0; p < world->partition_count; p++) world->unstable |= world->partition[p].unstable;
}

/* Returns whether the stages [begin, end) go from the force to the new displacements. */
static bool is_force_job(const tm_world *world, int32_t begin, int32_t end) {
    return world->entry[begin].stage.phase <= TM_PHASE_FORCE && world->entry[end - 1].stage.phase >= TM_PHASE_INTEGRATE;
}

void tm_partitions_run_stages(tm_world *world, int32_t begin, int32_t end, bool look_too) {
    stages s = {.world = world, .begin = begin, .end = end, .look = look_too};
    const bool waits = world->timing && world->partition_count > 1;
    double before_s[TM_MAX_STAGES];
    for (int32_t i = 0; i < world->stage_count && waits; i++) before_s[i] = world->entry[i].seconds;
    if (world->partition_count > 1 && is_force_job(world, begin, end)) {
        s.timed = world->has_thread_pool;
        s.overlaps = tm_overlaps_begin(world, end);
    }
    check_partitions(world, run_part, &s);
    if (waits) profile_wait(world, before_s);
    if (s.timed) tm_rebalance(world);
}

void tm_partitions_check_bounded(tm_world *world) { check_partitions(world, check_partition, world); }

/* Wakes the threads if the call has enough substeps to repay it. */
void tm_partitions_begin(tm_world *world, int32_t substeps) {
    enum { MIN_SUBSTEPS = 4 };
    world->has_thread_pool = world->thread_pool && substeps >= MIN_SUBSTEPS;
    if (world->has_thread_pool) tm_thread_pool_begin(world->thread_pool);
}

void tm_partitions_end(tm_world *world) {
    if (world->has_thread_pool) tm_thread_pool_end(world->thread_pool);
    world->has_thread_pool = false;
}

void tm_stage_do(const tm_stage *stage, tm_world *world) {
    const tm_range whole = {world->partition_count, 0, world->tissue->mesh->vertex_count};
    if (stage->range)
        stage->range(stage->self, world, &whole);
    else
        stage->run(stage->self, world);
}
