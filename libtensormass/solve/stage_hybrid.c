/* Stage "hybrid": the condensed part's force on the interface in each substep, its state between steps, and its
 * interior once per frame. */
#include "hybrid.h"

#include <string.h>

static void run(void *self, tm_world *world) {
    tm_hybrid *h = self;
    const tm_state *state = tm_world_state(world);
    for (int32_t i = 0; i < h->interface_count; i++) {
        h->at_m[i] = state->u_m[h->interface[i]];
        h->previous_m[i] = state->u_prev_m[h->interface[i]];
    }
    tms_coupling_force(&h->coupling, h->at_m, h->previous_m, h->push_N);
    memcpy(h->energy.pushed_N, h->push_N, 8 * (size_t)h->interface_count);
    for (int32_t i = 0; i < h->interface_count; i++) state->force_N[h->interface[i]] += h->push_N[i];
}

static void changed(void *self, tm_world *world) {
    (void)world;
    ((tm_hybrid *)self)->stale = true;
}

/* --- state between steps --- */

/* A snapshot begins with the division into parts: one with another division of the same organ would leave tetrahedra in
 * both or in none. Then follow the coupling's state and the contact solver's, if there is one. */
static uint64_t division(const tm_hybrid *h) { return tm_hash(h->alive, (size_t)h->mesh->tet_count, TM_HASH_SEED); }

static int64_t snapshot(void *self, void *buffer) {
    const tm_hybrid *h = self;
    const uint64_t mine = division(h);
    char *to = buffer ? memcpy(buffer, &mine, sizeof mine) : NULL;
    const int64_t head = (int64_t)sizeof mine + tms_coupling_snapshot(&h->coupling, to ? to + sizeof mine : NULL);
    char *rest = to ? to + head : NULL;
    if (!h->solver_contact.allocation) return head;
    if (!h->returns) return head + tms_hybrid_snapshot_contact(h, rest);
    if (rest) memcpy(rest, h->saved, (size_t)h->saved_bytes);
    return head + h->saved_bytes;
}

static int64_t snapshot_max(const tm_hybrid *h) {
    const int64_t head = (int64_t)sizeof(uint64_t) + tms_coupling_snapshot(&h->coupling, NULL);
    return head + (h->solver_contact.allocation ? tms_hybrid_snapshot_max(h) : 0);
}

static bool restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply) {
    tm_hybrid *h = self;
    uint64_t theirs;
    const int64_t coupling = tms_coupling_snapshot(&h->coupling, NULL),
                  left = bytes - (int64_t)sizeof theirs - coupling;
    (void)world;
    if (left < 0) return false;
    memcpy(&theirs, buffer, sizeof theirs);
    const char *followed = (const char *)buffer + sizeof theirs, *rest = followed + coupling;
    if (theirs != division(h) || !tms_coupling_restore(&h->coupling, followed, coupling, apply)) return false;
    if (!h->solver_contact.allocation) return left == 0;
    if (apply) {
        tms_hybrid_rollback(h, rest, left);
        return true;
    }
    const int64_t reuse = tms_contact_reuse_snapshot_bytes(h, rest, left),
                  head = reuse + 8 * (int64_t)h->interface_count;
    return reuse >= 0 && left >= head && tms_are_below(rest + reuse, (size_t)h->interface_count, 1e6) &&
           tms_contact_solver_restore(&h->solver_contact, rest + head, left - head, false);
}

static void checkpoint(void *self) {
    tm_hybrid *h = self;
    tms_coupling_checkpoint(&h->coupling);
    if (!h->returns && h->solver_contact.allocation) h->saved_bytes = tms_hybrid_snapshot_contact(h, h->saved);
}

/* The mobilities may not have been rolled back yet: they are read when needed. */
static void rollback(void *self, tm_world *world) {
    tm_hybrid *h = self;
    (void)world;
    tms_coupling_rollback(&h->coupling);
    h->returns = true;
    h->seen_revision = -1; /* the revision that was rolled back may be used again for another surface */
}

/* --- the stage --- */

/* Leaves the world, or a failed attempt to join one. The model is then as created and may join another. */
static void detach(void *self) {
    tm_hybrid *h = self;
    if (h->contact) tm_contact_set_block(h->contact, NULL);
    tms_contact_solver_destroy(&h->solver_contact);
    tms_contact_reuse_destroy(h);
    h->solver_contact = (tms_contact_solver){0};
    tms_hybrid_drop_energy(h);
    void **array[] = {(void **)&h->fixed_dof,
                      (void **)&h->interface_mobility_m_N,
                      (void **)&h->constraint_mode,
                      (void **)&h->constraint_mode_vertex,
                      (void **)&h->constraint_mode_single,
                      (void **)&h->gathered_base_m,
                      (void **)&h->gathered_m,
                      (void **)&h->since_m,
                      (void **)&h->moving,
                      &h->saved};
    for (size_t i = 0; i < sizeof array / sizeof *array; i++) {
        tms_free(*array[i]);
        *array[i] = NULL;
    }
    h->world = NULL;
    h->contact = NULL;
}

tm_status tm_stage_hybrid(tm_world *world, tm_hybrid *h, tm_contact *contact, tm_error *error) {
    TM_REQUIRE(world && h && !h->world, "world or hybrid is null, or hybrid is already in a world", TM_ERR_ARGUMENT);
    if (tm_tissue_mesh(tm_world_tissue(world)) != h->mesh)
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "the world's tissue has another mesh than the hybrid model; make it with tm_hybrid_tissue");
    if (contact && !h->has_contact)
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "the world has contact, and the hybrid model was made without; give tm_hybrid_def.contact");
    if (tm_world_step_s(world) > h->step_s)
        return tm_fail(
            error, TM_ERR_STEP, h->step_tet,
            "time step %.6g s is above the guaranteed critical step %.6g s of the whole organ, set by tetrahedron %d; "
            "lower the step or repair that tetrahedron",
            tm_world_step_s(world), h->step_s, (int)h->step_tet);
    const uint8_t *alive = tm_tissue_alive(tm_world_tissue(world));
    for (int32_t t = 0; t < h->mesh->tet_count; t++)
        if (alive[t] && !h->alive[t])
            return tm_fail(
                error, TM_ERR_ARGUMENT, t,
                "tetrahedron %d is condensed, and active in the world's tissue; make that tissue with tm_hybrid_tissue",
                (int)t);
    h->world = world;
    h->stale = true;
    tms_coupling_forget(&h->coupling);
    h->fixed_dof = tms_alloc_zeroed(3 * (size_t)h->mesh->vertex_count, 1);
    h->interface_mobility_m_N = tms_alloc_zeroed((size_t)h->interface_count, 8);
    h->moving = tms_alloc(4 * (size_t)h->mesh->vertex_count);
    tm_status status =
        h->fixed_dof && h->interface_mobility_m_N && h->moving && tms_hybrid_make_energy(h)
            ? TM_OK
            : tm_fail(error, TM_ERR_MEMORY, -1, "no memory for the stage of a hybrid model; use a coarser mesh");
    if (status == TM_OK && contact) status = tms_hybrid_add_contact(h, contact, error);
    if (status != TM_OK) {
        detach(h);
        return status;
    }
    const tm_stage stage = {
        .size = sizeof(tm_stage),
        .name = "hybrid",
        .phase = TM_PHASE_LOAD,
        .run = run,
        .destroy = detach,
        .step_changed = changed,
        .self = h,
        .snapshot = snapshot,
        .restore = restore,
        .checkpoint = checkpoint,
        .rollback = rollback,
        .needs = {contact ? "contact" : NULL},
        .step_limit_s = h->step_s,
        .settle_refusal = "the world cannot settle the condensed part; solve the complete organ (tm_model_settle, "
                          "tm_solve_static), which has the same equilibrium",
        .snapshot_max = snapshot_max(h)};
    status = tm_world_add_stage(world, &stage, tm_hybrid_bytes(h), error);
    if (status != TM_OK)
        detach(h);
    else
        tm_world_set_energy_part(world, &h->energy.part);
    return status;
}

/* --- once per frame --- */

void tm_hybrid_recover(tm_hybrid *h, tm_world *world) {
    TM_REQUIRE(h && world && h->world == world, "hybrid or world is null, or hybrid is not in this world", );
    tm_world_profile_stage(world, h);
    const tm_state *state = tm_world_state(world);
    const tms_contact_solver *l = &h->solver_contact;
    const int32_t dofs = 3 * h->mesh->vertex_count;
    for (int32_t d = 0; d < dofs; d++)
        h->full_u[d] = h->vertex_kind[d / 3] == TMS_INTERFACE ? state->u_m[d] : h->value_m[d];
    tm_tissue_force(h->condensed, h->full_u, h->full_f);
    double *b = tms_work_rhs(h->work);
    for (int32_t i = 0; i < h->system.n; i++) b[i] = h->full_f[h->system.dof[i]] + h->load_N[h->system.dof[i]];
    for (int32_t i = 0; i < 3 * l->used_count; i++) {
        const int32_t s = l->used[i / 3], at = h->system.index[3 * l->vertex[s] + i % 3];
        if (at >= 0) b[at] += l->f[3 * s + i % 3];
    }
    const double *x = tms_work_solve(h->work);
    h->unrecovered = !x;
    h->owed = false;
    for (int32_t i = 0; x && i < h->system.n; i++) h->full_u[h->system.dof[i]] = x[i];
    for (int32_t d = 0; x && d < dofs; d++)
        if (h->vertex_kind[d / 3] == TMS_CONDENSED) state->u_m[d] = state->u_prev_m[d] = h->full_u[d];
    tm_world_profile_stage(world, NULL);
}

tm_tool_reaction tm_hybrid_reaction(const tm_hybrid *h, int32_t instrument) {
    TM_REQUIRE(h && h->contact, "hybrid is null or has no contact", (tm_tool_reaction){0});
    tm_tool_reaction r = tm_contact_reaction(h->contact, instrument);
    if (h->unrecovered) r.flags |= TM_REACTION_UNCONVERGED;
    return r;
}

tm_surface_view tm_hybrid_surface(tm_hybrid *h) {
    TM_REQUIRE(h && h->world, "hybrid is null, or not in a world", (tm_surface_view){0});
    tms_hybrid_rebuild_surface(h);
    return h->surface;
}
