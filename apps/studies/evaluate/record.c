/* Recordings of a model driven along a path, open loop, at some frame rate; the truth is the same model at 500 frames a
 * second. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "common/program_host.h"
#include "evaluate.h"

const char *const model_name[MODEL_COUNT] = {"precomputed", "isotropic", "fibred", "cut", "hybrid"};

/* Cuts a slit 4 mm wide and 10 mm deep, 6 mm from the tool's entry. */
static void cut_slit(sim *s) {
    const double *trocar = s->instrument_def[0].trocar_m;
    double top = -HUGE_VAL;
    for (int32_t v = 0; v < s->mesh->vertex_count; v++) top = fmax(top, s->mesh->rest_m[3 * v + 2]);
    for (int32_t t = 0; t < s->mesh->tet_count; t++) {
        double centre[3] = {0};
        for (int k = 0; k < 12; k++) centre[k % 3] += 0.25 * s->mesh->rest_m[3 * s->mesh->tet[4 * t + k / 3] + k % 3];
        double across = centre[0] - trocar[0], along = fabs(centre[1] - trocar[1]);
        if (across > 0.006 && across < 0.010 && along < 0.014 && centre[2] > top - 0.010)
            tm_cut_remove(s->model->tissue, &t, 1, NULL, 0);
    }
}

static sim *scene_open(const char *scene_name, double rate_Hz, const char *const *settings) {
    char name[256], file[2048], rate[64], *set[16] = {rate};
    int count = 1;
    sim *s = NULL;
    app_scene *scene = NULL;
    snprintf(name, sizeof name, "apps/scenes/evaluate-%s.yaml", scene_name);
    app_shared_file(name, file, sizeof file);
    snprintf(rate, sizeof rate, "time.frame_rate=%.9g", rate_Hz);
    for (int i = 0; settings && settings[i] && count < 16; i++) set[count++] = (char *)(uintptr_t)settings[i];
    return sim_scene_load(file, set, count, app_program_host(), &scene) || sim_create(scene, &s) ? NULL : s;
}

sim *model_open(model m, double rate_Hz, const char *const *settings) {
    sim *s = scene_open(model_name[m], rate_Hz, settings);
    if (s && m == MODEL_CUT) cut_slit(s);
    return s;
}

/* Opens a path's scene. Paths with another instrument, or two, have scenes with isotropic tissue for every model. */
static sim *path_open(model m, const path *p, double rate_Hz, const char *const *settings) {
    static const char *const computed[MODEL_COUNT][2] = {
        [MODEL_PRECOMPUTED] = {"model=precomputed"},
        [MODEL_HYBRID] = {"model=hybrid", "hybrid={box: {min: [15 mm, 15 mm, 17 mm], max: [45 mm, 45 mm, 31 mm]}}"}};
    const char *all[8] = {NULL};
    int count = 0;
    static const char *const scene[PATH_COUNT] = {[PATH_OTHER_HAND_CUTS] = "two-hands",
                                                  [PATH_SAME_HAND_CUTS] = "cautery",
                                                  [PATH_GRASPED] = "grasper",
                                                  [PATH_RANDOM] = "two-cauteries"};
    if (!scene[p->kind]) return model_open(m, rate_Hz, settings);
    for (int i = 0; i < 2 && computed[m][i]; i++) all[count++] = computed[m][i];
    for (; settings && *settings && count < 7; settings++) all[count++] = *settings;
    return scene_open(scene[p->kind], rate_Hz, all);
}

typedef struct follower {
    recording *r;
    path p;
    bool encoders;
    int hands;
} follower;

/* Computes the poses of all instruments. The recorded one is measured by its encoders, as are both of two that move at
 * random. */
static void poses_at(void *user, const sim *s, double time_s, tm_tool_pose to[TM_MAX_INSTRUMENTS]) {
    const follower *f = user;
    const recording *r = f->r;
    const path *p = &f->p;
    float seen[3];
    const int mine = r->instrument;
    for (int i = 0; i < s->instrument_count; i++) {
        to[i] = path_pose(p, i, time_s);
        if (r->replay && s->instrument_def[i].mode == TM_TOOL_CAUTERY) to[i].active = false;
    }
    for (int i = 0; f->encoders && i < s->instrument_count && i < TM_MAX_INSTRUMENTS; i++) {
        if (i != mine && p->kind != PATH_RANDOM) continue;
        device_see(s, i, &r->params, to[i].tip_m, true, seen);
        for (int c = 0; c < 3; c++) to[i].tip_m[c] = s->instrument_def[i].trocar_m[c] + (double)seen[c];
    }
}

/* Returns whether the recorded hand's cautery pedal is down; it does not cut if cuts are replayed. */
static bool is_cutting(const sim *s, const recording *r, const path *p, double time_s) {
    return s->instrument_def[r->instrument].mode == TM_TOOL_CAUTERY && path_pose(p, r->instrument, time_s).active;
}

/* Places the path below the trocar on the block's upper face; the tip's centre touches one radius above. */
static path placed(const path *p, const sim *s) {
    path q = *p;
    const double *trocar = s->instrument_def[0].trocar_m;
    double top = -HUGE_VAL;
    for (int32_t v = 0; v < s->mesh->vertex_count; v++) top = fmax(top, s->mesh->rest_m[3 * v + 2]);
    q.entry_m[0] = trocar[0] + 0.0013, q.entry_m[1] = trocar[1] - 0.0007; /* not on a lattice line */
    q.entry_m[2] = top + s->instrument_def[0].radius_m;
    return q;
}

/* Starts with the tool out of contact, so that nothing swings when the path begins. A real session
 * begins long before contact, and its earlier frames have made the first patch; here BEFORE frames make it. */
static void start(sim *s, follower *f) {
    tm_tool_pose to[TM_MAX_INSTRUMENTS];
    hrt_params_of_device(&f->r->params, s->axes[f->r->instrument].device);
    poses_at(f, s, 0, to);
    for (int i = 0; i < s->instrument_count; i++) {
        tm_model_set_pose(s->model, i, &to[i]);
        s->pose[i] = to[i];
    }
}

enum { BEFORE = 3 };

static bool flag_cutting(void *user, const sim *s, int k) {
    follower *f = user;
    for (int h = 0; h < f->hands; h++)
        if (is_cutting(s, &f->r[h], &f->p, (k + 1) * s->frame_s)) f->r[h].sample[k].sample.flags |= HRT_FLAG_CUTTING;
    return true;
}

int record(model m, const path *p, double rate_Hz, bool encoders, bool patches, recording *out) {
    return record_hands(m, p, rate_Hz, encoders, patches, 1, out);
}

int record_hands(model m, const path *p, double rate_Hz, bool encoders, bool patches, int hands, recording *out) {
    sim *s = path_open(m, p, rate_Hz, NULL);
    cut_replay replay;
    if (!s) return APP_FAILED;
    if (out->replay) cut_replay_begin(&replay, out->replay, s);
    for (int i = 0; i < s->instrument_count; i++) s->wants[i] = patches ? s->can_send : SIM_SENDS_FORCE;
    follower f = {out, placed(p, s), encoders, hands};
    start(s, &f);
    tm_status status = TM_OK;
    for (int k = 0; k < BEFORE && !status; k++) status = sim_frame(s, s->pose, s->substeps);
    if (out->replay) replay.begin_s = sim_time_s(s);
    if (!status)
        status = record_samples(s, (int)(path_length_s(&f.p) / s->frame_s), hands,
                                &(leader){poses_at, flag_cutting, &f}, out);
    sim_destroy(s);
    if (!status) return 0;
    fprintf(stderr, "tm-evaluate: the %s model became unstable at %g Hz\n", model_name[m], rate_Hz);
    return APP_FAILED;
}

int record_truth(model m, const path *p, bool encoders, recording *out) {
    return record_hands_truth(m, p, encoders, 1, out);
}

int record_hands_truth(model m, const path *p, bool encoders, int hands, recording *out) {
    static const char *const last_alone[] = {"time.average=0", "haptics.sends=force", "haptics.extrapolator=hold",
                                             NULL};
    sim *s = path_open(m, p, 1e6 / TICK_US, last_alone);
    if (!s) return APP_FAILED;
    follower f = {out, placed(p, s), encoders, hands};
    start(s, &f);
    const tm_status status =
        record_ticks(s, (int)(path_length_s(&f.p) * 1e6 / TICK_US), hands, &(leader){poses_at, NULL, &f}, out);
    sim_destroy(s);
    if (!status) return 0;
    fprintf(stderr, "tm-evaluate: the %s model became unstable at 500 Hz\n", model_name[m]);
    return APP_FAILED;
}

void truth_by_interpolation(recording *r) {
    r->interpolated = true, r->peak_N = 0;
    int n = 0;
    const int64_t gap_us = llround(fmax((double)r->params.stale_us, 3e6 * r->frame_s));
    for (int k = 0; k < r->ticks; k++) {
        int64_t t = (int64_t)k * TICK_US;
        while (n + 1 < r->samples && r->sample[n + 1].sample.t_us <= t) n++;
        const hrt_sample *a = &r->sample[n].sample, *b = &r->sample[n + 1 < r->samples ? n + 1 : n].sample;
        if (t < a->t_us || t > b->t_us || b->t_us - a->t_us > gap_us) {
            for (int i = 0; i < 3; i++) r->truth_N[3 * k + i] = NAN;
            continue;
        }
        double share = b->t_us > a->t_us ? fmin(fmax((double)(t - a->t_us) / (double)(b->t_us - a->t_us), 0), 1) : 0,
               size = 0;
        for (int i = 0; i < 3; i++) {
            double f = (1 - share) * (double)a->force_N[i] + share * (double)b->force_N[i];
            r->truth_N[3 * k + i] = (float)f;
            size += f * f;
        }
        r->peak_N = fmax(r->peak_N, sqrt(size));
    }
}
