/* Sessions as plain LCM logs, recorded by tm-sim or written by --generate. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"
#include "bandwidth.h"
#include "evaluate.h"
#include "io/from_message.h"
#include "link.h"
#include "mode.h"

enum { START_US = 1000000, MANY = 1024 };

/* --- write --- */

static bool put_force(app_link *log, app_message_kind kind, int64_t at_us, const hrt_sample *s,
                      const double trocar[3]) {
    tensormass_force_sample_t m = {.utime = START_US + at_us,
                                   .seq = (int32_t)s->seq,
                                   .session = 1,
                                   .tool_session = 1,
                                   .tool_utime = START_US + s->t_us,
                                   .stiffness_kind = (int8_t)s->stiffness_kind,
                                   .topology_revision = s->topology_revision};
    for (int i = 0; i < 3; i++) m.tip_m[i] = trocar[i] + (double)s->tip_m[i], m.force_N[i] = (double)s->force_N[i];
    for (int i = 0; i < 9; i++) m.stiffness_N_m[i] = (double)s->stiffness_N_m[i];
    return app_link_publish(log, kind, 0, m.utime, &m);
}

static bool put_patch(app_link *log, const sampled *x, const double trocar[3]) {
    static tensormass_contact_patch_t m;
    const hrt_patch *p = x->patch;
    memset(&m, 0, sizeof m);
    m.utime = START_US + x->ready_us, m.seq = (int32_t)x->sample.seq, m.session = 1,
    m.kind = (int8_t)x->sample.stiffness_kind;
    m.topology_revision = p->topology_revision, m.vertex_count = p->vertex_count, m.triangle_count = p->triangle_count;
    memcpy(m.vertex_m, p->vertex_m, sizeof m.vertex_m);
    memcpy(m.rest_m, p->rest_m, sizeof m.rest_m);
    memcpy(m.face, p->face, sizeof m.face);
    m.force_cap_N = p->force_cap_N;
    memcpy(m.triangle, p->triangle, sizeof m.triangle);
    memcpy(m.compliance_m_N, p->compliance_m_N, sizeof m.compliance_m_N);
    memcpy(m.origin_m, trocar, sizeof m.origin_m);
    memcpy(m.trocar_m, trocar, sizeof m.trocar_m);
    m.contact_compliance_m_N = p->contact_compliance_m_N, m.radius_m = p->radius_m,
    m.contact_length_m = p->contact_length_m;
    m.radiation_N_s_m = p->radiation_N_s_m, m.radiation_s = p->radiation_s;
    m.friction_static = p->friction_static, m.friction_kinetic = p->friction_kinetic;
    m.drag_s_m = p->drag_s_m, m.grasped = (int32_t)p->grasped;
    for (int i = 0; i < 3 && hrt_patch_grasps(p); i++) m.grasp_N[i] = p->rest_m[hrt_patch_tip(p) + i];
    return app_link_publish(log, APP_PATCH, 0, m.utime, &m);
}

static bool put_tick(app_link *log, const recording *r, int k, const double trocar_m[3]) {
    const int64_t at = (int64_t)k * TICK_US;
    tensormass_tool_state_t tool = {.utime = START_US + at,
                                    .seq = k,
                                    .session = 1,
                                    .state = HRT_ENGAGED,
                                    .active = 1,
                                    .device = (int8_t)hrt_device_type_number(r->params.device),
                                    .joints = (int8_t)r->params.device->joints};
    if (r->samples && !r->sample[0].sample.unilateral) tool.mode = HRT_MODE_GRASPER;
    hrt_sample truth = {.t_us = at, .seq = (uint32_t)k};
    for (int i = 0; i < 3; i++) {
        tool.tip_m[i] = trocar_m[i] + (double)r->tip_m[3 * k + i];
        truth.tip_m[i] = r->tip_m[3 * k + i], truth.force_N[i] = r->truth_N[3 * k + i];
    }
    return app_link_publish(log, APP_TOOL, 0, tool.utime, &tool) && put_force(log, APP_TRUTH, at, &truth, trocar_m);
}

int log_write(const char *file, const recording *r, const double trocar_m[3]) {
    app_output output;
    tm_error error = {0};
    if (!app_output_begin(&output, file, &error)) return app_report(NULL, 0, &error);
    app_link *log = app_link_write_log(output.temporary, &(app_link_def){0});
    bool good = log != NULL;
    int next = 0;
    for (int k = 0; k < r->ticks && good; k++) {
        for (; next < r->samples && r->sample[next].ready_us <= (int64_t)k * TICK_US && good; next++) {
            const sampled *x = &r->sample[next];
            good = (!x->patch || put_patch(log, x, trocar_m)) &&
                   put_force(log, APP_FORCE, x->ready_us, &x->sample, trocar_m);
        }
        good = good && put_tick(log, r, k, trocar_m);
    }
    good = app_link_close(log) && good;
    if (good && app_output_commit(&output, &error)) return 0;
    app_output_abandon(&output);
    fprintf(stderr, "%s: the log could not be written completely; check the disk\n", file);
    return APP_FAILED;
}

/* --- read --- */

/* Relates the controller's clock, of sample times t_n, to the log's, of arrivals. TOOL has both: the minimum difference
 * has the minimum delay. It is taken over the last one to two seconds, so that clocks may drift and be set. */
typedef struct clocks {
    int64_t least_us[2]; /* of the current block, and of the previous one */
    int count;
} clocks;

enum { CLOCK_BLOCK = 500 };

static void clocks_add(clocks *c, int64_t difference_us) {
    if (c->count % CLOCK_BLOCK == 0) {
        c->least_us[1] = c->count ? c->least_us[0] : difference_us;
        c->least_us[0] = difference_us;
    }
    if (difference_us < c->least_us[0]) c->least_us[0] = difference_us;
    c->count++;
}

static int64_t clocks_difference(const clocks *c) {
    return c->least_us[0] < c->least_us[1] ? c->least_us[0] : c->least_us[1];
}

typedef struct reading {
    recording *r;
    int64_t session; /* session of the controller with the most ticks */
    clocks clocks;
    int ticks_capacity, samples_capacity, truths_capacity, truths;
    int64_t first_us;
    bool grasper, started;
    bool origin_known;
    double origin[3]; /* position of the trocar */
    hrt_patch *pending;
    float *truth;
} reading;

static void *reserve(void *array, int *have, int want, size_t size) {
    if (want <= *have) return array;
    *have = want * 2;
    void *more = realloc(array, (size_t)*have * size);
    if (!more) abort();
    return more;
}

static app_verdict read_tool(void *user, int instrument, int64_t logged_us, const void *message) {
    (void)instrument;
    reading *g = user;
    const tensormass_tool_state_t *m = message;
    recording *r = g->r;
    if (m->session != g->session) return APP_LEFT;
    g->grasper = m->mode == HRT_MODE_GRASPER;
    clocks_add(&g->clocks, logged_us - m->utime);
    if (!g->started) {
        g->started = true, g->first_us = r->first_us = m->utime;
        if (!g->origin_known)
            memcpy(g->origin, m->tip_m, sizeof g->origin); /* without patches any nearby point is sufficient */
    }
    /* Ticks are approximately on a grid of TICK_US; a gap is filled with the last position. */
    int64_t tick = (m->utime - g->first_us + TICK_US / 2) / TICK_US;
    if (tick < 0 || tick > 100000000) return APP_LEFT;
    r->tip_m = reserve(r->tip_m, &g->ticks_capacity, (int)tick + 1, 3 * sizeof *r->tip_m);
    for (int64_t k = r->ticks; k < tick; k++)
        memcpy(r->tip_m + 3 * k, r->tip_m + 3 * (r->ticks - 1), 3 * sizeof *r->tip_m);
    for (int i = 0; i < 3; i++) r->tip_m[3 * tick + i] = (float)(m->tip_m[i] - g->origin[i]);
    if (tick + 1 > r->ticks) r->ticks = (int)tick + 1;
    return APP_TAKEN;
}

static app_verdict read_force(void *user, int instrument, int64_t logged_us, const void *message) {
    (void)instrument;
    reading *g = user;
    const tensormass_force_sample_t *m = message;
    recording *r = g->r;
    if (!g->started || !m->tool_utime || m->tool_session != g->session) return APP_LEFT; /* no controller yet */
    r->sample = reserve(r->sample, &g->samples_capacity, r->samples + 1, sizeof *r->sample);
    sampled *x = &r->sample[r->samples];
    *x = (sampled){.ready_us = logged_us - clocks_difference(&g->clocks) - g->first_us};
    hrt_sample *s = &x->sample;
    if (hrt_sample_from_message(m, g->origin, !g->grasper, &r->params, s) != HRT_ACCEPT) return APP_LEFT;
    s->session = s->tool_session = 1, s->t_us = m->tool_utime - g->first_us;
    if (s->t_us < 0) s->t_us = 0;
    if (r->samples && s->t_us <= r->sample[r->samples - 1].sample.t_us)
        return APP_LEFT; /* the controller accepts no older sample */
    if (g->pending && g->pending->seq == s->seq) s->patch = x->patch = g->pending, g->pending = NULL;
    r->samples++;
    return APP_TAKEN;
}

static app_verdict read_truth(void *user, int instrument, int64_t logged_us, const void *message) {
    (void)instrument, (void)logged_us;
    reading *g = user;
    const tensormass_force_sample_t *m = message;
    if (!g->started) return APP_LEFT;
    int64_t tick = (m->utime - g->first_us) / TICK_US;
    if (tick != g->truths) return APP_LEFT;
    g->truth = reserve(g->truth, &g->truths_capacity, g->truths + 1, 3 * sizeof *g->truth);
    for (int i = 0; i < 3; i++) g->truth[3 * tick + i] = (float)m->force_N[i];
    g->truths++;
    return APP_TAKEN;
}

static app_verdict read_patch(void *user, int instrument, int64_t logged_us, const void *message) {
    (void)instrument, (void)logged_us;
    static float scratch[HRT_PATCH_COMPLIANCE];
    reading *g = user;
    free(g->pending);
    g->pending = malloc(sizeof *g->pending);
    if (!g->pending) abort();
    if (hrt_patch_from_message(message, g->origin, scratch, g->pending) == HRT_ACCEPT) return APP_TAKEN;
    free(g->pending);
    g->pending = NULL;
    return APP_LEFT;
}

/* Copies the truth of the log, or computes the paper's. */
static void finish(reading *g) {
    recording *r = g->r;
    r->truth_N = app_zeroed(3 * (size_t)r->ticks, sizeof *r->truth_N);
    r->frame_s = r->samples > 1 ? 1e-6 * (double)(r->sample[r->samples - 1].sample.t_us - r->sample[0].sample.t_us) /
                                      (r->samples - 1)
                                : 0;
    if (g->truths < r->ticks) {
        truth_by_interpolation(r);
        return;
    }
    memcpy(r->truth_N, g->truth, 3 * (size_t)r->ticks * sizeof *r->truth_N);
    for (int k = 0; k < r->ticks; k++) {
        const float *f = r->truth_N + 3 * k;
        r->peak_N = fmax(r->peak_N, sqrt((double)f[0] * f[0] + (double)f[1] * f[1] + (double)f[2] * f[2]));
    }
}

/* --- survey before reading --- */

enum { INSTRUMENTS = LOG_INSTRUMENTS, SESSIONS = 64 };

typedef struct survey {
    bool origin_known[INSTRUMENTS];
    double origin[INSTRUMENTS][3];
    struct {
        int64_t id;
        int ticks, device;
    } session[INSTRUMENTS][SESSIONS];
    int sessions[INSTRUMENTS]; /* further sessions are ignored */
} survey;

static app_verdict survey_tool(void *user, int i, int64_t logged_us, const void *message) {
    (void)logged_us;
    survey *v = user;
    const tensormass_tool_state_t *m = message;
    int k = 0;
    while (k < v->sessions[i] && v->session[i][k].id != m->session) k++;
    if (k == SESSIONS) return APP_LEFT;
    if (k == v->sessions[i]) v->session[i][v->sessions[i]++].id = m->session;
    v->session[i][k].ticks++;
    v->session[i][k].device = m->device;
    return APP_TAKEN;
}

/* Takes the trocar from the first patch, or from the simulation's status. */
static void survey_origin(survey *v, int i, const double trocar_m[3]) {
    if (v->origin_known[i]) return;
    memcpy(v->origin[i], trocar_m, sizeof v->origin[i]);
    v->origin_known[i] = true;
}

static app_verdict survey_status(void *user, int instrument, int64_t logged_us, const void *message) {
    (void)instrument, (void)logged_us;
    const tensormass_sim_status_t *m = message;
    for (int i = 0; i < m->instrument_count && i < INSTRUMENTS; i++) survey_origin(user, i, m->trocar_m[i]);
    return APP_TAKEN;
}

static app_verdict survey_patch(void *user, int i, int64_t logged_us, const void *message) {
    (void)logged_us;
    survey_origin(user, i, ((const tensormass_contact_patch_t *)message)->trocar_m);
    return APP_TAKEN;
}

/* Passes the complete log to these listeners. */
static bool read_through(const char *file, const app_topic *topic, int topics) {
    app_link *log = app_link_read_log(file, &(app_link_def){.topic = topic, .topics = topics});
    if (!log) return false;
    while (app_link_receive(log, 0, MANY) > 0) {
    }
    return app_link_close(log);
}

static bool survey_log(const char *file, survey *v) {
    const app_topic topic[] = {{APP_TOOL, 0, survey_tool, v},
                               {APP_TOOL, 1, survey_tool, v},
                               {APP_PATCH, 0, survey_patch, v},
                               {APP_PATCH, 1, survey_patch, v},
                               {APP_SIM_STATUS, 0, survey_status, v}};
    return read_through(file, topic, sizeof topic / sizeof *topic);
}

int log_read(const char *file, int instrument, recording *out) {
    survey v = {0};
    int longest = 0;
    reading g = {.r = out};
    memset(out, 0, sizeof *out);
    snprintf(out->name, sizeof out->name, "%s", file);
    if (!survey_log(file, &v))
        return app_bad_input(file, 0, "cannot be read; name an LCM log, as tm-sim --record or lcm-logger writes it");
    for (int k = 1; k < v.sessions[instrument]; k++)
        if (v.session[instrument][k].ticks > v.session[instrument][longest].ticks) longest = k;
    out->sessions = v.sessions[instrument];
    g.session = v.session[instrument][longest].id;
    const int device = v.session[instrument][longest].device;
    if (device < 0 || device >= hrt_device_type_count)
        return app_bad_input(file, 0,
                             "TOOL_%d is of device %d, which this build does not know; use the build that wrote it",
                             instrument, device);
    hrt_params_of_device(&out->params, hrt_device_types[device]);
    g.origin_known = v.origin_known[instrument];
    memcpy(g.origin, v.origin[instrument], sizeof g.origin);
    const app_topic topic[] = {{APP_TOOL, instrument, read_tool, &g},
                               {APP_PATCH, instrument, read_patch, &g},
                               {APP_FORCE, instrument, read_force, &g},
                               {APP_TRUTH, instrument, read_truth, &g}};
    if (!read_through(file, topic, sizeof topic / sizeof *topic))
        return app_bad_input(file, 0, "disappeared while it was read; keep it until the program ends");
    free(g.pending);
    if (out->ticks && out->samples) finish(&g);
    free(g.truth);
    return 0;
}
