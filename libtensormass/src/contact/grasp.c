/* Stage "grasp": springs between the jaws and the vertices that they closed on (grasp_springs.c), solved in the same
 * sweeps as contact. */
#include "contact/grasp_internal.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"
#include "contact_law/jaw.h"

tm_grasp_def tm_grasp_def_default(void) {
    return (tm_grasp_def){.cookie = TM_COOKIE_GRASP,
                          .size = sizeof(tm_grasp_def),
                          .close_grip = 0.7,
                          .open_grip = 0.3,
                          .jaw_length_m = 0.01,
                          .reach_m = 0.001,
                          .compliance_m_N = 0.2e-3,
                          .release_time_s = 0.1,
                          .force_cap_N = 20,
                          .max_vertices = 64};
}

/* --- capture --- */

static void capture(tm_grasp *grasp, grasp_of_jaw *h, int32_t t, const tm_world *world) {
    const tm_tool *tool = grasp->contact->tool + t;
    tm_surface_view surface = tm_tissue_surface(world->tissue);
    h->count = tm_jaw_capture(&h->jaw, &grasp->def, &tool->def, &tool->pose, world->tissue->mesh->rest_m,
                              world->state.u_m, &surface, h->vertex, h->distance_m);
}

static bool holds(void *self, int32_t instrument, int32_t vertex) {
    const grasp_of_jaw *h = ((tm_grasp *)self)->grasp + instrument;
    for (int32_t i = 0; i < h->count; i++)
        if (h->vertex[i] == vertex) return true;
    return false;
}

/* Takes over the contact forces on the grasped vertices, so that closing changes no force, unless that would generate
 * energy: under a deep tool the springs of few vertices would store several times what the rows do. */
static void take_over(tm_grasp *grasp, grasp_of_jaw *h, int32_t t, const tm_world *world) {
    const tm_contact *contact = grasp->contact;
    double stored = 0;
    memset(h->force_N, 0, sizeof(double) * 3 * (size_t)h->count);
    for (int32_t k = 0; k < contact->row_count; k++) {
        const tm_contact_row *row = contact->row + k;
        if (row->instrument != t || !tm_row_is_grasped(contact, row)) continue;
        stored += tm_contact_row_energy(contact, k, &contact->tool[t].previous).compliance_J;
        for (int32_t i = 0; i < h->count; i++)
            for (int j = 0; j < 3; j++)
                if (row->vertex[j] == h->vertex[i])
                    vmadd(h->force_N + 3 * i, row->lambda_N * row->weight[j], row->normal, h->force_N + 3 * i);
    }
    tm_hold_take_over(grasp, h, t, stored);
    for (int32_t i = 0; i < h->count; i++) {
        double at[3];
        tm_hold_vertex_at(world, world->state.u_m, h->vertex[i], at);
        vmadd(at, grasp->def.compliance_m_N, h->force_N + 3 * i, at);
        tm_jaw_to_tool(&h->jaw, &contact->tool[t].pose, at, h->offset_m + 3 * i);
    }
}

/* --- the jaw --- */

static void drop(grasp_of_jaw *h, int32_t i) {
    h->count--;
    memmove(h->vertex + i, h->vertex + i + 1, sizeof *h->vertex * (size_t)(h->count - i));
    double *array[] = {h->offset_m, h->target_m, h->force_N, h->let_go_N};
    for (int k = 0; k < 4; k++)
        memmove(array[k] + 3 * i, array[k] + 3 * (i + 1), sizeof(double) * 3 * (size_t)(h->count - i));
}

static void open_jaw(grasp_of_jaw *h) {
    h->state = TM_GRASP_RELEASING;
    h->fade = 1;
    h->seen = false;
    memcpy(h->let_go_N, h->force_N, sizeof(double) * 3 * (size_t)h->count);
}

/* Drops released vertices that are out of the jaw. Contact of a hybrid has no tolerated depth: there, released tissue
 * is no obstacle until it is out of the jaw. */
static void release_what_is_out(grasp_of_jaw *h, const tm_tool *tool, const tm_world *world) {
    for (int32_t i = h->count - 1; i >= 0; i--) {
        double at[3], d[3];
        tm_hold_vertex_at(world, world->state.u_m, h->vertex[i], at);
        vsub(at, tool->capsule.tip_m, d);
        double along = law_clamp(vdot(d, h->jaw.axis_m[2]), -tool->def.contact_length_m, 0);
        vmadd(d, -along, h->jaw.axis_m[2], d);
        if (vnorm(d) > 1.05 * tool->def.radius_m) drop(h, i);
    }
    if (h->count == 0) h->state = TM_GRASP_OPEN;
}

static bool is_embedded(const grasp_of_jaw *h) {
    bool any = false;
    for (int i = 0; i < TM_MAX_STATIONS; i++) any = any || h->embedded_m[i] > 0;
    return h->seen && any;
}

static void release(const tm_grasp *grasp, grasp_of_jaw *h, const tm_tool *tool, const tm_world *world) {
    if (grasp->contact->others.solve) {
        release_what_is_out(h, tool, world);
    } else if (!is_embedded(h)) {
        h->count = 0;
        h->state = TM_GRASP_OPEN;
    }
}

/* Drops rows on held vertices. Rows on released vertices count at once: otherwise the tissue would pass through the
 * tool while the grasp fades, and be thrown out afterwards. Tissue inside the jaw when it opened is not pushed out.
 * Returns the number of rows left. */
static int32_t admit(void *self, int32_t t, tm_contact_row *row, int32_t count) {
    tm_grasp *grasp = self;
    grasp_of_jaw *h = grasp->grasp + t;
    double depth_m[TM_MAX_STATIONS] = {0};
    int32_t left = 0;
    for (int32_t i = 0; i < count && h->state == TM_GRASP_RELEASING; i++)
        if (tm_row_is_grasped(grasp->contact, row + i))
            depth_m[row[i].station] = fmax(depth_m[row[i].station], -row[i].gap_m);
    for (int i = 0; i < TM_MAX_STATIONS; i++)
        h->embedded_m[i] = h->seen ? law_min(h->embedded_m[i], depth_m[i]) : depth_m[i];
    h->seen = true;
    for (int32_t i = 0; i < count; i++) {
        const bool fixed = tm_row_is_grasped(grasp->contact, row + i);
        if (fixed && h->state != TM_GRASP_RELEASING) continue;
        if (fixed) row[i].gap_m += h->embedded_m[row[i].station];
        row[left++] = row[i];
    }
    return left;
}

static void work_jaw(tm_grasp *grasp, int32_t t, const tm_world *world) {
    grasp_of_jaw *h = grasp->grasp + t;
    const tm_tool *tool = grasp->contact->tool + t;
    switch (law_jaw_work(&h->was_closed, h->state == TM_GRASP_HOLDING, h->state == TM_GRASP_RELEASING,
                         tool->pose.active, tool->pose.grip, grasp->def.close_grip, grasp->def.open_grip)) {
    case LAW_JAW_STAYS: break;
    case LAW_JAW_CLOSES:
        capture(grasp, h, t, world);
        take_over(grasp, h, t, world);
        h->state = h->count > 0 ? TM_GRASP_HOLDING : TM_GRASP_OPEN;
        break;
    case LAW_JAW_OPENS: open_jaw(h); break;
    case LAW_JAW_FADES:
        if (h->fade > 0)
            h->fade = law_jaw_fade(h->fade, world->state.dt_s, grasp->def.release_time_s);
        else
            release(grasp, h, tool, world);
        break;
    }
}

/* Runs after the tools have moved: handles jaw events, updates the targets, starts the sweeps from the last forces. */
static void run(void *self, tm_world *world) {
    tm_grasp *grasp = self;
    for (int32_t t = 0; t < grasp->contact->tool_count; t++) {
        grasp_of_jaw *h = grasp->grasp + t;
        const tm_tool *tool = grasp->contact->tool + t;
        if (tool->def.mode != TM_TOOL_GRASPER) continue;
        tm_hold_begin(grasp, h, world);
        tm_jaw_rotate(&h->jaw, &tool->def, &tool->pose);
        if (h->placings != tool->placings) { /* teleported: the tissue that it held stays behind */
            h->count = 0;
            h->state = TM_GRASP_OPEN;
            h->placings = tool->placings;
            tm_hold_place(h, tool);
        }
        tm_hold_follow(h, tool);
        work_jaw(grasp, t, world);
        for (int32_t i = 0; i < h->count; i++) {
            tm_jaw_to_world(&h->jaw, &tool->pose, h->offset_m + 3 * i, h->target_m + 3 * i);
            tm_hold_start(grasp, h, i, world);
        }
    }
}

static void react(void *self, int32_t t, double force_N[3], double resultant_N[3]) {
    const tm_grasp *grasp = self;
    const grasp_of_jaw *h = grasp->grasp + t;
    const tm_tool *tool = grasp->contact->tool + t;
    for (int32_t i = 0; i < h->count; i++) {
        double on_tool[3], at_tip[3];
        vscale(-1, h->force_N + 3 * i, on_tool);
        tm_tool_tip_force(&tool->def, &tool->pose, h->target_m + 3 * i, on_tool, at_tip);
        vmadd(force_N, 1, at_tip, force_N);
        vmadd(resultant_N, 1, on_tool, resultant_N);
    }
}

static int32_t held(void *self, int32_t t, const int32_t **vertex, const double **target_m, double *compliance_m_N) {
    const tm_grasp *grasp = self;
    const grasp_of_jaw *h = grasp->grasp + t;
    *vertex = h->vertex;
    *target_m = h->target_m;
    *compliance_m_N = grasp->def.compliance_m_N;
    return h->state == TM_GRASP_RELEASING ? -1 : h->count;
}

static void load(void *self, int32_t t, tm_jaw_load *to) {
    const tm_grasp *grasp = self;
    const grasp_of_jaw *h = grasp->grasp + t;
    *to = (tm_jaw_load){h->count, h->vertex, h->force_N, h->offset_m, &h->jaw, grasp->def.compliance_m_N};
}

/* --- the stage --- */

static void changed(void *self, tm_world *world) {
    tm_grasp *grasp = self;
    for (int32_t t = 0; t < grasp->contact->tool_count; t++) {
        grasp_of_jaw *h = grasp->grasp + t;
        for (int32_t i = h->count - 1; i >= 0; i--)
            if (world->tissue->mass_kg[h->vertex[i]] <= 0) drop(h, i);
    }
}

static void destroy(void *self) {
    tm_grasp *grasp = self;
    tm_contact_remove_block(grasp->contact, grasp);
    tm_pool pool = grasp->pool;
    tm_pool_release(&pool);
}

static bool take_hold(tm_pool *pool, grasp_of_jaw *h, int32_t n, const tm_tool *tool) {
    h->vertex = TM_ALLOC(pool, int32_t, n);
    h->offset_m = TM_ALLOC(pool, double, 3 * n);
    h->target_m = TM_ALLOC(pool, double, 3 * n);
    h->force_N = TM_ALLOC(pool, double, 3 * n);
    h->let_go_N = TM_ALLOC(pool, double, 3 * n);
    h->distance_m = TM_ALLOC(pool, double, n);
    tm_jaw_begin(&h->jaw, &tool->def, &tool->pose);
    h->placings = tool->placings;
    tm_hold_place(h, tool);
    return !pool->failed;
}

static tm_status check(const tm_grasp_def *def, tm_error *error) {
    if (!(def->open_grip >= 0) || !(def->close_grip > def->open_grip) || !(def->close_grip <= 1))
        return tm_fail(error, TM_ERR_ARGUMENT, -1,
                       "grasp: closes at grip %g and opens at %g; give 0 <= open < close <= 1", def->close_grip,
                       def->open_grip);
    if (!(def->jaw_length_m >= 0) || !(def->reach_m >= 0) || !(def->compliance_m_N > 0) ||
        !(def->release_time_s >= 0) || !(def->force_cap_N > 0) || def->max_vertices < 1 ||
        !isfinite(def->compliance_m_N + def->jaw_length_m + def->reach_m + def->release_time_s))
        return tm_fail(
            error, TM_ERR_ARGUMENT, -1,
            "grasp has jaw length %g m, reach %g m, compliance %g m/N, release time %g s, force cap %g N, %d "
            "vertices; give positive compliance, cap and number of vertices, and nothing negative",
            def->jaw_length_m, def->reach_m, def->compliance_m_N, def->release_time_s, def->force_cap_N,
            def->max_vertices);
    return TM_OK;
}

tm_status tm_stage_grasp(tm_world *world, tm_contact *contact, const tm_grasp_def *def, tm_grasp **grasp,
                         tm_error *error) {
    TM_REQUIRE_DEF(def, TM_COOKIE_GRASP, TM_ERR_ARGUMENT);
    TM_REQUIRE(world && grasp && contact && contact->world == world,
               "world or grasp is null, or contact is not of this world", TM_ERR_ARGUMENT);
    tm_status status = check(def, error);
    if (status) return status;
    tm_pool pool = {0};
    tm_grasp *self = TM_ALLOC(&pool, tm_grasp, 1);
    bool taken = self != NULL;
    for (int32_t t = 0; t < contact->tool_count && taken; t++)
        taken = take_hold(&pool, self->grasp + t, def->max_vertices, contact->tool + t) &&
                take_hold(&pool, self->saved + t, def->max_vertices, contact->tool + t);
    if (!taken) {
        tm_pool_release(&pool);
        return tm_fail_memory(error, "grasp stage");
    }
    self->pool = pool;
    self->def = *def;
    self->contact = contact;
    const tm_stage stage = {.size = sizeof stage,
                            .name = "grasp",
                            .phase = TM_PHASE_CONSTRAIN,
                            .run = run,
                            .destroy = destroy,
                            .step_changed = changed,
                            .self = self,
                            .snapshot = tm_grasp_snapshot,
                            .restore = tm_grasp_restore,
                            .checkpoint = tm_grasp_checkpoint,
                            .rollback = tm_grasp_rollback,
                            .needs = {"contact"},
                            .runs_before = TM_STAGE_CONTACT_DETECT,
                            .snapshot_max = tm_grasp_snapshot_max(self)};
    status = tm_world_add_stage(world, &stage, pool.bytes, error);
    if (status) {
        tm_pool_release(&pool);
        return status;
    }
    tm_world_set_few(world, "grasp", &tm_changes_none); /* "contact solve" makes the changes */
    const tm_constraint_block block = {.self = self,
                                       .owner = self,
                                       .sweep = tm_grasp_sweep,
                                       .finish = tm_grasp_finish,
                                       .push = tm_grasp_push,
                                       .hold_back = tm_grasp_hold_back,
                                       .lost = tm_grasp_lost,
                                       .react = react,
                                       .is_grasped = holds,
                                       .grasped = held,
                                       .load = load,
                                       .admit = admit};
    tm_contact_add_block(contact, &block);
    *grasp = self;
    return TM_OK;
}

int32_t tm_grasp_vertices(const tm_grasp *grasp, int32_t instrument, const int32_t **vertex, tm_grasp_state *state) {
    TM_REQUIRE(grasp && instrument >= 0 && instrument < grasp->contact->tool_count,
               "grasp is null or instrument is not one of its contact's", 0);
    const grasp_of_jaw *h = grasp->grasp + instrument;
    if (vertex) *vertex = h->vertex;
    if (state) *state = h->state;
    return h->count;
}
