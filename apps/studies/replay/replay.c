/* Replays a recording through an extrapolator, tick by tick, and measures its errors. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bandwidth.h"
#include "json_file.h"
#include "studies/replay/frozen.h"
#include "studies/replay/replay.h"

/* Ticks affected by a sample's arrival: `local_model` begins to blend to other tissue in the second. */
enum { SETTLING = 3 };

typedef struct arrival {
    int64_t at_us;
    const sampled *sample;
} arrival;

/* Computes which samples arrive and when: lost ones are left out, and no sample overtakes an earlier one. */
static int arrivals(const recording *r, const conditions *c, arrival *out) {
    uint64_t seed = c->seed * 7919 + 1;
    int count = 0;
    int64_t frame_us = llround(r->frame_s * 1e6), last = 0;
    for (int i = 0; i < r->samples; i++) {
        double late = (double)c->latency_frames + c->jitter * app_uniform(&seed);
        bool lost = app_uniform(&seed) < c->loss;
        if (lost) continue;
        int64_t at = r->sample[i].ready_us + llround(late * (double)frame_us);
        if (at < last) at = last;
        out[count++] = (arrival){last = at, &r->sample[i]};
    }
    return count;
}

const char *const phase_name[PHASE_COUNT] = {"free", "touch", "press", "slide", "grasp", "lift", "cut", "let go"};

typedef struct sums {
    double error2, angle2, cut_error2, phase_error2[PHASE_COUNT];
    double *of_tick; /* squared error of each judged tick */
    int cut, angled, in_contact, off_patch;
    errors e;
} sums;

static double length3(const float v[3]) {
    return sqrt((double)v[0] * v[0] + (double)v[1] * v[1] + (double)v[2] * v[2]);
}

/* Adds the error of a tick. `since_us`: time of the tissue state that the force is computed from. */
static void judge(sums *s, const recording *r, int tick, int64_t since_us, const float force[3], uint32_t limits) {
    const float *truth = r->truth_N + 3 * tick;
    float d[3] = {force[0] - truth[0], force[1] - truth[1], force[2] - truth[2]};
    double error = length3(d), size = length3(force), size_true = length3(truth);
    s->of_tick[s->e.judged] = (float)(error * error);
    s->error2 += error * error, s->e.judged++;
    if (r->phase) s->phase_error2[r->phase[tick]] += error * error, s->e.phase_ticks[r->phase[tick]]++;
    if (cut_list_between(r->replay, 1e-6 * (double)since_us, 1e-6 * tick * TICK_US))
        s->cut_error2 += error * error, s->cut++;
    if (tick > 0 && !isnan(truth[-3])) {
        float moved[3] = {truth[0] - truth[-3], truth[1] - truth[-2], truth[2] - truth[-1]};
        s->e.jump_true = fmax(s->e.jump_true, length3(moved) / r->peak_N);
    }
    s->e.peak = fmax(s->e.peak, error / r->peak_N);
    s->e.largest = fmax(s->e.largest, size / r->peak_N);
    s->e.over_limit = fmax(s->e.over_limit, size / (double)r->params.force_max_N);
    if (size_true > 0) s->in_contact++, s->off_patch += (limits & HRT_LIMIT_PATCH) != 0;
    if (size_true > 0.1 * r->peak_N && size > 0) {
        double cosine = ((double)force[0] * truth[0] + (double)force[1] * truth[1] + (double)force[2] * truth[2]) /
                        (size * size_true);
        double angle = acos(fmin(fmax(cosine, -1), 1));
        s->angle2 += angle * angle, s->angled++;
    }
}

/* Computes forces from samples. */
typedef struct player {
    bool is_frozen;
    hrt_extrapolation law;
    frozen frozen;
} player;

static void player_take(player *p, const recording *r, const hrt_sample *sample) {
    if (p->is_frozen)
        frozen_sample(&p->frozen, &r->params, sample);
    else
        hrt_extrapolation_sample(&p->law, &r->params, sample);
}

static void player_force(player *p, const recording *r, int64_t now_us, const float tip_m[3], float force_N[3]) {
    if (p->is_frozen)
        frozen_force(&p->frozen, tip_m, force_N);
    else
        hrt_extrapolation_force(&p->law, &r->params, now_us, tip_m, force_N);
}

static void player_reset(player *p, hrt_extrapolator which) {
    memset(p, 0, sizeof *p);
    p->is_frozen = (int)which == REPLAY_FROZEN;
    hrt_extrapolation_reset(&p->law, p->is_frozen ? HRT_HOLD : which);
}

const char *replay_law_name(int law) {
    return law == REPLAY_FROZEN ? "frozen" : hrt_extrapolator_name((hrt_extrapolator)law);
}

errors replay(const recording *r, hrt_extrapolator which, const conditions *c, float *force_N) {
    static player playing;
    sums s = {0};
    arrival *line = app_zeroed((size_t)r->samples, sizeof *line);
    double *jump = app_zeroed((size_t)r->ticks, sizeof *jump);
    float last[3] = {0};
    s.of_tick = app_zeroed((size_t)r->ticks, sizeof *s.of_tick);
    int count = arrivals(r, c, line), next = 0, jumps = 0;
    bool begun = false;
    int since = SETTLING; /* ticks after the last arrival */
    double spent = 0;
    player_reset(&playing, which);
    for (int tick = 0; tick < r->ticks; tick++) {
        int64_t now = (int64_t)tick * TICK_US;
        float force[3];
        double start = app_seconds();
        const int before = next;
        for (; next < count && line[next].at_us <= now; next++) {
            player_take(&playing, r, &line[next].sample->sample);
            begun = true;
        }
        player_force(&playing, r, now, r->tip_m + 3 * (size_t)tick, force);
        spent += app_seconds() - start;
        if (force_N) memcpy(force_N + 3 * tick, force, sizeof force);
        if (!begun || isnan(r->truth_N[3 * tick])) continue;
        judge(&s, r, tick, line[next - 1].sample->sample.t_us, force, playing.law.limits);
        float step[3] = {force[0] - last[0], force[1] - last[1], force[2] - last[2]};
        jump[jumps++] = (float)length3(step);
        since = next > before ? 0 : since + 1;
        if (since < SETTLING) s.e.jump_arrival = fmax(s.e.jump_arrival, length3(step) / r->peak_N);
        memcpy(last, force, sizeof last);
    }
    for (int p = 0; p < PHASE_COUNT; p++)
        s.e.phase_rms[p] = s.e.phase_ticks[p] ? sqrt(s.phase_error2[p] / s.e.phase_ticks[p]) / r->peak_N : 0;
    s.e.rms = s.e.judged ? sqrt(s.error2 / s.e.judged) / r->peak_N : 0;
    s.e.direction_rad = s.angled ? sqrt(s.angle2 / s.angled) : 0;
    s.e.off_patch = s.in_contact ? (double)s.off_patch / s.in_contact : 0;
    s.e.cut_since_error2 = s.error2 > 0 ? s.cut_error2 / s.error2 : 0;
    s.e.cut_since_ticks = s.e.judged ? (double)s.cut / s.e.judged : 0;
    s.e.ns_per_tick = 1e9 * spent / r->ticks;
    s.e.jump_p99 = app_percentile(jump, jumps, 0.99) / r->peak_N; /* app_percentile sorts */
    s.e.jump_peak = jumps ? jump[jumps - 1] / r->peak_N : 0;
    app_percentile(s.of_tick, s.e.judged, 1);
    for (int i = s.e.judged - s.e.judged / 50; i < s.e.judged && s.error2 > 0; i++)
        s.e.worst_error2 += s.of_tick[i] / s.error2;
    free(line);
    free(jump);
    free(s.of_tick);
    return s.e;
}

cJSON *errors_add(cJSON *rows, const errors *e) {
    return app_json_add(
        rows,
        "judged %d rms %g peak %g jump_peak %g jump_p99 %g jump_arrival %g jump_true %g cut_since_error2 %g cut_since_ticks %g worst_error2 %g direction_rad %g largest %g over_limit %g off_patch %g ns_per_tick %g",
        e->judged, e->rms, e->peak, e->jump_peak, e->jump_p99, e->jump_arrival, e->jump_true, e->cut_since_error2,
        e->cut_since_ticks, e->worst_error2, e->direction_rad, e->largest, e->over_limit, e->off_patch, e->ns_per_tick);
}
