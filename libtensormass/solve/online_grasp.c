/* Online grasping: vertices between closed jaws are pinned to them, each by the compliance of the grasp. */
#include "contact_solver.h"

#include <math.h>
#include <string.h>

#include "contact_law/jaw.h"
#define LAW_REAL double
#include "libtensormass/numeric/vec.h"

static void vertex_at(const tms_contact_solver *l, int32_t vertex, double at_m[3]) {
    for (int c = 0; c < 3; c++) at_m[c] = l->mesh->rest_m[3 * (int64_t)vertex + c] + l->u_m[3 * (int64_t)vertex + c];
}

static bool has(const int32_t *list, int32_t count, int32_t vertex) {
    for (int32_t i = 0; i < count; i++)
        if (list[i] == vertex) return true;
    return false;
}

bool tms_contact_solver_in_jaws(const tms_contact_solver *l, const tm_contact_row *row) {
    const tms_grasp *h = &l->grasp_of[row->instrument];
    if (h->count == 0) return false;
    for (int k = 0; k < 3; k++)
        if (row->weight[k] > 0 && !has(h->vertex, h->count, row->vertex[k])) return false;
    return true;
}

bool tms_contact_solver_is_grasping(const tms_contact_solver *l, int32_t tool) {
    return l->grasp_of[tool].state == TM_GRASP_HOLDING;
}

/* Skips vertices that are imposed or in other jaws: each has one pin. */
static void leave_out_taken(const tms_contact_solver *l, tms_grasp *h) {
    int32_t kept = 0;
    for (int32_t i = 0; i < h->count; i++) {
        bool taken = false;
        for (int32_t k = 0; k < l->imposed_count; k++) taken |= l->pin[k].vertex == h->vertex[i];
        for (int t = 0; t < TM_MAX_INSTRUMENTS; t++)
            taken |= &l->grasp_of[t] != h && has(l->grasp_of[t].vertex, l->grasp_of[t].count, h->vertex[i]);
        if (!taken) h->vertex[kept++] = h->vertex[i];
    }
    h->count = kept;
}

/* Closes a jaw without a change of force: each spring starts with the contact force on its vertex. */
static void close_jaw(tms_contact_solver *l, int32_t t) {
    tms_grasp *h = &l->grasp_of[t];
    const tms_tool *tool = &l->tool[t];
    h->count = tm_jaw_capture(&h->jaw, &l->grasp, &tool->def, &tool->pose, l->mesh->rest_m, l->u_m, &l->surface,
                              h->vertex, h->distance_m);
    leave_out_taken(l, h);
    for (int32_t i = 0; i < h->count; i++) {
        double at[3];
        vertex_at(l, h->vertex[i], at);
        for (int32_t k = 0; k < l->now.count; k++) {
            const tm_contact_row *row = &l->now.row[k];
            for (int j = 0; j < 3 && row->instrument == t && tms_contact_solver_in_jaws(l, row); j++)
                for (int c = 0; c < 3 && row->vertex[j] == h->vertex[i]; c++)
                    at[c] += l->grasp.compliance_m_N * row->lambda_N * row->weight[j] * row->normal[c];
        }
        tm_jaw_to_tool(&h->jaw, &tool->pose, at, h->offset_m + 3 * i);
    }
    h->state = h->count ? TM_GRASP_HOLDING : TM_GRASP_OPEN;
}

static void open_jaw(tms_contact_solver *l, tms_grasp *h) {
    for (int32_t i = 0; i < h->count; i++) {
        const int32_t s = l->slot_of[h->vertex[i]];
        for (int c = 0; c < 3; c++) h->let_go_N[3 * i + c] = s < 0 ? 0 : l->f[3 * s + c] - l->now.fc[3 * s + c];
    }
    h->state = TM_GRASP_RELEASING;
    h->fade = 1;
}

void tms_contact_solver_work_jaws(tms_contact_solver *l) {
    for (int32_t t = 0; t < l->tool_count; t++) {
        tms_grasp *h = &l->grasp_of[t];
        const tms_tool *tool = &l->tool[t];
        if (tool->def.mode != TM_TOOL_GRASPER || l->grasp.max_vertices == 0) continue;
        tm_jaw_rotate(&h->jaw, &tool->def, &tool->pose);
        switch (law_jaw_work(&h->was_closed, h->state == TM_GRASP_HOLDING, h->state == TM_GRASP_RELEASING,
                             tool->pose.active, tool->pose.grip, l->grasp.close_grip, l->grasp.open_grip)) {
        case LAW_JAW_STAYS: continue;
        case LAW_JAW_CLOSES: close_jaw(l, t); break;
        case LAW_JAW_OPENS: open_jaw(l, h); break;
        case LAW_JAW_FADES:
            h->fade = law_jaw_fade(h->fade, l->update_s, l->grasp.release_time_s);
            if (!(h->fade > 0)) h->state = TM_GRASP_OPEN, h->count = 0;
            break;
        }
        tms_contact_solver_regather(l);
        l->pair_count = 0;
    }
}

void tms_contact_solver_follow_jaws(tms_contact_solver *l) {
    l->pin_count = l->imposed_count;
    for (int32_t t = 0; t < l->tool_count; t++) {
        tms_grasp *h = &l->grasp_of[t];
        if (h->count == 0) continue;
        tm_jaw_rotate(&h->jaw, &l->tool[t].def, &l->tool[t].pose);
        for (int32_t i = 0; i < h->count && l->pin_count < l->capacity; i++) {
            tms_pin *pin = &l->pin[l->pin_count++];
            double at[3];
            *pin = (tms_pin){.vertex = h->vertex[i],
                             .tool = t,
                             .compliance_m_N = l->grasp.compliance_m_N,
                             .fades = h->state == TM_GRASP_RELEASING,
                             .max_N = h->fade * vnorm(h->let_go_N + 3 * i)};
            tm_jaw_to_world(&h->jaw, &l->tool[t].pose, h->offset_m + 3 * i, at);
            for (int c = 0; c < 3; c++) pin->u_m[c] = at[c] - l->mesh->rest_m[3 * (int64_t)pin->vertex + c];
        }
    }
}

void tms_contact_solver_slip(tms_contact_solver *l) {
    for (int32_t t = 0; t < l->tool_count; t++) {
        tms_grasp *h = &l->grasp_of[t];
        for (int32_t i = 0; i < h->count && h->state == TM_GRASP_RELEASING; i++) {
            const int32_t s = l->slot_of[h->vertex[i]];
            const tms_pin *pin = s < 0 || l->pin_of[s] < 0 ? NULL : &l->pin[l->pin_of[s]];
            if (!pin || !pin->prescribed) continue;
            double at[3];
            for (int c = 0; c < 3; c++) {
                const int64_t d = 3 * (int64_t)pin->vertex + c;
                at[c] = l->mesh->rest_m[d] + l->u_m[d] + pin->compliance_m_N * pin->force_N[c];
            }
            tm_jaw_to_tool(&h->jaw, &l->tool[t].pose, at, h->offset_m + 3 * i);
        }
    }
}

void tms_contact_solver_force(const tms_contact_solver *l, int32_t tool, double force_N[3], double resultant_N[3]) {
    memcpy(force_N, l->now.force_N[tool], 24);
    memcpy(resultant_N, l->now.resultant_N[tool], 24);
    for (int32_t i = l->imposed_count; i < l->pin_count; i++) {
        const tms_pin *pin = &l->pin[i];
        const int32_t s = l->slot_of[pin->vertex];
        double at[3], on_tool[3], at_tip[3];
        if (pin->tool != tool || s < 0) continue;
        for (int c = 0; c < 3; c++) {
            at[c] = l->mesh->rest_m[3 * (int64_t)pin->vertex + c] + pin->u_m[c];
            on_tool[c] = l->now.fc[3 * s + c] - l->f[3 * s + c];
        }
        tm_tool_tip_force(&l->tool[tool].def, &l->tool[tool].pose, at, on_tool, at_tip);
        for (int c = 0; c < 3; c++) force_N[c] += at_tip[c], resultant_N[c] += on_tool[c];
    }
}
