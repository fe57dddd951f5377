/* Operating scenes: errors of every law on tissue that is pressed, held, lifted and cut, by phase, at every rate of
 * force samples, with the rate's cost.
 *
 * Scenes run as they are, and with cuts whose force ramps down; cauteries cut by themselves at every rate. Truth is the
 * same scene at the tick rate. */
#include <stdio.h>

#include "evaluate.h"
#include "json_file.h"

static const struct {
    const char *file, *name;
    double quick_s;  /* duration of the short form; 0: not in it */
    const char *set; /* null: unchanged scene */
} scenes[] = {{"liver-press", "liver-press", 5.8, NULL},
              {"liver-lift", "liver-lift", 0, NULL},
              {"liver-cut", "liver-cut", 0, NULL},
              {"liver-dissect", "liver-dissect", 9.5, NULL},
              {"liver-lift", "liver-lift, fade", 0, "cut.fade=50ms"},
              {"liver-cut", "liver-cut, fade", 0, "cut.fade=50ms"},
              {"liver-dissect", "liver-dissect, fade", 4.6, "cut.fade=50ms"}};
enum { SCENES = sizeof scenes / sizeof *scenes, LATEST = 2 };

static const double rates_Hz[] = {25, 50, 100, 250, 500}, quick_rates_Hz[] = {25, 500};
/* Above this rate a simulation sends no patch (libtensormass/scene/queries.c), and laws that need one run without. */
static const double patch_rate_max_Hz = 50;

static void add_phases(cJSON *row, const errors *e) {
    cJSON *phases = cJSON_AddObjectToObject(row, "phases");
    for (int p = 0; p < PHASE_COUNT; p++) {
        if (!(e->phase_ticks[p] > 0)) continue;
        cJSON *one = cJSON_AddObjectToObject(phases, phase_name[p]);
        app_json_add(one, "ticks %d rms %g", e->phase_ticks[p], e->phase_rms[p]);
    }
}

static void add_rows(cJSON *rows, const char *name, const recording *r, double rate_Hz) {
    static const char *const modes[] = {"probe", "grasper", "cautery"};
    for (int late = 0; late <= LATEST; late++)
        for (int x = 0; x < REPLAY_LAWS; x++) {
            const conditions c = {.latency_frames = late, .seed = 1};
            const errors e = replay(r, (hrt_extrapolator)x, &c, NULL);
            cJSON *row = errors_add(rows, &e);
            app_json_add(
                row,
                "extrapolator %s scene %s instrument %d mode %s rate_Hz %g latency_samples %d processor_share %g peak_N %g",
                replay_law_name(x), name, r->instrument, modes[r->mode], rate_Hz, late, r->processor_share, r->peak_N);
            add_phases(row, &e);
        }
}

static void free_all(recording r[TM_MAX_INSTRUMENTS]) {
    for (int h = 0; h < TM_MAX_INSTRUMENTS; h++) recording_free(&r[h]);
}

static int one_rate(const char *name, const scene_record *of, double rate_Hz, const recording *truth, cJSON *rows) {
    scene_record with = *of;
    recording r[TM_MAX_INSTRUMENTS] = {0};
    with.force_alone = rate_Hz > patch_rate_max_Hz;
    int hands = 0;
    const int rc = record_scene(&with, rate_Hz, r, &hands);
    for (int h = 0; h < hands; h++) {
        copy_truth(&truth[h], &r[h]);
        add_rows(rows, name, &r[h], rate_Hz);
    }
    free_all(r);
    return rc;
}

static int one_scene(int which, bool quick, cJSON *rows) {
    const char *const set[] = {"threads=1", scenes[which].set, NULL}, *const name = scenes[which].name;
    const double done = (double)which / SCENES;
    const double *rate_Hz = quick ? quick_rates_Hz : rates_Hz;
    const size_t rates = (quick ? sizeof quick_rates_Hz : sizeof rates_Hz) / sizeof *rate_Hz;
    recording truth[TM_MAX_INSTRUMENTS] = {0};
    char scene[256], file[2048];
    snprintf(scene, sizeof scene, "apps/scenes/%s.yaml", scenes[which].file);
    app_shared_file(scene, file, sizeof file);
    const scene_record of = {.scene = file, .set = set, .duration_s = quick ? scenes[which].quick_s : 0};
    progress(name, done);
    int rc = record_scene_truth(&of, truth);
    for (size_t k = 0; k < rates && !rc; k++) {
        rc = one_rate(name, &of, rate_Hz[k], truth, rows);
        progress(name, done + (double)(k + 1) / (double)(rates + 1) / SCENES);
    }
    free_all(truth);
    return rc;
}

int study_operating(const study_run *run, cJSON *rows) {
    int rc = 0;
    for (int i = 0; i < SCENES && !rc; i++)
        if (scenes[i].quick_s > 0 || !run->quick) rc = one_scene(i, run->quick, rows);
    return rc;
}
