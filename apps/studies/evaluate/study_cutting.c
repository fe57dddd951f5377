/* Ten minutes of two cauteries that press, slide, cut and lift off at random, felt with `contact` by either hand: how
 * far above everything that the tissue really does a hand is ever pushed. Cuts are the truth's, as in study_hands.c. */
#include <math.h>

#include "evaluate.h"
#include "json_file.h"

static const double SPEED_M_S = 0.01, TREMOR_M = 40e-6, RATE_HZ = 20, SOAK_S = 600;
/* of a quick run: one session, a few strokes of either hand */
enum { QUICK_POINTS = 9 };

static void add(cJSON *rows, const recording *r, uint64_t seed, int late, hrt_extrapolator which) {
    const conditions c = {.latency_frames = late, .seed = seed};
    const errors e = replay(r, which, &c, NULL);
    cJSON *row = errors_add(rows, &e);
    app_json_add(row, "seed %g instrument %d latency_frames %d extrapolator %s seconds %g cut %d peak_N %g",
                 (double)seed, r->instrument, late, hrt_extrapolator_name(which), 1e-6 * TICK_US * r->ticks,
                 r->replay ? r->replay->count : 0, r->peak_N);
}

/* The hands of one session, from one run of the tissue. */
static int felt(const path *p, uint64_t seed, cJSON *rows) {
    recording truth[PATH_HANDS] = {{.instrument = 0}, {.instrument = 1}},
              r[PATH_HANDS] = {{.instrument = 0}, {.instrument = 1}};
    int rc = record_hands_truth(MODEL_ISOTROPIC, p, true, PATH_HANDS, truth);
    for (int h = 0; h < PATH_HANDS; h++) r[h].replay = truth->cuts.count ? &truth->cuts : NULL;
    if (!rc) rc = record_hands(MODEL_ISOTROPIC, p, RATE_HZ, true, true, PATH_HANDS, r);
    for (int h = 0; h < PATH_HANDS && !rc; h++) {
        copy_truth(&truth[h], &r[h]);
        for (int late = 0; late <= 2 && truth[h].peak_N > 0; late++) {
            add(rows, &r[h], seed, late, HRT_POSITION);
            add(rows, &r[h], seed, late, HRT_CONTACT);
        }
    }
    for (int h = 0; h < PATH_HANDS; h++) recording_free(&r[h]), recording_free(&truth[h]);
    return rc;
}

int study_cutting(const study_run *run, cJSON *rows) {
    double done_s = run->model[MODEL_ISOTROPIC] ? 0 : SOAK_S;
    for (uint64_t seed = 1; done_s < SOAK_S; seed++) {
        const path p = path_make_random(seed, run->quick ? QUICK_POINTS : PATH_RANDOM_POINTS, SPEED_M_S, TREMOR_M);
        progress("two cauteries at random", done_s / SOAK_S);
        const int rc = felt(&p, seed, rows);
        if (rc) return rc;
        done_s += run->quick ? SOAK_S : path_length_s(&p);
    }
    return 0;
}
