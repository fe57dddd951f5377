/* Contact forces on the tools: sum over all blocks in a substep, average at the end of a frame. Also the tool paths of
 * a frame. */
#include "contact/contact_internal.h"

#include <math.h>
#include <string.h>

#include "base/vec.h"

/* --- one substep --- */

static void sum_reactions(tm_contact *contact) {
    for (int32_t t = 0; t < contact->tool_count; t++) {
        tm_tool *tool = contact->tool + t;
        memset(tool->substep_force_N, 0, sizeof tool->substep_force_N);
        memset(tool->substep_resultant_N, 0, sizeof tool->substep_resultant_N);
        for (int32_t b = 0; b < contact->block_count; b++)
            contact->block[b].react(contact->block[b].self, t, tool->substep_force_N, tool->substep_resultant_N);
    }
}

static void mark_releasing(tm_contact *contact) {
    for (int32_t t = 0; t < contact->tool_count; t++) {
        const int32_t *vertex;
        const double *target_m;
        double compliance_m_N;
        if (tm_contact_grasped(contact, t, &vertex, &target_m, &compliance_m_N) < 0)
            contact->tool[t].flags |= TM_REACTION_RELEASING;
    }
}

/* Zeroes forces that are not finite and marks the step as failed. */
static void disown(tm_contact *contact) {
    for (int32_t t = 0; t < contact->tool_count; t++) {
        tm_tool *tool = contact->tool + t;
        const double *f = tool->substep_force_N, *r = tool->substep_resultant_N;
        contact->unstable |= !isfinite(f[0] + f[1] + f[2] + r[0] + r[1] + r[2]);
    }
    if (!contact->unstable) return;
    contact->world->unstable = true;
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
    if (contact->world->part + 1 == contact->world->parts) contact->frame_step++;
    for (int32_t t = 0; t < contact->tool_count && within; t++) {
        tm_tool *tool = contact->tool + t;
        tool->sum_count++;
        tool->sum_time_s += state->time_s + state->dt_s; /* the rows are solved at the end of the substep */
        vmadd(tool->sum_tip_m, 1, tool->pose.tip_m, tool->sum_tip_m);
        vmadd(tool->sum_force_N, 1, tool->substep_force_N, tool->sum_force_N);
        vmadd(tool->sum_resultant_N, 1, tool->substep_resultant_N, tool->sum_resultant_N);
    }
}

void tm_contact_sum(tm_contact *contact) {
    tm_contact_observe(contact);
    sum_reactions(contact);
    mark_releasing(contact);
    disown(contact);
    average(contact);
}

/* --- calls of the application between frames --- */

#define INSTRUMENT_IS_THERE(...)                                                                                       \
    TM_REQUIRE(contact &&instrument >= 0 && instrument < contact->tool_count,                                          \
               "contact is null or instrument is not one of its own", __VA_ARGS__)

void tm_contact_set_target(tm_contact *contact, int32_t instrument, const tm_tool_pose *to, int32_t substeps) {
    INSTRUMENT_IS_THERE();
    TM_REQUIRE(TM_IS_POSE(to), "to is null, not finite or beyond 1e6", );
    tm_tool_move(contact->tool + instrument, to, substeps);
}

void tm_contact_set_pose(tm_contact *contact, int32_t instrument, const tm_tool_pose *at) {
    INSTRUMENT_IS_THERE();
    TM_REQUIRE(TM_IS_POSE(at), "at is null, not finite or beyond 1e6", );
    tm_tool_set_pose(contact->tool + instrument, at);
    int32_t kept = 0; /* its row forces belong to the previous pose */
    for (int32_t i = 0; i < contact->row_count; i++)
        if (contact->row[i].instrument != instrument) contact->row[kept++] = contact->row[i];
    contact->row_count = kept;
    if (contact->fading) tm_fading_drop(contact->fading, instrument);
}

tm_tool_pose tm_contact_pose(const tm_contact *contact, int32_t instrument) {
    INSTRUMENT_IS_THERE((tm_tool_pose){0});
    return contact->tool[instrument].pose;
}

bool tm_contact_is_grasped(const tm_contact *contact, const tm_contact_row *row) {
    TM_REQUIRE(contact && row, "contact or row is null", false);
    return tm_row_is_grasped(contact, row);
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
    if (tm_tool_is_present(tool) && !tool->outside) reaction.flags |= TM_REACTION_INSIDE;
    reaction.stiffness_kind = tool->stiffness_kind;
    memcpy(reaction.stiffness_N_m, tool->stiffness_N_m, tool->stiffness_kind ? sizeof reaction.stiffness_N_m : 0);
    for (int32_t i = 0; i < contact->row_count; i++)
        reaction.row_count += contact->row[i].instrument == instrument && contact->row[i].lambda_N > 0;
    if (tool->sum_count == 0) { /* no average yet: use the last substep */
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
