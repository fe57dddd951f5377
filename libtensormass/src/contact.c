/* Stage "contact": moves the tools. Its parts: "contact find" finds the rows of all of them, "contact constrain" makes
 * them non-penetrating, together with what else is held, "contact sum" sums the reactions. */
#include "contact_internal.h"

#include <math.h>
#include <string.h>

#include "contact_vec.h"

/* Broad phase: candidates are gathered with this much room (in tool radii) and kept until the tool has used up its part
 * or the tissue, at a bounded speed, might have used up its own. */
#define ROOM_TOOL 0.5
#define ROOM_TISSUE 1.0
#define TISSUE_SPEED_M_S 0.5
#define GATHER_EVERY 16
#define REACH 1.6 /* radii: what tm_local_rows looks at, its margin included */

tm_contact_def tm_contact_def_default(void) {
    return (tm_contact_def){.cookie = TM_COOKIE_CONTACT,
                            .size = sizeof(tm_contact_def),
                            .skin_compliance_m_N = 0.5e-3,
                            .sweeps = 10,
                            .max_rows = 256,
                            .force_cap_N = 50};
}

/* --- one substep --- */

static void refresh_supports(tm_contact *contact) {
    contact->held_by = contact->world->support;
    memset(contact->held, 0, 3 * (size_t)contact->world->tissue->mesh->vertex_count);
    tm_support_mask(contact->world, contact->held);
}

static double travel(const tm_capsule *a, const tm_capsule *b) {
    double tip[3], tail[3];
    vsub(a->tip_m, b->tip_m, tip);
    vsub(a->tail_m, b->tail_m, tail);
    return vmax(vnorm(tip), vnorm(tail));
}

static void gather(tm_contact *contact, tm_tool *tool) {
    const tm_state *state = &contact->world->state;
    const double *rest = contact->world->tissue->mesh->rest_m;
    tm_surface_view surface = tm_tissue_surface(contact->world->tissue);
    double radius = tool->def.radius_m, age_s = tool->gathered_age * state->dt_s;
    if (tool->gathered_age >= 0 && tool->gathered_age < GATHER_EVERY &&
        age_s * TISSUE_SPEED_M_S < ROOM_TISSUE * radius &&
        travel(&tool->capsule, &tool->gathered_at) < ROOM_TOOL * radius) {
        tool->gathered_age++;
        return;
    }
    tool->gathered_age = 0;
    tool->gathered_at = tool->capsule;
    if (!tool->clear) {
        bool outside = tm_tool_is_clear(tool, rest, state->u_m, &surface);
        tool->clear = outside && !tool->pierced;
        tool->pierced = !outside || tool->pierced;
        tool->leaving = outside;
    }
    double reach = radius * (REACH + ROOM_TOOL + ROOM_TISSUE) + 2 * travel(&tool->capsule, &tool->before);
    tm_local_gather(tool->surface, rest, state->u_m, surface.triangle, surface.face, NULL, surface.count,
                    &tool->capsule, reach);
}

static bool same_row(const tm_contact_row *a, const tm_contact_row *b) {
    return a->instrument == b->instrument && a->station == b->station && a->face == b->face && a->feature == b->feature;
}

static bool row_before(const tm_contact_row *a, const tm_contact_row *b) {
    if (a->instrument != b->instrument) return a->instrument < b->instrument;
    if (a->station != b->station) return a->station < b->station;
    return a->face != b->face ? a->face < b->face : a->feature < b->feature;
}

/* What each station's skin bore at the last substep: rows that take over from one another take over its depth too. */
static void remember_depth(tm_contact *contact) {
    for (int32_t t = 0; t < contact->tool_count; t++) {
        memset(contact->tool[t].station_depth_m, 0, sizeof contact->tool[t].station_depth_m);
        contact->tool[t].bears_N = 0;
    }
    for (int32_t i = 0; i < contact->row_count_before; i++) {
        const tm_contact_row *row = contact->row_before + i;
        tm_tool *tool = contact->tool + row->instrument;
        double depth = tm_skin_depth(contact->def.skin_compliance_m_N / row->share, tool->def.radius_m, row->lambda_N);
        tool->station_depth_m[row->station] = vmax(tool->station_depth_m[row->station], depth);
        tool->bears_N += row->lambda_N;
    }
}

/* Both lists are sorted: the multipliers of the last substep pass over in one walk. */
static void warm_start(tm_contact *contact) {
    int32_t k = 0;
    for (int32_t i = 0; i < contact->row_count; i++) {
        while (k < contact->row_count_before && row_before(contact->row_before + k, contact->row + i)) k++;
        if (k < contact->row_count_before && same_row(contact->row_before + k, contact->row + i))
            contact->row[i].lambda_N = contact->row_before[k].lambda_N;
    }
}

static void drop_shallowest(tm_contact *contact) {
    while (contact->row_count > contact->def.max_rows) {
        int32_t shallow = 0;
        for (int32_t i = 1; i < contact->row_count; i++)
            if (contact->row[i].gap_m > contact->row[shallow].gap_m) shallow = i;
        contact->tool[contact->row[shallow].instrument].flags |= TM_REACTION_OVERFLOWED;
        contact->row_count--;
        memmove(contact->row + shallow, contact->row + shallow + 1,
                sizeof *contact->row * (size_t)(contact->row_count - shallow));
    }
}

static void find_rows(tm_contact *contact) {
    const tm_state *state = &contact->world->state;
    tm_contact_row *swap = contact->row_before;
    contact->row_before = contact->row;
    contact->row_count_before = contact->row_count;
    contact->row = swap;
    contact->row_count = 0;
    int32_t history = 0;
    for (int32_t t = 0; t < contact->tool_count; t++) {
        tm_tool *tool = contact->tool + t;
        int32_t first = history;
        while (history < contact->row_count_before && contact->row_before[history].instrument == t) history++;
        if (!tm_tool_is_present(tool)) continue;
        gather(contact, tool);
        if (!tool->clear && !tool->leaving) continue;
        double margin = 0.1 * tool->def.radius_m + travel(&tool->capsule, &tool->before);
        bool overflowed = false;
        tm_contact_row *row = contact->row + contact->row_count;
        tm_local_place(tool->surface, contact->world->tissue->mesh->rest_m, state->u_m);
        int32_t count = tm_local_rows(tool->surface, contact->hits, &tool->capsule, margin, contact->row_before + first,
                                      history - first, row, contact->def.max_rows, &overflowed);
        if (!tool->clear) { /* its axis has left the tissue; wait for its skin */
            for (int32_t i = 0; i < count && tool->leaving; i++) tool->leaving = row[i].gap_m >= 0;
            tool->clear = tool->leaving;
            continue;
        }
        if (overflowed) tool->flags |= TM_REACTION_OVERFLOWED;
        contact->row_count += tm_contact_admit(contact, t, row, count);
    }
    drop_shallowest(contact);
    remember_depth(contact);
    warm_start(contact);
}

static void react_rows(void *self, int32_t t, double force_N[3], double resultant_N[3]) {
    const tm_contact *contact = self;
    tm_tool *tool = ((tm_contact *)self)->tool + t;
    for (int32_t i = 0; i < contact->row_count; i++) {
        const tm_contact_row *row = contact->row + i;
        double on_tool[3], at_tip[3];
        if (row->instrument != t || row->lambda_N <= 0) continue;
        vscale(-row->lambda_N, row->normal, on_tool);
        vmadd(on_tool, -1, contact->solver[i].drag_N, on_tool);
        tm_tip_force(tool->def.trocar_m, tool->pose.tip_m, row->point_m, on_tool, at_tip);
        vmadd(force_N, 1, at_tip, force_N);
        vmadd(resultant_N, 1, on_tool, resultant_N);
        if (row->lambda_N >= contact->def.force_cap_N) tool->flags |= TM_REACTION_CAPPED;
    }
}

/* --- the block of rows: the stage's own, or another's --- */

static void find_own(void *self, tm_world *world) {
    (void)world;
    find_rows(self);
    tm_contact_prepare(self);
}

static void sweep_own(void *self, tm_world *world, int32_t sweep) {
    (void)world;
    tm_contact_sweep(self, sweep);
}

static tm_block own_rows(tm_contact *contact) {
    return (tm_block){.self = contact, .find = find_own, .sweep = sweep_own, .react = react_rows};
}

/* Another surface than the tissue's is touched: which rows there are, its owner finds when it solves them. */
static void find_no_rows(void *self, tm_world *world) {
    (void)world;
    tm_contact *contact = self;
    for (int32_t t = 0; t < contact->tool_count; t++) contact->tool[t].clear = true;
    contact->row_count = 0;
}

static void solve_others(void *self, tm_world *world) {
    tm_contact *contact = self;
    tm_tool_pose pose[TM_MAX_INSTRUMENTS];
    uint32_t flags[TM_MAX_INSTRUMENTS] = {0};
    for (int32_t t = 0; t < contact->tool_count; t++) {
        pose[t] = contact->tool[t].pose;
        pose[t].active = tm_tool_is_present(contact->tool + t);
    }
    contact->row_count =
        contact->others.solve(contact->others.self, world, pose, contact->row, contact->def.max_rows, flags);
    for (int32_t i = 0; i < contact->row_count; i++) /* these rows have no film */
        memset(contact->solver[i].drag_N, 0, sizeof contact->solver[i].drag_N);
    for (int32_t t = 0; t < contact->tool_count; t++) contact->tool[t].flags |= flags[t];
}

static tm_block others_rows(tm_contact *contact) {
    return (tm_block){.self = contact,
                      .owner = contact->others.self,
                      .find = find_no_rows,
                      .finish = solve_others,
                      .react = react_rows};
}

/* --- what is felt --- */

static void sum_reactions(tm_contact *contact) {
    for (int32_t t = 0; t < contact->tool_count; t++) {
        tm_tool *tool = contact->tool + t;
        memset(tool->substep_force_N, 0, sizeof tool->substep_force_N);
        memset(tool->substep_resultant_N, 0, sizeof tool->substep_resultant_N);
        for (int32_t b = 0; b < contact->block_count; b++)
            contact->block[b].react(contact->block[b].self, t, tool->substep_force_N, tool->substep_resultant_N);
    }
}

static void mark_letting_go(tm_contact *contact) {
    for (int32_t t = 0; t < contact->tool_count; t++) {
        const int32_t *vertex;
        const double *target_m;
        double compliance_m_N;
        if (tm_contact_held(contact, t, &vertex, &target_m, &compliance_m_N) < 0)
            contact->tool[t].flags |= TM_REACTION_LETTING_GO;
    }
}

/* A number that is not finite is no force: none at all, and a mark that the step fails by. */
static void disown(tm_contact *contact) {
    for (int32_t t = 0; t < contact->tool_count; t++) {
        tm_tool *tool = contact->tool + t;
        const double *f = tool->substep_force_N, *r = tool->substep_resultant_N;
        contact->unsound |= !isfinite(f[0] + f[1] + f[2] + r[0] + r[1] + r[2]);
    }
    if (!contact->unsound) return;
    contact->world->unsound = true;
    for (int32_t t = 0; t < contact->tool_count; t++) {
        contact->tool[t].flags |= TM_REACTION_UNSTABLE;
        memset(contact->tool[t].substep_force_N, 0, sizeof contact->tool[t].substep_force_N);
        memset(contact->tool[t].substep_resultant_N, 0, sizeof contact->tool[t].substep_resultant_N);
    }
}

static void average(tm_contact *contact) {
    const tm_state *state = &contact->world->state;
    bool within = contact->frame_step < contact->frame_steps &&
                  contact->frame_step >= contact->frame_steps - contact->frame_average;
    contact->frame_step++;
    for (int32_t t = 0; t < contact->tool_count && within; t++) {
        tm_tool *tool = contact->tool + t;
        tool->sum_count++;
        tool->sum_time_s += state->time_s + state->dt_s; /* the rows hold at the end of the substep */
        vmadd(tool->sum_tip_m, 1, tool->pose.tip_m, tool->sum_tip_m);
        vmadd(tool->sum_force_N, 1, tool->substep_force_N, tool->sum_force_N);
        vmadd(tool->sum_resultant_N, 1, tool->substep_resultant_N, tool->sum_resultant_N);
    }
}

/* --- the stage and its parts, in the order of the step --- */

static void move(void *self, tm_world *world) {
    tm_contact *contact = self;
    if (contact->held_by != world->support) refresh_supports(contact);
    contact->unsound = false;
    for (int32_t t = 0; t < contact->tool_count; t++) {
        tm_tool *tool = contact->tool + t;
        tm_tool_advance(tool);
        if (travel(&tool->capsule, &tool->before) > TM_TOO_FAST * tool->def.radius_m)
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
    tm_contact *contact = self;
    (void)world;
    sum_reactions(contact);
    mark_letting_go(contact);
    disown(contact);
    average(contact);
}

/* dt changed or tissue was cut: candidates may be dead, supports may have moved to other vertices. */
static void changed(void *self, tm_world *world) {
    tm_contact *contact = self;
    int32_t revision = tm_tissue_surface(world->tissue).revision;
    if (revision == contact->revision) /* a cut moves no support, and must not cost what the mesh is large */
        refresh_supports(contact);
    for (int32_t t = 0; t < contact->tool_count && revision != contact->revision; t++)
        contact->tool[t].gathered_age = -1;
    contact->revision = revision;
}

/* --- creation --- */

static tm_status check(const tm_contact_def *def, tm_error *error) {
    if (def->instrument_count < 1 || def->instrument_count > TM_MAX_INSTRUMENTS)
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "contact: %d instruments; give 1 to %d", def->instrument_count,
                       TM_MAX_INSTRUMENTS);
    if (!(def->skin_compliance_m_N >= 0) || !isfinite(def->skin_compliance_m_N))
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "contact: skin compliance %g m/N; give 0 or more",
                       def->skin_compliance_m_N);
    if (def->sweeps < 1 || def->max_rows < 1 || def->max_rows > TM_LOCAL_HITS || !(def->force_cap_N > 0))
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "contact: %d sweeps, %d rows, force cap %g N; give at least one sweep, 1 to %d rows "
                       "and a positive cap",
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
            return tm_fail(error, TM_ERR_ARGUMENT, i,
                           "instrument %d: radius %g m, contact length %g m; give a positive radius, a "
                           "length of 0 or more and finite places",
                           i, tool->radius_m, tool->contact_length_m);
    }
    return TM_OK;
}

static tm_contact *take(tm_pool *pool, const tm_contact_def *def, int32_t vertex_count) {
    tm_contact *contact = TM_TAKE(pool, tm_contact, 1);
    if (!contact) return NULL;
    contact->row = TM_TAKE(pool, tm_contact_row, def->max_rows * def->instrument_count);
    contact->row_before = TM_TAKE(pool, tm_contact_row, def->max_rows * def->instrument_count);
    contact->solver = TM_TAKE(pool, tm_solver_row, def->max_rows);
    contact->hits = TM_TAKE(pool, tm_hits, 1);
    contact->held = TM_TAKE(pool, uint8_t, 3 * (int64_t)vertex_count);
    contact->kept = TM_TAKE(pool, char, tm_contact_snapshot_max(def));
    for (int32_t t = 0; t < def->instrument_count; t++) contact->tool[t].surface = TM_TAKE(pool, tm_local_surface, 1);
    return contact;
}

static void destroy(void *self) {
    tm_pool pool = ((tm_contact *)self)->pool;
    tm_pool_release(&pool);
}

static tm_status add_stages(tm_world *world, tm_contact *contact, int64_t bytes, tm_error *error) {
    const tm_stage stage[] = {{.name = "contact",
                               .run = move,
                               .destroy = destroy,
                               .step_changed = changed,
                               .snapshot = tm_contact_snapshot,
                               .restore = tm_contact_restore,
                               .keep = tm_contact_keep,
                               .give_back = tm_contact_give_back},
                              {.name = TM_STAGE_CONTACT_FIND, .run = find, .part_of = "contact"},
                              {.name = "contact constrain", .run = constrain, .part_of = "contact"},
                              {.name = "contact sum", .run = sum, .part_of = "contact"}};
    return tm_world_add_stages(world, stage, 4, TM_PHASE_CONSTRAIN, contact, bytes, error);
}

tm_status tm_stage_contact(tm_world *world, const tm_contact_def *def, tm_contact **contact, tm_error *error) {
    TM_REQUIRE_DEF(def, TM_COOKIE_CONTACT, TM_ERR_ARGUMENT);
    TM_REQUIRE(world && contact && (def->instrument || def->instrument_count < 1),
               "world, contact or def->instrument is null", TM_ERR_ARGUMENT);
    tm_status status = check(def, error);
    if (status) return status;
    tm_pool pool = {0};
    tm_contact *self = take(&pool, def, world->tissue->mesh->vertex_count);
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
        tm_tool_place(self->tool + t, &def->instrument[t].pose);
    }
    self->block[self->block_count++] = own_rows(self);
    status = add_stages(world, self, pool.bytes, error);
    if (status) {
        tm_pool_release(&pool);
        return status;
    }
    *contact = self;
    return TM_OK;
}

/* --- what the application calls between frames --- */

#define INSTRUMENT_IS_THERE(...)                                                                                       \
    TM_REQUIRE(contact &&instrument >= 0 && instrument < contact->tool_count,                                          \
               "contact is null or instrument is not one of its own", __VA_ARGS__)

void tm_contact_move(tm_contact *contact, int32_t instrument, const tm_tool_pose *to, int32_t substeps) {
    INSTRUMENT_IS_THERE();
    TM_REQUIRE(TM_IS_POSE(to), "to is null, not finite or beyond 1e6", );
    tm_tool_move(contact->tool + instrument, to, substeps);
}

void tm_contact_place(tm_contact *contact, int32_t instrument, const tm_tool_pose *at) {
    INSTRUMENT_IS_THERE();
    TM_REQUIRE(TM_IS_POSE(at), "at is null, not finite or beyond 1e6", );
    tm_tool_place(contact->tool + instrument, at);
    int32_t kept = 0; /* its multipliers belong to where it was */
    for (int32_t i = 0; i < contact->row_count; i++)
        if (contact->row[i].instrument != instrument) contact->row[kept++] = contact->row[i];
    contact->row_count = kept;
}

tm_tool_pose tm_contact_pose(const tm_contact *contact, int32_t instrument) {
    INSTRUMENT_IS_THERE((tm_tool_pose){0});
    return contact->tool[instrument].pose;
}

void tm_contact_set_block(tm_contact *contact, const tm_contact_block *block) {
    TM_REQUIRE(contact, "contact is null", );
    contact->others = block ? *block : (tm_contact_block){0};
    contact->block[contact->block_count - 1] = block ? others_rows(contact) : own_rows(contact);
}

bool tm_contact_holds(const tm_contact *contact, const tm_contact_row *row) {
    TM_REQUIRE(contact && row, "contact or row is null", false);
    return tm_row_is_held(contact, row);
}

void tm_contact_begin_frame(tm_contact *contact, int32_t substeps, int32_t average_over) {
    TM_REQUIRE(contact && substeps >= 0, "contact is null or substeps is negative", );
    contact->frame_step = 0;
    contact->frame_steps = substeps;
    contact->frame_average = average_over < 1 ? 1 : average_over > substeps ? substeps : average_over;
    for (int32_t t = 0; t < contact->tool_count; t++) {
        tm_tool *tool = contact->tool + t;
        memset(tool->sum_tip_m, 0, sizeof tool->sum_tip_m);
        memset(tool->sum_force_N, 0, sizeof tool->sum_force_N);
        memset(tool->sum_resultant_N, 0, sizeof tool->sum_resultant_N);
        tool->sum_time_s = 0;
        tool->sum_count = 0;
        tool->flags = 0;
    }
}

tm_tool_reaction tm_contact_reaction(const tm_contact *contact, int32_t instrument) {
    INSTRUMENT_IS_THERE((tm_tool_reaction){0});
    const tm_tool *tool = contact->tool + instrument;
    tm_tool_reaction reaction = {.flags = tool->flags};
    if (tm_tool_is_present(tool) && !tool->clear) reaction.flags |= TM_REACTION_INSIDE;
    reaction.stiffness_kind = tool->stiffness_kind;
    memcpy(reaction.stiffness_N_m, tool->stiffness_N_m, tool->stiffness_kind ? sizeof reaction.stiffness_N_m : 0);
    for (int32_t i = 0; i < contact->row_count; i++)
        reaction.row_count += contact->row[i].instrument == instrument && contact->row[i].lambda_N > 0;
    if (tool->sum_count == 0) { /* nothing averaged yet: as the last substep left it */
        reaction.time_s = contact->world->state.time_s;
        vset(tool->pose.tip_m, reaction.tip_m);
        vset(tool->substep_force_N, reaction.force_N);
        vset(tool->substep_resultant_N, reaction.resultant_N);
        return reaction;
    }
    double n = 1.0 / tool->sum_count;
    reaction.time_s = n * tool->sum_time_s;
    vscale(n, tool->sum_tip_m, reaction.tip_m);
    vscale(n, tool->sum_force_N, reaction.force_N);
    vscale(n, tool->sum_resultant_N, reaction.resultant_N);
    return reaction;
}

int32_t tm_contact_rows(const tm_contact *contact, const tm_contact_row **rows) {
    TM_REQUIRE(contact && rows, "contact or rows is null", 0);
    *rows = contact->row;
    return contact->row_count;
}

tm_contact *tm_world_contact(tm_world *world) {
    for (int32_t i = 0; i < world->stage_count; i++)
        if (world->slot[i].stage.run == move) return world->slot[i].stage.self;
    return NULL;
}
