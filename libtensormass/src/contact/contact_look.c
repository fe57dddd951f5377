/* What the tools look at: gathering what surface is near, and finding rows in it, each tool for itself and several at
 * the same time. Beside the force of the same substep where threads share that. */
#include "contact/contact_internal.h"

#include <string.h>

/* Broad phase: candidates are gathered with this much room (in tool radii) and kept until the tool has used up its part
 * or the tissue, at a bounded speed, might have used up its own. */
#define ROOM_TOOL 0.5
#define ROOM_TISSUE 1.0
#define TISSUE_SPEED_M_S 0.5
#define GATHER_EVERY 16
#define REACH 1.6 /* radii: what tm_local_rows looks at, its margin included */

static void gather(tm_contact *contact, tm_tool *tool) {
    const tm_state *state = &contact->world->state;
    const double *rest = contact->world->tissue->mesh->rest_m;
    tm_surface_view surface = tm_tissue_surface(contact->world->tissue);
    double radius = tool->def.radius_m, age_s = tool->gathered_age * state->dt_s;
    if (tool->gathered_age >= 0 && tool->gathered_age < GATHER_EVERY &&
        age_s * TISSUE_SPEED_M_S < ROOM_TISSUE * radius &&
        tm_capsule_travel(&tool->capsule, &tool->gathered_at) < ROOM_TOOL * radius) {
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
    double reach = radius * (REACH + ROOM_TOOL + ROOM_TISSUE) + 2 * tm_capsule_travel(&tool->capsule, &tool->before);
    tm_local_gather(tool->surface, rest, state->u_m, surface.triangle, surface.face, NULL, surface.count,
                    &tool->capsule, reach);
}

static void look_around(tm_sight *s, int32_t t) {
    tm_contact *contact = s->contact;
    const tm_world *world = contact->world;
    tm_tool *tool = contact->tool + t;
    s->count[t] = 0;
    if (!tm_tool_is_present(tool)) return;
    gather(contact, tool);
    if (!tool->clear && !tool->leaving) return;
    double margin = 0.1 * tool->def.radius_m + tm_capsule_travel(&tool->capsule, &tool->before);
    bool overflowed = false;
    tm_contact_row *row = contact->row_before + (int64_t)t * contact->def.max_rows;
    tm_local_place(tool->surface, world->tissue->mesh->rest_m, world->state.u_m);
    int32_t count =
        tm_local_rows(tool->surface, contact->hits + t, &tool->capsule, margin, contact->row + s->history[t],
                      s->history[t + 1] - s->history[t], row, contact->def.max_rows, &overflowed);
    if (!tool->clear) { /* its axis has left the tissue; wait for its skin */
        for (int32_t i = 0; i < count && tool->leaving; i++) tool->leaving = row[i].gap_m >= 0;
        tool->clear = tool->leaving;
        return;
    }
    if (overflowed) tool->flags |= TM_REACTION_OVERFLOWED;
    s->count[t] = count;
}

static void look_in_part(void *context, int32_t part) {
    tm_sight *s = context;
    const tm_contact *contact = s->contact;
    for (int32_t i = part; i < contact->tool_count; i += contact->world->part_count) look_around(s, s->tool[i]);
}

/* Who has something to look at first; where their rows of the substep before are. */
void tm_contact_begin_look(tm_contact *contact) {
    tm_sight *s = &contact->sight;
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

const tm_sight *tm_contact_look(tm_contact *contact) {
    tm_sight *s = &contact->sight;
    if (contact->looked) {
        contact->looked = false;
        return s;
    }
    tm_contact_begin_look(contact);
    if (s->busy > 1)
        tm_parts_do(contact->world, look_in_part, s);
    else
        for (int32_t t = 0; t < contact->tool_count; t++) look_around(s, t);
    return s;
}

/* --- while force is computed --- */

static bool is_of_contact(const tm_contact *contact, const void *self) {
    bool is = self == contact;
    for (int32_t b = 0; b < contact->block_count; b++) is |= self && contact->block[b].owner == self;
    return is;
}

/* Slot of "contact find", if from `slot` on nobody else comes before it. */
static int32_t find_slot(const tm_contact *contact, const tm_world *world, int32_t slot) {
    for (; slot < world->step_count && is_of_contact(contact, world->slot[slot].stage.self); slot++)
        if (!strcmp(world->slot[slot].stage.name, TM_STAGE_CONTACT_FIND)) return slot;
    return TM_NO_SLOT;
}

bool tm_contact_may_look_ahead(const tm_contact *contact, tm_world *world, int32_t next) {
    if (next == world->step_count || world->slot[next].stage.self != contact || contact->others.solve) return false;
    world->beside.slot = find_slot(contact, world, next);
    return world->beside.slot != TM_NO_SLOT;
}

void tm_contact_look_ahead(void *self, int32_t part) { look_in_part(&((tm_contact *)self)->sight, part); }

/* --- what contact has changed --- */

bool tm_contact_ends(const void *of, const tm_world *world, int32_t slot) {
    const tm_contact *contact = of;
    if (contact->others.solve) return false;
    while (slot < world->step_count && is_of_contact(contact, world->slot[slot].stage.self)) slot++;
    return slot == world->step_count;
}

bool tm_contact_is_sound(const void *of, const tm_world *world) {
    const tm_contact *contact = of;
    bool sound = true;
    for (int32_t i = 0; i < contact->row_count; i++)
        for (int j = 0; j < 3; j++) sound &= tm_parts_is_sound(world, contact->row[i].vertex[j]);
    for (int32_t t = 0; t < contact->tool_count; t++) {
        const tm_jaw_load load = tm_contact_load(contact, t);
        for (int32_t i = 0; i < load.count; i++) sound &= tm_parts_is_sound(world, load.vertex[i]);
    }
    return sound;
}
