/* Constraint block of the contact rows, the stage's own or another's: the rows of this substep, their start from the
 * previous forces, and their share of the tool forces. */
#include "contact/contact_internal.h"

#include <string.h>

#include "base/vec.h"

static bool same_row(const tm_contact_row *a, const tm_contact_row *b) {
    return a->instrument == b->instrument && a->station == b->station && a->face == b->face && a->feature == b->feature;
}

static bool row_before(const tm_contact_row *a, const tm_contact_row *b) {
    if (a->instrument != b->instrument) return a->instrument < b->instrument;
    if (a->station != b->station) return a->station < b->station;
    return a->face != b->face ? a->face < b->face : a->feature < b->feature;
}

static double depth_before(const tm_contact *contact, const tm_contact_row *row) {
    return tm_contact_compliance_depth(contact->def.contact_compliance_m_N / row->share,
                                       contact->tool[row->instrument].def.radius_m, row->lambda_N);
}

/* Stores the depth of each station's compliance at the last substep. */
static void remember_depth(tm_contact *contact) {
    for (int32_t t = 0; t < contact->tool_count; t++) {
        memset(contact->tool[t].station_depth_m, 0, sizeof contact->tool[t].station_depth_m);
        contact->tool[t].load_N = 0;
    }
    for (int32_t i = 0; i < contact->previous_row_count; i++) {
        const tm_contact_row *row = contact->previous_row + i;
        tm_tool *tool = contact->tool + row->instrument;
        tool->station_depth_m[row->station] = law_max(tool->station_depth_m[row->station], depth_before(contact, row));
        tool->load_N += row->lambda_N;
    }
}

/* Copies the state of known rows from the last substep: both lists are sorted, so one pass suffices. Rows that replace
 * others inherit their station's depth; if that generates energy, contact_passivity.c reduces the forces. */
static void warm_start(tm_contact *contact) {
    int32_t k = 0;
    for (int32_t i = 0; i < contact->row_count; i++) {
        tm_contact_row *row = contact->row + i;
        while (k < contact->previous_row_count && row_before(contact->previous_row + k, row)) k++;
        if (k < contact->previous_row_count && same_row(contact->previous_row + k, row))
            row->lambda_N = contact->previous_row[k].lambda_N;
        contact->solver[i].depth_m = contact->tool[row->instrument].station_depth_m[row->station];
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
    const tm_contact_query *s = tm_contact_detect(contact);
    tm_contact_row *swap = contact->previous_row;
    contact->previous_row = contact->row;
    contact->previous_row_count = contact->row_count;
    contact->row = swap;
    contact->row_count = 0;
    for (int32_t t = 0; t < contact->tool_count; t++) {
        tm_contact_row *row = contact->row + contact->row_count;
        memmove(row, contact->row + (int64_t)t * contact->def.max_rows, sizeof *row * (size_t)s->count[t]);
        contact->row_count += tm_contact_admit(contact, t, row, s->count[t]);
    }
    drop_shallowest(contact);
    remember_depth(contact);
    warm_start(contact);
}

static void react_rows(void *self, int32_t t, double force_N[3], double resultant_N[3]) {
    const tm_contact *contact = self;
    tm_tool *tool = ((tm_contact *)self)->tool + t;
    tm_lever lever = {.length_m = 0}; /* computed at the first loaded row */
    for (int32_t i = 0; i < contact->row_count; i++) {
        const tm_contact_row *row = contact->row + i;
        double on_tool[3], at_tip[3];
        if (row->instrument != t || row->lambda_N <= 0) continue;
        vscale(-row->lambda_N, row->normal, on_tool);
        vmadd(on_tool, -1, contact->solver[i].drag_N, on_tool);
        if (lever.length_m == 0) lever = tm_tool_lever(&tool->def, &tool->pose);
        tm_lever_force(&lever, row->point_m, on_tool, at_tip);
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

static void finish_own(void *self, tm_world *world) {
    (void)world;
    tm_contact_limit_energy(self);
}

static tm_constraint_block own_rows(tm_contact *contact) {
    return (tm_constraint_block){
        .self = contact, .find = find_own, .sweep = sweep_own, .finish = finish_own, .react = react_rows};
}

/* For a surface other than the tissue's: its owner finds the rows when it solves them. */
static void find_no_rows(void *self, tm_world *world) {
    (void)world;
    tm_contact *contact = self;
    for (int32_t t = 0; t < contact->tool_count; t++) contact->tool[t].outside = true;
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
    for (int32_t i = 0; i < contact->row_count; i++) /* these rows have no viscous drag */
        memset(contact->solver[i].drag_N, 0, sizeof contact->solver[i].drag_N);
    for (int32_t t = 0; t < contact->tool_count; t++) contact->tool[t].flags |= flags[t];
}

static tm_constraint_block others_rows(tm_contact *contact) {
    return (tm_constraint_block){.self = contact,
                                 .owner = contact->others.self,
                                 .find = find_no_rows,
                                 .finish = solve_others,
                                 .react = react_rows};
}

void tm_contact_set_block(tm_contact *contact, const tm_contact_block *block) {
    TM_REQUIRE(contact, "contact is null", );
    contact->others = block ? *block : (tm_contact_block){0};
    *tm_contact_rows_block(contact) = block ? others_rows(contact) : own_rows(contact);
}
