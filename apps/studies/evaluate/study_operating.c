/* Operating scenes: what every law errs where tissue is pressed, held, lifted and cut, phase by phase, at every rate of
 * force samples, with what that rate costs.
 *
 * Scenes run as they are: cauteries cut for themselves at every rate. Truth is the same scene at the tick rate. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "evaluate.h"

static const struct {
    const char *name;
    bool quick; /* in the short form too */
} scenes[] = {{"liver-press", true}, {"liver-lift", false}, {"liver-cut", false}, {"liver-dissect", true}};
enum { SCENES = sizeof scenes / sizeof *scenes, HANDS = 2, LATEST = 2 };

static const double rates_Hz[] = {25, 50, 100, 250, 500}, quick_rates_Hz[] = {25, 100, 500};
/* Above this rate a simulation sends no patch (apps/sim/stream.c), and laws that want one go without. */
static const double patch_rate_max_Hz = 50;

static double processor_s(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static sim *open_scene(const char *name, double rate_Hz, bool patches, bool truth) {
    char scene_name[256], file[2048], rate[64], *set[8] = {rate, (char *)"threads=1"};
    int count = 2;
    app_scene *scene = NULL;
    sim *s = NULL;
    snprintf(scene_name, sizeof scene_name, "apps/scenes/%s.yaml", name);
    app_shared_file(scene_name, file, sizeof file);
    snprintf(rate, sizeof rate, "time.frame_rate=%.9g", rate_Hz);
    set[count++] = (char *)(patches ? "haptics.sends=patch" : "haptics.sends=force");
    if (truth) set[count++] = (char *)"time.average=0";
    return sim_scene_load(file, set, count, &scene) || sim_create(scene, &s) ? NULL : s;
}

/* --- phases --- */

/* Seconds after an event that still belong to it. */
static const double touch_s = 0.1, grasp_s = 0.2, let_go_s = 0.3, cut_s = 0.1, slide_m_s = 3e-3;

typedef struct phase_watch {
    bool closed, touching;
    double touched_s, closed_s, opened_s, cut_s;
    float tip_m[3];
} phase_watch;

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

/* --- recordings --- */

static void poses_at(const sim *s, const hrt_params *params, double time_s, tm_tool_pose to[TM_MAX_INSTRUMENTS]) {
    float seen[3];
    for (int i = 0; i < s->instrument_count; i++) {
        to[i] = sim_hand_pose(s, i, time_s);
        device_see(s, i, params, to[i].tip_m, true, seen);
        for (int c = 0; c < 3; c++) to[i].tip_m[c] = s->instrument_def[i].trocar_m[c] + (double)seen[c];
    }
}

static void *take(size_t count, size_t size) {
    void *memory = calloc(count, size);
    if (!memory) abort();
    return memory;
}

/* One recording an instrument; returns how many, 0 having complained. */
static int record_truths(const char *name, recording out[HANDS]) {
    sim *s = open_scene(name, 1e6 / TICK_US, false, true);
    if (!s) return 0;
    const int hands = s->instrument_count;
    phase_watch watch[HANDS] = {0};
    tm_status status = TM_OK;
    for (int h = 0; h < hands; h++) {
        recording *r = &out[h];
        hrt_params_default(&r->params);
        r->instrument = h;
        r->ticks = (int)(s->scene->duration.si * 1e6 / TICK_US);
        r->tip_m = take(3 * (size_t)r->ticks, sizeof *r->tip_m);
        r->truth_N = take(3 * (size_t)r->ticks, sizeof *r->truth_N);
        r->phase = take((size_t)r->ticks, sizeof *r->phase);
        r->mode = s->instrument_def[h].mode;
        watch[h] = (phase_watch){.touched_s = -1, .closed_s = -1, .opened_s = -1, .cut_s = -1};
    }
    for (int k = 0; k < out->ticks && !status; k++) {
        tm_tool_pose to[TM_MAX_INSTRUMENTS];
        poses_at(s, &out->params, k * 1e-6 * TICK_US, to);
        status = sim_frame(s, to, s->substeps);
        for (int h = 0; h < hands; h++) {
            truth_take(&out[h], s, k, to);
            out[h].phase[k] = (uint8_t)phase_at(&watch[h], s, h, k * 1e-6 * TICK_US, out[h].tip_m + 3 * k);
        }
    }
    sim_destroy(s);
    if (status) fprintf(stderr, "tm-evaluate: %s became unstable at 500 Hz\n", name);
    return status ? 0 : hands;
}

/* Samples of every hand at a rate; returns the processor's seconds for a simulated second, below 0 having complained.
 */
static double record_samples(const char *name, double rate_Hz, recording out[HANDS]) {
    static sim_publisher publisher[HANDS];
    const bool patches = rate_Hz <= patch_rate_max_Hz;
    sim *s = open_scene(name, rate_Hz, patches, false);
    if (!s) return -1;
    const int hands = s->instrument_count, samples = (int)(s->scene->duration.si / s->frame_s);
    for (int h = 0; h < hands; h++) {
        publisher[h] = (sim_publisher){.session = 1};
        s->wants[h] = patches ? s->can_send : SIM_SENDS_FORCE;
        out[h].instrument = h;
        hrt_params_default(&out[h].params);
        out[h].frame_s = s->frame_s;
        out[h].samples = samples;
        out[h].sample = take((size_t)samples, sizeof *out[h].sample);
    }
    const double begin_s = processor_s();
    tm_status status = TM_OK;
    for (int k = 0; k < samples && !status; k++) {
        const double end_s = (k + 1) * s->frame_s;
        tm_tool_pose to[TM_MAX_INSTRUMENTS];
        poses_at(s, &out->params, end_s, to);
        status = sim_frame(s, to, s->substeps);
        const int64_t end_us = llround(end_s * 1e6), back_us = llround(0.5e6 * (s->average - 1) * s->dt_s);
        for (int h = 0; h < hands; h++)
            sampled_take(&publisher[h], s, h, &out[h].params, end_us - back_us, end_us, &out[h].sample[k]);
    }
    const double spent_s = processor_s() - begin_s, length_s = samples * s->frame_s;
    sim_destroy(s);
    if (status) fprintf(stderr, "tm-evaluate: %s became unstable at %g Hz\n", name, rate_Hz);
    return status ? -1 : spent_s / length_s;
}

/* --- rows --- */

static void add_phases(cJSON *row, const errors *e) {
    cJSON *phases = cJSON_AddObjectToObject(row, "phases");
    for (int p = 0; p < PHASE_COUNT; p++) {
        if (!(e->phase_ticks[p] > 0)) continue;
        cJSON *one = cJSON_AddObjectToObject(phases, phase_name[p]);
        cJSON_AddNumberToObject(one, "ticks", e->phase_ticks[p]);
        cJSON_AddNumberToObject(one, "rms", e->phase_rms[p]);
    }
}

static void add_rows(cJSON *rows, const char *name, const recording *r, double rate_Hz, double cost) {
    static const char *const modes[] = {"probe", "grasper", "cautery"};
    for (int late = 0; late <= LATEST; late++)
        for (int x = 0; x < HRT_EXTRAPOLATOR_COUNT; x++) {
            const conditions c = {.latency_frames = late, .seed = 1};
            const errors e = replay(r, (hrt_extrapolator)x, &c, NULL);
            cJSON *row = errors_json(&e);
            cJSON_AddItemToArray(rows, row);
            cJSON_AddStringToObject(row, "extrapolator", hrt_extrapolator_name((hrt_extrapolator)x));
            cJSON_AddStringToObject(row, "scene", name);
            cJSON_AddNumberToObject(row, "instrument", r->instrument);
            cJSON_AddStringToObject(row, "mode", modes[r->mode]);
            cJSON_AddNumberToObject(row, "rate_Hz", rate_Hz);
            cJSON_AddNumberToObject(row, "latency_samples", late);
            cJSON_AddNumberToObject(row, "processor_share", cost);
            cJSON_AddNumberToObject(row, "peak_N", r->peak_N);
            add_phases(row, &e);
        }
}

static int one_rate(const char *name, double rate_Hz, const recording *truth, int hands, cJSON *rows) {
    recording r[HANDS] = {0};
    const double cost = record_samples(name, rate_Hz, r);
    for (int h = 0; h < hands && cost >= 0; h++) {
        r[h].mode = truth[h].mode;
        copy_truth(&truth[h], &r[h]);
        add_rows(rows, name, &r[h], rate_Hz, cost);
    }
    for (int h = 0; h < HANDS; h++) recording_free(&r[h]);
    return cost >= 0 ? 0 : APP_FAILED;
}

static int one_scene(const char *name, double done, bool quick, cJSON *rows) {
    const double *rate_Hz = quick ? quick_rates_Hz : rates_Hz;
    const size_t rates = (quick ? sizeof quick_rates_Hz : sizeof rates_Hz) / sizeof *rate_Hz;
    recording truth[HANDS] = {0};
    progress(name, done);
    const int hands = record_truths(name, truth);
    int rc = hands ? 0 : APP_FAILED;
    for (size_t k = 0; k < rates && !rc; k++) {
        rc = one_rate(name, rate_Hz[k], truth, hands, rows);
        progress(name, done + (double)(k + 1) / (double)(rates + 1) / SCENES);
    }
    for (int h = 0; h < HANDS; h++) recording_free(&truth[h]);
    return rc;
}

cJSON *study_operating(const study_run *run) {
    cJSON *rows = cJSON_CreateArray();
    int rc = 0;
    for (int i = 0; i < SCENES && !rc; i++)
        if (scenes[i].quick || !run->quick) rc = one_scene(scenes[i].name, (double)i / SCENES, run->quick, rows);
    if (!rc) return rows;
    cJSON_Delete(rows);
    return NULL;
}
