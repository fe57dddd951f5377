/* Recordings of a scene: its scripted hands, open loop and seen through their encoders, at one frame rate for the
 * samples and at every tick for the truth. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "common/program_host.h"
#include "studies/replay/replay.h"

enum { SETTINGS = 16 };

/* Returns an exit code after a complaint: the scene has no tool whose force could be replayed. Read without settings
 * of haptics, which want instruments themselves. */
static int check_instruments(const scene_record *of) {
    app_scene *scene = NULL;
    int rc = sim_scene_load(of->scene, NULL, 0, app_program_host(), &scene);
    if (!rc && !scene->instrument.count)
        rc = app_bad_input(of->scene, 0, "no instrument, so there is no force to replay; add 'instruments:'");
    app_scene_free(scene);
    return rc;
}

/* Returns 0, or an exit code after a complaint. */
static int open_at(const scene_record *of, double rate_Hz, const char *const *more, sim **out) {
    char rate[64], *set[SETTINGS] = {rate};
    int count = 1, rc = check_instruments(of);
    app_scene *scene = NULL;
    snprintf(rate, sizeof rate, "time.frame_rate=%.9g", rate_Hz);
    for (; *more && count < SETTINGS; more++) set[count++] = (char *)(uintptr_t)*more;
    for (int i = 0; of->set && of->set[i] && count < SETTINGS; i++) set[count++] = (char *)(uintptr_t)of->set[i];
    if (!rc) rc = sim_scene_load(of->scene, set, count, app_program_host(), &scene);
    return rc ? rc : sim_create(scene, out);
}

/* The hands' poses, and what their devices see of them. By whole microseconds, so that hands are at the same places to
 * the bit whatever the rate: a cautery that is elsewhere by a rounding takes other tetrahedra after a while. */
static void poses_at(const sim *s, const recording *r, int64_t time_us, tm_tool_pose to[TM_MAX_INSTRUMENTS]) {
    float seen_m[3];
    for (int i = 0; i < s->instrument_count; i++) {
        to[i] = sim_hand_pose(s, i, 1e-6 * (double)time_us);
        device_see(s, i, &r->params, to[i].tip_m, true, seen_m);
        for (int c = 0; c < 3; c++) to[i].tip_m[c] = s->instrument_def[i].trocar_m[c] + (double)seen_m[c];
    }
}

static void *zeroed(size_t count, size_t size) {
    void *memory = calloc(count + 1, size);
    if (!memory) abort();
    return memory;
}

static double processor_s(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static double length_s(const scene_record *of, const sim *s) {
    return of->duration_s > 0 ? of->duration_s : s->scene->duration.si;
}

static int finish(sim *s, tm_status status, const scene_record *of, double rate_Hz) {
    sim_destroy(s);
    if (status) fprintf(stderr, "%s became unstable at %g Hz\n", of->scene, rate_Hz);
    return status ? APP_FAILED : 0;
}

int record_scene(const scene_record *of, double rate_Hz, recording *out, int *instruments) {
    static sim_publisher publisher[TM_MAX_INSTRUMENTS];
    const char *const more[] = {of->force_alone ? "haptics.sends=force" : "haptics.sends=patch", NULL};
    sim *s = NULL;
    const int rc = open_at(of, rate_Hz, more, &s);
    if (rc) return rc;
    *instruments = s->instrument_count;
    const int frames = (int)(length_s(of, s) / s->frame_s + 1e-9), count = s->instrument_count;
    for (int i = 0; i < count; i++) {
        publisher[i] = (sim_publisher){.session = 1};
        s->wants[i] = of->force_alone ? SIM_SENDS_FORCE : s->can_send;
        out[i].frame_s = s->frame_s, out[i].instrument = i, out[i].samples = frames;
        out[i].mode = s->instrument_def[i].mode;
        hrt_params_of_device(&out[i].params, s->axes[i].device);
        out[i].sample = zeroed((size_t)frames, sizeof *out->sample);
    }
    const double begin_s = processor_s();
    tm_status status = TM_OK;
    for (int k = 0; k < frames && !status; k++) {
        tm_tool_pose to[TM_MAX_INSTRUMENTS];
        const int64_t end_us = llround((k + 1) * s->frame_s * 1e6),
                      back_us = llround(0.5e6 * (s->average - 1) * s->dt_s);
        poses_at(s, out, end_us, to);
        status = sim_frame(s, to, s->substeps);
        cut_list_take(&out->cuts, s, 1e-6 * (double)end_us);
        for (int i = 0; i < count && !status; i++)
            sampled_take(&publisher[i], s, i, &out[i].params, end_us - back_us, end_us, &out[i].sample[k]);
    }
    for (int i = 0; i < count; i++) out[i].processor_share = (processor_s() - begin_s) / (frames * s->frame_s);
    return finish(s, status, of, rate_Hz);
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
    sim *s = NULL;
    const int rc = open_at(of, 1e6 / TICK_US, more, &s);
    if (rc) return rc;
    const int ticks = (int)(length_s(of, s) * 1e6 / TICK_US), count = s->instrument_count;
    phase_watch watch[TM_MAX_INSTRUMENTS];
    for (int i = 0; i < count; i++) {
        phase_watch_begin(&watch[i]);
        hrt_params_of_device(&out[i].params, s->axes[i].device);
        out[i].ticks = ticks, out[i].instrument = i;
        out[i].mode = s->instrument_def[i].mode;
        out[i].tip_m = zeroed(3 * (size_t)ticks, sizeof *out->tip_m);
        out[i].truth_N = zeroed(3 * (size_t)ticks, sizeof *out->truth_N);
        out[i].phase = zeroed((size_t)ticks, sizeof *out->phase);
    }
    tm_status status = TM_OK;
    for (int k = 0; k < ticks && !status; k++) {
        tm_tool_pose to[TM_MAX_INSTRUMENTS];
        const int64_t time_us = (int64_t)k * TICK_US;
        poses_at(s, out, time_us, to);
        status = sim_frame(s, to, s->substeps);
        for (int i = 0; i < count; i++) {
            truth_take(&out[i], s, k, to);
            out[i].phase[k] = (uint8_t)phase_at(&watch[i], s, i, 1e-6 * (double)time_us, out[i].tip_m + 3 * (size_t)k);
        }
    }
    return finish(s, status, of, 1e6 / TICK_US);
}
