/* A step's work in parts: stages that compute vertices one by one run together, a few hundred vertices at a time while
 * they are in the cache, each part by a thread of its own. A part computes its vertices whole (tm_force_part), so that
 * the bits are the same for any number of parts. */
#include "world/world_internal.h"

#include <string.h>

/* A part is worth a thread from this many tetrahedra on: below it, waiting for each other costs more. */
enum { LEAST_TETS = 2000, BLOCK = 512 };

bool tm_parts_take(tm_world *world, tm_pool *pool, const tm_world_def *def) {
    const tm_tissue *tissue = def->tissue;
    const int32_t worth = tissue->alive_count / LEAST_TETS;
    const int32_t wanted = def->threads < worth ? def->threads : worth;
    world->part_count = wanted > 1 ? wanted : 1;
    world->part = TM_TAKE(pool, tm_part, world->part_count + 1);
    if (!world->part) return false;
    if (!tm_borders_take(world, pool, tissue)) return false;
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

/* No displacement is beyond `largest_m`, infinite or no number. Magnitudes of doubles are ordered as their bits are, so
 * that adding what is left from the largest one allowed to the topmost bit sets that bit for all beyond. Looked at
 * after every substep: whole words are an instruction less than comparisons. */
static inline __attribute__((always_inline)) bool sound(const double *u, int32_t n, double largest_m) {
    uint64_t largest, word, beyond = 0;
    memcpy(&largest, &largest_m, sizeof largest);
    for (int32_t i = 0; i < n; i++) {
        memcpy(&word, u + i, sizeof word);
        beyond |= (word & INT64_MAX) + (INT64_MAX - largest);
    }
    return !(beyond >> 63);
}

/* The compiler looks at four at a time. */
TM_AVX2 static bool sound_wide(const double *u, int32_t n, double largest_m) { return sound(u, n, largest_m); }

static void look_at(const tm_world *world, tm_part *part, int32_t begin, int32_t end) {
    const double *u = world->state.u_next_m + 3 * (int64_t)begin;
    const int32_t n = 3 * (end - begin);
    if (!(world->wide ? sound_wide(u, n, world->largest_m) : sound(u, n, world->largest_m))) part->unsound = true;
}

/* At the new displacements. What is dead moves by nobody's doing but a caller's, before or behind all substeps: looked
 * at in the first and the last. */
static void look(const tm_world *world, tm_part *part, int32_t begin, int32_t end) {
    enum { GAP = 64 }; /* vertices: fewer dead ones are not worth leaving out */
    const uint64_t *living = world->tissue->graph.living;
    if (world->look_at_dead) {
        look_at(world, part, begin, end);
        return;
    }
    for (int32_t from, to = begin; tm_next_run(living, end, &from, &to);) {
        for (int32_t next, last = to; tm_next_run(living, end, &next, &last) && next - to < GAP;) to = last;
        look_at(world, part, from, to);
    }
}

bool tm_parts_is_sound(const tm_world *world, int32_t vertex) {
    return sound(world->state.u_next_m + 3 * (int64_t)vertex, 3, world->largest_m);
}

double tm_parts_way(const tm_world *world) {
    double way_m = 0;
    for (int32_t p = 0; p < world->part_count; p++)
        if (world->part[p].force.end > world->part[p].force.begin && !(world->part[p].way_m <= way_m))
            way_m = world->part[p].way_m;
    return way_m;
}

typedef struct stages {
    tm_world *world;
    int32_t begin, end;                            /* slots */
    bool look, timed;                              /* timed: by the clock, for the borders */
    int32_t overlap_count, overlap[TM_MAX_STAGES]; /* slots whose work overlaps */
} stages;

/* Time is booked by the first part for all of them. */
static void run_part(void *context, int32_t number) {
    const stages *s = context;
    tm_world *world = s->world;
    tm_part *part = world->part + number;
    const bool timed = world->timing && number == 0;
    const double since_s = s->timed ? tm_clock_s() : 0;
    if (part->unsound) part->unsound = false; /* a line that nobody writes need not come from another core */
    for (int32_t i = 0; i < s->overlap_count; i++) {
        const tm_stage *stage = &world->slot[s->overlap[i]].stage;
        if (timed) tm_world_charge(world, s->overlap[i]);
        stage->overlap->work(stage->self, world, number);
    }
    for (int32_t begin = part->force.begin; begin < part->force.end;) {
        const tm_range range = {number, begin, begin + BLOCK < part->force.end ? begin + BLOCK : part->force.end};
        for (int32_t i = s->begin; i < s->end; i++) {
            if (timed) tm_world_charge(world, i);
            world->slot[i].stage.range(world->slot[i].stage.self, world, &range);
        }
        if (s->look) look(world, part, range.begin, range.end);
        begin = range.end;
    }
    if (timed && world->part_count > 1) tm_world_charge(world, TM_NO_SLOT); /* from here on it waits for others */
    if (s->timed) tm_borders_book(part, tm_clock_s() - since_s);
}

/* Books the wait for other threads on the stages that these were still computing, in the ratio of the caller's own
 * times: not on the stage that happens to be the last. */
static void charge_wait(tm_world *world, const double *before_s) {
    const double wait_s = tm_clock_s() - world->charged_since_s;
    double own_s[TM_MAX_STAGES] = {0}, sum_s = 0;
    for (int32_t i = 0; i < world->stage_count; i++) {
        own_s[i] = world->slot[i].seconds - before_s[i]; /* 0 of those that did not run */
        sum_s += own_s[i];
    }
    for (int32_t i = 0; i < world->stage_count && sum_s > 0; i++) world->slot[i].seconds += wait_s * own_s[i] / sum_s;
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

/* Do the stages [begin, end) lead from the force to the new displacements? */
static bool is_force_job(const tm_world *world, int32_t begin, int32_t end) {
    return world->slot[begin].stage.phase <= TM_PHASE_FORCE && world->slot[end - 1].stage.phase >= TM_PHASE_INTEGRATE;
}

static void begin_overlaps(tm_world *world, stages *s) {
    for (int32_t i = s->end; i < world->step_count; i++) {
        const tm_stage *stage = &world->slot[i].stage;
        if (stage->overlap && stage->overlap->begin(stage->self, world)) s->overlap[s->overlap_count++] = i;
    }
}

void tm_parts_run_stages(tm_world *world, int32_t begin, int32_t end, bool look_too) {
    stages s = {.world = world, .begin = begin, .end = end, .look = look_too};
    const bool waits = world->timing && world->part_count > 1;
    double before_s[TM_MAX_STAGES];
    for (int32_t i = 0; i < world->stage_count && waits; i++) before_s[i] = world->slot[i].seconds;
    world->group_end = end;
    if (world->part_count > 1 && is_force_job(world, begin, end)) {
        s.timed = world->team_is_there;
        begin_overlaps(world, &s);
    }
    look_by_parts(world, run_part, &s);
    if (waits) charge_wait(world, before_s);
    if (s.timed) tm_borders_follow(world);
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
