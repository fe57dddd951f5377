/* Contact makes no energy. Its rows push along normals blended over the surface, which are the gradient of no
 * potential: on facets as large as the tool, tissue that slides round a tool that stands still can be driven by it. So
 * every tool keeps an account of what its rows gave the tissue and hold in their skins over what moving the tool put in
 * (passivity observer, Hannaford and Ryu 2002); where that exceeds a share of what it did lately,
 * the film between tool and tissue thickens until they stick, and nothing slides round any more. */
#include "contact/contact_internal.h"

#include "base/vec.h"
#include "law/skin.h"

/* Of the reactions times the way that the tool went with them: from the first share on the film thickens, from the
 * second on it sticks (sliding over facets of two tool radii makes and loses 5 % in turn); what is not worth it; and
 * how long an account remembers. */
static const double SHARE_FROM = 0.08, SHARE_TO = 0.16, LITTLE_J = 1e-6, MEMORY_S = 1;
static const double STICKS = 300; /* times the film's coefficient: at 10 mm/s as large as the reaction */

/* Of one row, over the two steps around the force as the scheme does its work: what it gives the tissue less what the
 * hand gives it. */
static double row_surplus(const tm_contact *contact, const tm_contact_row *row, const tm_solver_row *r,
                          double *turnover_J) {
    const tm_state *s = &contact->world->state;
    const tm_tool *tool = contact->tool + row->instrument;
    double here[3], there[3], hand = 0, work = 0;
    tm_capsule_station(&tool->capsule, row->station, here);
    tm_capsule_station(&tool->earlier, row->station, there);
    for (int c = 0; c < 3; c++) {
        const double force = row->lambda_N * row->normal[c] + r->drag_N[c];
        hand += 0.5 * force * (here[c] - there[c]);
        for (int j = 0; j < 3; j++) {
            const int32_t dof = 3 * row->vertex[j] + c;
            work += 0.5 * force * row->weight[j] * (s->u_next_m[dof] - s->u_prev_m[dof]);
        }
    }
    *turnover_J += row->lambda_N * vnorm(r->moved_m);
    return work - hand;
}

void tm_contact_observe(tm_contact *contact) {
    double sprung[TM_MAX_INSTRUMENTS] = {0}, surplus[TM_MAX_INSTRUMENTS] = {0}, turnover[TM_MAX_INSTRUMENTS] = {0};
    for (int32_t i = 0; i < contact->row_count; i++) {
        const tm_contact_row *row = contact->row + i;
        const double compliance = contact->solver[i].compliance;
        if (!(row->lambda_N > 0)) continue;
        surplus[row->instrument] += row_surplus(contact, row, contact->solver + i, &turnover[row->instrument]);
        if (compliance > 0)
            sprung[row->instrument] += law_skin_energy(
                compliance, LAW_SKIN_TRAVEL * contact->tool[row->instrument].def.radius_m, row->lambda_N);
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

double tm_contact_film_s_m(const tm_tool *tool) {
    const double over = tool->surplus_J - LITTLE_J - SHARE_FROM * tool->turnover_J;
    if (!(over > 0)) return LAW_FILM_S_M;
    const double full = (SHARE_TO - SHARE_FROM) * tool->turnover_J + LITTLE_J;
    return LAW_FILM_S_M * (1 + STICKS * law_min(over / full, 1));
}
