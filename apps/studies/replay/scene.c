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
static void poses_at(void *user, const sim *s, double time_s, tm_tool_pose to[TM_MAX_INSTRUMENTS]) {
    const recording *r = user;
    const double whole_s = 1e-6 * (double)llround(1e6 * time_s);
    float seen_m[3];
    for (int i = 0; i < s->instrument_count; i++) {
        to[i] = sim_hand_pose(s, i, whole_s);
        device_see(s, i, &r->params, to[i].tip_m, true, seen_m);
        for (int c = 0; c < 3; c++) to[i].tip_m[c] = s->instrument_def[i].trocar_m[c] + (double)seen_m[c];
    }
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
    const char *const more[] = {of->force_alone ? "haptics.sends=force" : "haptics.sends=patch", NULL};
    sim *s = NULL;
    const int rc = open_at(of, rate_Hz, more, &s);
    if (rc) return rc;
    const int frames = (int)(length_s(of, s) / s->frame_s + 1e-9), count = *instruments = s->instrument_count;
    for (int i = 0; i < count; i++)
        out[i].instrument = i, s->wants[i] = of->force_alone ? SIM_SENDS_FORCE : s->can_send;
    const double begin_s = processor_s();
    const tm_status status = record_samples(s, frames, count, &(leader){poses_at, NULL, out}, out);
    for (int i = 0; i < count; i++) out[i].processor_share = (processor_s() - begin_s) / (frames * s->frame_s);
    return finish(s, status, of, rate_Hz);
}

int record_scene_truth(const scene_record *of, recording *out) {
    const char *const more[] = {"time.average=0", "haptics.sends=force", "haptics.extrapolator=hold", NULL};
    sim *s = NULL;
    const int rc = open_at(of, 1e6 / TICK_US, more, &s);
    if (rc) return rc;
    const int ticks = (int)(length_s(of, s) * 1e6 / TICK_US), count = s->instrument_count;
    for (int i = 0; i < count; i++) {
        phase_watch_begin(&out[i].watch);
        out[i].instrument = i;
        out[i].phase = calloc((size_t)ticks + 1, sizeof *out->phase);
        if (!out[i].phase) abort();
    }
    return finish(s, record_ticks(s, ticks, count, &(leader){poses_at, NULL, out}, out), of, 1e6 / TICK_US);
}
