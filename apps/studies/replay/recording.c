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

static void *zeroed(size_t count, size_t size) {
    void *memory = calloc(count + 1, size);
    if (!memory) abort();
    return memory;
}

static void drop_samples(recording *r) {
    for (int i = 0; i < r->samples; i++) free(r->sample[i].patch);
    free(r->sample);
}

void recording_begin(recording *r, const sim *s, int samples, int ticks) {
    hrt_params_of_device(&r->params, s->axes[r->instrument].device);
    r->mode = s->instrument_def[r->instrument].mode;
    if (ticks) {
        r->ticks = ticks;
        r->tip_m = zeroed(3 * (size_t)ticks, sizeof *r->tip_m),
        r->truth_N = zeroed(3 * (size_t)ticks, sizeof *r->truth_N);
        return;
    }
    drop_samples(r);
    r->frame_s = s->sample_s, r->samples = samples, r->sample = zeroed((size_t)samples, sizeof *r->sample);
}

/* The force is the mean of the last substeps: the tool was where it is told of half as long before the sample's end. */
void recording_sample(recording *r, sim_publisher *p, const sim *s, int k) {
    static float scratch[HRT_PATCH_COMPLIANCE];
    const tm_instrument_def *def = &s->instrument_def[r->instrument];
    const int64_t end_us = llround((k + 1) * s->sample_s * 1e6), back_us = llround(0.5e6 * (s->average - 1) * s->dt_s);
    tensormass_force_sample_t m;
    sampled *out = &r->sample[k];
    sim_force_sample(p, s, r->instrument, end_us, 1, end_us - back_us, 0, &m);
    *out = (sampled){.ready_us = end_us};
    hrt_sample_from_message(&m, def->trocar_m, def->mode != TM_TOOL_GRASPER, &r->params, &out->sample);
    if (!sim_contact_patch(p, s, &m, &p->patch)) return;
    out->patch = zeroed(1, sizeof *out->patch);
    if (hrt_patch_from_message(&p->patch, def->trocar_m, scratch, out->patch) == HRT_ACCEPT)
        out->sample.patch = out->patch;
    else
        free(out->patch), out->patch = NULL;
}

tm_status record_samples(sim *s, int frames, int hands, const leader *by, recording *out) {
    static sim_publisher publisher[TM_MAX_INSTRUMENTS];
    tm_status status = TM_OK;
    for (int h = 0; h < hands; h++)
        publisher[h] = (sim_publisher){.session = 1}, recording_begin(&out[h], s, frames, 0);
    for (int k = 0; k < frames && !status; k++) {
        tm_tool_pose to[TM_MAX_INSTRUMENTS];
        by->pose(by->user, s, (k + 1) * s->frame_s, to);
        status = sim_frame(s, to, s->substeps);
        cut_list_take(&out->cuts, s, (k + 1) * s->frame_s);
        for (int h = 0; h < hands && !status; h++) recording_sample(&out[h], &publisher[h], s, k);
        if (by->after && !by->after(by->user, s, k)) break;
    }
    return status;
}

static void take_tick(recording *r, const sim *s, int k, const tm_tool_pose *to) {
    double size = 0;
    for (int c = 0; c < 3; c++) {
        const double force_N = s->reaction[r->instrument].force_N[c];
        r->tip_m[3 * k + c] = (float)(to[r->instrument].tip_m[c] - s->instrument_def[r->instrument].trocar_m[c]);
        r->truth_N[3 * k + c] = (float)force_N;
        size += force_N * force_N;
    }
    r->peak_N = fmax(r->peak_N, sqrt(size));
    const double time_s = 1e-6 * (double)((int64_t)k * TICK_US);
    if (r->phase) r->phase[k] = (uint8_t)phase_at(&r->watch, s, r->instrument, time_s, r->tip_m + 3 * (size_t)k);
}

tm_status record_ticks(sim *s, int ticks, int hands, const leader *by, recording *out) {
    tm_status status = TM_OK;
    for (int h = 0; h < hands; h++) recording_begin(&out[h], s, 0, ticks);
    for (int k = 0; k < ticks && !status; k++) {
        tm_tool_pose to[TM_MAX_INSTRUMENTS];
        by->pose(by->user, s, 1e-6 * k * TICK_US, to);
        status = sim_frame(s, to, s->substeps);
        cut_list_take(&out->cuts, s, (k - 0.5) * 1e-6 * TICK_US); /* within the tick's 2 ms */
        for (int h = 0; h < hands; h++) take_tick(&out[h], s, k, to);
        if (s->broken_off || (by->after && !by->after(by->user, s, k))) break;
    }
    return status;
}

void recording_free(recording *r) {
    drop_samples(r);
    free(r->tip_m);
    free(r->truth_N);
    free(r->phase);
    cut_list_free(&r->cuts);
    memset(r, 0, sizeof *r);
}
