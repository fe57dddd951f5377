/* Stage "hybrid": the condensed part pushes on the interface in every substep, and contact of all tools with the whole
 * organ's surface is solved in one system: dynamic vertices give as their mass lets them within a substep, inner ones
 * quasi-statically, through the interface. */
#include "hybrid.h"

#include <string.h>

/* --- force on the interface --- */

/* Sums in eight lanes, always the same: one after the other they would wait for each other. */
enum { LANES = 8 };
static double sum_lanes(const double lane[LANES]) {
    double sum = 0;
    for (int k = 0; k < LANES; k++) sum += lane[k];
    return sum;
}

static double dot(const double *restrict a, const double *restrict b, int32_t n) {
    double lane[LANES] = {0}, rest = 0;
    int32_t i = 0;
    for (; i + LANES <= n; i += LANES)
        for (int k = 0; k < LANES; k++) lane[k] += a[i + k] * b[i + k];
    for (; i < n; i++) rest += a[i] * b[i];
    return rest + sum_lanes(lane);
}

/* push -= r * x, and the sum of r * at. */
static double both_halves(const double *restrict r, double x, const double *restrict at, double *restrict push,
                          int32_t n) {
    double lane[LANES] = {0}, rest = 0;
    int32_t j = 0;
    for (; j + LANES <= n; j += LANES)
        for (int k = 0; k < LANES; k++) {
            lane[k] += r[j + k] * at[j + k];
            push[j + k] -= r[j + k] * x;
        }
    for (; j < n; j++) {
        rest += r[j] * at[j];
        push[j] -= r[j] * x;
    }
    return rest + sum_lanes(lane);
}

/* push := interface_N - schur * at, each entry of the triangle read once. */
static void push_back(const tm_hybrid *h) {
    const int32_t n = h->interface_count;
    const double *row = h->schur, *at = h->at_m;
    double *push = h->push_N;
    memcpy(push, h->responses.interface_N, 8 * (size_t)n);
    for (int32_t i = 0; i < n; row += n - i, i++)
        push[i] -= row[0] * at[i] + both_halves(row + 1, at[i], at + i + 1, push + i + 1, n - i - 1);
}

static void run(void *self, tm_world *world) {
    tm_hybrid *h = self;
    const tm_state *state = tm_world_state(world);
    for (int32_t i = 0; i < h->interface_count; i++) h->at_m[i] = state->u_m[h->interface[i]];
    push_back(h);
    for (int32_t i = 0; i < h->interface_count; i++) state->force_N[h->interface[i]] += h->push_N[i];
}

/* --- compliance within a substep --- */

static double mobility(const tm_hybrid *h, int32_t dof) {
    return h->held[dof] ? 0 : tm_world_mobility_s2_kg(h->world)[dof / 3];
}

/* How the components of an inside vertex follow the interface: [3][interface_count], gathered when its slot is new. */
static const double *through(tm_hybrid *h, int32_t vertex) {
    const tms_local *l = &h->local;
    const int32_t slot = l->slot_of[vertex], n = h->interface_count;
    double *row = h->through + 3 * (int64_t)slot * n;
    if (h->through_vertex[slot] == vertex) return row;
    h->through_vertex[slot] = vertex;
    for (int c = 0; c < 3; c++) {
        const int32_t at = h->place[3 * vertex + c];
        for (int32_t k = 0; k < n; k++)
            row[(int64_t)c * n + k] = at < 0 ? 0 : tms_response(&h->responses, h->responses.kept_count + k, at);
    }
    return row;
}

static void inside_inside(tm_hybrid *h, int32_t a, int32_t b, double C[9]) {
    const int32_t n = h->interface_count;
    const double *ra = through(h, a), *rb = through(h, b);
    for (int i = 0; i < 9; i++) {
        const int32_t row = h->place[3 * a + i / 3], column = h->place[3 * b + i % 3];
        const double *x = ra + (int64_t)(i / 3) * n, *y = rb + (int64_t)(i % 3) * n;
        double sum = row < 0 || column < 0 ? 0 : tms_response(&h->responses, column, row);
        for (int32_t k = 0; k < n; k++) sum += x[k] * h->give_m_N[k] * y[k];
        C[i] = sum;
    }
}

static void compliance(void *self, int32_t a, int32_t b, double C[9]) {
    tm_hybrid *h = self;
    const bool in_a = h->part[a] == TMS_CONDENSED, in_b = h->part[b] == TMS_CONDENSED;
    memset(C, 0, 72);
    if (in_a && in_b) {
        inside_inside(h, a, b, C);
    } else if (in_a || in_b) {
        const int32_t inside = in_a ? a : b, other = in_a ? b : a;
        if (h->part[other] != TMS_INTERFACE) return;
        const double *row = through(h, inside);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                const int32_t k = h->place[3 * other + j];
                C[in_a ? 3 * i + j : 3 * j + i] = row[(int64_t)i * h->interface_count + k] * h->give_m_N[k];
            }
    } else if (a == b) {
        for (int i = 0; i < 3; i++) C[4 * i] = mobility(h, 3 * a + i);
    }
}

/* Shape at the end of the substep without contact. */
static void refresh(void *self, const int32_t *vertex, int32_t count) {
    tm_hybrid *h = self;
    const double *u_next = tm_world_state(h->world)->u_next_m;
    const int32_t n = h->interface_count;
    for (int32_t i = 0; i < 3 * count; i++) {
        const int32_t d = 3 * vertex[i / 3] + i % 3, at = h->place[d];
        double u = u_next[d];
        if (h->part[vertex[i / 3]] == TMS_CONDENSED) {
            const double *row = through(h, vertex[i / 3]) + (int64_t)(i % 3) * n;
            u = at < 0 ? h->value_m[d] : h->responses.base_m[at] + dot(row, h->at_m, n);
        }
        h->local.base_m[d] = u;
    }
}

static bool passes(void *self, const tm_contact_row *row) {
    return tm_contact_holds(((tm_hybrid *)self)->contact, row);
}

/* --- when the step's length, the supports or the tissue have changed --- */

static int32_t revision(const tm_hybrid *h) { return tm_tissue_surface(tm_world_tissue(h->world)).revision; }

static bool is_stale(const tm_hybrid *h) { return h->stale || h->known_revision != revision(h); }

/* What was made of mobilities. Looked at when it is needed, so that it does not matter which stage hears of a change
 * first: the integrator has them anew by then. */
static void make_fresh(tm_hybrid *h) {
    h->stale = false;
    h->known_revision = revision(h);
    memset(h->held, 0, 3 * (size_t)h->mesh->vertex_count);
    tm_support_mask(h->world, h->held);
    for (int32_t k = 0; k < h->interface_count; k++) h->give_m_N[k] = mobility(h, h->interface[k]);
    if (!h->local.memory) return;
    tms_local_forget(&h->local);
    for (int32_t s = 0; s < h->local.capacity; s++) h->through_vertex[s] = -1;
}

static void changed(void *self, tm_world *world) {
    (void)world;
    ((tm_hybrid *)self)->stale = true;
}

/* --- contact --- */

static void rebuild_surface(tm_hybrid *h) {
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
}

/* --- what lasts from step to step --- */

/* First, which part is whose: a snapshot of another division of the same organ would leave tetrahedra in both or in
 * none. Then what the on-line system keeps, if there is one. */
static uint64_t division(const tm_hybrid *h) { return tm_hash(h->alive, (size_t)h->mesh->tet_count, TM_HASH_SEED); }

static int64_t snapshot(void *self, void *buffer) {
    const tm_hybrid *h = self;
    const uint64_t mine = division(h);
    char *to = buffer ? memcpy(buffer, &mine, sizeof mine) : NULL, *rest = to ? to + sizeof mine : NULL;
    if (!h->local.memory) return sizeof mine;
    if (!h->returns) return (int64_t)sizeof mine + tms_local_snapshot(&h->local, is_stale(h), rest);
    if (rest) memcpy(rest, h->kept, (size_t)h->kept_bytes);
    return (int64_t)sizeof mine + h->kept_bytes;
}

static void take_back(tm_hybrid *h, const void *buffer, int64_t bytes) {
    h->returns = false;
    rebuild_surface(h);
    make_fresh(h);
    tms_local_restore(&h->local, buffer, bytes, true);
}

static bool restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply) {
    tm_hybrid *h = self;
    uint64_t theirs;
    (void)world;
    if (bytes < (int64_t)sizeof theirs) return false;
    memcpy(&theirs, buffer, sizeof theirs);
    if (theirs != division(h)) return false;
    const char *rest = (const char *)buffer + sizeof theirs;
    const int64_t left = bytes - (int64_t)sizeof theirs;
    if (!h->local.memory) return left == 0;
    if (apply) take_back(h, rest, left);
    return apply || tms_local_restore(&h->local, rest, left, false);
}

static void keep(void *self) {
    tm_hybrid *h = self;
    if (!h->returns && h->local.memory) h->kept_bytes = tms_local_snapshot(&h->local, is_stale(h), h->kept);
}

/* The mobilities may not have been given back yet: taken when they are needed. */
static void give_back(void *self, tm_world *world) {
    tm_hybrid *h = self;
    (void)world;
    h->returns = true;
    h->seen_revision = -1; /* the number of the surface that was given back may come again for another */
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
            u_next[d] += mobility(h, d) * f;
            continue;
        }
        const double *row = h->through + (3 * (int64_t)s + i % 3) * n;
        for (int32_t k = 0; k < n; k++) h->push_N[k] += row[k] * f;
        inside = true;
    }
    for (int32_t k = 0; inside && k < n; k++) u_next[h->interface[k]] += h->give_m_N[k] * h->push_N[k];
}

static int32_t solve(void *self, tm_world *world, const tm_tool_pose *pose, tm_contact_row *row, int32_t max_rows,
                     uint32_t flags[TM_MAX_INSTRUMENTS]) {
    tm_hybrid *h = self;
    tms_local *l = &h->local;
    const tm_state *state = tm_world_state(world);
    bool any = false;
    if (h->returns) take_back(h, h->kept, h->kept_bytes);
    if (is_stale(h)) make_fresh(h);
    rebuild_surface(h);
    for (int32_t t = 0; t < l->tool_count; t++) {
        tms_local_pose(l, t, &pose[t]);
        any |= tms_local_can_touch(&l->tool[t]);
    }
    if (!any) { /* nothing is pushed, and nothing remembered */
        memset(l->f, 0, 24 * (size_t)l->capacity);
        l->before_count = 0;
        tms_local_regather(l);
        return 0;
    }
    for (int32_t k = 0; k < h->interface_count; k++) h->at_m[k] = state->u_next_m[h->interface[k]];
    memcpy(l->u_m, state->u_m, 24 * (size_t)h->mesh->vertex_count);
    tms_local_gather(l);
    for (int32_t t = 0; t < l->tool_count; t++) flags[t] = l->tool[t].overflowed ? TM_REACTION_OVERFLOWED : 0u;
    if (l->use_count == 0) return 0;
    tms_local_solve(l);
    move(h);
    const int32_t count = l->now.count < max_rows ? l->now.count : max_rows;
    memcpy(row, l->now.row, (size_t)count * sizeof *row);
    for (int32_t t = 0; t < l->tool_count; t++) flags[t] = tms_local_flags(l, t);
    return count;
}

/* --- the stage --- */

static tm_status add_contact(tm_hybrid *h, tm_contact *contact, tm_error *error) {
    rebuild_surface(h);
    const tm_status status =
        tms_local_create(h->mesh, h->surface, &h->contact_def, NULL, h->max_local_vertices, &h->local, error);
    if (status != TM_OK) return status;
    h->local.self = h;
    h->local.compliance = compliance;
    h->local.refresh = refresh;
    h->local.passes = passes;
    h->through = tms_take(24 * (size_t)h->local.capacity * (size_t)h->interface_count);
    h->through_vertex = tms_take(4 * (size_t)h->local.capacity);
    h->kept = tms_take((size_t)tms_local_snapshot_most(&h->local));
    if (!h->through || !h->through_vertex || !h->kept)
        return tms_fail(error, TM_ERR_MEMORY, -1,
                        "no memory for contact with %d interface components; lower max_local_vertices",
                        (int)h->interface_count);
    const tm_contact_block block = {h, solve};
    tm_contact_set_block(contact, &block);
    h->contact = contact; /* from here on there is something to undo with it */
    return TM_OK;
}

/* Leaves the world, or the attempt to join one, and is as it was made: it may join another. */
static void detach(void *self) {
    tm_hybrid *h = self;
    if (h->contact) tm_contact_set_block(h->contact, NULL);
    tms_local_destroy(&h->local);
    h->local = (tms_local){0};
    void **array[] = {(void **)&h->held, (void **)&h->give_m_N, (void **)&h->through, (void **)&h->through_vertex,
                      &h->kept};
    for (size_t i = 0; i < sizeof array / sizeof *array; i++) {
        tms_give(*array[i]);
        *array[i] = NULL;
    }
    h->world = NULL;
    h->contact = NULL;
}

tm_status tm_stage_hybrid(tm_world *world, tm_hybrid *h, tm_contact *contact, tm_error *error) {
    TM_REQUIRE(world && h && !h->world, "world or hybrid is null, or hybrid is in a world already", TM_ERR_ARGUMENT);
    if (tm_tissue_mesh(tm_world_tissue(world)) != h->mesh)
        return tms_fail(error, TM_ERR_ARGUMENT, -1,
                        "the world's tissue is of another mesh than the hybrid model; make it with tm_hybrid_tissue");
    if (contact && !h->has_contact)
        return tms_fail(
            error, TM_ERR_ARGUMENT, -1,
            "the hybrid model was made without contact, and its world has some; give tm_hybrid_def.contact");
    if (tm_world_step_s(world) > h->step_s)
        return tms_fail(
            error, TM_ERR_STEP, h->step_tet,
            "time step %.6g s is above the guaranteed critical step %.6g s of the whole organ, set by tetrahedron %d; "
            "lower the step or mend that tetrahedron",
            tm_world_step_s(world), h->step_s, (int)h->step_tet);
    const uint8_t *alive = tm_tissue_alive(tm_world_tissue(world));
    for (int32_t t = 0; t < h->mesh->tet_count; t++)
        if (alive[t] && !h->alive[t])
            return tms_fail(
                error, TM_ERR_ARGUMENT, t,
                "tetrahedron %d is condensed, and alive in the world's tissue; make that tissue with tm_hybrid_tissue",
                (int)t);
    h->world = world;
    h->stale = true;
    h->held = tms_take_zeroed(3 * (size_t)h->mesh->vertex_count, 1);
    h->give_m_N = tms_take_zeroed((size_t)h->interface_count, 8);
    tm_status status =
        h->held && h->give_m_N
            ? TM_OK
            : tms_fail(error, TM_ERR_MEMORY, -1, "no memory for the stage of a hybrid model; use a coarser mesh");
    if (status == TM_OK && contact) status = add_contact(h, contact, error);
    if (status != TM_OK) {
        detach(h);
        return status;
    }
    const tm_stage stage = {.size = sizeof(tm_stage),
                            .name = "hybrid",
                            .phase = TM_PHASE_LOAD,
                            .run = run,
                            .destroy = detach,
                            .step_changed = changed,
                            .self = h,
                            .snapshot = snapshot,
                            .restore = restore,
                            .keep = keep,
                            .give_back = give_back,
                            .needs = {contact ? "contact" : NULL},
                            .step_limit_s = h->step_s,
                            .not_settled = "the condensed part is no world's to relax; solve the whole organ "
                                           "(tm_solve_static), which has the same rest"};
    status = tm_world_add_stage(world, &stage, tm_hybrid_bytes(h), error);
    if (status != TM_OK) detach(h);
    return status;
}

/* --- once a frame --- */

void tm_hybrid_recover(tm_hybrid *h, tm_world *world) {
    TM_REQUIRE(h && world && h->world == world, "hybrid or world is null, or hybrid is not in this world", );
    tm_world_work_of(world, h);
    const tm_state *state = tm_world_state(world);
    const tms_local *l = &h->local;
    const int32_t dofs = 3 * h->mesh->vertex_count;
    for (int32_t d = 0; d < dofs; d++) h->full_u[d] = h->part[d / 3] == TMS_INTERFACE ? state->u_m[d] : h->value_m[d];
    tm_tissue_force(h->condensed, h->full_u, h->full_f);
    double *b = tms_work_rhs(h->work);
    for (int32_t i = 0; i < h->system.n; i++) b[i] = h->full_f[h->system.dof[i]] + h->load_N[h->system.dof[i]];
    for (int32_t i = 0; i < 3 * l->use_count; i++) {
        const int32_t s = l->use[i / 3], at = h->system.index[3 * l->vertex[s] + i % 3];
        if (at >= 0) b[at] += l->f[3 * s + i % 3];
    }
    const double *x = tms_work_solve(h->work);
    h->unrecovered = !x;
    for (int32_t i = 0; x && i < h->system.n; i++) h->full_u[h->system.dof[i]] = x[i];
    for (int32_t d = 0; x && d < dofs; d++)
        if (h->part[d / 3] == TMS_CONDENSED) state->u_m[d] = state->u_prev_m[d] = h->full_u[d];
    tm_world_work_of(world, NULL);
}

tm_tool_reaction tm_hybrid_reaction(const tm_hybrid *h, int32_t instrument) {
    TM_REQUIRE(h && h->contact, "hybrid is null or has no contact", (tm_tool_reaction){0});
    tm_tool_reaction r = tm_contact_reaction(h->contact, instrument);
    if (h->unrecovered) r.flags |= TM_REACTION_UNCONVERGED;
    return r;
}

tm_surface_view tm_hybrid_surface(tm_hybrid *h) {
    TM_REQUIRE(h && h->world, "hybrid is null or in no world", (tm_surface_view){0});
    rebuild_surface(h);
    return h->surface;
}
