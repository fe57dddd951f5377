/* Contact of all tools with the complete organ's surface, solved as one system. Dynamic vertices yield by their mass
 * within a substep, interior ones quasi-statically, through the interface. */
#include "hybrid.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Relative to the largest displacement by contact: a substep may stop at this error. The next one continues from there
 * with another step, so that equilibrium is still reached to the last digits. */
static const double LOOSE_TOLERANCE = 3e-5;
/* For rows that are then reused: their forces are solved to 1e-9 at once. */
static const double LOOSE_TOLERANCE_ROWS = 3e-3;
/* Maximum substeps between gatherings while neither tools nor tissue move far; interval between checks of the tissue's
 * speed. */
enum { GATHER_EVERY = 128, WANDER_EVERY = 4 };

/* Computes the gathered positions of condensed vertices, without contact forces on them. */
static void place_gathered(tm_hybrid *h, const int32_t *vertex, int32_t count) {
    const int32_t n = h->interface_count;
    for (int32_t i = 0; i < 3 * count; i++) {
        const int32_t v = vertex[i / 3], d = 3 * v + i % 3, at = h->interface_index[d];
        if (h->vertex_kind[v] != TMS_CONDENSED) continue;
        const double *row = tms_hybrid_constraint_mode(h, v) + (int64_t)(i % 3) * n;
        h->gathered_base_m[3 * h->solver_contact.slot_of[v] + i % 3] =
            at < 0 ? h->value_m[d] : h->responses.base_m[at] + tms_dot(row, h->gathered_m, n);
    }
}

/* Computes the shape at the end of the substep without contact. For condensed vertices: that of the last gathering, in
 * double, plus the interface's motion since then, in single. Equilibrium is thus exact once a gathering has taken place
 * there. */
static void refresh(void *self, const int32_t *vertex, int32_t count) {
    tm_hybrid *h = self;
    const double *u_next = tm_world_state(h->world)->u_next_m;
    const int32_t n = h->interface_count, padded = h->coupling.padded;
    const bool anew = h->solver_contact.gathered_age <= 1;
    if (anew) {
        memcpy(h->gathered_m, h->at_m, 8 * (size_t)n);
        place_gathered(h, vertex, count);
    }
    for (int32_t k = 0; k < n; k++) h->since_m[k] = (float)(h->at_m[k] - h->gathered_m[k]);
    for (int32_t i = 0; i < count; i++) {
        const int32_t v = vertex[i], slot = h->solver_contact.slot_of[v];
        float moved[3] = {0};
        if (h->vertex_kind[v] != TMS_CONDENSED) {
            memcpy(h->solver_contact.base_m + 3 * (int64_t)v, u_next + 3 * (int64_t)v, 24);
            continue;
        }
        if (!anew) tms_rows_times(h->constraint_mode_single + 3 * (int64_t)slot * padded, 3, padded, h->since_m, moved);
        for (int c = 0; c < 3; c++)
            h->solver_contact.base_m[3 * (int64_t)v + c] = h->gathered_base_m[3 * slot + c] + (double)moved[c];
    }
}

static bool passes(void *self, const tm_contact_row *row) {
    tm_hybrid *h = self;
    const bool held = tm_contact_is_grasped(h->contact, row);
    h->reuse->passed |= held;
    return held;
}

/* --- after a change of the step's length, the supports or the tissue --- */

static int32_t revision(const tm_hybrid *h) { return tm_tissue_surface(tm_world_tissue(h->world)).revision; }

/* Returns whether data derived from mobilities is outdated. */
static bool tms_hybrid_is_stale(const tm_hybrid *h) { return h->stale || h->known_revision != revision(h); }

/* Recomputes the data derived from mobilities. Checked on use, so that the order in which stages see a change has no
 * influence: the integrator has the new values by then. */
static void make_fresh(tm_hybrid *h) {
    h->stale = false;
    h->known_revision = revision(h);
    memset(h->fixed_dof, 0, 3 * (size_t)h->mesh->vertex_count);
    tm_support_mask(h->world, h->fixed_dof);
    for (int32_t k = 0; k < h->interface_count; k++)
        h->interface_mobility_m_N[k] = tms_hybrid_mobility(h, h->interface[k]);
    h->moving_count = 0;
    for (int32_t v = 0; v < h->mesh->vertex_count; v++)
        if (tm_world_mobility_s2_kg(h->world)[v] > 0) h->moving[h->moving_count++] = v;
    if (!h->solver_contact.allocation) return;
    tms_contact_solver_forget(&h->solver_contact);
    tms_contact_reuse_forget(h);
    for (int32_t s = 0; s < h->solver_contact.capacity; s++) h->constraint_mode_vertex[s] = -1;
}

/* --- contact --- */

void tms_hybrid_rebuild_surface(tm_hybrid *h) {
    const tm_tissue *tissue = tm_world_tissue(h->world);
    const uint8_t *alive = tm_tissue_alive(tissue);
    const int32_t revision = tm_tissue_surface(tissue).revision;
    if (h->surface.revision >= 0 && revision == h->seen_revision) return;
    h->seen_revision = revision;
    int32_t n = 0;
    for (int32_t f = 0; f < 4 * h->mesh->tet_count; f++) {
        const int32_t t = f / 4, other = h->mesh->tet_neighbour[f];
        const bool here = !h->alive[t] || alive[t], there = other >= 0 && (!h->alive[other] || alive[other]);
        if (!here || there) continue;
        for (int i = 0; i < 3; i++)
            h->surface_triangle[3 * n + i] = h->mesh->tet[4 * (int64_t)t + tm_face_vertex[f % 4][i]];
        h->surface_face[n++] = f;
    }
    h->surface = (tm_surface_view){n, h->surface_triangle, h->surface_face, h->surface.revision + 1};
    h->solver_contact.surface = h->surface;
    tms_contact_solver_regather(&h->solver_contact);
    if (h->reuse) tms_contact_reuse_forget(h);
}

int64_t tms_hybrid_snapshot_contact(const tm_hybrid *h, void *buffer) {
    const bool forgotten = tms_hybrid_is_stale(h);
    int64_t head = tms_contact_reuse_snapshot(h, forgotten, buffer);
    const int64_t gathered = 8 * (int64_t)h->interface_count;
    if (buffer) memcpy((char *)buffer + head, h->gathered_m, (size_t)gathered);
    head += gathered;
    return head + tms_contact_solver_snapshot(&h->solver_contact, forgotten, buffer ? (char *)buffer + head : NULL);
}

int64_t tms_hybrid_snapshot_max(const tm_hybrid *h) {
    return tms_contact_reuse_snapshot_max(h) + 8 * (int64_t)h->interface_count +
           tms_contact_solver_snapshot_max(&h->solver_contact);
}

void tms_hybrid_rollback(tm_hybrid *h, const void *buffer, int64_t bytes) {
    h->returns = false;
    tms_hybrid_rebuild_surface(h);
    make_fresh(h);
    const int64_t reuse = tms_contact_reuse_snapshot_bytes(h, buffer, bytes),
                  gathered = 8 * (int64_t)h->interface_count;
    memcpy(h->gathered_m, (const char *)buffer + reuse, (size_t)gathered);
    tms_contact_solver_restore(&h->solver_contact, (const char *)buffer + reuse + gathered, bytes - reuse - gathered,
                               true);
    place_gathered(h, h->solver_contact.list, h->solver_contact.used_count);
    tms_contact_reuse_restore(h, buffer);
}

/* Applies the contact forces to the coming positions. */
static void move(tm_hybrid *h) {
    const tms_contact_solver *l = &h->solver_contact;
    double *u_next = tm_world_state(h->world)->u_next_m;
    const int32_t n = h->interface_count;
    bool inside = false;
    memset(h->push_N, 0, 8 * (size_t)n);
    for (int32_t i = 0; i < 3 * l->used_count; i++) {
        const int32_t s = l->used[i / 3], d = 3 * l->vertex[s] + i % 3;
        const double f = l->f[3 * s + i % 3];
        if (f == 0) continue;
        if (h->vertex_kind[d / 3] != TMS_CONDENSED) {
            u_next[d] += tms_hybrid_mobility(h, d) * f;
            continue;
        }
        const double *row = h->constraint_mode + (3 * (int64_t)s + i % 3) * n;
        for (int32_t k = 0; k < n; k++) h->push_N[k] += row[k] * f;
        inside = true;
    }
    for (int32_t k = 0; inside && k < n; k++) u_next[h->interface[k]] += h->interface_mobility_m_N[k] * h->push_N[k];
    for (int32_t i = 0; i < 3 * l->used_count; i++) { /* for the energy balance: all forces on the interface */
        const int32_t s = l->used[i / 3], d = 3 * l->vertex[s] + i % 3;
        if (h->vertex_kind[d / 3] == TMS_INTERFACE) h->push_N[h->interface_index[d]] += l->f[3 * s + i % 3];
    }
}

/* Handles a tracked tool whose rows the reuse substep has just solved. Within a substep only the interface couples it
 * to the others, if at all, so it keeps its solution. */
static void resolve_tracked(tm_hybrid *h, bool followed) {
    tms_contact_solver *l = &h->solver_contact;
    for (int32_t t = 0; t < l->tool_count; t++)
        l->tool[t].prescribed = followed && !l->friction && l->tool[t].near && h->reuse->kind[t] == TMS_TOOL_TRACKED;
    for (int32_t i = 0; i < 3 * l->previous_count; i++) { /* the neighbourhood may have changed since */
        const tm_contact_row *row = &l->previous[i / 3];
        if (!bsearch(&row->vertex[i % 3], l->list, (size_t)l->used_count, sizeof *l->list, tms_ascending))
            l->tool[row->instrument].prescribed = false;
    }
}

/* Begins an interval with the rows of an inexact solution; this substep is its first. Returns false if they cannot be
 * reused; the solve must then be completed. */
static bool settle_rows(tm_hybrid *h) {
    tms_contact_reuse_begin(h, false);
    const int32_t gathered_age = h->solver_contact.gathered_age;
    if (h->reuse->age != 0 || !tms_contact_reuse_advance(h)) return false;
    h->reuse->age = 0;
    h->solver_contact.gathered_age = gathered_age;
    tms_contact_reuse_move(h);
    return true;
}

/* Solves for all unknowns that are not prescribed, to the loose or the full tolerance. */
static void solve_for_use(tms_contact_solver *l, bool rough) {
    l->inexact = rough;
    l->loose_tolerance = rough ? LOOSE_TOLERANCE_ROWS : LOOSE_TOLERANCE;
    if (l->used_count > 0)
        tms_contact_solver_solve(l);
    else
        l->previous_count = 0; /* no row is left to reuse */
}

/* Returns the forces on the interface. */
static const double *solve_in_full(tm_hybrid *h, bool followed) {
    tms_contact_solver *l = &h->solver_contact;
    const tms_reuse_past past = tms_reuse_past_of(h);
    const bool may_give = followed && !h->reuse->passed;
    h->reuse->passed = false;
    tms_contact_solver_gather(l);
    resolve_tracked(h, may_give);
    memcpy(l->f_saved, l->f, 24 * (size_t)l->capacity);
    l->converged = true; /* without unknowns, */
    l->now.count = 0;
    solve_for_use(l, followed);
    const bool settled = followed && l->converged && settle_rows(h);
    if (followed && !settled) solve_for_use(l, false);
    for (int32_t t = 0; t < l->tool_count; t++) l->tool[t].prescribed = false;
    if (!settled) {
        const bool swept = !l->converged;
        if (swept) tms_contact_solver_freeze(l, l->f_saved);
        move(h);
        tms_contact_reuse_begin(h, swept);
    }
    if (followed) tms_contact_reuse_judge(h, &past);
    return settled ? h->reuse->push_N : h->push_N;
}

/* Estimates how far tissue with mass may have moved since the last gathering, from its maximum speed. Condensed tissue
 * moves only with its interface and the tools. */
static void count_wandering(tm_hybrid *h) {
    const tm_state *state = tm_world_state(h->world);
    double most = 0;
    if (h->solver_contact.gathered_age % WANDER_EVERY != 0) return;
    for (int32_t i = 0; i < h->moving_count; i++)
        for (int32_t d = 3 * h->moving[i]; d < 3 * h->moving[i] + 3; d++) {
            const double moved = fabs(state->u_m[d] - state->u_prev_m[d]);
            most = moved > most ? moved : most;
        }
    h->solver_contact.wandered_m += WANDER_EVERY * most;
}

static int32_t solve(void *self, tm_world *world, const tm_tool_pose *pose, tm_contact_row *row, int32_t max_rows,
                     uint32_t flags[TM_MAX_INSTRUMENTS]) {
    tm_hybrid *h = self;
    tms_contact_solver *l = &h->solver_contact;
    const tm_state *state = tm_world_state(world);
    bool any = false;
    if (h->returns) tms_hybrid_rollback(h, h->saved, h->saved_bytes);
    if (tms_hybrid_is_stale(h)) make_fresh(h);
    tms_hybrid_rebuild_surface(h);
    for (int32_t t = 0; t < l->tool_count; t++) {
        tms_contact_solver_move(l, t, &pose[t]);
        any |= tms_contact_solver_can_touch(&l->tool[t]);
    }
    if (!any) { /* no force, and no history */
        memset(l->f, 0, 24 * (size_t)l->capacity);
        l->previous_count = 0;
        tms_contact_solver_regather(l);
        tms_contact_reuse_forget(h);
        tms_hybrid_limit_energy(h, NULL, 0);
        return 0;
    }
    for (int32_t k = 0; k < h->interface_count; k++) h->at_m[k] = state->u_next_m[h->interface[k]];
    count_wandering(h);
    const bool over = tms_contact_reuse_is_over(h), followed = tms_contact_reuse_advance(h);
    const double *push_N = h->reuse->push_N;
    if (followed && !over)
        tms_contact_reuse_move(h);
    else
        push_N = solve_in_full(h, followed);
    tms_hybrid_limit_energy(h, push_N, l->now.count);
    const int32_t count = l->now.count < max_rows ? l->now.count : max_rows;
    memcpy(row, l->now.row, (size_t)count * sizeof *row);
    for (int32_t t = 0; t < l->tool_count; t++) flags[t] = tms_contact_solver_flags(l, t);
    return count;
}

tm_status tms_hybrid_add_contact(tm_hybrid *h, tm_contact *contact, tm_error *error) {
    tms_hybrid_rebuild_surface(h);
    const tm_status status = tms_contact_solver_create(h->mesh, h->surface, &h->contact_def, NULL,
                                                       h->max_contact_vertices, &h->solver_contact, error);
    if (status != TM_OK) return status;
    if (!tms_contact_reuse_create(h))
        return tm_fail(error, TM_ERR_MEMORY, -1,
                       "no memory for contact with %d interface components; use a coarser mesh",
                       (int)h->interface_count);
    h->solver_contact.self = h;
    h->solver_contact.compliance = tms_hybrid_compliance;
    h->solver_contact.refresh = refresh;
    h->solver_contact.update_neighbourhood = tms_hybrid_estimate_neighbourhood;
    h->solver_contact.passes = passes;
    h->constraint_mode = tms_alloc(24 * (size_t)h->solver_contact.capacity * (size_t)h->interface_count);
    h->constraint_mode_vertex = tms_alloc(4 * (size_t)h->solver_contact.capacity);
    h->constraint_mode_single = tms_alloc(12 * (size_t)h->solver_contact.capacity * (size_t)h->coupling.padded);
    h->gathered_base_m = tms_alloc_zeroed(3 * (size_t)h->solver_contact.capacity, 8);
    h->gathered_m = tms_alloc_zeroed((size_t)h->interface_count, 8);
    h->since_m = tms_alloc_zeroed((size_t)h->coupling.padded, 4);
    h->solver_contact.gather_every = GATHER_EVERY;
    h->saved = tms_alloc((size_t)tms_hybrid_snapshot_max(h));
    if (!h->constraint_mode || !h->constraint_mode_vertex || !h->constraint_mode_single || !h->gathered_base_m ||
        !h->gathered_m || !h->since_m || !h->saved)
        return tm_fail(error, TM_ERR_MEMORY, -1,
                       "no memory for contact with %d interface components; lower max_contact_vertices",
                       (int)h->interface_count);
    const tm_contact_block block = {h, solve};
    tm_contact_set_block(contact, &block);
    h->contact = contact; /* from here on a failure must be undone with it */
    return TM_OK;
}
