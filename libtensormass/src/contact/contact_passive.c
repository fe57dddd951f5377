/* Contact makes no energy. Rows that are deeper than the tool's motion made them (tissue that slides along normals
 * which are blended over facets as large as the tool, and so the gradient of no potential) start from the depth of the
 * deepest row of their station, which they take over from one another. But where that one's tissue cannot give way and
 * theirs can, they are pressed in anew in every substep, and nobody does that work. So every tool keeps an account of
 * what its rows gave the tissue and hold in their skins over what moving the tool put in (passivity observer, Hannaford
 * and Ryu 2002); where that is more than nothing, rows keep to their own depth. */
#include "contact/contact_internal.h"

#include "base/vec.h"
#include "law/skin.h"

/* At this share of the reactions times the way that the tool went with them nothing is taken over any more; what is not
 * worth it; and how long an account remembers. */
static const double SHARE = 0.04, LITTLE_J = 1e-6, MEMORY_S = 1;

tm_row_work tm_contact_row_work(const tm_contact *contact, int32_t i, const tm_capsule *earlier) {
    const tm_contact_row *row = contact->row + i;
    const tm_tool *tool = contact->tool + row->instrument;
    const double compliance = contact->def.skin_compliance_m_N / row->share;
    tm_row_work w = {.skin_J = 0};
    double here[3], there[3];
    tm_capsule_station(&tool->capsule, row->station, here);
    tm_capsule_station(earlier, row->station, there);
    for (int c = 0; c < 3; c++) {
        w.force_N[c] = row->lambda_N * row->normal[c] + contact->solver[i].drag_N[c];
        w.way_m[c] = here[c] - there[c];
        w.hand_J += 0.5 * w.force_N[c] * w.way_m[c];
    }
    if (compliance > 0) w.skin_J = law_skin_energy(compliance, LAW_SKIN_TRAVEL * tool->def.radius_m, row->lambda_N);
    return w;
}

static double work_on_tissue(const tm_state *s, const tm_contact_row *row, const double force_N[3]) {
    double work = 0;
    for (int c = 0; c < 3; c++)
        for (int j = 0; j < 3; j++) {
            const int32_t dof = 3 * row->vertex[j] + c;
            work += 0.5 * force_N[c] * row->weight[j] * (s->u_next_m[dof] - s->u_prev_m[dof]);
        }
    return work;
}

void tm_contact_observe(tm_contact *contact) {
    if (contact->others.solve) return; /* their rows are not ours to hold back */
    double sprung[TM_MAX_INSTRUMENTS] = {0}, surplus[TM_MAX_INSTRUMENTS] = {0}, turnover[TM_MAX_INSTRUMENTS] = {0};
    for (int32_t i = 0; i < contact->row_count; i++) {
        const tm_contact_row *row = contact->row + i;
        const int32_t t = row->instrument;
        if (!(row->lambda_N > 0)) continue;
        const tm_row_work w = tm_contact_row_work(contact, i, &contact->tool[t].earlier);
        surplus[t] += work_on_tissue(&contact->world->state, row, w.force_N) - w.hand_J;
        turnover[t] += row->lambda_N * vnorm(contact->solver[i].moved_m);
        sprung[t] += w.skin_J;
    }
    const double left = 1 - law_min(contact->world->state.dt_s / MEMORY_S, 1);
    for (int32_t t = 0; t < contact->tool_count; t++) {
        tm_tool *tool = contact->tool + t;
        tool->surplus_J = left * tool->surplus_J + surplus[t] + sprung[t] - tool->sprung_J;
        tool->turnover_J = left * tool->turnover_J + turnover[t];
        tool->sprung_J = sprung[t];
        tool->earlier = tool->before;
    }
}

double tm_contact_takes_over(const tm_tool *tool) {
    const double over = tool->surplus_J - LITTLE_J;
    return over > 0 ? 1 - law_min(over / (SHARE * tool->turnover_J + LITTLE_J), 1) : 1;
}
