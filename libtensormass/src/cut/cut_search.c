/* Search for detached fragments: a flood over faces from constrained tetrahedra, a little each substep. Cuts during the
 * flood are harmless: what it has not reached at the end was never reachable. */
#include "cut/cut_internal.h"

#include <string.h>

enum {
    REACH_PER_STEP = 256,  /* tetrahedra from which the flood continues in a substep */
    SEEDS_PER_STEP = 2048, /* seeds visited for that, most of them removed */
    AHEAD = 8              /* prefetch distance for neighbours: the force pass has displaced them from the caches */
};

/* Appends an active tetrahedron that is not reached yet to the queue. Seeds are handled separately. */
static void reach(tm_cut_stage *stage, const tm_tissue *tissue, int32_t tet) {
    stage->visits++;
    if (tet < 0 || stage->reached[tet] || stage->is_seed[tet] || !tissue->alive[tet]) return;
    stage->reached[tet] = 1;
    stage->queue[stage->queue_end++] = tet;
}

/* Lists the tetrahedra held by supports, removed ones too: once, and again when supports change. A vertex attached to
 * tissue outside (a hybrid's condensed part) counts as supported. */
static void list_seeds(tm_cut_stage *stage, tm_world *world) {
    const tm_mesh *mesh = world->tissue->mesh;
    stage->supports_set = world->supports_set;
    stage->seed_count = 0;
    stage->any_support = false;
    memset(stage->is_seed, 0, (size_t)mesh->tet_count);
    memset(stage->fixed, 0, 3 * (size_t)mesh->vertex_count);
    tm_support_mask(world, stage->fixed);
    for (int32_t v = 0; v < mesh->vertex_count; v++) {
        const bool hung = world->tissue->extra_mass_kg && world->tissue->extra_mass_kg[v] > 0;
        if (!hung && !stage->fixed[3 * v] && !stage->fixed[3 * v + 1] && !stage->fixed[3 * v + 2]) continue;
        stage->any_support = true;
        for (int32_t i = mesh->vertex_tet_begin[v]; i < mesh->vertex_tet_begin[v + 1]; i++) {
            const int32_t tet = mesh->vertex_tet[i];
            if (!stage->is_seed[tet]) stage->seed[stage->seed_count++] = tet;
            stage->is_seed[tet] = 1;
        }
    }
}

void tm_cut_update_seeds(tm_cut_stage *stage, tm_world *world) {
    if (stage->supports_set != world->supports_set) list_seeds(stage, world);
}

/* Begins a search. `reached` is all zero: the previous search cleared it. */
void tm_cut_begin_search(tm_cut_stage *stage, tm_world *world) {
    const tm_mesh *mesh = world->tissue->mesh;
    stage->revision = world->tissue->surface.revision;
    stage->queue_begin = stage->queue_end = stage->sweep_at = stage->seed_at = 0;
    stage->falling = false;
    stage->state = stage->any_support ? SEARCH_REACH : SEARCH_IDLE; /* without constraints nothing counts as detached */
    if (!stage->any_support) return;
    for (int32_t t = 0; t < stage->contact->tool_count; t++) {
        const int32_t *vertex;
        const double *target_m;
        double compliance_m_N;
        const int32_t count = tm_contact_grasped(stage->contact, t, &vertex, &target_m, &compliance_m_N);
        for (int32_t k = 0; k < count; k++)
            for (int32_t i = mesh->vertex_tet_begin[vertex[k]]; i < mesh->vertex_tet_begin[vertex[k] + 1]; i++)
                reach(stage, world->tissue, mesh->vertex_tet[i]);
    }
}

/* Returns the next tetrahedron to continue from: active seeds first, then the queue; -1: none, or enough removed seeds
 * for now. */
static int32_t next_reached(tm_cut_stage *stage, const tm_tissue *tissue, int32_t *looks) {
    while (stage->seed_at < stage->seed_count && (*looks)-- > 0) {
        const int32_t tet = stage->seed[stage->seed_at++];
        stage->visits++;
        if (!tissue->alive[tet]) continue;
        stage->reached[tet] = 1;
        return tet;
    }
    if (stage->seed_at < stage->seed_count || stage->queue_begin == stage->queue_end) return -1;
    const int32_t ahead = stage->queue_begin + AHEAD;
    if (ahead < stage->queue_end) __builtin_prefetch(tissue->mesh->tet_neighbour + 4 * (int64_t)stage->queue[ahead]);
    return stage->queue[stage->queue_begin++];
}

void tm_cut_flood(tm_cut_stage *stage, const tm_tissue *tissue) {
    int32_t looks = SEEDS_PER_STEP, tet = 0;
    for (int budget = REACH_PER_STEP; budget > 0 && tet >= 0; budget--) {
        tet = next_reached(stage, tissue, &looks);
        for (int f = 0; f < 4 && tet >= 0; f++) reach(stage, tissue, tissue->mesh->tet_neighbour[4 * (int64_t)tet + f]);
    }
    if (stage->queue_begin == stage->queue_end && stage->seed_at == stage->seed_count) stage->state = SEARCH_SWEEP;
}
