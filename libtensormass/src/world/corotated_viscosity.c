/* The complete law of corotated tissue, for which the pass over linear tensors is not needed. It serves tissue with
 * averaged dilatation, and relaxing tissue: long-term law and terms, with histories of tetrahedra. Four passes, each
 * divided among the step's threads: strains of batches; with averaged dilatation, pressures of domains, then their
 * stresses on batches; corner forces gathered by vertices. Every sum is complete and ascending, so results are
 * bit-identical to those of one thread. */
#include "tissue/tangent.h"
#include "world/viscosity.h"

#include <math.h>
#include <string.h>

/* --- memory --- */

enum { RELAXING = TM_REGION_ROTATION | TM_REGION_VISCOSITY };

static bool relaxes(const tm_rotation *rotation, int32_t batch) {
    const tm_material_field field = tm_tissue_field(rotation->tissue);
    return tm_field_has(&field, rotation->batches.span[batch].tet, RELAXING);
}

static int64_t kept(const void *self) {
    const tm_rotation *rotation = self;
    int64_t batches = 0;
    for (int32_t p = 0; p < rotation->batches.count; p++) batches += relaxes(rotation, p);
    return 6 * TM_LANES * batches + tm_nodal_dilatation_domains(&rotation->nodal_dilatation);
}

/* Allocates one evaluation. It shares memory of the elastic tissue, because only one of both runs. */
static bool take_room(tm_relaxing *r, tm_pool *pool) {
    const tm_mesh *mesh = r->world->tissue->mesh;
    const tm_relaxing *lender = r->rotation->whole;
    const int64_t lanes = TM_LANES * (int64_t)r->batches->count;
    tm_viscous *v = &r->viscous;
    r->active = TM_ALLOC(pool, int32_t, r->world->partition_count);
    if (lender) {
        v->corner_N = lender->viscous.corner_N, v->stress_J = lender->viscous.stress_J;
        r->slot = lender->slot;
        return !pool->failed;
    }
    const int32_t first = mesh->vertex_tet_begin[tm_ranges_first(&r->where)];
    const int32_t last = mesh->vertex_tet_begin[tm_ranges_first(&r->where) + tm_ranges_length(&r->where)];
    v->corner_N = TM_ALLOC(pool, double, 12 * lanes);
    if (tm_nodal_dilatation_is_on(&r->rotation->nodal_dilatation)) v->stress_J = TM_ALLOC(pool, double, 9 * lanes);
    r->slot = tm_shifted(TM_ALLOC(pool, int32_t, last - first), sizeof *r->slot, first);
    if (pool->failed) return false;
    tm_packs_corners(r->batches, r->slot);
    return true;
}

bool tm_relaxing_init_elastic(tm_relaxing *r, tm_pool *pool, tm_world *world, tm_rotation *rotation) {
    *r = (tm_relaxing){.world = world, .rotation = rotation, .batches = &rotation->batches, .where = rotation->where};
    r->passes = tm_viscous_choose(world->tissue->plain);
    return take_room(r, pool);
}

/* Lists what the stage "rotation" computes while some of its bodies relax. */
static bool list_elastic(tm_relaxing *r, tm_pool *pool, const tm_material_field *field) {
    const tm_rotation *rotation = r->rotation;
    r->relaxes = TM_ALLOC(pool, uint8_t, rotation->batches.count);
    r->elastic = TM_ALLOC(pool, int32_t, rotation->batches.count);
    if (!tm_effect_vertices(&r->elastic_where, pool, field, TM_REGION_ROTATION, TM_REGION_VISCOSITY)) return false;
    for (int32_t p = 0; !pool->failed && p < rotation->batches.count; p++) {
        r->relaxes[p] = relaxes(rotation, p);
        if (!r->relaxes[p]) r->elastic[r->elastic_count++] = p;
    }
    return !pool->failed;
}

static bool begin(void *self, tm_pool *pool, tm_world *world, const tm_viscosity_def *def, double *const *histories) {
    tm_rotation *rotation = self;
    tm_relaxing *r = TM_ALLOC(pool, tm_relaxing, 1);
    const tm_material_field field = tm_rotation_field(world->tissue);
    if (!r) return false;
    *r = (tm_relaxing){.world = world, .rotation = rotation, .batches = &r->relaxed};
    r->passes = tm_viscous_choose(world->tissue->plain);
    if (!tm_prony_init(&r->viscous, &r->relaxed, pool, &field, def, histories) ||
        !tm_effect_vertices(&r->where, pool, &field, RELAXING, 0) || !take_room(r, pool))
        return false;
    if (r->relaxed.count < rotation->batches.count && !list_elastic(r, pool, &field)) return false;
    rotation->terms = r;
    return true;
}

static void end(void *self) { ((tm_rotation *)self)->terms = NULL; }

/* --- the passes --- */

static const tm_nodal_dilatation *dilatation_of(const tm_relaxing *r) {
    return tm_nodal_dilatation_is_on(&r->rotation->nodal_dilatation) ? &r->rotation->nodal_dilatation : NULL;
}

/* Returns the number of batches before the partition. */
static int32_t batches_before(const tm_relaxing *r, int32_t partition) {
    return tm_tet_batches_before(r->batches->count, partition, r->world->partition_count);
}

static void strain(void *context, int32_t partition) {
    const tm_relaxing *r = context;
    r->active[partition] = r->passes.strain(r->batches, &r->viscous, dilatation_of(r), batches_before(r, partition),
                                            batches_before(r, partition + 1), r->world->state.u_m);
}

static void average(void *context, int32_t partition) {
    const tm_relaxing *r = context;
    const int32_t *begin = tm_nodal_dilatation_domains_of(&r->rotation->nodal_dilatation)->begin;
    const tm_force_partition *own = &r->world->partition[partition].force;
    tm_nodal_dilatation_average(&r->rotation->nodal_dilatation, r->viscous.terms ? &r->viscous : NULL,
                                begin[own->begin], begin[own->end]);
}

static void press(void *context, int32_t partition) {
    const tm_relaxing *r = context;
    r->passes.pressure(r->batches, &r->viscous, dilatation_of(r), batches_before(r, partition),
                       batches_before(r, partition + 1));
}

static void gather(void *context, int32_t partition) {
    const tm_relaxing *r = context;
    const int32_t *begin = r->world->tissue->mesh->vertex_tet_begin;
    const tm_force_partition *own = &r->world->partition[partition].force;
    double *TM_RESTRICT force = r->world->state.force_N;
    for (int32_t k = 0, first, last; tm_ranges_next(&r->where, &k, own->begin, own->end, &first, &last);)
        for (int32_t v = first; v < last; v++) {
            double x = force[3 * v], y = force[3 * v + 1], z = force[3 * v + 2];
            for (int32_t i = begin[v]; i < begin[v + 1]; i++) {
                const double *pull = r->viscous.corner_N + r->slot[i];
                x -= pull[0], y -= pull[TM_LANES], z -= pull[2 * TM_LANES];
            }
            force[3 * v] = x, force[3 * v + 1] = y, force[3 * v + 2] = z;
        }
}

/* --- timers --- */

/* Timed calls between comparisons; the comparison's own time is attributed to no stage. */
enum { COMPARE_EVERY = 64 };
/* Factor of growth, per comparison, of the stored minimum times: other programs lengthen single measurements. */
static const double FORGET = 1.02;

static void linear_part(void *context, int32_t number) {
    const tm_world *world = context;
    tm_force_partition own = world->partition[number].force;
    const tm_tissue *tissue = world->tissue;
    tissue->force(&tissue->graph, &own, own.begin, own.end, world->state.u_m, world->state.force_N);
}

/* Measures the time of the force without relaxation: the linear pass and the stage "rotation", into scratch. The second
 * run counts, because the first checks all batches. Changes nothing that a step depends on. */
static double time_elastic(tm_relaxing *r) {
    tm_world *world = r->world;
    const tm_stage *stage = &world->entry[tm_world_stage_index(world, r->rotation)].stage;
    double *const force_N = world->state.force_N;
    double began_s = 0;
    world->state.force_N = r->rotation->scratch_N;
    r->rotation->done_by_viscosity = false;
    for (int i = 0; i < 2; i++) {
        began_s = tm_clock_s();
        if (!r->rotation->whole) tm_partitions_run(world, linear_part, world);
        stage->run(stage->self, world);
    }
    r->rotation->done_by_viscosity = true;
    world->state.force_N = force_N;
    return tm_clock_s() - began_s;
}

static double min_of(double before_s, double now_s) {
    return before_s > 0 && FORGET * before_s < now_s ? FORGET * before_s : now_s;
}

static void pull(tm_relaxing *r) {
    tm_partitions_run(r->world, strain, r);
    if (dilatation_of(r)) {
        tm_partitions_run(r->world, average, r);
        tm_partitions_run(r->world, press, r);
    }
    tm_partitions_run(r->world, gather, r);
}

/* Attributes the time of elastic tissue to "rotation" instead of the running stage, "viscosity". */
static void corner_forces_timed(tm_relaxing *r) {
    tm_world *world = r->world;
    const int32_t mine = world->profiled;
    const bool compares = r->timed++ % COMPARE_EVERY == 0;
    if (compares) {
        tm_profile_enter(world, TM_NO_STAGE);
        r->elastic_s = min_of(r->elastic_s, time_elastic(r));
        tm_profile_enter(world, mine);
    }
    const double began_s = tm_clock_s();
    pull(r);
    const double took_s = tm_clock_s() - began_s;
    if (compares) r->compared_s = min_of(r->compared_s, took_s);
    const double moved_s = took_s * (r->elastic_s < r->compared_s ? r->elastic_s / r->compared_s : 1);
    world->entry[tm_world_stage_index(world, r->rotation)].seconds += moved_s;
    world->entry[mine].seconds -= moved_s;
}

void tm_relaxing_force(tm_relaxing *r) {
    tm_world *world = r->world;
    r->viscous.history_frozen = world->evaluating;
    const bool all = tm_ranges_length(&r->where) == world->tissue->mesh->vertex_count;
    if (all && world->timing && world->profiled != TM_NO_STAGE && r->viscous.terms)
        corner_forces_timed(r);
    else
        pull(r);
    if (r->relaxes) return; /* the report of the stage "rotation" has its own batches */
    r->rotation->active = 0;
    for (int32_t p = 0; p < world->partition_count; p++) r->rotation->active += r->active[p];
    r->rotation->list_count = r->batches->count;
}

/* --- what the stage "viscosity" asks --- */

static void force(void *self) { tm_relaxing_force(((tm_rotation *)self)->terms); }

static void evaluate(void *self, const tm_fading *fading) {
    const tm_relaxing *r = ((tm_rotation *)self)->terms;
    tm_viscous once = r->viscous;
    once.history_frozen = false;
    for (int32_t t = 0; t < once.terms; t++)
        once.history_kept[t] = fading[t].kept_share, once.old[t] = fading[t].old, once.now[t] = fading[t].now;
    r->passes.strain(r->batches, &once, dilatation_of(r), 0, r->batches->count, r->world->state.u_m);
    if (dilatation_of(r))
        tm_nodal_dilatation_average(&r->rotation->nodal_dilatation, &once, 0,
                                    tm_nodal_dilatation_domains(&r->rotation->nodal_dilatation));
}

static void set(void *self, tm_world *world, bool relaxes) {
    tm_rotation *rotation = self;
    const tm_relaxing *r = rotation->terms;
    const bool partly = relaxes && r->relaxes;
    const int32_t all = world->tissue->mesh->vertex_count;
    rotation->done_by_viscosity = relaxes && !partly;
    rotation->relaxes = partly ? r->relaxes : NULL;
    rotation->elastic = partly ? r->elastic : rotation->every;
    rotation->elastic_count = partly ? r->elastic_count : rotation->batches.count;
    rotation->conserving.where = partly ? &r->elastic_where : &rotation->where;
    if (r->relaxes) {
        rotation->seen = false;
        rotation->conserving.valid = false, rotation->conserving.last_s = -HUGE_VAL;
    }
    if (relaxes)
        tm_world_set_force(world,
                           &(tm_force_provider){.stage = "viscosity", .where = tm_ranges_within(&r->where, all)});
    else
        tm_world_set_force(world, rotation->whole ? &(tm_force_provider){.stage = "rotation"} : NULL);
}

static void set_step(void *self, const tm_fading *fading) {
    tm_viscous *v = &((tm_rotation *)self)->terms->viscous;
    for (int32_t t = 0; t < v->terms; t++)
        v->history_kept[t] = fading[t].kept_share, v->old[t] = fading[t].old, v->now[t] = fading[t].now;
}

static bool prepare_rest(void *self, const tm_tissue *tissue, tm_relaxed *relaxed) {
    const tm_rotation *rotation = self;
    const tm_material_field field = tm_rotation_field(tissue);
    relaxed->batches = rotation->terms->relaxed;
    if (rotation->terms->relaxes && !tm_tet_batches_init(&relaxed->batches, &relaxed->pool, &field)) return false;
    return tm_nodal_dilatation_init(&relaxed->nodal_dilatation, &relaxed->pool, &field, relaxed->batches.count);
}

static void rest(void *self, tm_relaxed *relaxed, bool begins) {
    tm_rotation *rotation = self;
    const tm_tet_batches batches = rotation->batches;
    const tm_nodal_dilatation dilatation = rotation->nodal_dilatation;
    (void)begins; /* both ways */
    rotation->batches = relaxed->batches;
    rotation->nodal_dilatation = relaxed->nodal_dilatation;
    relaxed->batches = batches;
    relaxed->nodal_dilatation = dilatation;
}

const struct tm_relaxing_law tm_corotated_relaxing = {.stage = "rotation",
                                                      .kept = kept,
                                                      .begin = begin,
                                                      .end = end,
                                                      .set = set,
                                                      .set_step = set_step,
                                                      .force = force,
                                                      .evaluate = evaluate,
                                                      .prepare_rest = prepare_rest,
                                                      .rest = rest};
