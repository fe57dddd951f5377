/* Recordings of a scene: its scripted hands, open loop and seen through their encoders, at one frame rate for the
 * samples and at every tick for the truth. */
#include <math.h>
#include <stdlib.h>

#include "studies/replay/replay.h"

enum { SETTINGS = 16 };

static sim *open_at(const scene_record *of, double rate_Hz, const char *const *more) {
    char rate[64], *set[SETTINGS] = {rate};
    int count = 1;
    sim *s = NULL;
    app_scene *scene = NULL;
    snprintf(rate, sizeof rate, "time.frame_rate=%.9g", rate_Hz);
    for (; *more && count < SETTINGS; more++) set[count++] = (char *)(uintptr_t)*more;
    for (int i = 0; of->set && of->set[i] && count < SETTINGS; i++) set[count++] = (char *)(uintptr_t)of->set[i];
    return sim_scene_load(of->scene, set, count, &scene) || sim_create(scene, &s) ? NULL : s;
}

/* The hands' poses, and what their devices see of them. */
static void poses_at(const sim *s, const recording *r, double time_s, tm_tool_pose to[TM_MAX_INSTRUMENTS]) {
    float seen_m[3];
    for (int i = 0; i < s->instrument_count; i++) {
        to[i] = sim_hand_pose(s, i, time_s);
        device_see(s, i, &r->params, to[i].tip_m, true, seen_m);
        for (int c = 0; c < 3; c++) to[i].tip_m[c] = s->instrument_def[i].trocar_m[c] + (double)seen_m[c];
    }
}

static void *zeroed(size_t count, size_t size) {
    void *memory = calloc(count + 1, size);
    if (!memory) abort();
    return memory;
}

int record_scene(const scene_record *of, double rate_Hz, recording *out) {
    static sim_publisher publisher;
    const char *const more[] = {"haptics.sends=patch", NULL};
    sim *s = open_at(of, rate_Hz, more);
    if (!s) return APP_FAILED;
    publisher = (sim_publisher){.session = 1};
    const int frames = (int)llround(of->duration_s / s->frame_s), count = s->instrument_count;
    for (int i = 0; i < count; i++) {
        s->wants[i] = s->can_send;
        out[i].frame_s = s->frame_s, out[i].instrument = i, out[i].samples = frames;
        hrt_params_default(&out[i].params);
        out[i].sample = zeroed((size_t)frames, sizeof *out->sample);
    }
    tm_status status = TM_OK;
    for (int k = 0; k < frames && !status; k++) {
        tm_tool_pose to[TM_MAX_INSTRUMENTS];
        const double end_s = (k + 1) * s->frame_s;
        const int64_t end_us = llround(end_s * 1e6), back_us = llround(0.5e6 * (s->average - 1) * s->dt_s);
        poses_at(s, out, end_s, to);
        status = sim_frame(s, to, s->substeps);
        cut_list_take(&out->cuts, s, end_s);
        for (int i = 0; i < count && !status; i++)
            sampled_take(&publisher, s, i, &out[i].params, end_us - back_us, end_us, &out[i].sample[k]);
    }
    sim_destroy(s);
    return status ? APP_FAILED : 0;
}

void truth_take(recording *r, const sim *s, int k, const tm_tool_pose *to) {
    double size = 0;
    for (int c = 0; c < 3; c++) {
        const double force_N = s->reaction[r->instrument].force_N[c];
        r->tip_m[3 * k + c] = (float)(to[r->instrument].tip_m[c] - s->instrument_def[r->instrument].trocar_m[c]);
        r->truth_N[3 * k + c] = (float)force_N;
        size += force_N * force_N;
    }
    r->peak_N = fmax(r->peak_N, sqrt(size));
}

int record_scene_truth(const scene_record *of, recording *out) {
    const char *const more[] = {"time.average=0", "haptics.sends=force", "haptics.extrapolator=hold", NULL};
    sim *s = open_at(of, 1e6 / TICK_US, more);
    if (!s) return APP_FAILED;
    const int ticks = (int)(of->duration_s * 1e6 / TICK_US), count = s->instrument_count;
    for (int i = 0; i < count; i++) {
        hrt_params_default(&out[i].params);
        out[i].ticks = ticks, out[i].instrument = i;
        out[i].tip_m = zeroed(3 * (size_t)ticks, sizeof *out->tip_m);
        out[i].truth_N = zeroed(3 * (size_t)ticks, sizeof *out->truth_N);
    }
    tm_status status = TM_OK;
    for (int k = 0; k < ticks && !status; k++) {
        tm_tool_pose to[TM_MAX_INSTRUMENTS];
        poses_at(s, out, k * 1e-6 * TICK_US, to);
        status = sim_frame(s, to, s->substeps);
        for (int i = 0; i < count; i++) truth_take(&out[i], s, k, to);
    }
    sim_destroy(s);
    return status ? APP_FAILED : 0;
}
