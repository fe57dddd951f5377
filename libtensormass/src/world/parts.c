/* A step's work in parts: stages that compute vertices one by one run together, a few hundred vertices at a time while
 * they are in the cache, each part by a thread of its own. A part computes its vertices whole (tm_force_part), so that
 * the bits are the same for any number of parts. */
#include "world/world_internal.h"

#include <string.h>

/* A part is worth a thread from this many tetrahedra on: below it, waiting for each other costs more. */
enum { LEAST_TETS = 2000, BLOCK = 512, ALIGNED = 8 /* vertices: whole cache lines of every array */ };

/* --- the division --- */

/* What parts cost, in edges: a vertex counts as two, and an edge that crosses a border in both. */
typedef struct costs {
    tm_pool pool;
    int32_t count;        /* vertices */
    int32_t *lower_begin; /* [count+1] into lower */
    int32_t *lower;       /* lower neighbours of each vertex, ascending */
    const int32_t *upper_begin;
} costs;

static bool take_costs(const tm_tissue *tissue, costs *c) {
    const int32_t n = tissue->graph.vertex_count, pairs = tissue->pair_count;
    *c = (costs){.count = n, .upper_begin = tissue->graph.upper_begin};
    c->lower_begin = TM_TAKE(&c->pool, int32_t, n + 2);
    c->lower = TM_TAKE(&c->pool, int32_t, pairs);
    if (c->pool.failed) return false;
    for (int32_t p = 0; p < pairs; p++) c->lower_begin[tissue->pair[2 * (int64_t)p + 1] + 2]++;
    for (int32_t v = 0; v < n; v++) c->lower_begin[v + 2] += c->lower_begin[v + 1];
    for (int32_t p = 0; p < pairs; p++) /* begins slide to their ends, and so to their places */
        c->lower[c->lower_begin[tissue->pair[2 * (int64_t)p + 1] + 1]++] = tissue->pair[2 * (int64_t)p];
    return true;
}

static int64_t cost_of(const costs *c, int32_t k, int32_t begin) {
    int64_t cost = c->upper_begin[k + 1] - c->upper_begin[k] + 2;
    for (int32_t i = c->lower_begin[k]; i < c->lower_begin[k + 1] && c->lower[i] < begin; i++) cost++;
    return cost;
}

/* Parts of at most this cost, one after the other; false: the last has to cost more. */
static bool set_borders(const costs *c, int64_t most, tm_part *part, int32_t count) {
    int32_t k = 0;
    for (int32_t p = 0; p < count; p++) {
        int64_t cost = 0;
        part[p].force.begin = k;
        for (int32_t v = k; v < c->count; v++) {
            cost += cost_of(c, v, part[p].force.begin);
            if (cost > most) break;
            if ((v + 1) % ALIGNED == 0 || v + 1 == c->count) k = v + 1;
        }
        part[p].force.end = k;
    }
    return k == c->count;
}

/* The least cost of the dearest part, to a thousandth. */
static bool divide(const tm_tissue *tissue, tm_part *part, int32_t count) {
    part[0].force = tm_force_whole(&tissue->graph);
    if (count == 1) return true;
    costs c;
    const bool taken = take_costs(tissue, &c);
    if (taken) {
        const int64_t all = (int64_t)tissue->pair_count + 2 * (int64_t)c.count;
        int64_t low = all / count, high = 2 * all;
        while (high - low > all / (1000 * (int64_t)count) + 1) {
            const int64_t middle = (low + high) / 2;
            if (set_borders(&c, middle, part, count))
                high = middle;
            else
                low = middle;
        }
        set_borders(&c, high, part, count);
    }
    tm_pool_release(&c.pool);
    return taken;
}

/* Has j an upper edge into the part? Of all that ever live. */
static bool reaches(const tm_tissue *tissue, int32_t j, const tm_force_part *part) {
    for (int32_t p = tissue->graph.upper_begin[j]; p < tissue->graph.upper_begin[j + 1]; p++) {
        const int32_t l = tissue->pair[2 * (int64_t)p + 1];
        if (l >= part->begin && l < part->end) return true;
    }
    return false;
}

static void find_below(const tm_tissue *tissue, tm_force_part *part, tm_pool *pool) {
    int32_t count = 0;
    for (int32_t j = 0; j < part->begin; j++) count += reaches(tissue, j, part);
    int32_t *below = TM_TAKE(pool, int32_t, count);
    if (!below) return;
    for (int32_t j = 0; j < part->begin; j++)
        if (reaches(tissue, j, part)) below[part->below_count++] = j;
    part->below = below;
}

bool tm_parts_take(tm_world *world, tm_pool *pool, const tm_world_def *def) {
    const tm_tissue *tissue = def->tissue;
    const int32_t worth = tissue->alive_count / LEAST_TETS;
    const int32_t wanted = def->threads < worth ? def->threads : worth;
    world->part_count = wanted > 1 ? wanted : 1;
    world->part = TM_TAKE(pool, tm_part, world->part_count + 1);
    if (!world->part) return false;
    if (!divide(tissue, world->part, world->part_count)) return false;
    for (int32_t p = 1; p < world->part_count; p++) find_below(tissue, &world->part[p].force, pool);
    world->part[world->part_count].force = tm_force_whole(&tissue->graph);
    for (int32_t p = 0; p <= world->part_count; p++)
        world->part[p].force.ring = TM_TAKE(pool, double, 4 * (int64_t)TM_FORCE_RING);
    world->run_parts = def->run_parts;
    world->run_parts_user = def->run_parts_user;
    if (world->part_count == 1 || def->run_parts) return !pool->failed;
    world->team = tm_team_create(world->part_count);
    return !pool->failed && world->team;
}

/* --- running --- */

/* No displacement is beyond 1e6 m, infinite or no number. Magnitudes of doubles are ordered as their bits are, so that
 * adding what is left from the largest one allowed to the topmost bit sets that bit for all beyond. Looked at after
 * every substep: whole words are an instruction less than comparisons. */
static inline __attribute__((always_inline)) bool sound(const double *u, int32_t n) {
    static const double LARGEST_DISPLACEMENT_M = 1e6;
    uint64_t largest, word, beyond = 0;
    memcpy(&largest, &LARGEST_DISPLACEMENT_M, sizeof largest);
    for (int32_t i = 0; i < n; i++) {
        memcpy(&word, u + i, sizeof word);
        beyond |= (word & INT64_MAX) + (INT64_MAX - largest);
    }
    return !(beyond >> 63);
}

/* The compiler looks at four at a time. */
TM_AVX2 static bool sound_wide(const double *u, int32_t n) { return sound(u, n); }

/* At the new displacements. */
static void look(const tm_world *world, tm_part *part, int32_t begin, int32_t end) {
    const double *u = world->state.u_next_m + 3 * (int64_t)begin;
    const int32_t n = 3 * (end - begin);
    if (!(world->wide ? sound_wide(u, n) : sound(u, n))) part->unsound = true;
}

typedef struct stages {
    tm_world *world;
    int32_t begin, end; /* slots */
    bool look;
} stages;

/* Time is booked by the first part for all of them. */
static void run_part(void *context, int32_t number) {
    const stages *s = context;
    tm_world *world = s->world;
    tm_part *part = world->part + number;
    const bool timed = world->timing && number == 0;
    part->unsound = false;
    for (int32_t begin = part->force.begin; begin < part->force.end;) {
        const tm_range range = {number, begin, begin + BLOCK < part->force.end ? begin + BLOCK : part->force.end};
        for (int32_t i = s->begin; i < s->end; i++) {
            if (timed) tm_world_charge(world, i);
            world->slot[i].stage.range(world->slot[i].stage.self, world, &range);
        }
        if (s->look) look(world, part, range.begin, range.end);
        begin = range.end;
    }
}

static void look_at_part(void *context, int32_t number) {
    tm_world *world = context;
    tm_part *part = world->part + number;
    part->unsound = false;
    look(world, part, part->force.begin, part->force.end);
}

void tm_parts_do(tm_world *world, void (*work)(void *context, int32_t part), void *context) {
    if (world->part_count == 1)
        work(context, 0);
    else if (world->run_parts && !world->asking)
        world->run_parts(world->run_parts_user, work, context, world->part_count);
    else if (world->team_is_there)
        tm_team_run(world->team, work, context);
    else
        for (int32_t p = 0; p < world->part_count; p++) work(context, p);
}

/* Of work that looks; other work leaves alone what the last look found, be it of a step that failed. */
static void look_by_parts(tm_world *world, void (*work)(void *context, int32_t part), void *context) {
    tm_parts_do(world, work, context);
    for (int32_t p = 0; p < world->part_count; p++) world->unsound |= world->part[p].unsound;
}

void tm_parts_run_stages(tm_world *world, int32_t begin, int32_t end, bool look_too) {
    stages s = {world, begin, end, look_too};
    look_by_parts(world, run_part, &s);
}

void tm_parts_look(tm_world *world) { look_by_parts(world, look_at_part, world); }

/* Threads are woken for calls that are worth it. */
void tm_parts_begin(tm_world *world, int32_t substeps) {
    enum { LEAST_SUBSTEPS = 4 };
    world->team_is_there = world->team && substeps >= LEAST_SUBSTEPS;
    if (world->team_is_there) tm_team_begin(world->team);
}

void tm_parts_end(tm_world *world) {
    if (world->team_is_there) tm_team_end(world->team);
    world->team_is_there = false;
}

void tm_stage_do(const tm_stage *stage, tm_world *world) {
    const tm_range whole = {world->part_count, 0, world->tissue->mesh->vertex_count};
    if (stage->range)
        stage->range(stage->self, world, &whole);
    else
        stage->run(stage->self, world);
}
