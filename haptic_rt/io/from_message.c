/* Converts received messages to samples and patches of the core, and checks them. */
#include "from_message.h"

#include <string.h>

hrt_reject hrt_sample_from_message(const tensormass_force_sample_t *m, const double trocar_m[3], bool unilateral,
                                   const hrt_params *params, hrt_sample *s) {
    memset(s, 0, sizeof *s);
    s->session = m->session;
    s->tool_session = m->tool_session;
    s->t_us = m->tool_utime;
    s->seq = (uint32_t)m->seq;
    s->topology_revision = m->topology_revision;
    s->flags = m->flags >= 0 && m->flags <= UINT16_MAX ? (uint16_t)m->flags
                                                       : UINT16_MAX; /* more bits than known: an unknown flag */
    s->stiffness_kind = m->stiffness_kind;
    s->unilateral = unilateral;
    for (int i = 0; i < 3; i++) {
        s->tip_m[i] = (float)(m->tip_m[i] - trocar_m[i]);
        s->force_N[i] = (float)m->force_N[i];
    }
    if (m->stiffness_kind != 0)
        for (int i = 0; i < 9; i++) s->stiffness_N_m[i] = (float)m->stiffness_N_m[i];
    return hrt_sample_check(s, params);
}

hrt_reject hrt_patch_from_message(const tensormass_contact_patch_t *m, const double trocar_m[3],
                                  float scratch[HRT_PATCH_COMPLIANCE], hrt_patch *patch) {
    if (m->vertex_count < 3 || m->vertex_count > HRT_PATCH_MAX_VERTICES || m->triangle_count < 1 ||
        m->triangle_count > HRT_PATCH_MAX_TRIANGLES || m->vertex_count + (m->grasped != 0) > HRT_PATCH_MAX_VERTICES)
        return HRT_REJECT_INDEX;
    memset(patch, 0, sizeof *patch);
    patch->seq = (uint32_t)m->seq;
    patch->topology_revision = m->topology_revision;
    patch->vertex_count = m->vertex_count;
    patch->triangle_count = m->triangle_count;
    patch->contact_compliance_m_N = m->contact_compliance_m_N;
    patch->force_cap_N = m->force_cap_N;
    patch->radius_m = m->radius_m;
    patch->contact_length_m = m->contact_length_m;
    patch->drag_s_m = m->drag_s_m;
    patch->radiation_N_s_m = m->radiation_N_s_m;
    patch->radiation_s = m->radiation_s;
    patch->friction_static = m->friction_static;
    patch->friction_kinetic = m->friction_kinetic;
    patch->grasped = (uint32_t)m->grasped;
    const int32_t n = 3 * hrt_patch_nodes(patch), tip = hrt_patch_tip(patch);
    for (int32_t i = 0; i < n; i++) {
        const double origin_m = m->origin_m[i % 3] - trocar_m[i % 3];
        patch->vertex_m[i] = (float)((double)m->vertex_m[i] + origin_m);
        patch->rest_m[i] = i < tip ? (float)((double)m->rest_m[i] + origin_m) : m->grasp_N[i % 3];
    }
    for (int32_t i = 0; i < 3 * m->triangle_count; i++) patch->triangle[i] = (uint8_t)m->triangle[i];
    memcpy(patch->face, m->face, sizeof *patch->face * (size_t)m->triangle_count);
    memcpy(patch->compliance_m_N, m->compliance_m_N, (size_t)(n * (n + 1) / 2) * sizeof *patch->compliance_m_N);
    return hrt_patch_prepare(patch, scratch);
}
