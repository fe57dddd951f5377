/* Passivity observer of the hybrid model: limits the energy that contact generates, as contact_passivity.c does for
 * tissue with mass.
 *
 * Contact rows act along blended normals, move between both kinds of tissue, and remove any depth at once. Without a
 * limit, vertices of little mass would gain high speeds. After each substep's solve the work of all rows is computed as
 * the integrator sees it. It is the work on tissue with mass and the interface, plus the elastic energy of condensed
 * tissue and contact compliance. The tools' work and the energy that damping dissipates are subtracted. In no window of
 * LAW_WINDOW_S may the sum exceed WINDOW_SHARE of the stored energy. If it would, one factor reduces the forces of all
 * rows. At rest nothing is generated, and forces do not change. */
#include "hybrid.h"

#include <math.h>
#include <string.h>

#define LAW_REAL double
#include "contact_law/compliance.h"

static const double WINDOW_SHARE = 0.15, LITTLE_J = 2e-8;
static const double LEAST_WAY_M = 1e-12; /* rounding error of the path between equal poses */
enum { HALVINGS = 30 };

/* Work of all rows over the two steps around them, with their forces scaled by `share`: share way + share^2 own; held:
 * elastic energy of condensed tissue. */
typedef struct row_sum {
    double way_J, own_J, held_J, tool_work_J;
} row_sum;

static double compressed_J(const tms_contact_solver *l, int32_t count, double share) {
    double sum = 0;
    for (int32_t i = 0; i < count; i++) {
        const tm_contact_row *row = &l->now.row[i];
        const double compliance = l->def.contact_compliance_m_N / row->share;
        if (!(row->lambda_N > 0) || !(compliance > 0)) continue;
        sum += law_compliance_energy(compliance, LAW_COMPLIANCE_TRAVEL * l->tool[row->instrument].def.radius_m,
                                     share * row->lambda_N);
    }
    return sum;
}

static double tool_work_J(const tm_hybrid *h, int32_t count) {
    const tms_contact_solver *l = &h->solver_contact;
    double sum = 0;
    for (int32_t i = 0; i < count; i++) {
        const tm_contact_row *row = &l->now.row[i];
        double here[3], there[3];
        tms_contact_reuse_station(&l->tool[row->instrument].capsule, row, here);
        tm_capsule earlier = {.radius_m = l->tool[row->instrument].def.radius_m};
        memcpy(earlier.tip_m, h->passivity.was_m[1][row->instrument], 24);
        memcpy(earlier.tail_m, h->passivity.was_m[1][row->instrument] + 3, 24);
        tms_contact_reuse_station(&earlier, row, there);
        for (int c = 0; c < 3; c++) sum += 0.5 * row->lambda_N * row->normal[c] * (here[c] - there[c]);
    }
    return sum;
}

/* Returns the work of a slot's force on the displacement by all forces on condensed tissue and the interface. */
static double strain_of(const tm_hybrid *h, int32_t slot) {
    const tms_contact_solver *l = &h->solver_contact;
    const int64_t c3 = 3 * (int64_t)l->capacity;
    double sum = 0;
    for (int32_t j = 0; j < l->used_count; j++) {
        const int32_t other = l->used[j];
        const double *g = l->f + 3 * other;
        if (h->vertex_kind[l->vertex[other]] == TMS_DYNAMIC || (g[0] == 0 && g[1] == 0 && g[2] == 0)) continue;
        for (int c = 0; c < 3; c++)
            sum += l->f[3 * slot + c] * tms_dot(l->block + (3 * slot + c) * c3 + 3 * other, g, 3);
    }
    return sum;
}

static row_sum sum_work(const tm_hybrid *h, const double *push_N, int32_t count) {
    const tms_contact_solver *l = &h->solver_contact;
    const tm_state *s = tm_world_state(h->world);
    row_sum sum = {.tool_work_J = tool_work_J(h, count)};
    double strain = 0, interface = 0;
    for (int32_t k = 0; k < h->interface_count; k++) {
        const int32_t d = h->interface[k];
        const double adds = h->interface_mobility_m_N[k] * push_N[k];
        interface += push_N[k] * adds;
        sum.way_J += 0.5 * push_N[k] * (s->u_next_m[d] - adds - s->u_prev_m[d]);
    }
    sum.own_J = 0.5 * interface;
    for (int32_t i = 0; i < l->used_count; i++) {
        const int32_t slot = l->used[i], v = l->vertex[slot];
        if (l->f[3 * slot] == 0 && l->f[3 * slot + 1] == 0 && l->f[3 * slot + 2] == 0) continue;
        if (h->vertex_kind[v] != TMS_DYNAMIC) {
            strain += strain_of(h, slot);
            continue;
        }
        for (int c = 0; c < 3; c++) {
            const int32_t d = 3 * v + c;
            const double f = l->f[3 * slot + c], adds = tms_hybrid_mobility(h, d) * f;
            sum.way_J += 0.5 * f * (s->u_next_m[d] - adds - s->u_prev_m[d]);
            sum.own_J += 0.5 * f * adds;
        }
    }
    sum.held_J = 0.5 * fmax(strain - interface, 0);
    return sum;
}

static double gain_J(const tm_hybrid *h, const row_sum *sum, int32_t count, double share) {
    const tms_hybrid_passivity *p = &h->passivity;
    return share * (sum->way_J - sum->tool_work_J) + share * share * sum->own_J +
           0.5 * (share * share * sum->held_J + compressed_J(&h->solver_contact, count, share) - p->strained_J[1]);
}

static double recently_generated_J(const tms_hybrid_passivity *p) {
    return law_ledger_recent(p->generated_J, p->min_generated_J);
}

/* Returns the kinetic and elastic energy. */
static double stored_J(const tm_hybrid *h) {
    const tm_state *s = tm_world_state(h->world);
    const double *mobility = tm_world_mobility_s2_kg(h->world);
    double moving = 0, strained = 0;
    for (int32_t i = 0; i < 3 * h->moving_count; i++) {
        const int32_t v = h->moving[i / 3], d = 3 * v + i % 3;
        const double went = s->u_m[d] - s->u_prev_m[d];
        moving += went * went / mobility[v];
        strained -= s->u_m[d] * s->force_N[d];
    }
    return 0.5 * (moving + fabs(strained));
}

/* Returns the energy that damping dissipates in this step: contact may generate as much. */
static double damped_J(const tm_hybrid *h) {
    const tm_state *s = tm_world_state(h->world);
    const double *damping = tm_tissue_damping_kg_s(tm_world_tissue(h->world));
    double sum = 0;
    for (int32_t i = 0; i < 3 * h->moving_count; i++) {
        const int32_t v = h->moving[i / 3], d = 3 * v + i % 3;
        const double way = s->u_next_m[d] - s->u_prev_m[d];
        sum += damping[v] * way * way;
    }
    return 0.25 * sum / s->dt_s;
}

static double find_share(const tm_hybrid *h, const row_sum *sum, int32_t count, double may_J) {
    double least = 0, most = 1;
    for (int halving = 0; halving < HALVINGS; halving++) {
        const double share = 0.5 * (least + most);
        *(gain_J(h, sum, count, share) <= may_J ? &least : &most) = share;
    }
    return least;
}

static void reduce(tm_hybrid *h, const double *push_N, double share) {
    tms_contact_solver *l = &h->solver_contact;
    double *u_next = tm_world_state(h->world)->u_next_m;
    for (int32_t k = 0; k < h->interface_count; k++)
        u_next[h->interface[k]] += (share - 1) * h->interface_mobility_m_N[k] * push_N[k];
    for (int32_t i = 0; i < 3 * l->used_count; i++) {
        const int32_t slot = l->used[i / 3], d = 3 * l->vertex[slot] + i % 3;
        if (h->vertex_kind[d / 3] == TMS_DYNAMIC)
            u_next[d] += (share - 1) * tms_hybrid_mobility(h, d) * l->f[3 * slot + i % 3];
        l->f[3 * slot + i % 3] *= share;
    }
    for (int32_t i = 0; i < l->now.count; i++) l->now.row[i].lambda_N *= share;
    for (int32_t i = 0; i < l->previous_count; i++) l->previous[i].lambda_N *= share;
    for (int32_t i = 0; i < h->reuse->system.count; i++) h->reuse->system.lambda_N[i] *= share;
    tms_contact_solver_sum(l, &l->now);
}

static void place_of(const tms_tool *tool, double at_m[6]) {
    memcpy(at_m, tool->capsule.tip_m, 24);
    memcpy(at_m + 3, tool->capsule.tail_m, 24);
}

static bool is_loaded(const tms_contact_solver *l, int32_t t, int32_t count) {
    bool any = false;
    for (int32_t i = 0; i < count; i++) any |= l->now.row[i].instrument == t && l->now.row[i].lambda_N > 0;
    return any;
}

/* Updates the tools' poses. Returns whether a tool was placed inside tissue: it may push the tissue out, until it moves
 * or has no contact. */
static bool follow_tools(tm_hybrid *h, int32_t count) {
    tms_hybrid_passivity *p = &h->passivity;
    bool placed = false;
    for (int32_t t = 0; t < h->solver_contact.tool_count; t++) {
        const tms_tool *tool = &h->solver_contact.tool[t];
        double at_m[6], most = 0;
        place_of(tool, at_m);
        for (int c = 0; c < 6; c++) most = fmax(most, fabs(at_m[c] - p->was_m[0][t][c]));
        if (!p->seen || most > tool->def.radius_m) {
            p->placed[t] = 1;
            memcpy(p->was_m[0][t], at_m, sizeof at_m);
            memcpy(p->was_m[1][t], at_m, sizeof at_m);
        } else if (most > LEAST_WAY_M)
            p->placed[t] = 0;
        p->placed[t] = p->placed[t] && is_loaded(&h->solver_contact, t, count);
        placed |= p->placed[t];
    }
    p->seen = 1;
    return placed;
}

static void advance(tm_hybrid *h, double gain, double strained) {
    tms_hybrid_passivity *p = &h->passivity;
    p->generated_J += gain;
    p->strained_J[1] = p->strained_J[0];
    p->strained_J[0] = strained;
    memcpy(p->was_m[1], p->was_m[0], sizeof p->was_m[0]);
    for (int32_t t = 0; t < h->solver_contact.tool_count; t++) place_of(&h->solver_contact.tool[t], p->was_m[0][t]);
    law_ledger_advance(p->generated_J, p->min_generated_J, &p->window_s, tm_world_state(h->world)->dt_s);
}

void tms_hybrid_limit_energy(tm_hybrid *h, const double *push_N, int32_t count) {
    tms_hybrid_passivity *p = &h->passivity;
    const bool placed = follow_tools(h, count);
    row_sum sum = {0};
    double share = 1, gain;
    if (count > 0) sum = sum_work(h, push_N, count);
    gain = gain_J(h, &sum, count, 1);
    if (count > 0 && !placed && recently_generated_J(p) + gain > LITTLE_J) {
        const double stored = stored_J(h) + p->strained_J[0];
        const double may = fmax(WINDOW_SHARE * stored + LITTLE_J - recently_generated_J(p), 0);
        if (gain > may + 1e-3 * LITTLE_J) {
            share = find_share(h, &sum, count, may);
            gain = gain_J(h, &sum, count, share);
            reduce(h, push_N, share);
        }
    }
    advance(h, placed ? fmin(gain, 0) : gain, share * share * sum.held_J + compressed_J(&h->solver_contact, count, 1));
    const double lately = recently_generated_J(p);
    if (count > 0 && lately > LITTLE_J) p->generated_J -= fmin(damped_J(h), lately);
}
