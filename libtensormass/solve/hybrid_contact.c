/* Contact of all tools with the whole organ's surface, solved in one system: dynamic vertices give as their mass lets
 * them within a substep, inner ones quasi-statically, through the interface. */
#include "hybrid.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Of the largest displacement that contact makes: a substep ends where a step has come so near. The next one goes on
 * from there with another, so that what rests still comes to rest on the last digits. */
static const double ENOUGH = 3e-5;
/* For rows that are kept then: how hard they press is solved to 1e-9 at once. */
static const double ENOUGH_FOR_ROWS = 3e-3;
/* Substeps that what surrounds the tools is kept at most, while neither they nor the tissue move far; how often is
 * looked how fast it moves. */
enum { GATHER_EVERY = 128, WANDER_EVERY = 4 };

/* Places of condensed vertices where what surrounds the tools was looked for, without what presses on them. */
static void place_gathered(tm_hybrid *h, const int32_t *vertex, int32_t count) {
    const int32_t n = h->interface_count;
    for (int32_t i = 0; i < 3 * count; i++) {
        const int32_t v = vertex[i / 3], d = 3 * v + i % 3, at = h->place[d];
        if (h->part[v] != TMS_CONDENSED) continue;
        const double *row = tms_hybrid_through(h, v) + (int64_t)(i % 3) * n;
        h->gathered_base_m[3 * h->local.slot_of[v] + i % 3] =
            at < 0 ? h->value_m[d] : h->responses.base_m[at] + tms_dot(row, h->gathered_m, n);
    }
}

/* Shape at the end of the substep without contact: of condensed vertices that of the last gathering, in double, and in
 * single what the border has moved since. So what rests is exact once it has been looked around there. */
static void refresh(void *self, const int32_t *vertex, int32_t count) {
    tm_hybrid *h = self;
    const double *u_next = tm_world_state(h->world)->u_next_m;
    const int32_t n = h->interface_count, padded = h->coupling.padded;
    const bool anew = h->local.gathered_age <= 1;
    if (anew) {
        memcpy(h->gathered_m, h->at_m, 8 * (size_t)n);
        place_gathered(h, vertex, count);
    }
    for (int32_t k = 0; k < n; k++) h->since_m[k] = (float)(h->at_m[k] - h->gathered_m[k]);
    for (int32_t i = 0; i < count; i++) {
        const int32_t v = vertex[i], slot = h->local.slot_of[v];
        float moved[3] = {0};
        if (h->part[v] != TMS_CONDENSED) {
            memcpy(h->local.base_m + 3 * (int64_t)v, u_next + 3 * (int64_t)v, 24);
            continue;
        }
        if (!anew) tms_rows_times(h->through_single + 3 * (int64_t)slot * padded, 3, padded, h->since_m, moved);
        for (int c = 0; c < 3; c++)
            h->local.base_m[3 * (int64_t)v + c] = h->gathered_base_m[3 * slot + c] + (double)moved[c];
    }
}

static bool passes(void *self, const tm_contact_row *row) {
    tm_hybrid *h = self;
    const bool held = tm_contact_holds(h->contact, row);
    h->span->passed |= held;
    return held;
}

/* --- when the step's length, the supports or the tissue have changed --- */

static int32_t revision(const tm_hybrid *h) { return tm_tissue_surface(tm_world_tissue(h->world)).revision; }

/* hybrid_contact.c. What was made of mobilities is not of today's. */
static bool tms_hybrid_is_stale(const tm_hybrid *h) { return h->stale || h->known_revision != revision(h); }

/* What was made of mobilities. Looked at when it is needed, so that it does not matter which stage hears of a change
 * first: the integrator has them anew by then. */
static void make_fresh(tm_hybrid *h) {
    h->stale = false;
    h->known_revision = revision(h);
    memset(h->held, 0, 3 * (size_t)h->mesh->vertex_count);
    tm_support_mask(h->world, h->held);
    for (int32_t k = 0; k < h->interface_count; k++) h->give_m_N[k] = tms_hybrid_mobility(h, h->interface[k]);
    h->moving_count = 0;
    for (int32_t v = 0; v < h->mesh->vertex_count; v++)
        if (tm_world_mobility_s2_kg(h->world)[v] > 0) h->moving[h->moving_count++] = v;
    if (!h->local.memory) return;
    tms_local_forget(&h->local);
    tms_span_forget(h);
    for (int32_t s = 0; s < h->local.capacity; s++) h->through_vertex[s] = -1;
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
    h->local.surface = h->surface;
    tms_local_regather(&h->local);
    if (h->span) tms_span_forget(h);
}

int64_t tms_hybrid_snapshot_contact(const tm_hybrid *h, void *buffer) {
    const bool forgotten = tms_hybrid_is_stale(h);
    int64_t head = tms_span_snapshot(h, forgotten, buffer);
    const int64_t gathered = 8 * (int64_t)h->interface_count;
    if (buffer) memcpy((char *)buffer + head, h->gathered_m, (size_t)gathered);
    head += gathered;
    return head + tms_local_snapshot(&h->local, forgotten, buffer ? (char *)buffer + head : NULL);
}

int64_t tms_hybrid_snapshot_most(const tm_hybrid *h) {
    return tms_span_snapshot_most(h) + 8 * (int64_t)h->interface_count + tms_local_snapshot_most(&h->local);
}

void tms_hybrid_take_back(tm_hybrid *h, const void *buffer, int64_t bytes) {
    h->returns = false;
    tms_hybrid_rebuild_surface(h);
    make_fresh(h);
    const int64_t span = tms_span_snapshot_bytes(h, buffer, bytes), gathered = 8 * (int64_t)h->interface_count;
    memcpy(h->gathered_m, (const char *)buffer + span, (size_t)gathered);
    tms_local_restore(&h->local, (const char *)buffer + span + gathered, bytes - span - gathered, true);
    place_gathered(h, h->local.list, h->local.use_count);
    tms_span_restore(h, buffer);
}

/* The forces found, let into the coming positions. */
static void move(tm_hybrid *h) {
    const tms_local *l = &h->local;
    double *u_next = tm_world_state(h->world)->u_next_m;
    const int32_t n = h->interface_count;
    bool inside = false;
    memset(h->push_N, 0, 8 * (size_t)n);
    for (int32_t i = 0; i < 3 * l->use_count; i++) {
        const int32_t s = l->use[i / 3], d = 3 * l->vertex[s] + i % 3;
        const double f = l->f[3 * s + i % 3];
        if (f == 0) continue;
        if (h->part[d / 3] != TMS_CONDENSED) {
            u_next[d] += tms_hybrid_mobility(h, d) * f;
            continue;
        }
        const double *row = h->through + (3 * (int64_t)s + i % 3) * n;
        for (int32_t k = 0; k < n; k++) h->push_N[k] += row[k] * f;
        inside = true;
    }
    for (int32_t k = 0; inside && k < n; k++) u_next[h->interface[k]] += h->give_m_N[k] * h->push_N[k];
}

/* A tool on what has mass, which following has just solved for: within a substep it knows of the others through the
 * border alone, if at all, and keeps what it has. */
static void give_watched(tm_hybrid *h, bool followed) {
    tms_local *l = &h->local;
    for (int32_t t = 0; t < l->tool_count; t++)
        l->tool[t].given = followed && !l->rub && l->tool[t].near && h->span->kind[t] == TMS_TOOL_WATCHED;
    for (int32_t i = 0; i < 3 * l->before_count; i++) { /* what surrounds the tools may be another since */
        const tm_contact_row *row = &l->before[i / 3];
        if (!bsearch(&row->vertex[i % 3], l->list, (size_t)l->use_count, sizeof *l->list, tms_ascending))
            l->tool[row->instrument].given = false;
    }
}

/* The rows of a rough solution begin a span, whose first substep is this one. False: they cannot, and it is to be
 * solved to the end. */
static bool settle_rows(tm_hybrid *h) {
    tms_span_begin(h, false);
    const int32_t gathered_age = h->local.gathered_age;
    if (h->span->age != 0 || !tms_span_follow(h)) return false;
    h->span->age = 0;
    h->local.gathered_age = gathered_age;
    tms_span_move(h);
    return true;
}

/* For all that is not given, roughly or to the end. */
static void solve_for_use(tms_local *l, bool rough) {
    l->rough = rough;
    l->enough = rough ? ENOUGH_FOR_ROWS : ENOUGH;
    if (l->use_count > 0)
        tms_local_solve(l);
    else
        l->before_count = 0; /* no row is left that a span could keep */
}

static void solve_in_full(tm_hybrid *h, bool followed) {
    tms_local *l = &h->local;
    const tms_span_past past = tms_span_past_of(h);
    const bool may_give = followed && !h->span->passed;
    h->span->passed = false;
    tms_local_gather(l);
    give_watched(h, may_give);
    memcpy(l->f_saved, l->f, 24 * (size_t)l->capacity);
    l->converged = true; /* where there is nothing to solve, */
    l->now.count = 0;
    solve_for_use(l, followed);
    const bool settled = followed && l->converged && settle_rows(h);
    if (followed && !settled) solve_for_use(l, false);
    for (int32_t t = 0; t < l->tool_count; t++) l->tool[t].given = false;
    if (!settled) {
        const bool swept = !l->converged;
        if (swept) tms_local_freeze(l, l->f_saved);
        move(h);
        tms_span_begin(h, swept);
    }
    if (followed) tms_span_judge(h, &past);
}

/* How far what has mass may have moved since the tools' surroundings were looked for: by its largest speed. Condensed
 * tissue goes as its border and the tools do. */
static void count_wandering(tm_hybrid *h) {
    const tm_state *state = tm_world_state(h->world);
    double most = 0;
    if (h->local.gathered_age % WANDER_EVERY != 0) return;
    for (int32_t i = 0; i < h->moving_count; i++)
        for (int32_t d = 3 * h->moving[i]; d < 3 * h->moving[i] + 3; d++) {
            const double moved = fabs(state->u_m[d] - state->u_prev_m[d]);
            most = moved > most ? moved : most;
        }
    h->local.wandered_m += WANDER_EVERY * most;
}

static int32_t solve(void *self, tm_world *world, const tm_tool_pose *pose, tm_contact_row *row, int32_t max_rows,
                     uint32_t flags[TM_MAX_INSTRUMENTS]) {
    tm_hybrid *h = self;
    tms_local *l = &h->local;
    const tm_state *state = tm_world_state(world);
    bool any = false;
    if (h->returns) tms_hybrid_take_back(h, h->kept, h->kept_bytes);
    if (tms_hybrid_is_stale(h)) make_fresh(h);
    tms_hybrid_rebuild_surface(h);
    for (int32_t t = 0; t < l->tool_count; t++) {
        tms_local_pose(l, t, &pose[t]);
        any |= tms_local_can_touch(&l->tool[t]);
    }
    if (!any) { /* nothing is pushed, and nothing remembered */
        memset(l->f, 0, 24 * (size_t)l->capacity);
        l->before_count = 0;
        tms_local_regather(l);
        tms_span_forget(h);
        return 0;
    }
    for (int32_t k = 0; k < h->interface_count; k++) h->at_m[k] = state->u_next_m[h->interface[k]];
    count_wandering(h);
    const bool over = tms_span_is_over(h), followed = tms_span_follow(h);
    if (followed && !over)
        tms_span_move(h);
    else
        solve_in_full(h, followed);
    const int32_t count = l->now.count < max_rows ? l->now.count : max_rows;
    memcpy(row, l->now.row, (size_t)count * sizeof *row);
    for (int32_t t = 0; t < l->tool_count; t++) flags[t] = tms_local_flags(l, t);
    return count;
}

tm_status tms_hybrid_add_contact(tm_hybrid *h, tm_contact *contact, tm_error *error) {
    tms_hybrid_rebuild_surface(h);
    const tm_status status =
        tms_local_create(h->mesh, h->surface, &h->contact_def, NULL, h->max_local_vertices, &h->local, error);
    if (status != TM_OK) return status;
    if (!tms_span_create(h))
        return tm_fail(error, TM_ERR_MEMORY, -1,
                       "no memory for contact with %d interface components; use a coarser mesh",
                       (int)h->interface_count);
    h->local.self = h;
    h->local.compliance = tms_hybrid_compliance;
    h->local.refresh = refresh;
    h->local.around = tms_hybrid_look_around;
    h->local.passes = passes;
    h->through = tms_take(24 * (size_t)h->local.capacity * (size_t)h->interface_count);
    h->through_vertex = tms_take(4 * (size_t)h->local.capacity);
    h->through_single = tms_take(12 * (size_t)h->local.capacity * (size_t)h->coupling.padded);
    h->gathered_base_m = tms_take_zeroed(3 * (size_t)h->local.capacity, 8);
    h->gathered_m = tms_take_zeroed((size_t)h->interface_count, 8);
    h->since_m = tms_take_zeroed((size_t)h->coupling.padded, 4);
    h->local.gather_every = GATHER_EVERY;
    h->kept = tms_take((size_t)tms_hybrid_snapshot_most(h));
    if (!h->through || !h->through_vertex || !h->through_single || !h->gathered_base_m || !h->gathered_m ||
        !h->since_m || !h->kept)
        return tm_fail(error, TM_ERR_MEMORY, -1,
                       "no memory for contact with %d interface components; lower max_local_vertices",
                       (int)h->interface_count);
    const tm_contact_block block = {h, solve};
    tm_contact_set_block(contact, &block);
    h->contact = contact; /* from here on there is something to undo with it */
    return TM_OK;
}
