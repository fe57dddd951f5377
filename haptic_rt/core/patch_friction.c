/* Coulomb friction on the patch at the tool's stations, between ticks. Same law as the simulation
 * (contact_law/friction.h; docs/friction.md). Tissue motion under a station comes from the vertices' displacements now
 * and in the last tick, so a new sample's correction is included. */
#include "internal.h"

#if HRT_WITH_FRICTION
#include "contact_law/friction.h"

static const float MIN_COMPLIANCE_m_N = 1.0e-6f; /* minimum compliance: without stretch there is no force */

static const uint8_t *corners(const hrt_friction *friction, const hrt_contact_row *row) {
    return &friction->patch->triangle[HRT_XYZ * row->triangle];
}

static law_v3 on_axis(uint8_t station, float radius_m, law_v3 tip, const float *direction) {
    const float back_m = (float)station * radius_m;
    if (direction) return vminus(tip, vtimes(back_m, vget(direction)));
    return vtimes(1.0f - back_m / vsize(tip), tip);
}

/* Sums the rows of a station: load, normal, normal force. Returns false if no row is loaded. */
static bool press(hrt_friction_station *g, const hrt_contact_row *row, int32_t count) {
    law_v3 sum = {0.0f, 0.0f, 0.0f};
    g->load_N = 0.0f;
    for (; count > 0; count--, row++) {
        if (row->station != g->is.station || !(row->lambda_N > 0.0f)) continue;
        g->load_N += row->lambda_N;
        sum = vplus(sum, vtimes(row->lambda_N, vget(row->normal)));
    }
    vput(sum, g->normal);
    g->normal_force_N = vunit(g->normal, g->normal);
    return g->load_N > 0.0f;
}

const hrt_friction_station *hrt_friction_station_of(const hrt_friction *friction, const hrt_contact_row *row) {
    for (int32_t k = 0; k < friction->count; k++)
        if (friction->station[k].is.station == row->station && row->lambda_N > 0.0f) return &friction->station[k];
    return NULL;
}

void hrt_friction_begin(hrt_friction *friction, const hrt_patch *patch, hrt_friction_history *was, const float tip_m[3],
                        const hrt_shaft *shaft) {
    friction->shaft = shaft;
    friction->patch = patch;
    friction->history = was;
    friction->tip = vget(tip_m);
    friction->count = was->count;
    for (int32_t k = 0; k < was->count; k++) friction->station[k].is = was->at[k];
    if (was->known != 0) return;
    vset(tip_m, was->tip_m);
    if (hrt_is_free(shaft)) vset(shaft->direction, was->direction);
}

void hrt_friction_shape(hrt_friction *friction, const float *shift_m) {
    for (int32_t i = 0; i < 3 * friction->patch->vertex_count; i++) {
        friction->u_m[i] = friction->patch->vertex_m[i] - friction->patch->rest_m[i] + shift_m[i];
        if ((friction->history->known >> i / 3 & 1u) == 0) friction->history->u_m[i] = friction->u_m[i];
    }
    friction->history->known |= (1u << friction->patch->vertex_count) - 1u;
}

void hrt_friction_add(const hrt_friction *friction, const hrt_contact_row *row, int32_t count, float sign,
                      float *force_N) {
    for (; count > 0; count--, row++) {
        const hrt_friction_station *g = hrt_friction_station_of(friction, row);
        for (int k = 0; g && k < 3; k++)
            vadd(&force_N[HRT_XYZ * corners(friction, row)[k]], sign * row->weight[k] * row->lambda_N / g->load_N,
                 g->is.force_N);
    }
}

void hrt_friction_load(hrt_friction *friction, const hrt_contact_row *row, int32_t count) {
    int32_t kept = 0;
    for (int32_t k = 0; k < friction->count; k++)
        if (press(&friction->station[k], row, count)) friction->station[kept++] = friction->station[k];
    friction->count = kept;
    for (int32_t r = 0; r < count; r++) {
        if (!(row[r].lambda_N > 0.0f) || hrt_friction_station_of(friction, &row[r])) continue;
        hrt_friction_station *g = &friction->station[friction->count++];
        *g = (hrt_friction_station){.is = {.station = row[r].station, .stick_state = 1.0f}};
        press(g, row, count);
    }
}

/* Returns the tissue motion under a station for vertex displacements u_m. */
static law_v3 under(const hrt_friction *friction, const hrt_friction_station *g, const hrt_contact_row *row,
                    int32_t count, const float *u_m) {
    law_v3 sum = {0.0f, 0.0f, 0.0f};
    for (; count > 0; count--, row++) {
        if (row->station != g->is.station || !(row->lambda_N > 0.0f)) continue;
        for (int k = 0; k < 3; k++)
            if (row->weight[k] > 0.0f)
                sum = vplus(sum, vtimes(row->weight[k] * row->lambda_N / g->load_N,
                                        vget(&u_m[HRT_XYZ * corners(friction, row)[k]])));
    }
    return sum;
}

/* Adds the compliance along `e` under each station for one newton at every station. */
static void add_compliance(hrt_friction *friction, const hrt_contact_row *row, int32_t count, law_v3 e) {
    float load[HRT_PATCH_DOFS] = {0}, shift_m[HRT_PATCH_DOFS] = {0};
    uint8_t from[HRT_PATCH_MAX_VERTICES];
    law_v3 force[HRT_PATCH_MAX_VERTICES];
    int32_t loaded = 0;
    for (int32_t r = 0; r < count; r++) {
        const hrt_friction_station *g = hrt_friction_station_of(friction, &row[r]);
        for (int k = 0; g && k < 3; k++)
            load[corners(friction, &row[r])[k]] += row[r].weight[k] * row[r].lambda_N / g->load_N;
    }
    for (int32_t v = 0; v < friction->patch->vertex_count; v++) {
        if (!(load[v] > 0.0f)) continue;
        from[loaded] = (uint8_t)v;
        force[loaded++] = vtimes(load[v], e);
    }
    for (int32_t i = 0; i < loaded; i++) hrt_patch_respond(friction->patch, from[i], from, force, loaded, shift_m);
    for (int32_t k = 0; k < friction->count; k++)
        friction->station[k].compliance_sum_m_N =
            law_max(friction->station[k].compliance_sum_m_N,
                    vinner(e, under(friction, &friction->station[k], row, count, shift_m)));
}

/* Computes the tangential compliance in two directions and keeps the larger, which next_force divides by. In
 * anisotropic tissue the smaller would overestimate the force. */
static void add_cross_compliance(hrt_friction *friction, const hrt_contact_row *row, int32_t count) {
    if (friction->count == 0) return;
    const law_v3 normal = vget(friction->station[0].normal);
    law_v3 e = {0.0f, -normal.z, normal.y};
    if (normal.x * normal.x > 0.5f) e = (law_v3){-normal.y, normal.x, 0.0f};
    e = vtimes(1.0f / law_max(vsize(e), 1.0e-9f), e);
    for (int32_t k = 0; k < friction->count; k++) friction->station[k].compliance_sum_m_N = 0.0f;
    add_compliance(friction, row, count, e);
    add_compliance(friction, row, count, vouter(normal, e));
}

/* Computes the friction force that is consistent with this shape. c (t - stretch) = tool travel - tissue travel, where
 * the previous force moved the tissue. t' = P((c stretch + travel + B t) / (c + B)); P projects into the cone, B is the
 * tissue's compliance. The stretch is stored apart, so the unconverged part of a sticking force is not lost. */
static void next_force(const hrt_friction *friction, hrt_friction_station *g, law_v3 went) {
    const hrt_patch *p = friction->patch;
    const hrt_friction_history *was = friction->history;
    const float compliance = law_max(p->contact_compliance_m_N, MIN_COMPLIANCE_m_N);
    hrt_friction_state before = {.stick_state = 1.0f};
    for (int32_t k = 0; k < was->count; k++)
        if (was->at[k].station == g->is.station) before = was->at[k];
    const bool is_free = hrt_is_free(friction->shaft);
    const law_v3 moved = vminus(
                     on_axis(g->is.station, p->radius_m, friction->tip, is_free ? friction->shaft->direction : NULL),
                     on_axis(g->is.station, p->radius_m, vget(was->tip_m), is_free ? was->direction : NULL)),
                 way = vminus(moved, went), force = vget(g->is.force_N), stretch = vget(before.stretch_N);
    vput(vplus(force, vtimes(1.0f / (compliance + g->compliance_sum_m_N),
                             vplus(vtimes(compliance, vminus(stretch, force)), way))),
         g->is.force_N);
    vput(vplus(stretch, vtimes(1.0f / compliance, way)), g->is.stretch_N);
    law_across(g->normal, g->is.force_N);
    law_across(g->normal, g->is.stretch_N);
    g->slipped_m = 0.0f;
    g->is.stick_state = before.stick_state;
    const float most =
        law_friction_coefficient(p->friction_static, p->friction_kinetic, before.stick_state) * g->normal_force_N;
    if (!law_friction_slips(most, g->is.force_N)) return;
    g->slipped_m = compliance * vsize(vminus(vget(g->is.stretch_N), vget(g->is.force_N)));
    vset(g->is.force_N, g->is.stretch_N);
}

void hrt_friction_iterate(hrt_friction *friction, const hrt_contact_row *row, int32_t count, float *residual_N) {
    hrt_friction_load(friction, row, count);
    add_cross_compliance(friction, row, count);
    for (int32_t k = 0; k < friction->count; k++) {
        hrt_friction_station *g = &friction->station[k];
        next_force(friction, g,
                   vminus(under(friction, g, row, count, friction->u_m),
                          under(friction, g, row, count, friction->history->u_m)));
    }
    hrt_friction_add(friction, row, count, 1.0f, residual_N);
}

void hrt_friction_settle(hrt_friction *friction, float passed_s) {
    hrt_friction_history *to = friction->history;
    to->count = friction->count;
    for (int32_t k = 0; k < friction->count; k++) {
        to->at[k] = friction->station[k].is;
        to->at[k].stick_state = law_stick_state(to->at[k].stick_state, friction->station[k].slipped_m, passed_s);
    }
    for (int32_t i = 0; i < 3 * friction->patch->vertex_count; i++) to->u_m[i] = friction->u_m[i];
    vput(friction->tip, to->tip_m);
    if (hrt_is_free(friction->shaft)) vset(friction->shaft->direction, to->direction);
}
#endif
