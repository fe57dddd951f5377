#include "publish.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "io/network.h"
#include "scene/picture.h"

/* --- cuts: one message per cutting instrument, in the frame's order --- */

/* Lists the ties that an instrument cut in this frame; -1: those that broke or went with their tissue. */
static int32_t list_ties(const sim *s, int who, int32_t tie[SIM_TIES_TOLD]) {
    int32_t count = 0;
    for (int32_t i = 0; i < s->ties_cut.count; i++)
        if (s->ties_cut.why[i] == who || (who < 0 && s->ties_cut.why[i] < 0)) tie[count++] = s->ties_cut.tie[i];
    return count;
}

static void send_cuts(sim_publisher *p, const sim *s, int64_t utime) {
    for (int who = -1; who < s->instrument_count && s->cuts.count + s->ties_cut.count > 0; who++) {
        int32_t count = 0, tie[SIM_TIES_TOLD], ties = list_ties(s, who, tie);
        for (int32_t i = 0; i < s->cuts.count; i++)
            if (s->cuts.instrument[i] == who) p->removed[count++] = s->cuts.tet[i];
        if (!count && !ties) continue;
        tensormass_cut_event_t m = {.utime = utime,
                                    .seq = p->cut_seq++,
                                    .session = p->session,
                                    .instrument = (int8_t)who,
                                    .topology_revision = sim_surface(s).revision,
                                    .removed_count = count,
                                    .removed_tet = p->removed,
                                    .alive_count = sim_alive(s),
                                    .tie_count = ties,
                                    .cut_tie = tie};
        app_link_publish(p->link, APP_CUT, 0, utime, &m);
    }
}

/* --- the rest --- */

static int refuse(sim_publisher *p, int code, const char *why) {
    sim_publisher_close(p);
    fprintf(stderr, "tm-sim: %s\n", why);
    return code;
}

static bool open_link(sim_publisher *p, const sim *s, const sim_way *way, char *why, int why_size) {
    app_topic topic[SIM_TOPICS];
    app_link_def def = {.topic = topic, .key = way->key, .copy = p->log};
    tm_error error = {0};
    p->ears = (sim_ears){.listener = way->listener, .sealed = way->key && way->key->known, .session = way->session};
    if (way->listener.tool) def.topics = sim_ears_topics(&p->ears, s->instrument_count, topic);
    if (way->queue) p->link = app_link_join(way->queue, &def, NULL);
    if (way->queue || !way->url) return way->queue ? p->link != NULL : (p->link = p->log) != NULL;
    app_network_opener *open = hrt_network(&error);
    if (open)
        p->link = open(way->url, &def, why, why_size);
    else
        snprintf(why, (size_t)why_size, "%s", error.message);
    return p->link != NULL;
}

int sim_publisher_open(sim_publisher *p, const sim *s, const sim_way *way) {
    char why[300];
    *p = (sim_publisher){.session = way->session, .forces = way->forces};
    if (!way->url && !way->queue && !way->log) return 0;
    snprintf(why, sizeof why, "the log %s cannot be written; choose another folder", way->log ? way->log : "");
    if (way->log && !(p->log = app_link_write_log(way->log, &(app_link_def){.key = way->key})))
        return refuse(p, APP_BAD_INPUT, why);
    snprintf(why, sizeof why, "out of memory for messages; close other programs");
    if (!open_link(p, s, way, why, sizeof why)) return refuse(p, APP_BAD_INPUT, why);
    p->rendering = sim_options(s->scene, "rendering");
    if (sim_has(s, "cut")) p->removed = malloc(sizeof *p->removed * (size_t)s->mesh->tet_count);
    if (sim_has(s, "cut") && !p->removed)
        return refuse(p, APP_FAILED, "out of memory for cut messages; use a smaller mesh");
    return 0;
}

bool sim_publisher_close(sim_publisher *p) {
    if (p->link != p->log) app_link_close(p->link);
    const bool good = app_link_close(p->log);
    free(p->removed);
    p->removed = NULL;
    p->link = p->log = NULL;
    return good;
}

sim_refused sim_publisher_refused(const sim_publisher *p) {
    if (!p->link) return (sim_refused){0};
    const app_link_counts *c = app_link_counted(p->link);
    const app_packet_counts packets = app_link_packets(p->link);
    return (sim_refused){.malformed = atomic_load(&c->malformed),
                         .forged = atomic_load(&c->forged),
                         .packets = packets.malformed + packets.oversized,
                         .foreign = packets.foreign};
}

static int32_t sample_flags(uint32_t reaction_flags) {
    static const struct {
        uint32_t reaction;
        int32_t sample;
    } pair[] = {{TM_REACTION_CAPPED, SIM_FLAG_CAPPED},           {TM_REACTION_OVERFLOWED, SIM_FLAG_OVERFLOWED},
                {TM_REACTION_UNCONVERGED, SIM_FLAG_UNCONVERGED}, {TM_REACTION_REPEATED, SIM_FLAG_REPEATED},
                {TM_REACTION_UNSTABLE, SIM_FLAG_UNSTABLE},       {TM_REACTION_TOO_FAST, SIM_FLAG_TOO_FAST},
                {TM_REACTION_INSIDE, SIM_FLAG_INSIDE},           {TM_REACTION_RELEASING, SIM_FLAG_RELEASING}};
    int32_t flags = 0;
    for (size_t i = 0; i < sizeof pair / sizeof *pair; i++)
        if (reaction_flags & pair[i].reaction) flags |= pair[i].sample;
    return flags;
}

static bool all_finite(const double *x, int n) {
    bool good = true;
    for (int i = 0; i < n; i++) good = good && isfinite(x[i]);
    return good;
}

/* Returns whether the instrument is a cautery with its pedal down. */
static bool cuts_now(const sim *s, int instrument) {
    return s->pose[instrument].active && s->instrument_def[instrument].mode == TM_TOOL_CAUTERY;
}

void sim_force_sample(sim_publisher *p, const sim *s, int instrument, int64_t utime, int64_t tool_session,
                      int64_t tool_utime, int32_t flags, tensormass_force_sample_t *out) {
    const tm_tool_reaction *r = &s->reaction[instrument];
    *out = (tensormass_force_sample_t){.utime = utime,
                                       .seq = p->seq[instrument]++,
                                       .session = p->session,
                                       .instrument = (int8_t)instrument,
                                       .tool_session = tool_session,
                                       .tool_utime = tool_utime};
    uint32_t how = r->flags;
    if (!all_finite(r->force_N, 3) || !all_finite(r->tip_m, 3) ||
        (r->stiffness_kind && !all_finite(r->stiffness_N_m, 9)))
        how |= TM_REACTION_UNSTABLE;
    out->topology_revision = sim_surface(s).revision;
    out->flags = flags | sample_flags(how);
    memcpy(out->tip_m, s->pose[instrument].tip_m, sizeof out->tip_m);
    if (how & TM_REACTION_UNSTABLE) return;
    if (instrument < s->model->instrument_count) memcpy(out->tip_m, r->tip_m, sizeof out->tip_m);
    memcpy(out->force_N, r->force_N, sizeof out->force_N);
    if (s->wants[instrument] != SIM_SENDS_FORCE && r->stiffness_kind) {
        out->stiffness_kind = (int8_t)r->stiffness_kind;
        memcpy(out->stiffness_N_m, r->stiffness_N_m, sizeof out->stiffness_N_m);
    }
    if (s->patch_valid[instrument]) out->flags |= SIM_FLAG_PATCH;
    if (cuts_now(s, instrument)) out->flags |= SIM_FLAG_CUTTING;
}

/* Stores the compliance row by row. With a grasp each row has three more entries, and there are three more rows. */
static void put_compliance(const tm_patch *t, float *to) {
    const int n = 3 * t->vertex_count;
    const double *from = t->compliance_m_N;
    for (int i = 0; i < n; i++) {
        for (int j = i; j < n; j++) *to++ = (float)*from++;
        for (int c = 0; c < 3 && t->grasps; c++) *to++ = (float)t->dvertex_dtip[3 * i + c];
    }
    for (int i = 0; i < 9 && t->grasps; i++)
        if (i % 3 >= i / 3) *to++ = (float)t->grasp_stiffness_N_m[i];
}

static void put_hold(const tm_patch *t, tensormass_contact_patch_t *out) {
    out->grasped = (int32_t)(t->grasped | 1u << t->vertex_count);
    for (int c = 0; c < 3; c++) {
        out->grasp_N[c] = (float)t->grasp_N[c];
        out->vertex_m[3 * t->vertex_count + c] = (float)(t->grasp_tip_m[c] - t->trocar_m[c]);
    }
}

bool sim_contact_patch(const sim_publisher *p, const sim *s, const tensormass_force_sample_t *sample,
                       tensormass_contact_patch_t *out) {
    if (!s->patch_valid[sample->instrument] || !(sample->flags & SIM_FLAG_PATCH)) return false;
    const tm_patch *t = &s->patch[sample->instrument];
    memset(out, 0, sizeof *out);
    out->utime = sample->utime;
    out->seq = sample->seq;
    out->session = p->session;
    out->instrument = sample->instrument;
    out->topology_revision = t->topology_revision;
    out->kind = (int8_t)t->kind;
    out->vertex_count = t->vertex_count;
    out->triangle_count = t->triangle_count;
    memcpy(out->origin_m, t->trocar_m, sizeof out->origin_m);
    for (int i = 0; i < 3 * t->vertex_count; i++) {
        out->vertex_m[i] = (float)(t->vertex_m[i] - t->trocar_m[i % 3]);
        out->rest_m[i] = (float)(t->rest_m[i] - t->trocar_m[i % 3]);
    }
    memcpy(out->face, t->face, sizeof *out->face * (size_t)t->triangle_count);
    memcpy(out->triangle, t->triangle, 3 * (size_t)t->triangle_count);
    put_compliance(t, out->compliance_m_N);
    if (t->grasps) put_hold(t, out);
    out->contact_compliance_m_N = (float)t->contact_compliance_m_N;
    out->force_cap_N = (float)t->force_cap_N;
    out->radius_m = (float)t->radius_m;
    out->contact_length_m = (float)t->contact_length_m;
    out->drag_s_m = (float)t->drag_s_m;
    out->radiation_N_s_m = (float)t->radiation_N_s_m;
    out->radiation_s = (float)t->radiation_s;
    out->friction_static = (float)t->friction_static;
    out->friction_kinetic = (float)t->friction_kinetic;
    memcpy(out->trocar_m, t->trocar_m, sizeof out->trocar_m);
    return true;
}

void sim_publish_reaction(sim_publisher *p, const sim *s, sim_tools *tools, int instrument, int64_t utime,
                          int32_t substeps, int32_t average, int32_t flags, tensormass_force_sample_t *sample) {
    const sim_tool *tool = &tools->tool[instrument];
    const int64_t t_n = sim_tools_mean_utime(tools, instrument, substeps, average);
    sim_force_sample(p, s, instrument, utime, t_n ? tool->now.session : 0, t_n, flags, sample);
    if (!p->link || !p->forces) return;
    if (sim_contact_patch(p, s, sample, &p->patch)) app_link_publish(p->link, APP_PATCH, instrument, utime, &p->patch);
    app_link_publish(p->link, APP_FORCE, instrument, utime, sample);
}

static void send_tissue(sim_publisher *p, sim *s, int64_t utime) {
    const sim_picture *now = sim_picture_now(s);
    const tensormass_tissue_t m = {.utime = utime,
                                   .seq = p->tissue_seq++,
                                   .session = p->session,
                                   .sim_utime = llround(sim_time_s(s) * 1e6),
                                   .topology_revision = now->revision,
                                   .vertex_count = now->vertex_count,
                                   .vertex_id = now->vertex_id,
                                   .vertex_m = now->vertex_m,
                                   .triangle_count = now->triangle_count,
                                   .triangle = now->triangle,
                                   .triangle_kind = now->triangle_kind,
                                   .tie_total = now->tie_total,
                                   .tie_count = now->tie_count,
                                   .tie_id = now->tie_id,
                                   .tie_m = now->tie_m};
    app_link_publish(p->link, APP_TISSUE, 0, utime, &m);
}

void sim_publish_frame(sim_publisher *p, sim *s, int64_t utime, double compute_s, double speed, double rate_Hz) {
    if (!p->link) return;
    tensormass_sim_status_t m = {.utime = utime,
                                 .seq = p->status_seq++,
                                 .session = p->session,
                                 .scene = (char *)(uintptr_t)s->scene->file,
                                 .model = (char *)(uintptr_t)s->model->kind->name,
                                 .tets_alive = sim_alive(s),
                                 .substeps = s->substeps,
                                 .dt_s = s->dt_s,
                                 .frame_s = s->frame_s,
                                 .compute_s = compute_s,
                                 .sample_rate_Hz = rate_Hz,
                                 .sim_seconds_per_wall_second = speed,
                                 .dropped_utime = p->dropped_us,
                                 .instrument_count = (int8_t)s->instrument_count};
    for (int i = 0; i < s->instrument_count; i++) {
        memcpy(m.tip_m[i], s->pose[i].tip_m, sizeof m.tip_m[i]);
        memcpy(m.trocar_m[i], s->instrument_def[i].trocar_m, sizeof m.trocar_m[i]);
        m.is_free[i] = s->instrument_def[i].is_free;
        tm_tool_direction(&s->instrument_def[i], &s->pose[i], m.direction[i]);
        for (int a = 0; a < 3; a++) { /* columns z and y of the instrument's axes */
            m.axis[i][a] = s->axes[i].r[3 * a + 2];
            m.up[i][a] = s->axes[i].r[3 * a + 1];
        }
        memcpy(m.force_N[i], s->reaction[i].force_N, sizeof m.force_N[i]);
        m.patch_age[i] = s->patch_valid[i] ? s->patch[i].age : -1;
        m.radius_m[i] = s->instrument_def[i].radius_m;
        m.roll_rad[i] = s->pose[i].roll_rad;
        m.grip[i] = s->pose[i].grip;
        m.mode[i] = (int8_t)s->instrument_def[i].mode;
        m.device[i] = (int8_t)hrt_device_type_number(s->axes[i].device);
        m.active[i] = s->pose[i].active;
    }
    send_cuts(p, s, utime);
    app_link_publish(p->link, APP_SIM_STATUS, 0, utime, &m);
    if (p->rendering && s->frames % p->rendering->every.value == 0 && app_link_wanted(p->link, APP_TISSUE, 0))
        send_tissue(p, s, utime);
}
