/* Decoded force samples and patches, and every extrapolator on the accepted ones: bounded and finite. */
#include <math.h>

#include "fuzz.h"
#include "io/node.h"

static void floats(fuzz_bytes *b, float *out, int count, bool tame) {
    for (int i = 0; i < count; i++) {
        if (tame)
            out[i] = (float)(int8_t)fuzz_u8(b) / 1000;
        else
            fuzz_take(b, &out[i], sizeof *out);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static hrt_patch patches[6]; /* a sample in use must not change */
    static float scratch[HRT_PATCH_COMPLIANCE];
    fuzz_bytes b = {data, size};
    hrt_params params;
    hrt_params_default(&params);
    hrt_extrapolation x;
    hrt_extrapolation_reset(&x, (hrt_extrapolator)(fuzz_u8(&b) % HRT_EXTRAPOLATOR_COUNT));
    int64_t now_us = 1000000;
    uint32_t seq = 0;
    for (int round = 0; round < 6 && b.left; round++) {
        hrt_patch *patch = &patches[round];
        uint8_t what = fuzz_u8(&b);
        hrt_sample s = {
            .session = 1, .tool_session = 1, .seq = ++seq, .stiffness_kind = what & 3, .unilateral = what & 4};
        s.t_us = now_us - (int64_t)fuzz_u8(&b) * 500;
        floats(&b, s.tip_m, 3, what & 8);
        floats(&b, s.force_N, 3, what & 8);
        floats(&b, s.stiffness_N_m, 9, what & 16);
        if (what & 32) {
            memset(patch, 0, sizeof *patch);
            patch->seq = s.seq;
            patch->vertex_count = fuzz_u8(&b) % (HRT_PATCH_MAX_VERTICES + 3);
            patch->triangle_count = fuzz_u8(&b) % (HRT_PATCH_MAX_TRIANGLES + 3);
            patch->radius_m = 0.0025f;
            patch->contact_compliance_m_N = 1e-4f;
            patch->contact_length_m = 0.05f;
            patch->drag_s_m = (float)fuzz_u8(&b) / 128;       /* from 1 s/m on it is rejected */
            patch->radiation_N_s_m = (float)fuzz_u8(&b) / 16; /* from 10 N s/m on it is rejected */
            patch->radiation_s = (float)fuzz_u8(&b) / 1024;
            patch->friction_static =
                (float)fuzz_u8(&b) / 64; /* above 2 it is rejected, and so is kinetic above static */
            patch->friction_kinetic = (float)fuzz_u8(&b) / 256;
            const int own = 3 * patch->vertex_count;
            if (what & 2) patch->grasped = patch->vertex_count < 31 ? 1u << patch->vertex_count | fuzz_u8(&b) : 1u;
            int dofs = 3 * hrt_patch_nodes(patch);
            if (dofs > HRT_PATCH_DOFS) dofs = HRT_PATCH_DOFS;
            floats(&b, patch->vertex_m, dofs, what & 64);
            fuzz_take(&b, patch->triangle, sizeof patch->triangle);
            if (what & 128) /* a diagonal matrix, which is accepted */
                for (int i = 0, at = 0; i < dofs; at += dofs - i, i++) {
                    const float size = (float)(1 + (fuzz_u8(&b) & 15));
                    patch->compliance_m_N[at] = i < own ? 1e-3f * size : -100.0f * size;
                    for (int j = own; i < own && j < dofs; j++) /* motion of the vertices per motion of the tip */
                        patch->compliance_m_N[at + j - i] = (float)(int8_t)fuzz_u8(&b) / 64;
                }
            else
                floats(&b, patch->compliance_m_N, dofs * (dofs + 1) / 2, what & 64);
            if (hrt_patch_prepare(patch, scratch) == HRT_ACCEPT) s.patch = patch;
        }
        if (hrt_sample_check(&s, &params) == HRT_ACCEPT) hrt_extrapolation_sample(&x, &params, &s);
        for (int tick = 0; tick < 8; tick++) {
            float tip[3], force[3];
            now_us += 2000;
            floats(&b, tip, 3, true);
            if (what & 8)
                for (int k = 0; k < 3; k++) tip[k] = s.tip_m[k] + 0.01f * tip[k];
            hrt_extrapolation_force(&x, &params, now_us, tip, force);
            for (int k = 0; k < 3; k++) PROMISE(isfinite(force[k]));
        }
    }
    return 0;
}
