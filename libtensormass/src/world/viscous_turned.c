/* The stage "viscosity" of tissue that turns: histories of tetrahedra, and a force that is the whole law's, so that the
 * tensors of what is linear are not run beside it. Four passes, each divided among the step's threads: strains of
 * packs; where changes of volume are averaged, pressures of domains, then their stresses on packs; corners' pulls
 * gathered by vertices. Whoever sums, sums all of it in ascending order, so that the bits are those of one thread. */
#include "world/viscosity.h"

#include <string.h>

/* --- room --- */

/* Places of the pulls on each vertex, in the order of mesh->vertex_tet. */
static void find_corners(const tm_mesh *mesh, int32_t *place) {
    for (int32_t v = 0; v < mesh->vertex_count; v++)
        for (int32_t i = mesh->vertex_tet_begin[v]; i < mesh->vertex_tet_begin[v + 1]; i++) {
            const int32_t tet = mesh->vertex_tet[i];
            int k = 0;
            while (mesh->tet[4 * (int64_t)tet + k] != v) k++;
            place[i] = TM_LANES * (12 * (tet / TM_LANES) + 3 * k) + tet % TM_LANES;
        }
}

int64_t tm_relaxing_kept(const tm_rotation *rotation) {
    return 6 * TM_LANES * (int64_t)rotation->packs.count + tm_swollen_domains(&rotation->swollen);
}

bool tm_relaxing_take(tm_relaxing *r, tm_pool *pool, tm_world *world, const tm_viscosity_def *def,
                      double *const *kept) {
    const tm_tissue *tissue = world->tissue;
    const tm_mesh *mesh = tissue->mesh;
    tm_viscous *v = &r->viscous;
    r->world = world;
    r->rotation = tm_world_rotation(world);
    r->passes = tm_viscous_choose(tissue->plain);
    const int64_t lanes = TM_LANES * (int64_t)r->rotation->packs.count;
    v->terms = def->count;
    v->bulk_J = TM_TAKE(pool, double, lanes);
    v->corner_N = TM_TAKE(pool, double, 12 * lanes);
    if (tissue->smoothed) v->stress_J = TM_TAKE(pool, double, 9 * lanes);
    r->place = TM_TAKE(pool, int32_t, 4 * (int64_t)mesh->tet_count);
    r->active = TM_TAKE(pool, int32_t, world->part_count);
    if (pool->failed) return false;
    for (int32_t t = 0; t < def->count; t++) {
        v->shear[t] = def->term[t].shear;
        v->more[t] = def->term[t].volume - def->term[t].shear;
        v->memory[t] = kept[t];
        v->swelling[t] = kept[t] + 6 * lanes;
    }
    for (int32_t t = 0; !tissue->smoothed && t < mesh->tet_count; t++)
        v->bulk_J[t] = mesh->volume_m3[t] * tm_smoothed_bulk_Pa(tm_tissue_tet_material(tissue, t));
    find_corners(mesh, r->place);
    return true;
}

/* --- the passes --- */

static const tm_swollen *swollen_of(const tm_relaxing *r) {
    return r->rotation->swollen.tissue ? &r->rotation->swollen : NULL;
}

/* Packs before the part. */
static int32_t packs_before(const tm_relaxing *r, int32_t part) {
    return (int32_t)((int64_t)r->rotation->packs.count * part / r->world->part_count);
}

static void strain(void *context, int32_t part) {
    const tm_relaxing *r = context;
    r->active[part] = r->passes.strain(&r->rotation->packs, &r->viscous, swollen_of(r), packs_before(r, part),
                                       packs_before(r, part + 1), r->world->state.u_m);
}

static void average(void *context, int32_t part) {
    const tm_relaxing *r = context;
    const int32_t *begin = tm_swollen_domains_of(&r->rotation->swollen)->begin;
    const tm_force_part *own = &r->world->part[part].force;
    tm_swollen_average(&r->rotation->swollen, &r->viscous, begin[own->begin], begin[own->end]);
}

static void press(void *context, int32_t part) {
    const tm_relaxing *r = context;
    r->passes.pressure(&r->rotation->packs, &r->viscous, swollen_of(r), packs_before(r, part),
                       packs_before(r, part + 1));
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

void tm_relaxing_force(tm_relaxing *r) {
    tm_world *world = r->world;
    r->viscous.still = world->asking;
    tm_parts_do(world, strain, r);
    if (swollen_of(r)) {
        tm_parts_do(world, average, r);
        tm_parts_do(world, press, r);
    }
    tm_parts_do(world, gather, r);
    r->rotation->active = 0;
    for (int32_t p = 0; p < world->part_count; p++) r->rotation->active += r->active[p];
    r->rotation->list_count = r->rotation->packs.count;
}

void tm_relaxing_look(const tm_relaxing *r, const tm_fading *fading) {
    tm_viscous once = r->viscous;
    once.still = false;
    for (int32_t t = 0; t < once.terms; t++)
        once.keep[t] = fading[t].keep, once.old[t] = fading[t].old, once.now[t] = fading[t].now;
    r->passes.strain(&r->rotation->packs, &once, swollen_of(r), 0, r->rotation->packs.count, r->world->state.u_m);
    if (swollen_of(r)) tm_swollen_average(&r->rotation->swollen, &once, 0, tm_swollen_domains(&r->rotation->swollen));
}

void tm_relaxing_no_tensors(void *self, tm_world *world, const tm_range *range) {
    (void)self;
    const size_t bytes = 3 * sizeof(double) * (size_t)(range->end - range->begin);
    memset(world->state.force_N + 3 * (int64_t)range->begin, 0, bytes);
    if (world->internal_N)
        world->tissue->force(&world->tissue->graph, &world->part[range->part].force, range->begin, range->end,
                             world->state.u_m, world->internal_N);
}
