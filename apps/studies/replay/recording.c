/* Recordings of a path or of a scene's own hands. They contain removed tetrahedra, for replay at another frame rate,
 * and the hand's activity. They also contain the tool measured by its device, samples as the controller receives them,
 * and the truth at every tick. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bandwidth.h"
#include "common/program_host.h"
#include "io/from_message.h"
#include "studies/replay/replay.h"
#include "tensormass/cut.h"

/* --- cuts --- */

static void cut_list_take(cut_list *list, const sim *s, double time_s) {
    int count = list->count + s->cuts.count;
    if (count > list->capacity) {
        list->capacity = 2 * count;
        list->tet = realloc(list->tet, sizeof *list->tet * (size_t)list->capacity);
        list->time_s = realloc(list->time_s, sizeof *list->time_s * (size_t)list->capacity);
        if (!list->tet || !list->time_s) abort();
    }
    for (int i = 0; i < s->cuts.count; i++) {
        list->tet[list->count + i] = s->cuts.tet[i];
        list->time_s[list->count + i] = time_s;
    }
    list->count = count;
}

/* Appends the tetrahedra that the last frame removed, all at one time. */
static void cut_list_free(cut_list *list) {
    free(list->tet);
    free(list->time_s);
    memset(list, 0, sizeof *list);
}

bool cut_list_between(const cut_list *list, double from_s, double to_s) {
    for (int i = 0; list && i < list->count; i++)
        if (list->time_s[i] > from_s && list->time_s[i] <= to_s) return true;
    return false;
}

int cut_list_shared(const cut_list *a, const cut_list *b) {
    int shared = 0;
    for (int i = 0; i < a->count; i++)
        for (int j = 0; j < b->count; j++)
            if (a->tet[i] == b->tet[j]) {
                shared++;
                break;
            }
    return shared;
}

/* Removes the tetrahedra that are due. Returns the steps until the next is due, at most INT32_MAX. */
static int32_t between(void *user, sim *s) {
    cut_replay *r = user;
    const cut_list *list = r->list;
    const double now_s = sim_time_s(s) - r->begin_s + 0.5 * s->dt_s;
    for (; r->next < list->count && list->time_s[r->next] <= now_s; r->next++)
        tm_cut_remove(s->model->tissue, &list->tet[r->next], 1, NULL, 0);
    if (r->next == list->count) return INT32_MAX;
    const double until = ceil((list->time_s[r->next] - now_s) / s->dt_s);
    return until < INT32_MAX ? (until > 1 ? (int32_t)until : 1) : INT32_MAX;
}

void cut_replay_begin(cut_replay *replay, const cut_list *list, sim *s) {
    *replay = (cut_replay){.list = list, .begin_s = HUGE_VAL};
    s->between = between;
    s->between_user = replay;
}

/* --- phases --- */

/* Time for which an event determines the phase, s. */
static const double touch_s = 0.1, grasp_s = 0.2, let_go_s = 0.3, cut_s = 0.1, slide_m_s = 3e-3;

static void phase_watch_begin(phase_watch *w) {
    *w = (phase_watch){.touched_s = -1, .closed_s = -1, .opened_s = -1, .cut_s = -1};
}

/* Returns the phase of the tick that ended at time_s and updates the watch. */
static phase phase_at(phase_watch *w, const sim *s, int instrument, double time_s, const float tip_m[3]) {
    const tm_tool_pose *pose = &s->pose[instrument];
    const double *f = s->reaction[instrument].force_N;
    const bool touching = f[0] != 0 || f[1] != 0 || f[2] != 0;
    float moved[3] = {tip_m[0] - w->tip_m[0], tip_m[1] - w->tip_m[1], tip_m[2] - w->tip_m[2]};
    if (s->instrument_def[instrument].mode == TM_TOOL_GRASPER) {
        if (!w->closed && pose->grip >= 0.7) w->closed = true, w->closed_s = time_s;
        if (w->closed && pose->grip <= 0.3) w->closed = false, w->opened_s = time_s;
    }
    if (touching != w->touching) w->touching = touching, w->touched_s = time_s;
    if (s->cuts.count) w->cut_s = time_s;
    memcpy(w->tip_m, tip_m, sizeof w->tip_m);
    if (time_s - w->opened_s < let_go_s) return PHASE_LET_GO;
    if (w->closed && time_s - w->closed_s < grasp_s) return PHASE_GRASP;
    if (touching && time_s - w->cut_s < cut_s) return PHASE_CUT;
    if (w->closed) return PHASE_LIFT;
    if (time_s - w->touched_s < touch_s) return PHASE_TOUCH;
    if (!touching) return PHASE_FREE;
    const float speed = sqrtf(moved[0] * moved[0] + moved[1] * moved[1] + moved[2] * moved[2]) / (1e-6f * TICK_US);
    const double size = sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
    const double along = (moved[0] * f[0] + moved[1] * f[1] + moved[2] * f[2]) / size / (1e-6 * TICK_US);
    const double across = sqrt(fmax((double)speed * (double)speed - along * along, 0));
    return across > slide_m_s && across > fabs(along) ? PHASE_SLIDE : PHASE_PRESS;
}

/* --- samples and ticks --- */

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

static void drop_samples(recording *r) {
    for (int i = 0; i < r->samples; i++) free(r->sample[i].patch);
    free(r->sample);
}

void recording_begin(recording *r, const sim *s, int samples, int ticks) {
    hrt_params_of_device(&r->params, s->axes[r->instrument].device);
    r->mode = s->instrument_def[r->instrument].mode;
    if (ticks) {
        r->ticks = ticks;
        r->tip_m = app_zeroed(3 * (size_t)ticks, sizeof *r->tip_m),
        r->truth_N = app_zeroed(3 * (size_t)ticks, sizeof *r->truth_N);
        return;
    }
    drop_samples(r);
    r->frame_s = s->sample_s, r->samples = samples, r->sample = app_zeroed((size_t)samples, sizeof *r->sample);
}

/* The force is the mean of the last substeps, so the reported tool pose is that at half their duration before the
 * sample's end. */
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
    out->patch = app_zeroed(1, sizeof *out->patch);
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

static void read_tick(recording *r, const sim *s, int k, const tm_tool_pose *to) {
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
        for (int h = 0; h < hands; h++) read_tick(&out[h], s, k, to);
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

/* --- a scene's hands --- */

enum { SETTINGS = 16 };

/* Checks for a tool whose force can be replayed. Returns an exit code after an error message if there is none. Reads
 * the scene without settings of haptics, which require instruments themselves. */
static int check_instruments(const scene_record *of) {
    app_scene *scene = NULL;
    int rc = sim_scene_load(of->scene, NULL, 0, app_program_host(), &scene);
    if (!rc && !scene->instrument.count)
        rc = app_bad_input(of->scene, 0,
                           "the scene has no instrument, so there is no force to replay; add 'instruments:'");
    app_scene_free(scene);
    return rc;
}

/* Opens the scene. Returns 0, or an exit code after an error message. */
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

/* Computes the hands' poses as their devices measure them. Times are whole microseconds, so poses are bit-identical at
 * all rates: a rounding difference would make a cautery remove other tetrahedra after a while. */
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
    const double begin_s = app_processor_s();
    const tm_status status = record_samples(s, frames, count, &(leader){poses_at, NULL, out}, out);
    for (int i = 0; i < count; i++) out[i].processor_share = (app_processor_s() - begin_s) / (frames * s->frame_s);
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
        out[i].phase = app_zeroed((size_t)ticks, sizeof *out->phase);
    }
    return finish(s, record_ticks(s, ticks, count, &(leader){poses_at, NULL, out}, out), of, 1e6 / TICK_US);
}
