/* The whole law of tissue that turns, so that the tensors of what is linear are not run beside it: of tissue whose
 * changes of volume are averaged, and of tissue that relaxes, what the series leaves and its terms, with histories of
 * tetrahedra. Four passes, each divided among the step's threads: strains of packs; where changes of volume are
 * averaged, pressures of domains, then their stresses on packs; corners' pulls gathered by vertices. Whoever sums, sums
 * all of it in ascending order, so that the bits are those of one thread. */
#include "world/viscosity.h"

#include <string.h>

/* --- room --- */

int64_t tm_relaxing_kept(const tm_rotation *rotation) {
    return 6 * TM_LANES * (int64_t)rotation->packs.count + tm_swollen_domains(&rotation->swollen);
}

/* Of one look; what the elastic tissue has already is shared, for only one of both runs. */
static bool take_room(tm_relaxing *r, tm_pool *pool) {
    const tm_mesh *mesh = r->world->tissue->mesh;
    const tm_relaxing *lender = r->rotation->whole;
    const int64_t lanes = TM_LANES * (int64_t)r->rotation->packs.count;
    tm_viscous *v = &r->viscous;
    r->active = TM_TAKE(pool, int32_t, r->world->part_count);
    if (lender) {
        v->corner_N = lender->viscous.corner_N, v->stress_J = lender->viscous.stress_J;
        r->place = lender->place;
        return !pool->failed;
    }
    v->corner_N = TM_TAKE(pool, double, 12 * lanes);
    if (r->world->tissue->smoothed) v->stress_J = TM_TAKE(pool, double, 9 * lanes);
    r->place = TM_TAKE(pool, int32_t, 4 * (int64_t)mesh->tet_count);
    if (pool->failed) return false;
    tm_packs_corners(mesh, r->place);
    return true;
}

bool tm_relaxing_take_elastic(tm_relaxing *r, tm_pool *pool, tm_world *world, tm_rotation *rotation) {
    *r = (tm_relaxing){.world = world, .rotation = rotation, .packs = &rotation->packs};
    r->passes = tm_viscous_choose(world->tissue->plain);
    return take_room(r, pool);
}

bool tm_relaxing_take(tm_relaxing *r, tm_pool *pool, tm_world *world, tm_rotation *rotation,
                      const tm_viscosity_def *def, double *const *kept) {
    const tm_tissue *tissue = world->tissue;
    tm_viscous *v = &r->viscous;
    if (!tm_relaxing_take_elastic(r, pool, world, rotation)) return false;
    r->packs = &r->left;
    const tm_material_field field = tm_tissue_field(tissue);
    return tm_prony_take(v, &r->left, pool, &field, def, rotation->packs.count, kept);
}

/* --- the passes --- */

static const tm_swollen *swollen_of(const tm_relaxing *r) {
    return tm_swollen_is_on(&r->rotation->swollen) ? &r->rotation->swollen : NULL;
}

/* Packs before the part. */
static int32_t packs_before(const tm_relaxing *r, int32_t part) {
    return tm_packs_before(r->packs->count, part, r->world->part_count);
}

static void strain(void *context, int32_t part) {
    const tm_relaxing *r = context;
    r->active[part] = r->passes.strain(r->packs, &r->viscous, swollen_of(r), packs_before(r, part),
                                       packs_before(r, part + 1), r->world->state.u_m);
}

static void average(void *context, int32_t part) {
    const tm_relaxing *r = context;
    const int32_t *begin = tm_swollen_domains_of(&r->rotation->swollen)->begin;
    const tm_force_part *own = &r->world->part[part].force;
    tm_swollen_average(&r->rotation->swollen, r->viscous.terms ? &r->viscous : NULL, begin[own->begin],
                       begin[own->end]);
}

static void press(void *context, int32_t part) {
    const tm_relaxing *r = context;
    r->passes.pressure(r->packs, &r->viscous, swollen_of(r), packs_before(r, part), packs_before(r, part + 1));
}

static void gather(void *context, int32_t part) {
    const tm_relaxing *r = context;
    const int32_t *begin = r->world->tissue->mesh->vertex_tet_begin;
    const tm_force_part *own = &r->world->part[part].force;
    double *TM_RESTRICT force = r->world->state.force_N;
    for (int32_t v = own->begin; v < own->end; v++) {
        double x = force[3 * v], y = force[3 * v + 1], z = force[3 * v + 2];
        for (int32_t i = begin[v]; i < begin[v + 1]; i++) {
            const double *pull = r->viscous.corner_N + r->place[i];
            x -= pull[0], y -= pull[TM_LANES], z -= pull[2 * TM_LANES];
        }
        force[3 * v] = x, force[3 * v + 1] = y, force[3 * v + 2] = z;
    }
}

/* --- timers --- */

/* Timed calls from one comparison to the next: what it takes itself is booked on no stage. */
enum { COMPARE_EVERY = 64 };
/* Seconds compared are the least, forgotten by so much a comparison: other programs make single ones longer. */
static const double FORGET = 1.02;

static void linear_part(void *context, int32_t number) {
    const tm_world *world = context;
    tm_force_part own = world->part[number].force;
    const tm_tissue *tissue = world->tissue;
    tissue->force(&tissue->graph, &own, own.begin, own.end, world->state.u_m, world->state.force_N);
}

/* What the force would take now if nothing relaxed: the linear pass and the stage "rotation", into scratch. The second
 * time counts, for the first one looks at all packs. Changes nothing that a step depends on. */
static double time_elastic(tm_relaxing *r) {
    tm_world *world = r->world;
    const tm_stage *stage = &world->slot[tm_world_slot_of(world, r->rotation)].stage;
    double *const force_N = world->state.force_N;
    double began_s = 0;
    world->state.force_N = r->rotation->scratch_N;
    r->rotation->left_to_viscosity = false;
    for (int i = 0; i < 2; i++) {
        began_s = tm_clock_s();
        if (!r->rotation->whole) tm_parts_do(world, linear_part, world);
        stage->run(stage->self, world);
    }
    r->rotation->left_to_viscosity = true;
    world->state.force_N = force_N;
    return tm_clock_s() - began_s;
}

static double least(double before_s, double now_s) {
    return before_s > 0 && FORGET * before_s < now_s ? FORGET * before_s : now_s;
}

static void pull(tm_relaxing *r) {
    tm_parts_do(r->world, strain, r);
    if (swollen_of(r)) {
        tm_parts_do(r->world, average, r);
        tm_parts_do(r->world, press, r);
    }
    tm_parts_do(r->world, gather, r);
}

/* Moves what the elastic tissue would take from the running stage, "viscosity", to "rotation". */
static void pull_timed(tm_relaxing *r) {
    tm_world *world = r->world;
    const int32_t mine = world->charged;
    const bool compares = r->timed++ % COMPARE_EVERY == 0;
    if (compares) {
        tm_world_charge(world, TM_NO_SLOT);
        r->elastic_s = least(r->elastic_s, time_elastic(r));
        tm_world_charge(world, mine);
    }
    const double began_s = tm_clock_s();
    pull(r);
    const double took_s = tm_clock_s() - began_s;
    if (compares) r->compared_s = least(r->compared_s, took_s);
    const double moved_s = took_s * (r->elastic_s < r->compared_s ? r->elastic_s / r->compared_s : 1);
    world->slot[tm_world_slot_of(world, r->rotation)].seconds += moved_s;
    world->slot[mine].seconds -= moved_s;
}

void tm_relaxing_force(tm_relaxing *r) {
    tm_world *world = r->world;
    r->viscous.still = world->asking;
    if (world->timing && world->charged != TM_NO_SLOT && r->viscous.terms)
        pull_timed(r);
    else
        pull(r);
    r->rotation->active = 0;
    for (int32_t p = 0; p < world->part_count; p++) r->rotation->active += r->active[p];
    r->rotation->list_count = r->packs->count;
}

void tm_relaxing_look(const tm_relaxing *r, const tm_fading *fading) {
    tm_viscous once = r->viscous;
    once.still = false;
    for (int32_t t = 0; t < once.terms; t++)
        once.keep[t] = fading[t].keep, once.old[t] = fading[t].old, once.now[t] = fading[t].now;
    r->passes.strain(r->packs, &once, swollen_of(r), 0, r->packs->count, r->world->state.u_m);
    if (swollen_of(r)) tm_swollen_average(&r->rotation->swollen, &once, 0, tm_swollen_domains(&r->rotation->swollen));
}
