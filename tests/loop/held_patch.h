/* Converts a patch of the library to the form that the controller receives: apps/sim/publish.c and io/node.c without
 * a network. */
#ifndef HELD_PATCH_H
#define HELD_PATCH_H

#include <string.h>

#include "hrt.h"
#include "tensormass/patch.h"

static inline void patch_to_controller(const tm_patch *from, hrt_patch *to) {
    memset(to, 0, sizeof *to);
    to->topology_revision = from->topology_revision;
    to->vertex_count = from->vertex_count;
    to->triangle_count = from->triangle_count;
    to->grasped = from->grasps ? from->grasped | 1u << from->vertex_count : 0u;
    float *entry = to->compliance_m_N;
    for (int i = 0; i < 3 * from->vertex_count; i++) {
        to->vertex_m[i] = (float)(from->vertex_m[i] - from->trocar_m[i % 3]);
        to->rest_m[i] = (float)(from->rest_m[i] - from->trocar_m[i % 3]);
        for (int j = i; j < 3 * from->vertex_count; j++) *entry++ = (float)tm_patch_compliance(from, i, j);
        for (int c = 0; c < 3 && from->grasps; c++) *entry++ = (float)from->dvertex_dtip[3 * i + c];
    }
    for (int i = 0; i < 9 && from->grasps; i++)
        if (i % 3 >= i / 3) *entry++ = (float)from->grasp_stiffness_N_m[i];
    for (int c = 0; c < 3 && from->grasps; c++) {
        to->vertex_m[hrt_patch_tip(to) + c] = (float)(from->grasp_tip_m[c] - from->trocar_m[c]);
        to->rest_m[hrt_patch_tip(to) + c] = (float)from->grasp_N[c];
    }
    memcpy(to->face, from->face, sizeof *to->face * (size_t)from->triangle_count);
    for (int i = 0; i < 3 * from->triangle_count; i++) to->triangle[i] = (uint8_t)from->triangle[i];
    to->contact_compliance_m_N = (float)from->contact_compliance_m_N;
    to->force_cap_N = (float)from->force_cap_N;
    to->radius_m = (float)from->radius_m;
    to->contact_length_m = (float)from->contact_length_m;
    to->drag_s_m = (float)from->drag_s_m;
    to->radiation_N_s_m = (float)from->radiation_N_s_m;
    to->radiation_s = (float)from->radiation_s;
    to->friction_static = (float)from->friction_static;
    to->friction_kinetic = (float)from->friction_kinetic;
}

#endif
