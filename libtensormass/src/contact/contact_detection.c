/* Contact detection: broad and narrow phase of each tool, in parallel.
 *
 * The broad phase gathers triangles within a margin and keeps them until motion may have used up the margin. The narrow
 * phase finds contact rows among them. Detection overlaps the force pass if threads share it. */
#include "contact/contact_internal.h"

#include <math.h>
#include <string.h>

#include "contact_law/feature.h"

/* Margin of the broad phase, in tool radii. Every few substeps, or sooner if tool or tissue (at a bounded speed) may
 * have moved far, a check is due: whether the tool is outside, and whether its candidates are still complete. Within
 * one call of the step, candidates are kept as long as nothing else can be in reach. */
#define MARGIN_TOOL 0.5
#define MARGIN_TISSUE 1.0
#define TISSUE_SPEED_M_S 0.5
#define BROAD_PHASE_EVERY 16
#define REACH 1.6 /* radii: reach of tm_local_rows, its margin included */

static bool is_due(const tm_contact *contact, const tm_tool *tool) {
    const double radius = tool->def.radius_m, age_s = tool->gathered_age * contact->world->state.dt_s;
    return tool->gathered_age < 0 || tool->gathered_age >= BROAD_PHASE_EVERY ||
           age_s * TISSUE_SPEED_M_S >= MARGIN_TISSUE * radius ||
           tm_capsule_travel(&tool->capsule, &tool->gathered_at) >= MARGIN_TOOL * radius;
}

static void check_outside(const tm_contact *contact, tm_tool *tool) {
    const tm_tissue *tissue = contact->world->tissue;
    const bool outside = tm_tool_is_outside(tool, tissue->mesh->rest_m, contact->world->state.u_m, &tissue->surface);
    tool->outside = outside && !tool->placed_inside;
    tool->placed_inside = !outside || tool->placed_inside;
    tool->axis_outside = outside;
}

static void gather(const tm_contact *contact, tm_tool *tool) {
    const tm_tissue *tissue = contact->world->tissue;
    const double reach = tool->def.radius_m * (REACH + MARGIN_TOOL + MARGIN_TISSUE) +
                         2 * tm_capsule_travel(&tool->capsule, &tool->previous);
    tm_local_gather(tool->surface, tissue->mesh->rest_m, contact->world->state.u_m, tissue->surface.triangle,
                    tissue->surface.face, NULL, tissue->surface.count, &tool->capsule, reach);
    tool->margin_used_m = tool->longer_m = 0;
    tool->regathered = true, tool->maybe_moved = false;
}

/* Returns whether motion and edge growth since the last gathering, and `more_m`, may exceed the margin. A triangle that
 * was not gathered can have come nearer by the motion of tissue and tool at most; the reach of rows grows with the
 * tool's speed. The normal of a triangle in reach also needs neighbours one edge farther, so edges that have grown use
 * the margin too. NaN counts as exceeded. */
static bool is_margin_used(const tm_tool *tool, double more_m) {
    const double room = (MARGIN_TOOL + MARGIN_TISSUE) * tool->def.radius_m;
    const double used_m = tool->margin_used_m + tm_capsule_travel(&tool->capsule, &tool->previous) + tool->longer_m;
    return !(used_m + more_m <= room);
}

static double longest_edge(const tm_local_surface *s) {
    double most2 = 0;
    for (int32_t i = 0; i < s->near.face_count; i++)
        for (int j = 0; j < 3; j++) {
            const int32_t *v = s->face_vertex[s->near.face[i]];
            double edge[3];
            vsub(s->position_m[v[(j + 1) % 3]], s->position_m[v[j]], edge);
            most2 = law_max(vdot(edge, edge), most2);
        }
    return sqrt(most2);
}

/* Returns whether a station has sunk through a face: with history it may be deeper than any margin. */
static bool sinks(const tm_contact_query *s, int32_t t) {
    const tm_contact *contact = s->contact;
    bool deep = false;
    for (int32_t i = s->history[t]; i < s->history[t + 1]; i++)
        deep |= law_sinks(contact->row[i].gap_m, contact->row[i].lambda_N, contact->tool[t].def.radius_m);
    return deep;
}

static void update_broad_phase(const tm_contact_query *s, int32_t t) {
    tm_contact *contact = s->contact;
    tm_tool *tool = contact->tool + t;
    const bool never = tool->gathered_age < 0, due = is_due(contact, tool);
    /* for the tissue's motion in the previous substep, which is known later */
    const double ahead_m = law_max(0.1 * (MARGIN_TOOL + MARGIN_TISSUE) * tool->def.radius_m, 2 * contact->way_m);
    tool->regathered = false;
    tool->gathered_age = due ? 0 : tool->gathered_age + 1;
    if (due) tool->gathered_at = tool->capsule;
    if (due && !tool->outside) check_outside(contact, tool);
    if (never || is_margin_used(tool, ahead_m) ||
        (due && (tool->maybe_moved || tool->surface->overflowed || sinks(s, t))))
        gather(contact, tool);
}

static void find_tool_rows(tm_contact_query *s, int32_t t) {
    tm_contact *contact = s->contact;
    const tm_world *world = contact->world;
    tm_tool *tool = contact->tool + t;
    s->count[t] = 0;
    if (!tool->outside && !tool->axis_outside) return;
    double margin = 0.1 * tool->def.radius_m + tm_capsule_travel(&tool->capsule, &tool->previous);
    bool overflowed = false;
    tm_contact_row *row = contact->previous_row + (int64_t)t * contact->def.max_rows;
    tm_local_place(tool->surface, world->tissue->mesh->rest_m, world->state.u_m);
    int32_t count =
        tm_local_rows(tool->surface, contact->hits + t, &tool->capsule, margin, contact->row + s->history[t],
                      s->history[t + 1] - s->history[t], row, contact->def.max_rows, &overflowed);
    tool->longer_m = law_max(longest_edge(tool->surface) - tool->surface->edge_m, 0);
    if (!tool->outside) { /* its axis has left the tissue; wait for its compliance */
        for (int32_t i = 0; i < count && tool->axis_outside; i++) tool->axis_outside = row[i].gap_m >= 0;
        tool->outside = tool->axis_outside;
        return;
    }
    if (overflowed) tool->flags |= TM_REACTION_OVERFLOWED;
    s->count[t] = count;
}

static void detect_tool(tm_contact_query *s, int32_t t) {
    s->count[t] = 0;
    if (!tm_tool_is_present(s->contact->tool + t)) return;
    update_broad_phase(s, t);
    find_tool_rows(s, t);
}

/* Repeats detection for tools whose margin is used up. The tissue's motion in the previous substep is known only after
 * integration, which is later than detection that overlapped the force pass. */
static void repeat_detection(tm_contact_query *s) {
    tm_contact *contact = s->contact;
    const double way_m = contact->way_m = tm_max_increment_m(contact->world);
    for (int32_t t = 0; t < contact->tool_count; t++) {
        tm_tool *tool = contact->tool + t;
        if (!tm_tool_is_present(tool)) tool->margin_used_m = INFINITY;
        if (!tm_tool_is_present(tool) || tool->regathered) continue;
        tool->margin_used_m += way_m + tm_capsule_travel(&tool->capsule, &tool->previous);
        if (!is_margin_used(tool, 0)) continue;
        gather(contact, tool);
        find_tool_rows(s, t);
    }
}

static void detect_in_partition(void *context, int32_t partition) {
    tm_contact_query *s = context;
    const tm_contact *contact = s->contact;
    for (int32_t i = partition; i < contact->tool_count; i += contact->world->partition_count)
        detect_tool(s, s->tool[i]);
}

/* Orders the tools, those with candidates first, and finds their rows of the previous substep. */
static void begin_detection(tm_contact *contact) {
    tm_contact_query *s = &contact->query;
    int32_t idle = contact->tool_count;
    s->contact = contact, s->busy = 0;
    for (int32_t t = 0, i = 0; t < contact->tool_count; t++) {
        const tm_tool *tool = contact->tool + t;
        const bool busy = tm_tool_is_present(tool) && (tool->gathered_age < 0 || tool->surface->face_count > 0);
        s->tool[busy ? s->busy++ : --idle] = t;
        s->history[t] = i;
        while (i < contact->row_count && contact->row[i].instrument == t) i++;
        s->history[t + 1] = i;
    }
}

const tm_contact_query *tm_contact_detect(tm_contact *contact) {
    tm_contact_query *s = &contact->query;
    if (!contact->detected) {
        begin_detection(contact);
        if (s->busy > 1)
            tm_partitions_run(contact->world, detect_in_partition, s);
        else
            for (int32_t t = 0; t < contact->tool_count; t++) detect_tool(s, t);
    }
    contact->detected = false;
    repeat_detection(s);
    return s;
}

/* --- during the force pass --- */

bool tm_contact_owns(const tm_contact *contact, const void *self) {
    bool is = contact && self == contact;
    for (int32_t b = 0; contact && b < contact->block_count; b++) is |= self && contact->block[b].owner == self;
    return is;
}

/* Returns whether detection may overlap the force pass. It needs positions at the start of the substep, the tools at
 * its end, and the previous rows, but not the new force. Every stage between the new displacements and "contact detect"
 * must be contact's own or registered as changing nothing (tm_changes_none): any other might move tools or cut. */
static bool begin_overlap(void *self, tm_world *world) {
    tm_contact *contact = self;
    const struct tm_stage_entry *slot = world->entry + world->group_end, *const end = world->entry + world->step_count;
    while (slot < end && slot->stage.overlap != &tm_contact_overlap &&
           (tm_contact_owns(contact, slot->stage.self) || slot->few == &tm_changes_none))
        slot++;
    if (slot == end || slot->stage.self != contact || contact->others.solve) return false;
    begin_detection(contact);
    contact->detected = true;
    return true;
}

static void work_overlap(void *self, tm_world *world, int32_t partition) {
    tm_contact *contact = self;
    (void)world;
    detect_in_partition(&contact->query, partition);
}

const tm_overlap tm_contact_overlap = {begin_overlap, work_overlap};

const char *tm_contact_first_stage(const tm_contact *contact) {
    const tm_world *world = contact->world;
    for (int32_t i = 0; i < world->step_count; i++)
        if (world->entry[i].stage.phase == TM_PHASE_CONSTRAIN && tm_contact_owns(contact, world->entry[i].stage.self))
            return world->entry[i].stage.name;
    return TM_STAGE_CONTACT_DETECT;
}

/* --- displacements that contact has changed --- */

/* Returns whether the list applies: another solver's rows may load any vertex. */
static bool applies(const void *self) { return !((const tm_contact *)self)->others.solve; }

static bool are_bounded(const void *self, const tm_world *world) {
    const tm_contact *contact = self;
    bool sound = true;
    for (int32_t i = 0; i < contact->row_count; i++)
        for (int j = 0; j < 3; j++) sound &= tm_vertex_is_bounded(world, contact->row[i].vertex[j]);
    for (int32_t i = 0; contact->fading && i < contact->fading->count; i++)
        for (int j = 0; j < 3; j++) sound &= tm_vertex_is_bounded(world, contact->fading->row[i].vertex[j]);
    for (int32_t t = 0; t < contact->tool_count; t++) {
        const tm_jaw_load load = tm_contact_load(contact, t);
        for (int32_t i = 0; i < load.count; i++) sound &= tm_vertex_is_bounded(world, load.vertex[i]);
    }
    return sound;
}

/* Of rows, fading rows and jaws; those of another solver's rows are not known. */
static void forces(const void *self, void *to, tm_add_force *add) {
    const tm_contact *contact = self;
    double force[3], share[3];
    for (int32_t i = 0; i < contact->row_count && applies(contact); i++) {
        const tm_contact_row *row = contact->row + i;
        if (row->lambda_N == 0) continue;
        vmadd(contact->solver[i].drag_N, row->lambda_N, row->normal, force);
        for (int j = 0; j < 3; j++) {
            vscale(row->weight[j], force, share);
            add(to, row->vertex[j], share);
        }
    }
    for (int32_t i = 0; contact->fading && i < contact->fading->count; i++)
        for (int j = 0; j < 3; j++) {
            const tm_fading_row *row = contact->fading->row + i;
            vscale(row->weight[j] * row->lambda_N, row->normal, share);
            add(to, row->vertex[j], share);
        }
    for (int32_t t = 0; t < contact->tool_count; t++) {
        const tm_jaw_load load = tm_contact_load(contact, t);
        for (int32_t i = 0; i < load.count; i++) add(to, load.vertex[i], load.force_N + 3 * i);
    }
}

const tm_few tm_contact_few = {applies, are_bounded, forces};
