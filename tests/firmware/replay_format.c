#include <string.h>

#include "replay.h"

static void raw(replay_bytes *bytes, void *value, uint32_t size) {
    if (bytes->failed || (uint32_t)(bytes->end - bytes->at) < size) {
        bytes->failed = true;
        return;
    }
    if (bytes->write)
        memcpy(bytes->at, value, size);
    else
        memcpy(value, bytes->at, size);
    bytes->at += size;
}

void replay_u8(replay_bytes *bytes, uint8_t *value) { raw(bytes, value, 1); }

static void number(replay_bytes *bytes, int32_t *value) { raw(bytes, value, 4); }

/* Writes enums and bools with a fixed size: their own differs between machines. */
#define AS_NUMBER(bytes, type, field)                                                                                  \
    do {                                                                                                               \
        int32_t as_number = (int32_t)(field);                                                                          \
        number(bytes, &as_number);                                                                                     \
        (field) = (type)as_number;                                                                                     \
    } while (0)

void replay_frame(replay_bytes *bytes, hrt_can_frame *frame) {
    raw(bytes, &frame->id, 4);
    replay_u8(bytes, &frame->length);
    replay_u8(bytes, &frame->flags);
    raw(bytes, frame->data, 8);
}

void replay_sample(replay_bytes *bytes, hrt_sample *sample) {
    raw(bytes, &sample->session, 8);
    raw(bytes, &sample->tool_session, 8);
    raw(bytes, &sample->t_us, 8);
    raw(bytes, &sample->seq, 4);
    number(bytes, &sample->topology_revision);
    number(bytes, &sample->stiffness_kind);
    AS_NUMBER(bytes, bool, sample->unilateral);
    raw(bytes, sample->tip_m, sizeof sample->tip_m);
    raw(bytes, sample->force_N, sizeof sample->force_N);
    raw(bytes, sample->stiffness_N_m, sizeof sample->stiffness_N_m);
}

/* Writes counts first, as they bound the arrays; a firmware built for smaller patches reads no larger one. */
void replay_patch(replay_bytes *bytes, hrt_patch *patch) {
    raw(bytes, &patch->seq, 4);
    number(bytes, &patch->topology_revision);
    number(bytes, &patch->vertex_count);
    number(bytes, &patch->triangle_count);
    raw(bytes, &patch->grasped, 4);
    if (patch->vertex_count < 0 || patch->vertex_count > HRT_PATCH_MAX_VERTICES ||
        hrt_patch_nodes(patch) > HRT_PATCH_MAX_VERTICES || patch->triangle_count < 0 ||
        patch->triangle_count > HRT_PATCH_MAX_TRIANGLES) {
        bytes->failed = true;
        return;
    }
    const uint32_t n = 3u * (uint32_t)hrt_patch_nodes(patch);
    if (hrt_patch_grasps(patch)) raw(bytes, &patch->rest_m[hrt_patch_tip(patch)], 12);
    raw(bytes, patch->vertex_m, 4 * n);
    raw(bytes, patch->triangle, 3u * (uint32_t)patch->triangle_count);
    raw(bytes, patch->compliance_m_N, 2 * n * (n + 1));
    raw(bytes, &patch->contact_compliance_m_N, 4);
    raw(bytes, &patch->radius_m, 4);
    raw(bytes, &patch->contact_length_m, 4);
    raw(bytes, &patch->drag_s_m, 4);
    raw(bytes, &patch->radiation_N_s_m, 4);
    raw(bytes, &patch->radiation_s, 4);
}

void replay_command(replay_bytes *bytes, fw_news *news) {
    AS_NUMBER(bytes, bool, news->enable);
    AS_NUMBER(bytes, bool, news->reset);
    AS_NUMBER(bytes, bool, news->passivity);
    AS_NUMBER(bytes, bool, news->coupling);
    AS_NUMBER(bytes, hrt_extrapolator, news->extrapolator);
}

void replay_result(replay_bytes *bytes, hrt_result *result) {
    AS_NUMBER(bytes, hrt_state, result->state);
    AS_NUMBER(bytes, hrt_fault, result->fault);
    number(bytes, &result->fault_detail);
    raw(bytes, &result->limits, 4);
    AS_NUMBER(bytes, bool, result->motors_on);
    raw(bytes, result->torque, sizeof result->torque);
    raw(bytes, result->force_N, sizeof result->force_N);
    raw(bytes, result->joint, 5 * sizeof *result->joint); /* the Impulse Engine's joints */
    raw(bytes, result->tip_m, sizeof result->tip_m);
    raw(bytes, result->velocity_m_s, sizeof result->velocity_m_s);
    raw(bytes, &result->gain, 4);
    raw(bytes, &result->passivity_J, 4);
    raw(bytes, &result->sample_age_us, 8);
    AS_NUMBER(bytes, hrt_extrapolator, result->extrapolator);
}
