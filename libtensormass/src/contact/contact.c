/* Stage "contact": moves the tools at the start of a step. Its substages: "contact detect" finds the rows of all tools;
 * "contact solve" makes them non-penetrating, together with the other blocks; "contact forces" sums the reactions. */
#include "contact/contact_internal.h"

#include <math.h>
#include <string.h>

tm_contact_def tm_contact_def_default(void) {
    return (tm_contact_def){.cookie = TM_COOKIE_CONTACT,
                            .size = sizeof(tm_contact_def),
                            .contact_compliance_m_N = 0.5e-3,
                            .sweeps = 10,
                            .max_rows = 256,
                            .force_cap_N = 50};
}

static void refresh_supports(tm_contact *contact) {
    contact->fixed_by = contact->world->support;
    memset(contact->fixed, 0, 3 * (size_t)contact->world->tissue->mesh->vertex_count);
    tm_support_mask(contact->world, contact->fixed);
}

/* --- the stage and its substages, in the order of the step --- */

static void move(void *self, tm_world *world) {
    tm_contact *contact = self;
    if (contact->fixed_by != world->support) refresh_supports(contact);
    contact->unstable = false;
    for (int32_t t = 0; t < contact->tool_count; t++) {
        tm_tool *tool = contact->tool + t;
        tm_tool_advance(tool, world->part, world->parts);
        if (tm_capsule_travel(&tool->capsule, &tool->previous) > TM_TOO_FAST * tool->def.radius_m)
            tool->flags |= TM_REACTION_TOO_FAST;
    }
}

static void find(void *self, tm_world *world) {
    const tm_contact *contact = self;
    for (int32_t b = 0; b < contact->block_count; b++)
        if (contact->block[b].find) contact->block[b].find(contact->block[b].self, world);
}

static void constrain(void *self, tm_world *world) { tm_contact_constrain(self, world); }

static void sum(void *self, tm_world *world) {
    (void)world;
    tm_contact_sum(self);
}

/* Updates after dt changed or tissue was cut: candidates may be removed, supports may be on other vertices. */
static void changed(void *self, tm_world *world) {
    tm_contact *contact = self;
    int32_t revision = tm_tissue_surface(world->tissue).revision;
    if (revision == contact->revision) /* a cut moves no support: avoid the cost of the complete mesh */
        refresh_supports(contact);
    for (int32_t t = 0; t < contact->tool_count; t++) contact->tool[t].gathered_age = -1; /* it counts steps of dt */
    contact->revision = revision;
}

/* --- creation --- */

static tm_status check(const tm_contact_def *def, tm_error *error) {
    if (def->instrument_count < 1 || def->instrument_count > TM_MAX_INSTRUMENTS)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "contact has %d instruments; give 1 to %d", def->instrument_count,
                       TM_MAX_INSTRUMENTS);
    if (!(def->contact_compliance_m_N >= 0) || !isfinite(def->contact_compliance_m_N))
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "contact compliance is %g m/N; give 0 or more",
                       def->contact_compliance_m_N);
    if (def->sweeps < 1 || def->max_rows < 1 || def->max_rows > TM_LOCAL_HITS || !(def->force_cap_N > 0))
        return tm_fail(
            error, TM_ERR_ARGUMENT, -1,
            "contact has %d sweeps, %d rows and a force cap of %g N; give at least one sweep, 1 to %d rows and a "
            "positive cap",
            def->sweeps, def->max_rows, def->force_cap_N, TM_LOCAL_HITS);
    for (int32_t i = 0; i < def->instrument_count; i++) {
        const tm_instrument_def *tool = def->instrument + i;
        if (tool->mode != TM_TOOL_PROBE && tool->mode != TM_TOOL_GRASPER && tool->mode != TM_TOOL_CAUTERY)
            return tm_fail(error, TM_ERR_ARGUMENT, i, "instrument %d: mode %d; give one of tm_tool_mode", i,
                           (int)tool->mode);
        bool finite = TM_IS_POSE(&tool->pose) && isfinite(tool->pose.roll_rad) && isfinite(tool->pose.grip);
        for (int c = 0; c < 3; c++) finite = finite && isfinite(tool->trocar_m[c]) && isfinite(tool->pose.tip_m[c]);
        if (!finite || !(tool->radius_m > 0) || !isfinite(tool->radius_m) || !(tool->contact_length_m >= 0) ||
            !isfinite(tool->contact_length_m))
            return tm_fail(
                error, TM_ERR_ARGUMENT, i,
                "instrument %d has radius %g m and contact length %g m; give a positive radius, a length of 0 or "
                "more and finite positions",
                i, tool->radius_m, tool->contact_length_m);
    }
    return TM_OK;
}

static tm_contact *init(tm_pool *pool, const tm_contact_def *def, int32_t vertex_count) {
    tm_contact *contact = TM_ALLOC(pool, tm_contact, 1);
    if (!contact) return NULL;
    contact->row = TM_ALLOC(pool, tm_contact_row, def->max_rows * def->instrument_count);
    contact->previous_row = TM_ALLOC(pool, tm_contact_row, def->max_rows * def->instrument_count);
    contact->solver = TM_ALLOC(pool, tm_solver_row, def->max_rows);
    contact->hits = TM_ALLOC(pool, tm_hits, def->instrument_count);
    contact->fixed = TM_ALLOC(pool, uint8_t, 3 * (int64_t)vertex_count);
    contact->saved = TM_ALLOC(pool, char, tm_contact_snapshot_max(def));
    for (int32_t t = 0; t < def->instrument_count; t++) contact->tool[t].surface = TM_ALLOC(pool, tm_local_surface, 1);
    return contact;
}

static void destroy(void *self) {
    ((tm_contact *)self)->world->notes_travel--;
    tm_pool pool = ((tm_contact *)self)->pool;
    tm_pool_release(&pool);
}

static tm_status add_stages(tm_world *world, tm_contact *contact, int64_t bytes, tm_error *error) {
    const tm_stage stage[] = {
        {.name = "contact",
         .phase = TM_PHASE_BEGIN,
         .run = move,
         .destroy = destroy,
         .step_changed = changed,
         .snapshot = tm_contact_snapshot,
         .restore = tm_contact_restore,
         .checkpoint = tm_contact_checkpoint,
         .rollback = tm_contact_rollback,
         .snapshot_max = tm_contact_snapshot_max(&contact->def)},
        {.name = TM_STAGE_CONTACT_DETECT,
         .phase = TM_PHASE_CONSTRAIN,
         .run = find,
         .overlap = &tm_contact_overlap,
         .substage_of = "contact"},
        {.name = "contact solve", .phase = TM_PHASE_CONSTRAIN, .run = constrain, .substage_of = "contact"},
        {.name = "contact forces", .phase = TM_PHASE_CONSTRAIN, .run = sum, .substage_of = "contact"}};
    const tm_status status = tm_world_add_stages(world, stage, 4, contact, bytes, error);
    if (status) return status;
    world->notes_travel++;
    tm_world_set_few(world, TM_STAGE_CONTACT_DETECT, &tm_changes_none);
    tm_world_set_few(world, "contact solve", &tm_contact_few);
    tm_world_set_few(world, "contact forces", &tm_changes_none);
    return TM_OK;
}

tm_status tm_stage_contact(tm_world *world, const tm_contact_def *def, tm_contact **contact, tm_error *error) {
    TM_REQUIRE_DEF(def, TM_COOKIE_CONTACT, TM_ERR_ARGUMENT);
    TM_REQUIRE(world && contact && (def->instrument || def->instrument_count < 1),
               "world, contact or def->instrument is null", TM_ERR_ARGUMENT);
    tm_status status = check(def, error);
    if (status) return status;
    tm_pool pool = {0};
    tm_contact *self = init(&pool, def, world->tissue->mesh->vertex_count);
    if (!self || pool.failed) {
        tm_pool_release(&pool);
        return tm_fail_memory(error, "contact stage");
    }
    self->pool = pool;
    self->world = world;
    self->def = *def;
    self->def.instrument = NULL; /* the caller's array is copied */
    self->tool_count = def->instrument_count;
    self->revision = tm_tissue_surface(world->tissue).revision;
    for (int32_t t = 0; t < def->instrument_count; t++) {
        self->tool[t].def = def->instrument[t];
        self->tool[t].capsule.instrument = t;
        tm_tool_set_pose(self->tool + t, &def->instrument[t].pose);
    }
    self->block_count = 1;
    tm_contact_set_block(self, NULL);
    status = add_stages(world, self, pool.bytes, error);
    if (status) {
        tm_pool_release(&pool);
        return status;
    }
    *contact = self;
    return TM_OK;
}

tm_contact *tm_world_contact(tm_world *world) {
    for (int32_t i = 0; i < world->stage_count; i++)
        if (world->entry[i].stage.run == move) return world->entry[i].stage.self;
    return NULL;
}
