/* Stage "ties": springs between surfaces, solved implicitly in the sweeps of contact, so that they limit no step. */
#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "tensormass/ties.h"
#include "touch/touch_internal.h"

enum { TM_COOKIE_TIES = 0x74696573 };

/* What changes in a step. */
typedef struct tie_state {
    double lambda_N;
    int32_t whole, why;
} tie_state;

/* Of this substep. */
typedef struct tie_row {
    int32_t vertex[4];
    double weight[4], normal[3], response[4][3], diagonal_m_N, stretch_m;
    double span_m[3], mobility_m_N[3]; /* from end to end before the substep; of all four vertices, by axis */
    bool is_short;                     /* its direction is solved too */
} tie_row;

struct tm_ties {
    tm_pool pool;
    tm_world *world;
    int32_t count, sweeps, gone_count, fetched, saved_gone;
    tm_tie *tie;
    tie_state *state, *saved;
    tie_row *row;
    int32_t *gone; /* [count] ties that went, in that order */
    uint8_t *fixed;
    const void *fixed_by;
};

tm_ties_def tm_ties_def_default(void) {
    return (tm_ties_def){.cookie = TM_COOKIE_TIES, .size = sizeof(tm_ties_def), .sweeps = 10};
}

bool tm_tie_lead(const tm_mesh *mesh, int32_t vertex, const int32_t *triangle, int32_t count, tm_tie *tie) {
    TM_REQUIRE(mesh && tie && (triangle || count <= 0), "mesh, tie or triangle is null", false);
    const double *x = mesh->rest_m;
    bool found = false;
    for (int32_t i = 0; i < count; i++) {
        const int32_t *v = triangle + 3 * i;
        if (v[0] == vertex || v[1] == vertex || v[2] == vertex) continue;
        const tm_touch_closest c = tm_touch_point_triangle(x + 3 * vertex, x + 3 * v[0], x + 3 * v[1], x + 3 * v[2]);
        if (found && c.distance_m >= tie->rest_m) continue;
        tie->vertex = vertex, tie->rest_m = c.distance_m;
        for (int j = 0; j < 3; j++) tie->other[j] = v[j], tie->weight[j] = c.weight[j];
        found = true;
    }
    return found;
}

/* --- ends --- */

static void ends_at(const tm_ties *t, int32_t i, const double *u_m, double from[3], double to[3]) {
    const tm_tie *tie = t->tie + i;
    const double *rest = t->world->tissue->mesh->rest_m;
    for (int c = 0; c < 3; c++) {
        from[c] = rest[3 * tie->vertex + c] + u_m[3 * tie->vertex + c];
        to[c] = 0;
        for (int j = 0; j < 3; j++)
            to[c] += tie->weight[j] * (rest[3 * tie->other[j] + c] + u_m[3 * tie->other[j] + c]);
    }
}

static void end(tm_ties *t, int32_t i, int32_t why) {
    t->state[i] = (tie_state){.why = why};
    t->gone[t->gone_count++] = i;
}

/* --- cutting --- */

/* Returns the distance of a tie from the axis of a tool, up to its end behind the tip. */
static double distance_m(const double from[3], const double to[3], const tm_capsule *capsule) {
    double s, r;
    bool inside;
    return tm_touch_segments(from, to, capsule->tip_m, capsule->tail_m, &s, &r, &inside);
}

static void cut(tm_ties *t, const tm_contact *contact) {
    for (int32_t k = 0; contact && k < contact->tool_count; k++) {
        const tm_tool *tool = contact->tool + k;
        if (tool->def.mode != TM_TOOL_CAUTERY || !tool->pose.active) continue;
        for (int32_t i = 0; i < t->count; i++) {
            double from[3], to[3];
            if (!t->state[i].whole) continue;
            ends_at(t, i, t->world->state.u_m, from, to);
            if (distance_m(from, to, &tool->capsule) <= tool->def.radius_m) end(t, i, k);
        }
    }
}

/* --- the step --- */

/* Across itself a tie is a spring of force / length. Above this share of the mobility's stiffness its ends would swing
 * if its direction were that of the last substep: short ties, whose rest length is 0 for instance. */
static const double STIFF_ACROSS = 0.25;

static void push(tm_ties *t, int32_t i, const double force_N[3]) {
    const tie_row *row = t->row + i;
    for (int j = 0; j < 4; j++)
        for (int c = 0; c < 3; c++)
            t->world->state.u_next_m[3 * row->vertex[j] + c] += row->response[j][c] * force_N[c];
}

static void prepare(tm_ties *t, int32_t i) {
    const tm_tie *tie = t->tie + i;
    tie_row *row = t->row + i;
    double from[3], to[3], force[3];
    ends_at(t, i, t->world->state.u_m, from, to);
    *row = (tie_row){.vertex = {tie->vertex, tie->other[0], tie->other[1], tie->other[2]},
                     .weight = {1, -tie->weight[0], -tie->weight[1], -tie->weight[2]}};
    vsub(to, from, row->span_m);
    const double length_m = vunit(row->span_m, row->normal);
    row->stretch_m = length_m - tie->rest_m;
    for (int j = 0; j < 4; j++)
        for (int c = 0; c < 3; c++) {
            const int32_t dof = 3 * row->vertex[j] + c;
            row->response[j][c] = t->fixed[dof] ? 0 : row->weight[j] * t->world->mobility_s2_kg[row->vertex[j]];
            row->mobility_m_N[c] += row->weight[j] * row->response[j][c];
            row->diagonal_m_N += row->weight[j] * row->response[j][c] * row->normal[c] * row->normal[c];
        }
    const double mobility = law_max(law_max(row->mobility_m_N[0], row->mobility_m_N[1]), row->mobility_m_N[2]);
    row->is_short = t->state[i].lambda_N * mobility >= STIFF_ACROSS * length_m;
    vscale(t->state[i].lambda_N, row->normal, force);
    push(t, i, force);
}

/* Solves force and direction of a short tie: both are those of its ends after the substep. */
static void relax_short(tm_ties *t, int32_t i) {
    tie_row *row = t->row + i;
    const tm_state *state = &t->world->state;
    double before[3], free_m[3], change[3], mobility = 0; /* free_m: from end to end without the tie's force */
    vscale(t->state[i].lambda_N, row->normal, before);
    for (int c = 0; c < 3; c++) {
        free_m[c] = row->span_m[c] + row->mobility_m_N[c] * before[c];
        for (int j = 0; j < 4; j++) {
            const int32_t dof = 3 * row->vertex[j] + c;
            free_m[c] -= row->weight[j] * (state->u_next_m[dof] - state->u_m[dof]);
        }
    }
    const double stretch = vunit(free_m, row->normal) - t->tie[i].rest_m;
    t->world->unstable |= !(fabs(stretch) < INFINITY);
    for (int c = 0; c < 3; c++) mobility += row->mobility_m_N[c] * row->normal[c] * row->normal[c];
    t->state[i].lambda_N = law_max(stretch / (mobility + 1 / t->tie[i].stiffness_N_m), 0);
    vscale(t->state[i].lambda_N, row->normal, change);
    vsub(change, before, change);
    push(t, i, change);
}

static void relax(tm_ties *t, int32_t i) {
    const tie_row *row = t->row + i;
    const tm_state *state = &t->world->state;
    double nearer = 0, change[3];
    for (int j = 0; j < 4; j++)
        for (int c = 0; c < 3; c++) {
            const int32_t dof = 3 * row->vertex[j] + c;
            nearer += row->weight[j] * row->normal[c] * (state->u_next_m[dof] - state->u_m[dof]);
        }
    const double stretch = row->stretch_m - nearer + row->diagonal_m_N * t->state[i].lambda_N;
    t->world->unstable |= !(fabs(stretch) < INFINITY);
    const double lambda = law_max(stretch / (row->diagonal_m_N + 1 / t->tie[i].stiffness_N_m), 0);
    vscale(lambda - t->state[i].lambda_N, row->normal, change);
    if (lambda != t->state[i].lambda_N) push(t, i, change);
    t->state[i].lambda_N = lambda;
}

static void sweep(void *self, tm_world *world, int32_t number) {
    (void)world;
    tm_ties *t = self;
    for (int32_t k = 0; k < t->count; k++) {
        const int32_t i = number % 2 ? t->count - 1 - k : k;
        if (t->state[i].whole) t->row[i].is_short ? relax_short(t, i) : relax(t, i);
    }
}

static void react_not(void *self, int32_t instrument, double force_N[3], double resultant_N[3]) {
    (void)self, (void)instrument, (void)force_N, (void)resultant_N;
}

static bool has_tissue(const tm_ties *t, int32_t i) {
    const double *mass = t->world->tissue->mass_kg;
    bool all = mass[t->tie[i].vertex] > 0;
    for (int j = 0; j < 3; j++) all &= !(t->tie[i].weight[j] > 0) || mass[t->tie[i].other[j]] > 0;
    return all;
}

static void run(void *self, tm_world *world) {
    tm_ties *t = self;
    if (t->fixed_by != world->support) {
        t->fixed_by = world->support;
        memset(t->fixed, 0, 3 * (size_t)world->tissue->mesh->vertex_count);
        tm_support_mask(world, t->fixed);
    }
    tm_contact *contact = tm_world_contact(world);
    for (int32_t i = 0; i < t->count; i++) {
        if (!t->state[i].whole) continue;
        if (!has_tissue(t, i))
            end(t, i, TM_TIE_TISSUE_WENT);
        else if (t->tie[i].break_N > 0 && t->state[i].lambda_N > t->tie[i].break_N)
            end(t, i, TM_TIE_BROKE);
    }
    if (!world->settling) cut(t, contact);
    for (int32_t i = 0; i < t->count; i++)
        if (t->state[i].whole) prepare(t, i);
    for (int32_t number = 0; number < t->sweeps && !contact; number++) sweep(t, world, number);
}

/* Supports may be on other vertices. */
static void changed(void *self, tm_world *world) {
    (void)world;
    ((tm_ties *)self)->fixed_by = NULL;
}

static bool is_bounded(const void *self, const tm_world *world) {
    const tm_ties *t = self;
    bool bounded = true;
    for (int32_t i = 0; i < t->count; i++)
        for (int j = 0; j < 4 && t->state[i].whole; j++) bounded &= tm_vertex_is_bounded(world, t->row[i].vertex[j]);
    return bounded;
}

static void forces(const void *self, void *to, tm_add_force *add) {
    const tm_ties *t = self;
    for (int32_t i = 0; i < t->count; i++)
        for (int j = 0; j < 4 && t->state[i].whole; j++) {
            double force[3];
            vscale(t->row[i].weight[j] * t->state[i].lambda_N, t->row[i].normal, force);
            add(to, t->row[i].vertex[j], force);
        }
}
static const tm_few few = {.is_bounded = is_bounded, .forces = forces};

/* --- state between steps --- */

static void checkpoint(void *self) {
    tm_ties *t = self;
    t->saved_gone = t->gone_count;
    memcpy(t->saved, t->state, sizeof *t->state * (size_t)t->count);
}

static void rollback(void *self, tm_world *world) {
    (void)world;
    tm_ties *t = self;
    t->gone_count = t->saved_gone;
    memcpy(t->state, t->saved, sizeof *t->state * (size_t)t->count);
}

static int64_t snapshot(void *self, void *buffer) {
    const tm_ties *t = self;
    const size_t bytes = sizeof *t->state * (size_t)t->count;
    if (buffer) memcpy(buffer, t->state, bytes);
    return (int64_t)bytes;
}

static bool restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply) {
    (void)world;
    tm_ties *t = self;
    if (bytes != (int64_t)sizeof *t->state * t->count) return false;
    if (!apply) return true;
    memcpy(t->state, buffer, (size_t)bytes);
    t->gone_count = t->fetched = 0; /* those that went before the snapshot are not told again */
    for (int32_t i = 0; i < t->count; i++)
        if (!t->state[i].whole) t->gone[t->gone_count++] = i, t->fetched++;
    return true;
}

/* --- creation --- */

static tm_status check(const tm_world *world, const tm_ties_def *def, tm_error *error) {
    const int32_t n = world->tissue->mesh->vertex_count;
    for (int32_t i = 0; i < def->count; i++) {
        const tm_tie *tie = def->tie + i;
        bool fits = tie->vertex >= 0 && tie->vertex < n;
        for (int j = 0; j < 3; j++)
            fits = fits && tie->other[j] >= 0 && tie->other[j] < n && tie->other[j] != tie->vertex &&
                   tie->weight[j] >= 0 && tie->weight[j] <= 1;
        fits = fits && fabs(tie->weight[0] + tie->weight[1] + tie->weight[2] - 1) < 1e-9;
        if (!fits || !(tie->rest_m >= 0) || !(tie->stiffness_N_m > 0) || !(tie->break_N >= 0) ||
            !isfinite(tie->rest_m + tie->stiffness_N_m + tie->break_N))
            return tm_fail(error, TM_ERR_ARGUMENT, i,
                           "ties: tie %d has stiffness %g N/m, length %g m, breaking load %g N; give a positive "
                           "stiffness, none negative, and four vertices of the tissue with weights that sum to 1",
                           i, tie->stiffness_N_m, tie->rest_m, tie->break_N);
    }
    return TM_OK;
}

static void destroy(void *self) {
    tm_ties *t = self;
    tm_contact *contact = tm_world_contact(t->world);
    if (contact) tm_contact_remove_block(contact, t);
    t->world->ties = NULL;
    tm_pool pool = t->pool;
    tm_pool_release(&pool);
}

static tm_status add_stage(tm_ties *t, tm_contact *contact, tm_error *error) {
    tm_stage stage = {.size = sizeof stage,
                      .name = "ties",
                      .phase = TM_PHASE_CONSTRAIN,
                      .run = run,
                      .destroy = destroy,
                      .step_changed = changed,
                      .self = t,
                      .snapshot = snapshot,
                      .restore = restore,
                      .checkpoint = checkpoint,
                      .rollback = rollback};
    if (contact) stage.needs[0] = "contact", stage.runs_before = TM_STAGE_CONTACT_DETECT;
    const tm_status status = tm_world_add_stage(t->world, &stage, t->pool.bytes, error);
    if (status) return status;
    t->world->ties = t;
    tm_world_set_few(t->world, "ties", &few);
    const tm_constraint_block block = {.self = t, .owner = t, .sweep = sweep, .react = react_not};
    if (contact) tm_contact_add_block(contact, &block);
    return TM_OK;
}

tm_status tm_stage_ties(tm_world *world, const tm_ties_def *def, tm_ties **ties, tm_error *error) {
    TM_REQUIRE_DEF(def, TM_COOKIE_TIES, TM_ERR_ARGUMENT);
    TM_REQUIRE(world && ties && def->count >= 0 && (def->tie || def->count == 0) && def->sweeps > 0,
               "world, ties or def->tie is null, or a number is negative", TM_ERR_ARGUMENT);
    tm_status status = check(world, def, error);
    if (status) return status;
    tm_pool pool = {0};
    tm_ties *t = TM_ALLOC(&pool, tm_ties, 1);
    if (!t) return tm_fail_memory(error, "ties");
    *t = (tm_ties){.world = world, .count = def->count, .sweeps = def->sweeps};
    t->tie = TM_ALLOC(&pool, tm_tie, def->count);
    t->state = TM_ALLOC(&pool, tie_state, def->count);
    t->saved = TM_ALLOC(&pool, tie_state, def->count);
    t->row = TM_ALLOC(&pool, tie_row, def->count);
    t->gone = TM_ALLOC(&pool, int32_t, def->count);
    t->fixed = TM_ALLOC(&pool, uint8_t, 3 * (int64_t)world->tissue->mesh->vertex_count);
    status = pool.failed ? tm_fail_memory(error, "ties") : TM_OK;
    for (int32_t i = 0; i < def->count && !status; i++) t->tie[i] = def->tie[i], t->state[i].whole = 1;
    t->pool = pool;
    if (!status) status = add_stage(t, tm_world_contact(world), error);
    if (status)
        tm_pool_release(&pool);
    else
        *ties = t;
    return status;
}

/* --- the rest --- */

tm_ties *tm_world_ties(tm_world *world) {
    TM_REQUIRE(world, "world is null", NULL);
    return world->ties;
}

int32_t tm_ties_count(const tm_ties *ties) {
    TM_REQUIRE(ties, "ties is null", 0);
    return ties->count;
}

tm_tie tm_ties_get(const tm_ties *ties, int32_t tie) {
    TM_REQUIRE(ties && tie >= 0 && tie < ties->count, "ties is null or tie is not one of its own", (tm_tie){0});
    return ties->tie[tie];
}

bool tm_ties_is_whole(const tm_ties *ties, int32_t tie) {
    TM_REQUIRE(ties && tie >= 0 && tie < ties->count, "ties is null or tie is not one of its own", false);
    return ties->state[tie].whole != 0;
}

double tm_ties_force_N(const tm_ties *ties, int32_t tie, double from_m[3], double to_m[3]) {
    TM_REQUIRE(ties && tie >= 0 && tie < ties->count, "ties is null or tie is not one of its own", 0);
    double from[3], to[3];
    ends_at(ties, tie, ties->world->state.u_m, from, to);
    if (from_m) vset(from, from_m);
    if (to_m) vset(to, to_m);
    return ties->state[tie].whole ? ties->state[tie].lambda_N : 0;
}

int32_t tm_ties_fetch_cut(tm_ties *ties, int32_t *tie, int32_t *why, int32_t capacity) {
    TM_REQUIRE(ties && (tie || capacity <= 0), "ties or tie is null", 0);
    int32_t count = 0;
    for (; ties->fetched < ties->gone_count && count < capacity; count++) {
        tie[count] = ties->gone[ties->fetched++];
        if (why) why[count] = ties->state[tie[count]].why;
    }
    return count;
}

double tm_ties_energy(tm_world *world, void *to, tm_add_force *add) {
    const tm_ties *t = tm_world_ties(world);
    double stored = 0;
    if (t) forces(t, to, add);
    for (int32_t i = 0; t && i < t->count; i++)
        if (t->state[i].whole) stored += 0.5 * t->state[i].lambda_N * t->state[i].lambda_N / t->tie[i].stiffness_N_m;
    return stored;
}
