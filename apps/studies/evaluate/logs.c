/* Sessions as plain LCM logs: what a run of tm-sim records, or what --generate writes. */
#include <lcm/eventlog.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"
#include "evaluate.h"
#include "event_log.h"
#include "lcm_types/tensormass_contact_patch_t.h"
#include "lcm_types/tensormass_force_sample_t.h"
#include "lcm_types/tensormass_sim_status_t.h"
#include "lcm_types/tensormass_tool_state_t.h"
#include "wire.h"

enum { START_US = 1000000, ENCODED_MAX = 32768, GRASPER = 1 };

/* --- write --- */

#define PUT(log, channel, at_us, type, message)                                                                        \
    do {                                                                                                               \
        static uint8_t buffer[ENCODED_MAX];                                                                            \
        int size = type##_encode(buffer, 0, sizeof buffer, message);                                                   \
        put(log, channel, at_us, buffer, size);                                                                        \
    } while (0)

static bool failed;

static void put(lcm_eventlog_t *log, const char *channel, int64_t at_us, uint8_t *data, int size) {
    lcm_eventlog_event_t event = {.timestamp = START_US + at_us,
                                  .channellen = (int)strlen(channel),
                                  .datalen = size,
                                  .channel = (char *)(uintptr_t)channel,
                                  .data = data};
    if (size < 0 || lcm_eventlog_write_event(log, &event) != 0) failed = true;
}

static void put_force(lcm_eventlog_t *log, const char *channel, int64_t at_us, const hrt_sample *s,
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
    PUT(log, channel, at_us, tensormass_force_sample_t, &m);
}

static void put_patch(lcm_eventlog_t *log, const sampled *x, const double trocar[3]) {
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
    m.skin_compliance_m_N = p->skin_compliance_m_N, m.radius_m = p->radius_m, m.contact_length_m = p->contact_length_m;
    m.film_s_m = p->film_s_m, m.held = (int32_t)p->held;
    for (int i = 0; i < 3 && hrt_patch_holds(p); i++) m.hold_N[i] = p->rest_m[hrt_patch_tip(p) + i];
    PUT(log, "PATCH_0", x->ready_us, tensormass_contact_patch_t, &m);
}

int log_write(const char *file, const recording *r, const double trocar_m[3]) {
    app_output output;
    tm_error error = {0};
    if (!app_output_begin(&output, file, &error)) return app_report(NULL, 0, &error);
    lcm_eventlog_t *log = lcm_eventlog_create(output.temporary, "w");
    failed = !log;
    int next = 0;
    for (int k = 0; k < r->ticks && !failed; k++) {
        int64_t at = (int64_t)k * TICK_US;
        for (; next < r->samples && r->sample[next].ready_us <= at; next++) {
            if (r->sample[next].patch) put_patch(log, &r->sample[next], trocar_m);
            put_force(log, "FORCE_0", r->sample[next].ready_us, &r->sample[next].sample, trocar_m);
        }
        tensormass_tool_state_t tool = {.utime = START_US + at, .seq = k, .session = 1, .state = 3, .active = 1};
        if (r->samples && !r->sample[0].sample.unilateral) tool.mode = GRASPER;
        hrt_sample truth = {.t_us = at, .seq = (uint32_t)k};
        for (int i = 0; i < 3; i++) {
            tool.tip_m[i] = trocar_m[i] + (double)r->tip_m[3 * k + i];
            truth.tip_m[i] = r->tip_m[3 * k + i], truth.force_N[i] = r->truth_N[3 * k + i];
        }
        PUT(log, "TOOL_0", at, tensormass_tool_state_t, &tool);
        put_force(log, "TRUTH_0", at, &truth, trocar_m);
    }
    if (log) lcm_eventlog_destroy(log);
    if (!failed && app_output_commit(&output, &error)) return 0;
    app_output_abandon(&output);
    fprintf(stderr, "%s: the log could not be written whole; check the disk\n", file);
    return APP_FAILED;
}

/* --- read --- */

/* Sample times t_n are the controller's clock, arrival is the log's. TOOL carries both: the least difference is the one
 * with the least delay. Kept over the last second or two, so that clocks may drift and be set. */
typedef struct clocks {
    int64_t least_us[2]; /* of the block that fills, and of the one before */
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
    int64_t session; /* of the controller: the one with the most ticks */
    char tool[16], force[16], patch[16], truth_channel[16];
    clocks clocks;
    int ticks_room, samples_room, truths_room, truths;
    int64_t first_us;
    bool grasper, started;
    bool origin_known;
    double origin[3]; /* the trocar */
    hrt_patch *pending;
    uint32_t pending_seq;
    float *truth;
} reading;

static void *room(void *array, int *have, int want, size_t size) {
    if (want <= *have) return array;
    *have = want * 2;
    void *more = realloc(array, (size_t)*have * size);
    if (!more) abort();
    return more;
}

static void take_tool(reading *g, const tensormass_tool_state_t *m, int64_t logged_us) {
    recording *r = g->r;
    if (m->session != g->session) return;
    g->grasper = m->mode == GRASPER;
    clocks_add(&g->clocks, logged_us - m->utime);
    if (!g->started) {
        g->started = true, g->first_us = r->first_us = m->utime;
        if (!g->origin_known)
            memcpy(g->origin, m->tip_m, sizeof g->origin); /* no patches then, and any point near by will do */
    }
    /* Ticks lie on a grid of TICK_US, or a little beside; a gap is filled with the last position. */
    int64_t tick = (m->utime - g->first_us + TICK_US / 2) / TICK_US;
    if (tick < 0 || tick > 100000000) return;
    r->tip_m = room(r->tip_m, &g->ticks_room, (int)tick + 1, 3 * sizeof *r->tip_m);
    for (int64_t k = r->ticks; k < tick; k++)
        memcpy(r->tip_m + 3 * k, r->tip_m + 3 * (r->ticks - 1), 3 * sizeof *r->tip_m);
    for (int i = 0; i < 3; i++) r->tip_m[3 * tick + i] = (float)(m->tip_m[i] - g->origin[i]);
    if (tick + 1 > r->ticks) r->ticks = (int)tick + 1;
}

static void take_force(reading *g, const tensormass_force_sample_t *m, int64_t logged_us) {
    recording *r = g->r;
    if (!g->started || !m->tool_utime || m->tool_session != g->session) return; /* before a controller spoke */
    r->sample = room(r->sample, &g->samples_room, r->samples + 1, sizeof *r->sample);
    sampled *x = &r->sample[r->samples];
    *x = (sampled){.ready_us = logged_us - clocks_difference(&g->clocks) - g->first_us};
    hrt_sample *s = &x->sample;
    s->session = s->tool_session = 1, s->t_us = m->tool_utime - g->first_us, s->seq = (uint32_t)m->seq,
    s->stiffness_kind = m->stiffness_kind;
    s->unilateral = !g->grasper, s->topology_revision = m->topology_revision;
    for (int i = 0; i < 3; i++) s->tip_m[i] = (float)(m->tip_m[i] - g->origin[i]), s->force_N[i] = (float)m->force_N[i];
    for (int i = 0; i < 9; i++) s->stiffness_N_m[i] = (float)m->stiffness_N_m[i];
    if (s->t_us < 0) s->t_us = 0;
    if (hrt_sample_check(s, &r->params) != HRT_ACCEPT) return;
    if (r->samples && s->t_us <= r->sample[r->samples - 1].sample.t_us) return; /* the controller takes no older one */
    if (g->pending && g->pending_seq == s->seq) s->patch = x->patch = g->pending, g->pending = NULL;
    r->samples++;
}

static void take_truth(reading *g, const tensormass_force_sample_t *m) {
    if (!g->started) return;
    int64_t tick = (m->utime - g->first_us) / TICK_US;
    if (tick != g->truths) return;
    g->truth = room(g->truth, &g->truths_room, g->truths + 1, 3 * sizeof *g->truth);
    for (int i = 0; i < 3; i++) g->truth[3 * tick + i] = (float)m->force_N[i];
    g->truths++;
}

bool patch_from_message(const tensormass_contact_patch_t *m, const double origin_m[3], hrt_patch *p) {
    static float scratch[HRT_PATCH_COMPLIANCE];
    if (m->vertex_count < 3 || m->vertex_count > HRT_PATCH_MAX_VERTICES || m->triangle_count < 1 ||
        m->triangle_count > HRT_PATCH_MAX_TRIANGLES)
        return false;
    memset(p, 0, sizeof *p);
    p->seq = (uint32_t)m->seq, p->topology_revision = m->topology_revision;
    p->vertex_count = m->vertex_count, p->triangle_count = m->triangle_count, p->held = (uint32_t)m->held;
    if (hrt_patch_places(p) > HRT_PATCH_MAX_VERTICES) return false;
    for (int i = 0; i < 3 * hrt_patch_places(p); i++) {
        double shift = m->origin_m[i % 3] - origin_m[i % 3];
        p->vertex_m[i] = (float)((double)m->vertex_m[i] + shift);
        p->rest_m[i] = i < hrt_patch_tip(p) ? (float)((double)m->rest_m[i] + shift) : m->hold_N[i % 3];
    }
    memcpy(p->triangle, m->triangle, sizeof p->triangle);
    memcpy(p->face, m->face, sizeof p->face);
    p->force_cap_N = m->force_cap_N;
    memcpy(p->compliance_m_N, m->compliance_m_N, sizeof p->compliance_m_N);
    p->skin_compliance_m_N = m->skin_compliance_m_N, p->radius_m = m->radius_m,
    p->contact_length_m = m->contact_length_m, p->film_s_m = m->film_s_m;
    return hrt_patch_prepare(p, scratch) == HRT_ACCEPT;
}

static void take_patch(reading *g, const tensormass_contact_patch_t *m) {
    free(g->pending);
    g->pending = calloc(1, sizeof *g->pending);
    if (!g->pending) abort();
    g->pending_seq = (uint32_t)m->seq;
    if (patch_from_message(m, g->origin, g->pending)) return;
    free(g->pending);
    g->pending = NULL;
}

static void take_event(reading *g, const app_log_event *e) {
    static tensormass_contact_patch_t patch;
    tensormass_tool_state_t tool;
    tensormass_force_sample_t force;
    if (!strcmp(e->channel, g->tool) && tensormass_tool_state_t_decode(e->data, 0, e->size, &tool) >= 0)
        take_tool(g, &tool, e->timestamp);
    if (!strcmp(e->channel, g->patch) && tensormass_contact_patch_t_decode(e->data, 0, e->size, &patch) >= 0)
        take_patch(g, &patch);
    if (!strcmp(e->channel, g->force) && tensormass_force_sample_t_decode(e->data, 0, e->size, &force) >= 0)
        take_force(g, &force, e->timestamp);
    if (!strcmp(e->channel, g->truth_channel) && tensormass_force_sample_t_decode(e->data, 0, e->size, &force) >= 0)
        take_truth(g, &force);
}

/* The truth of the log, or the paper's. */
static void finish(reading *g) {
    recording *r = g->r;
    r->truth_N = calloc(3 * (size_t)r->ticks, sizeof *r->truth_N);
    if (!r->truth_N) abort();
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

/* --- what there is, before it is read --- */

enum { INSTRUMENTS = LOG_INSTRUMENTS, SESSIONS = 64 };

typedef struct survey {
    bool origin_known[INSTRUMENTS];
    double origin[INSTRUMENTS][3];
    struct {
        int64_t id;
        int ticks;
    } session[INSTRUMENTS][SESSIONS];
    int sessions[INSTRUMENTS]; /* further ones are not looked at */
} survey;

static void survey_tool(survey *v, int i, const tensormass_tool_state_t *m) {
    int k = 0;
    while (k < v->sessions[i] && v->session[i][k].id != m->session) k++;
    if (k == SESSIONS) return;
    if (k == v->sessions[i]) v->session[i][v->sessions[i]++].id = m->session;
    v->session[i][k].ticks++;
}

/* The trocar stands in the first patch, or in the simulation's status. */
static void survey_origin(survey *v, int i, const double trocar_m[3]) {
    if (v->origin_known[i]) return;
    memcpy(v->origin[i], trocar_m, sizeof v->origin[i]);
    v->origin_known[i] = true;
}

/* Generated decoders believe the lengths of strings; a log may hold anything. */
static void survey_status(survey *v, const app_log_event *e) {
    char none[] = "";
    tensormass_sim_status_t m = {.scene = none, .model = none};
    if (!app_wire_sound_head("20.ss", 20, 2, tensormass_sim_status_t_encoded_size(&m), e->data, e->size) ||
        tensormass_sim_status_t_decode(e->data, 0, e->size, &m) != e->size)
        return;
    for (int i = 0; i < m.instrument_count && i < INSTRUMENTS; i++) survey_origin(v, i, m.trocar_m[i]);
    tensormass_sim_status_t_decode_cleanup(&m);
}

static void survey_event(survey *v, const app_log_event *e) {
    static tensormass_contact_patch_t patch;
    tensormass_tool_state_t tool;
    if (!strcmp(e->channel, "SIM_STATUS")) survey_status(v, e);
    for (int i = 0; i < INSTRUMENTS; i++) {
        char channel[2][16];
        snprintf(channel[0], sizeof channel[0], "TOOL_%d", i);
        snprintf(channel[1], sizeof channel[1], "PATCH_%d", i);
        if (!strcmp(e->channel, channel[0]) && tensormass_tool_state_t_decode(e->data, 0, e->size, &tool) >= 0)
            survey_tool(v, i, &tool);
        if (!v->origin_known[i] && !strcmp(e->channel, channel[1]) &&
            tensormass_contact_patch_t_decode(e->data, 0, e->size, &patch) >= 0)
            survey_origin(v, i, patch.trocar_m);
    }
}

static bool for_each_event(const char *file, void (*take)(void *, const app_log_event *), void *user) {
    app_log *log = app_log_open(file);
    if (!log) return false;
    for (const app_log_event *e; (e = app_log_next(log));) take(user, e);
    app_log_close(log);
    return true;
}

static void survey_any(void *user, const app_log_event *e) { survey_event(user, e); }
static void take_any(void *user, const app_log_event *e) { take_event(user, e); }

int log_read(const char *file, int instrument, recording *out) {
    survey v = {0};
    int longest = 0;
    reading g = {.r = out};
    memset(out, 0, sizeof *out);
    hrt_params_default(&out->params);
    snprintf(out->name, sizeof out->name, "%s", file);
    if (!for_each_event(file, survey_any, &v))
        return app_bad_input(file, 0, "cannot be read; name an LCM log, as tm-sim --record or lcm-logger writes it");
    for (int k = 1; k < v.sessions[instrument]; k++)
        if (v.session[instrument][k].ticks > v.session[instrument][longest].ticks) longest = k;
    out->sessions = v.sessions[instrument];
    g.session = v.session[instrument][longest].id;
    g.origin_known = v.origin_known[instrument];
    memcpy(g.origin, v.origin[instrument], sizeof g.origin);
    snprintf(g.tool, sizeof g.tool, "TOOL_%d", instrument);
    snprintf(g.force, sizeof g.force, "FORCE_%d", instrument);
    snprintf(g.patch, sizeof g.patch, "PATCH_%d", instrument);
    snprintf(g.truth_channel, sizeof g.truth_channel, "TRUTH_%d", instrument);
    if (!for_each_event(file, take_any, &g))
        return app_bad_input(file, 0, "was there a moment ago; leave it in place while it is read");
    free(g.pending);
    if (out->ticks && out->samples) finish(&g);
    free(g.truth);
    return 0;
}
