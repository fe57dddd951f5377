/* Pieces of a recording: the tool as its device sees it, and samples as the controller takes them. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "io/from_message.h"
#include "studies/replay/replay.h"

void device_see(const sim *s, int instrument, const hrt_params *params, const double tip_m[3], bool encoders,
                float seen_m[3]) {
    float relative[3];
    for (int i = 0; i < 3; i++) relative[i] = (float)(tip_m[i] - s->instrument_def[instrument].trocar_m[i]);
    memcpy(seen_m, relative, sizeof relative);
    if (!encoders) return;
    hrt_axes axes;
    float joint[HRT_JOINTS] = {0};
    int32_t count[HRT_JOINTS] = {0};
    axes.device = params->device;
    for (int i = 0; i < 9; i++) axes.r[i] = (float)s->axes[instrument].r[i];
    if (!hrt_inverse(&axes, relative, joint)) return;
    for (int j = 0; j < HRT_MOTORS; j++) count[j] = (int32_t)lroundf(hrt_count_of_joint(params, j, joint[j]));
    hrt_counts_to_joint(params, count, joint);
    hrt_tip(&axes, joint, seen_m);
}

void sampled_take(sim_publisher *p, const sim *s, int instrument, const hrt_params *params, int64_t t_us,
                  int64_t ready_us, sampled *out) {
    static float scratch[HRT_PATCH_COMPLIANCE];
    const tm_instrument_def *def = &s->instrument_def[instrument];
    tensormass_force_sample_t m;
    sim_force_sample(p, s, instrument, ready_us, 1, t_us, 0, &m);
    *out = (sampled){.ready_us = ready_us};
    hrt_sample_from_message(&m, def->trocar_m, def->mode != TM_TOOL_GRASPER, params, &out->sample);
    if (!sim_contact_patch(p, s, &m, &p->patch)) return;
    out->patch = malloc(sizeof *out->patch);
    if (!out->patch) abort();
    if (hrt_patch_from_message(&p->patch, def->trocar_m, scratch, out->patch) == HRT_ACCEPT)
        out->sample.patch = out->patch;
    else
        free(out->patch), out->patch = NULL;
}

void recording_free(recording *r) {
    for (int i = 0; i < r->samples; i++) free(r->sample[i].patch);
    free(r->sample);
    free(r->tip_m);
    free(r->truth_N);
    free(r->phase);
    cut_list_free(&r->cuts);
    memset(r, 0, sizeof *r);
}
