/* Stage "touch": contact of tissue with tissue. With instruments its rows are a block of contact's sweeps; without, the
 * stage sweeps them itself. */
#include "touch/touch_internal.h"

#include <math.h>
#include <string.h>

tm_touching_def tm_touching_def_default(void) {
    return (tm_touching_def){.cookie = TM_COOKIE_TOUCHING,
                             .size = sizeof(tm_touching_def),
                             .body_count = 1,
                             .thickness_m = 0.5e-3,
                             .compliance_m_N = 0.5e-3,
                             .sweeps = 10,
                             .max_rows = 4096,
                             .max_candidates = 65536,
                             .force_cap_N = 50};
}

/* --- the step --- */

static void refresh_supports(tm_touching *t) {
    t->fixed_by = t->world->support;
    memset(t->fixed, 0, 3 * (size_t)t->world->tissue->mesh->vertex_count);
    tm_support_mask(t->world, t->fixed);
}

static void run(void *self, tm_world *world) {
    tm_touching *t = self;
    if (t->fixed_by != world->support) refresh_supports(t);
    if (!t->found_early) tm_touch_begin(t), tm_touch_find(t);
    t->found_early = false;
    tm_touch_prepare(t);
    if (tm_world_contact(world)) return; /* contact sweeps the rows */
    for (int32_t sweep = 0; sweep < t->def.sweeps; sweep++) tm_touch_sweep(t, sweep);
    tm_touch_sweep_last(t);
    tm_touch_note_energy(t);
    tm_touch_list_entered(t);
    tm_touch_remember(t);
    tm_touch_remember_account(t);
}

/* Rows depend on the start of a substep. Overlaps if no stage between the new displacements and this one might cut:
 * each is contact's, or registered as changing nothing. */
static bool begin_overlap(void *self, tm_world *world) {
    tm_touching *t = self;
    const tm_contact *contact = tm_world_contact(world);
    for (int32_t i = world->group_end; i < world->step_count && world->entry[i].stage.self != self; i++)
        if (world->entry[i].few != &tm_changes_none && !tm_contact_owns(contact, world->entry[i].stage.self))
            return false;
    tm_touch_begin(t);
    tm_touch_update(t); /* here, as it uses all threads */
    t->found_early = true;
    return true;
}

/* On the caller's thread: it takes from nothing to a millisecond, and a thread of the pool that is late by as much
 * counts as preempted. */
static void work_overlap(void *self, tm_world *world, int32_t part) {
    (void)world;
    if (part == 0) tm_touch_find(self);
}
static const tm_overlap overlap = {begin_overlap, work_overlap};

static void sweep(void *self, tm_world *world, int32_t number) {
    (void)world;
    tm_touch_sweep(self, number);
}

static void note(void *self, tm_world *world) {
    (void)world;
    tm_touch_sweep_last(self);
    tm_touch_note_energy(self);
}

/* After the forces of all instruments were limited, in each round. */
static bool hold_back(void *self, tm_world *world, int32_t instrument) {
    return instrument + 1 == tm_world_contact(world)->tool_count && tm_touch_limit_energy(self);
}

static void finish(void *self, tm_world *world) {
    (void)world;
    tm_touch_list_entered(self);
    tm_touch_remember(self);
    tm_touch_remember_account(self);
}

static void react_not(void *self, int32_t instrument, double force_N[3], double resultant_N[3]) {
    (void)self, (void)instrument, (void)force_N, (void)resultant_N;
}

static void changed(void *self, tm_world *world) {
    tm_touching *t = self;
    if (t->revision == world->tissue->surface.revision) refresh_supports(t);
}

static bool is_bounded(const void *self, const tm_world *world) {
    const tm_touching *t = self;
    bool bounded = true;
    for (int32_t i = 0; i < t->row_count; i++)
        for (int j = 0; j < 4; j++) bounded &= tm_vertex_is_bounded(world, t->row[i].vertex[j]);
    return bounded;
}
static const tm_few few = {.is_bounded = is_bounded, .forces = tm_touch_forces};

/* --- state between steps --- */

static void checkpoint(void *self) {
    tm_touching *t = self;
    t->maybe_moved = true;
    t->saved_count = t->memory_count;
    memcpy(t->saved, t->memory, sizeof *t->memory * (size_t)t->memory_count);
}

/* Takes the account from the memory, which now holds another one. */
static void recall_account(tm_touching *t) {
    const tm_touch_memory *m = t->memory + t->memory_count - 1;
    const bool has = t->memory_count > 0 && m->edges == TM_TOUCH_MEMORY_ACCOUNT;
    t->reserve_J = has ? m->lambda_N : 0, t->pushed_J = has ? m->drag_N[2] : 0;
    for (int i = 0; i < 2; i++) t->stored_before_J[i] = has ? m->drag_N[i] : 0;
}

static void rollback(void *self, tm_world *world) {
    (void)world;
    tm_touching *t = self;
    t->memory_count = t->saved_count;
    memcpy(t->memory, t->saved, sizeof *t->memory * (size_t)t->saved_count);
    recall_account(t);
    t->row_count = 0;
    t->gathered = false;
}

static int64_t snapshot(void *self, void *buffer) {
    const tm_touching *t = self;
    if (buffer) memcpy(buffer, t->memory, sizeof *t->memory * (size_t)t->memory_count);
    return (int64_t)sizeof *t->memory * t->memory_count;
}

static bool restore(void *self, tm_world *world, const void *buffer, int64_t bytes, bool apply) {
    (void)world;
    tm_touching *t = self;
    const int64_t count = bytes / (int64_t)sizeof *t->memory;
    if (bytes < 0 || bytes % (int64_t)sizeof *t->memory || count > t->def.max_rows) return false;
    if (!apply) return true;
    memcpy(t->memory, buffer, (size_t)bytes);
    t->memory_count = (int32_t)count;
    recall_account(t);
    t->row_count = 0;
    t->gathered = false;
    return true;
}

/* --- creation --- */

static tm_status check(const tm_touching_def *def, const tm_world *world, tm_error *error) {
    if (def->body_count < 1 || def->body_count > TM_MAX_BODIES)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "touch: %d bodies; give 1 to %d", def->body_count, TM_MAX_BODIES);
    if (!(def->thickness_m > 0) || !(def->thickness_m < 1) || !(def->compliance_m_N >= 0) ||
        !isfinite(def->compliance_m_N) || !(def->force_cap_N > 0) || def->sweeps < 1 || def->max_rows < 1 ||
        def->max_candidates < 0)
        return tm_fail(
            error, TM_ERR_ARGUMENT, -1,
            "touch: thickness %g m, compliance %g m/N, force cap %g N, %d sweeps, %d rows; give positive ones",
            def->thickness_m, def->compliance_m_N, def->force_cap_N, def->sweeps, def->max_rows);
    if (!(def->mu_kinetic >= 0) || !(def->mu_kinetic <= def->mu_static) || !(def->mu_static <= 2))
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "touch: friction %g, kinetic %g; give coefficients from 0 to 2, the kinetic one not above the "
                       "static one",
                       def->mu_static, def->mu_kinetic);
    for (int32_t i = 0; def->tet_body && i < world->tissue->mesh->tet_count; i++)
        if (def->tet_body[i] < 0 || def->tet_body[i] >= def->body_count)
            return tm_fail(error, TM_ERR_ARGUMENT, i, "touch: tetrahedron %d is of body %d; give 0 to %d", i,
                           def->tet_body[i], def->body_count - 1);
    for (int32_t a = 0; def->pair && a < def->body_count; a++)
        for (int32_t b = 0; b < a; b++)
            if (!def->pair[a * def->body_count + b] != !def->pair[b * def->body_count + a])
                return tm_fail(error, TM_ERR_ARGUMENT, a,
                               "touch: body %d touches %d, but not the reverse; make 'pair' symmetric", a, b);
    return TM_OK;
}

static bool init(tm_touching *t, tm_pool *pool, const tm_touching_def *def) {
    const tm_mesh *mesh = t->world->tissue->mesh;
    const size_t pairs = (size_t)(def->body_count * def->body_count);
    t->def = *def;
    if (!def->max_candidates) t->def.max_candidates = 65536;
    memset(t->pair, 1, sizeof t->pair);
    if (def->pair) memcpy(t->pair, def->pair, pairs);
    if (def->tet_body && (t->tet_body = TM_ALLOC(pool, int32_t, mesh->tet_count)))
        memcpy(t->tet_body, def->tet_body, sizeof *t->tet_body * (size_t)mesh->tet_count);
    t->def.pair = NULL, t->def.tet_body = NULL; /* the caller's arrays */
    t->row = TM_ALLOC(pool, tm_touching_row, def->max_rows);
    t->solver = TM_ALLOC(pool, tm_touch_solver, def->max_rows);
    t->memory = TM_ALLOC(pool, tm_touch_memory, def->max_rows);
    t->saved = TM_ALLOC(pool, tm_touch_memory, def->max_rows);
    t->fixed = TM_ALLOC(pool, uint8_t, 3 * (int64_t)mesh->vertex_count);
    t->revision = t->world->tissue->surface.revision - 1;
    t->is_fast = TM_ALLOC(pool, uint8_t, mesh->vertex_count);
    t->is_followed = TM_ALLOC(pool, uint8_t, mesh->vertex_count);
    t->followed = TM_ALLOC(pool, int32_t, TM_TOUCH_MAX_FOLLOWED);
    t->reach_m = 2 * def->thickness_m; /* thickness, and a lookahead of at most as much */
    return tm_touch_surface_init(&t->surface, pool, t->world->tissue) && tm_touch_gather_init(t, pool);
}

static void destroy(void *self) {
    tm_touching *t = self;
    tm_contact *contact = tm_world_contact(t->world);
    if (contact) tm_contact_remove_block(contact, t);
    t->world->notes_travel--;
    t->world->touching = NULL;
    t->world->settle_stride_m = 0;
    t->world->settle_slides = false;
    tm_pool pool = t->pool;
    tm_pool_release(&pool);
}

static tm_status add_stage(tm_touching *t, tm_contact *contact, tm_error *error) {
    tm_stage stage = {.size = sizeof stage,
                      .name = "touch",
                      .phase = TM_PHASE_CONSTRAIN,
                      .run = run,
                      .destroy = destroy,
                      .step_changed = changed,
                      .self = t,
                      .overlap = &overlap,
                      .snapshot = snapshot,
                      .restore = restore,
                      .checkpoint = checkpoint,
                      .rollback = rollback,
                      .snapshot_max = (int64_t)sizeof *t->memory * t->def.max_rows};
    if (contact) stage.needs[0] = "contact", stage.runs_before = TM_STAGE_CONTACT_DETECT;
    const tm_status status = tm_world_add_stage(t->world, &stage, t->pool.bytes, error);
    if (status) return status;
    t->world->notes_travel++;
    t->world->touching = t;
    t->world->settle_stride_m = 0.2 * t->def.thickness_m; /* two sides: less than a thickness, which rows reach */
    t->world->settle_slides = t->def.mu_static < TM_SETTLE_FRICTION;
    tm_world_set_few(t->world, "touch", &few);
    const tm_constraint_block block = {
        .self = t, .owner = t, .sweep = sweep, .finish = note, .hold_back = hold_back, .react = react_not};
    const tm_constraint_block behind = {.self = t, .owner = t, .finish = finish, .react = react_not};
    if (contact) tm_contact_add_block(contact, &block), tm_contact_add_block_behind(contact, &behind);
    return TM_OK;
}

tm_status tm_stage_touch(tm_world *world, const tm_touching_def *def, tm_touching **touching, tm_error *error) {
    TM_REQUIRE_DEF(def, TM_COOKIE_TOUCHING, TM_ERR_ARGUMENT);
    TM_REQUIRE(world && touching, "world or touching is null", TM_ERR_ARGUMENT);
    tm_status status = check(def, world, error);
    if (status) return status;
    tm_pool pool = {0};
    tm_touching *t = TM_ALLOC(&pool, tm_touching, 1);
    if (t) t->world = world;
    if (!t || !init(t, &pool, def)) {
        tm_pool_release(&pool);
        return tm_fail_memory(error, "touch stage");
    }
    t->pool = pool;
    status = add_stage(t, tm_world_contact(world), error);
    if (status) {
        tm_pool_release(&pool);
        return status;
    }
    *touching = t;
    return TM_OK;
}

tm_touching *tm_world_touching(tm_world *world) {
    TM_REQUIRE(world, "world is null", NULL);
    return world->touching;
}

int32_t tm_touching_rows(const tm_touching *touching, const tm_touching_row **row) {
    TM_REQUIRE(touching && row, "touching or row is null", 0);
    *row = touching->row;
    return touching->row_count;
}

tm_touching_report tm_touching_get_report(const tm_touching *touching) {
    TM_REQUIRE(touching, "touching is null", (tm_touching_report){0});
    return touching->report;
}
