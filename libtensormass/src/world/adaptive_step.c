/* Adaptive step: the tangents of nonlinear laws are bounded by how far a tetrahedron is strained, and the step follows
 * that bound, in powers of two. Before every step the largest strain of each batch, one step ahead of the present
 * state, is held against the strains that each level allows.
 *
 * Stability: K(u) <= max over tetrahedra of a(strain)/a_max times the sum of bounds that guarantees the finest step
 * (critical_step.c), a the bound of d2W/dF2 over strains up to that one. An average of dilatations lies within those of
 * its tetrahedra, so that with averaged dilatation the largest strain limits the pressures too. With mass scaling the
 * masses guarantee the finest step. */
#include <math.h>
#include <string.h>

#include "material/hyperelastic.h"
#include "world/world_internal.h"

enum { NODES = 18, CALM = 8 };

/* State between steps: what a snapshot keeps. */
typedef struct kept {
    int32_t level, calm, calm_need; /* steps that needed less, and the most of what they needed */
    int32_t unused;
    int64_t steps[TM_ADAPTIVE_LEVELS];
} kept;

typedef struct tm_adaptive {
    tm_pool pool;
    tm_world *world;
    const tm_hyperelastic *hyper;
    tm_hyper_green strains;
    double *ahead_m;  /* [3*vertex_count] */
    double *strain_2; /* [batches] largest |E|^2 */
    uint8_t *limited; /* [batches] it has a nonlinear law */
    int32_t *need;    /* [partition_count] */
    double step_s, strain[TM_ADAPTIVE_LEVELS];
    int32_t levels;
    kept now, saved;
} adaptive;

/* --- what each level allows --- */

static double node(int i) { return TM_STRAIN_MOST * (i + 1) / NODES; }

double tm_adaptive_gain(const tm_material *material, int32_t count, bool averaged) {
    double least = HUGE_VAL;
    for (int32_t m = 0; m < count; m++)
        least = fmin(least, tm_law_stiffest_Pa(material + m, averaged) /
                                tm_law_stiffest_within_Pa(material + m, averaged, TM_STRAIN_REST));
    return TM_ADAPTIVE_MARGIN * sqrt(least);
}

/* Returns the guaranteed step if the bound of each material were a[m*stride + i]; 0: no memory. No tetrahedron is
 * stiffer than by the largest share that is left. */
static double step_with(tm_tissue *tissue, const double *a, int stride, int i, const double *limit, double all_s) {
    double step_s, least = HUGE_VAL;
    int32_t tet;
    for (int32_t m = 0; m < tissue->material_count; m++)
        least = fmin(least, limit[m] / fmin(a[m * stride + i], limit[m]));
    if (tissue->material_count == 1) return all_s * sqrt(least);
    for (int32_t m = 0; m < tissue->material_count; m++) tissue->stiffest_Pa[m] = fmin(a[m * stride + i], limit[m]);
    const bool done = tm_critical_step_find(tissue, &step_s, &tet);
    memcpy(tissue->stiffest_Pa, limit, sizeof *limit * (size_t)tissue->material_count);
    return done ? fmax(step_s, all_s * sqrt(least)) : 0;
}

/* Calls of creation: steps by strain, of the first `nodes`. Returns false without memory. */
static bool steps_by_strain(tm_tissue *tissue, int nodes, double *step_s) {
    tm_pool pool = {0};
    const int32_t count = tissue->material_count;
    double *a = TM_ALLOC(&pool, double, count *nodes), *limit = TM_ALLOC(&pool, double, count), all_s;
    int32_t tet;
    bool done = !pool.failed && tm_critical_step_find(tissue, &all_s, &tet);
    for (int32_t m = 0; m < count && done; m++) {
        limit[m] = tissue->stiffest_Pa[m];
        for (int i = 0; i < nodes; i++)
            a[m * nodes + i] = tm_law_stiffest_within_Pa(tissue->material + m, tissue->smoothed, node(i));
    }
    for (int i = 0; i < nodes && done; i++) {
        step_s[i] = step_with(tissue, a, nodes, i, limit, all_s);
        done = step_s[i] > 0;
    }
    tm_pool_release(&pool);
    return done;
}

double tm_adaptive_longest_s(tm_tissue *tissue) {
    double step_s[NODES];
    const int rest = (int)(TM_STRAIN_REST * NODES / TM_STRAIN_MOST - 1 + 1e-9);
    return steps_by_strain(tissue, rest + 1, step_s) ? TM_ADAPTIVE_MARGIN * step_s[rest] : 0;
}

/* --- the step --- */

static void look_ahead(void *context, int32_t part) {
    const adaptive *a = context;
    const tm_state *s = &a->world->state;
    const int32_t n = 3 * a->world->tissue->mesh->vertex_count, parts = a->world->partition_count;
    const double steps = 1 << a->now.level;
    for (int32_t i = tm_tet_batches_before(n, part, parts); i < tm_tet_batches_before(n, part + 1, parts); i++)
        a->ahead_m[i] = s->u_m[i] + steps * (s->u_m[i] - s->u_prev_m[i]);
}

static void find_need(void *context, int32_t part) {
    const adaptive *a = context;
    const int32_t count = a->hyper->packs.count, parts = a->world->partition_count;
    const int32_t begin = tm_tet_batches_before(count, part, parts),
                  end = tm_tet_batches_before(count, part + 1, parts);
    int32_t level = 0;
    a->strains(a->hyper, begin, end, a->ahead_m, a->strain_2);
    for (int32_t p = begin; p < end; p++)
        while (a->limited[p] && level < a->levels - 1 && !(a->strain_2[p] <= a->strain[level] * a->strain[level]))
            level++;
    a->need[part] = level;
}

/* Rises at once; sinks after CALM steps that need less, to the most that they needed. */
static int32_t next_level(kept *k, int32_t need) {
    if (need >= k->level) {
        k->calm = 0;
        return need;
    }
    k->calm_need = k->calm == 0 || need > k->calm_need ? need : k->calm_need;
    if (++k->calm < CALM) return k->level;
    k->calm = 0;
    return k->calm_need;
}

int32_t tm_adaptive_begin(tm_world *world) {
    adaptive *a = world->adaptive;
    int32_t need = 0;
    if (world->timing) tm_profile_enter(world, tm_world_stage_index(world, a));
    tm_partitions_run(world, look_ahead, a);
    tm_partitions_run(world, find_need, a);
    for (int32_t p = 0; p < world->partition_count; p++) need = a->need[p] > need ? a->need[p] : need;
    const int32_t level = next_level(&a->now, need);
    if (level != a->now.level) {
        a->now.level = level;
        tm_world_change_step(world, a->step_s / (1 << level));
    }
    a->now.steps[level]++;
    if (world->timing) tm_profile_enter(world, TM_NO_STAGE);
    return 1 << level;
}

/* --- the stage: memory, snapshots, rollback; its work is done before the substeps --- */

static void run(void *self, tm_world *world) { (void)self, (void)world; }

static int64_t snapshot(void *self, void *buffer) {
    if (buffer) memcpy(buffer, &((adaptive *)self)->now, sizeof(kept));
    return sizeof(kept);
}

static bool restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply) {
    adaptive *a = self;
    kept k;
    (void)world;
    if (bytes != sizeof k) return false;
    memcpy(&k, buffer, sizeof k);
    if (k.level < 0 || k.level >= a->levels || k.calm < 0 || k.calm >= CALM || k.calm_need < 0 ||
        k.calm_need >= a->levels)
        return false;
    if (apply) a->now = k; /* dt_s is the snapshot's */
    return true;
}

static void checkpoint(void *self) { ((adaptive *)self)->saved = ((adaptive *)self)->now; }

static void rollback(void *self, tm_world *world) {
    adaptive *a = self;
    const bool changed = a->now.level != a->saved.level;
    a->now = a->saved;
    if (!changed) return;
    world->state.dt_s = a->step_s / (1 << a->now.level);
    tm_world_changed(world);
}

static void destroy(void *self) {
    adaptive *a = self;
    a->world->adaptive = NULL;
    a->world->parts = 1;
    tm_pool pool = a->pool;
    tm_pool_release(&pool);
}

/* --- creation --- */

static bool take(adaptive *a, tm_pool *pool, tm_world *world) {
    const int32_t count = a->hyper->packs.count;
    a->ahead_m = TM_ALLOC(pool, double, 3 * (int64_t)world->tissue->mesh->vertex_count);
    a->strain_2 = TM_ALLOC(pool, double, count);
    a->limited = TM_ALLOC(pool, uint8_t, count);
    a->need = TM_ALLOC(pool, int32_t, world->partition_count);
    for (int32_t p = 0; p < count && !pool->failed; p++) a->limited[p] = (a->hyper->law[p].laws & ~1u) != 0;
    return !pool->failed;
}

/* Sets the levels and the strain that each allows. */
static tm_status set_levels(adaptive *a, tm_world *world, tm_error *error) {
    double step_s[NODES];
    if (!steps_by_strain(world->tissue, NODES, step_s)) return tm_fail_memory(error, "adaptive step");
    for (a->levels = 1; a->step_s / (1 << (a->levels - 1)) > world->state.dt_s * (1 + 1e-12); a->levels++)
        if (a->levels == TM_ADAPTIVE_LEVELS)
            return tm_fail(error, TM_ERR_STEP, -1, "adaptive step %.6g s is more than %d times %.6g s; lower it",
                           a->step_s, 1 << (TM_ADAPTIVE_LEVELS - 1), world->state.dt_s);
    for (int32_t k = 0; k < a->levels - 1; k++)
        for (int i = 0; i < NODES && a->step_s / (1 << k) <= TM_ADAPTIVE_MARGIN * step_s[i] * (1 + 1e-9); i++)
            a->strain[k] = node(i);
    a->strain[a->levels - 1] = HUGE_VAL;
    if (a->strain[0] < TM_STRAIN_REST * (1 - 1e-9))
        return tm_fail(error, TM_ERR_STEP, world->guaranteed_tet,
                       "adaptive step %.6g s is above %.6g s, which is guaranteed for strains up to %g; lower it",
                       a->step_s, tm_adaptive_longest_s(world->tissue), TM_STRAIN_REST);
    return TM_OK;
}

tm_status tm_adaptive_check(const tm_tissue *tissue, tm_error *error) {
    return tissue->stiffest_Pa
               ? TM_OK
               : tm_fail(
                     error, TM_ERR_EXCLUDED, -1,
                     "an adaptive step needs a nonlinear law, as a linear tangent never changes; leave the adaptive step out");
}

tm_status tm_world_adapt(tm_world *world, double step_s, tm_error *error) {
    TM_REQUIRE(world && !world->adaptive, "world is null or adaptive already", TM_ERR_ARGUMENT);
    const tm_status excluded = tm_adaptive_check(world->tissue, error);
    if (excluded) return excluded;
    if (!(step_s >= world->state.dt_s) || !isfinite(step_s))
        return tm_fail(error, TM_ERR_STEP, -1, "adaptive step %g s; give one of at least %g s, the world's", step_s,
                       world->state.dt_s);
    tm_pool pool = {0};
    adaptive *a = TM_ALLOC(&pool, adaptive, 1);
    tm_status status = a ? TM_OK : tm_fail_memory(error, "adaptive step");
    if (!status) {
        a->world = world, a->step_s = step_s, a->hyper = tm_world_hyperelastic(world);
        a->strains = tm_hyper_green_choose(world->tissue->plain);
        status = take(a, &pool, world) ? set_levels(a, world, error) : tm_fail_memory(error, "adaptive step");
    }
    const tm_stage stage = {.size = sizeof stage,
                            .name = "adaptive step",
                            .phase = TM_PHASE_BEGIN,
                            .run = run,
                            .destroy = destroy,
                            .self = a,
                            .snapshot = snapshot,
                            .restore = restore,
                            .checkpoint = checkpoint,
                            .rollback = rollback,
                            .needs = {"law"},
                            .skip_in_settle = true};
    if (!status) status = tm_world_add_stage(world, &stage, pool.bytes, error);
    if (status) {
        tm_pool_release(&pool);
        return status;
    }
    a->pool = pool;
    tm_world_set_divides(world, stage.name);
    world->adaptive = a, world->long_step_s = step_s;
    tm_world_change_step(world, step_s);
    return TM_OK;
}

bool tm_world_adaptive(const tm_world *world, tm_adaptive_step *state) {
    TM_REQUIRE(world && state, "world or state is null", false);
    const adaptive *a = world->adaptive;
    if (!a) return false;
    *state = (tm_adaptive_step){.step_s = a->step_s, .levels = a->levels, .level = a->now.level};
    memcpy(state->strain, a->strain, sizeof a->strain);
    memcpy(state->steps, a->now.steps, sizeof a->now.steps);
    return true;
}
