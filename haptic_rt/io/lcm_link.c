/* The module `haptic`: the one place of haptic_rt that calls liblcm. */
#include "lcm_link.h"
#include "wire.h"

#include <lcm/lcm.h>
#include <math.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "lcm_types/tensormass_contact_patch_t.h"
#include "lcm_types/tensormass_controller_command_t.h"
#include "lcm_types/tensormass_controller_status_t.h"
#include "lcm_types/tensormass_force_sample_t.h"
#include "lcm_types/tensormass_hand_command_t.h"
#include "lcm_types/tensormass_sim_status_t.h"
#include "lcm_types/tensormass_tool_state_t.h"

enum { CHANNEL = 32, BUFFER = 4096, REPLAY_AGE_US = 5000 };

struct hrt_link {
    hrt_link_def def;
    lcm_t *lcm;
    /* The generated ones: lcm_destroy does not free what they add to the library's own. */
    tensormass_hand_command_t_subscription_t *hands;
    tensormass_force_sample_t_subscription_t *forces;
    tensormass_contact_patch_t_subscription_t *patches;
    pthread_t thread;
    _Atomic bool stop;
    hrt_link_counts counts;
    int64_t sim_session, replay_session, replay_offset_us;
    char tool_channel[CHANNEL], status_channel[CHANNEL];
    uint32_t status_seq;
};

static int64_t now_us(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000 + t.tv_nsec / 1000;
}

/* A recorded sample answers a controller that is gone: it is taken as an answer to this one, with its ages kept among
 * samples of one recording. */
static void replayed(hrt_link *link, const tensormass_force_sample_t *m, hrt_force_sample *s) {
    if (m->tool_session == 0) return; /* the simulation had not heard a controller yet */
    if (m->tool_session != link->replay_session || m->session != link->sim_session) {
        link->replay_session = m->tool_session;
        link->sim_session = m->session;
        link->replay_offset_us = now_us() - m->tool_utime - REPLAY_AGE_US;
    }
    s->tool_session = link->def.node->config.session;
    s->tool_utime = m->tool_utime + link->replay_offset_us;
}

static void on_force(const lcm_recv_buf_t *raw, const char *channel, const tensormass_force_sample_t *m, void *user) {
    (void)raw, (void)channel;
    hrt_link *link = user;
    hrt_force_sample s = {.utime = m->utime,
                          .session = m->session,
                          .tool_session = m->tool_session,
                          .tool_utime = m->tool_utime,
                          .seq = (uint32_t)m->seq,
                          .instrument = m->instrument,
                          .stiffness_kind = m->stiffness_kind,
                          .flags = m->flags,
                          .topology_revision = m->topology_revision};
    memcpy(s.tip_m, m->tip_m, sizeof s.tip_m);
    memcpy(s.force_N, m->force_N, sizeof s.force_N);
    memcpy(s.stiffness_N_m, m->stiffness_N_m, sizeof s.stiffness_N_m);
    if (link->def.replay) replayed(link, m, &s);
    hrt_node_post_sample(link->def.node, &s);
    atomic_fetch_add(&link->counts.samples, 1);
}

static void on_patch(const lcm_recv_buf_t *raw, const char *channel, const tensormass_contact_patch_t *m, void *user) {
    (void)raw, (void)channel;
    hrt_link *link = user;
    const hrt_patch_message p = {.session = m->session,
                                 .seq = (uint32_t)m->seq,
                                 .instrument = m->instrument,
                                 .topology_revision = m->topology_revision,
                                 .vertex_count = m->vertex_count,
                                 .triangle_count = m->triangle_count,
                                 .vertex_m = m->vertex_m,
                                 .rest_m = m->rest_m,
                                 .origin_m = m->origin_m,
                                 .triangle = m->triangle,
                                 .face = m->face,
                                 .compliance_m_N = m->compliance_m_N,
                                 .skin_compliance_m_N = m->skin_compliance_m_N,
                                 .force_cap_N = m->force_cap_N,
                                 .radius_m = m->radius_m,
                                 .contact_length_m = m->contact_length_m};
    hrt_node_post_patch(link->def.node, &p);
    atomic_fetch_add(&link->counts.patches, 1);
}

static void take_sim_status(hrt_link *link, const tensormass_sim_status_t *m) {
    const int32_t i = link->def.instrument;
    if (i >= m->instrument_count) return;
    hrt_pose pose;
    memcpy(pose.trocar_m, m->trocar_m[i], sizeof pose.trocar_m);
    memcpy(pose.axis, m->axis[i], sizeof pose.axis);
    memcpy(pose.up, m->up[i], sizeof pose.up);
    hrt_node_post_pose(link->def.node, &pose);
    atomic_fetch_add(&link->counts.poses, 1);
}

/* Generated decoders believe the lengths of strings: messages that hold any are walked first. */
static void on_sim_status(const lcm_recv_buf_t *raw, const char *channel, void *user) {
    (void)channel;
    char none[] = "";
    tensormass_sim_status_t m = {.scene = none, .model = none};
    const int size = (int)raw->data_size;
    if (!app_wire_sound_head("20.ss", 20, 2, tensormass_sim_status_t_encoded_size(&m), raw->data, size)) return;
    if (tensormass_sim_status_t_decode(raw->data, 0, size, &m) != size) return;
    take_sim_status(user, &m);
    tensormass_sim_status_t_decode_cleanup(&m);
}

static void take_command(hrt_link *link, const tensormass_controller_command_t *m) {
    if (m->instrument != link->def.instrument) return;
    hrt_extrapolator which = HRT_HOLD;
    hrt_command command = {
        .extrapolator = -1, .passivity = m->passivity, .coupling = -1, .enable = -1, .reset = m->reset_fault == 1};
    if (m->extrapolator && hrt_extrapolator_find(m->extrapolator, &which)) command.extrapolator = which;
    hrt_node_post_command(link->def.node, &command);
    atomic_fetch_add(&link->counts.commands, 1);
}

static void on_command(const lcm_recv_buf_t *raw, const char *channel, void *user) {
    (void)channel;
    char none[] = "";
    tensormass_controller_command_t m = {.extrapolator = none};
    const int size = (int)raw->data_size;
    if (!app_wire_sound_head("13.s", 13, 1, tensormass_controller_command_t_encoded_size(&m), raw->data, size)) return;
    if (tensormass_controller_command_t_decode(raw->data, 0, size, &m) != size) return;
    take_command(user, &m);
    tensormass_controller_command_t_decode_cleanup(&m);
}

static void on_hand(const lcm_recv_buf_t *raw, const char *channel, const tensormass_hand_command_t *m, void *user) {
    (void)raw, (void)channel;
    hrt_link *link = user;
    if (m->instrument != link->def.instrument) return;
    for (int j = 0; j < 5; j++)
        if (!(fabs(m->joint[j]) < 1.0e3)) return;
    link->def.hand(link->def.user, m->joint, m->active != 0);
    atomic_fetch_add(&link->counts.hands, 1);
}

static void *receive(void *user) {
    hrt_link *link = user;
    struct pollfd fd = {.fd = lcm_get_fileno(link->lcm), .events = POLLIN};
    while (!atomic_load(&link->stop))
        if (poll(&fd, 1, 100) > 0) lcm_handle(link->lcm);
    return NULL;
}

static bool subscribe(hrt_link *link) {
    char channel[CHANNEL];
    const int i = link->def.instrument;
    bool good = true;
    if (link->def.hand) {
        snprintf(channel, sizeof channel, "HAND_%d", i);
        link->hands = tensormass_hand_command_t_subscribe(link->lcm, channel, on_hand, link);
        good = link->hands != NULL;
    }
    if (!link->def.node) return good;
    snprintf(channel, sizeof channel, "FORCE_%d", i);
    link->forces = tensormass_force_sample_t_subscribe(link->lcm, channel, on_force, link);
    snprintf(channel, sizeof channel, "PATCH_%d", i);
    link->patches = tensormass_contact_patch_t_subscribe(link->lcm, channel, on_patch, link);
    good = good && link->forces && link->patches;
    snprintf(channel, sizeof channel, "CONTROLLER_COMMAND_%d", i);
    good = good && lcm_subscribe(link->lcm, channel, on_command, link);
    return good && lcm_subscribe(link->lcm, "SIM_STATUS", on_sim_status, link);
}

static void leave(hrt_link *link) {
    if (link->hands) tensormass_hand_command_t_unsubscribe(link->lcm, link->hands);
    if (link->forces) tensormass_force_sample_t_unsubscribe(link->lcm, link->forces);
    if (link->patches) tensormass_contact_patch_t_unsubscribe(link->lcm, link->patches);
    if (link->lcm) lcm_destroy(link->lcm);
    free(link);
}

static hrt_link *link_open(const hrt_link_def *def, char *why, int why_size) {
    hrt_link *link = calloc(1, sizeof *link);
    if (!link) return NULL;
    link->def = *def;
    snprintf(link->tool_channel, CHANNEL, "TOOL_%d", def->instrument);
    snprintf(link->status_channel, CHANNEL, "CONTROLLER_%d", def->instrument);
    link->lcm = lcm_create(def->url);
    if (!link->lcm || !subscribe(link) || pthread_create(&link->thread, NULL, receive, link) != 0) {
        snprintf(
            why, (size_t)why_size,
            "LCM cannot open '%s'; for a multicast route on this machine alone type: ip link set lo up; ip route add 224.0.0.0/4 dev lo",
            def->url);
        leave(link);
        return NULL;
    }
    return link;
}

static void link_close(hrt_link *link) {
    atomic_store(&link->stop, true);
    pthread_join(link->thread, NULL);
    leave(link);
}

static void link_publish_tool(hrt_link *link, const hrt_tool_state *t) {
    uint8_t buffer[BUFFER];
    tensormass_tool_state_t m = {.utime = t->utime,
                                 .seq = (int32_t)t->seq,
                                 .session = t->session,
                                 .instrument = t->instrument,
                                 .mode = t->mode,
                                 .state = t->state,
                                 .active = t->active,
                                 .extrapolator = t->extrapolator};
    memcpy(m.tip_m, t->tip_m, sizeof m.tip_m);
    memcpy(m.joint, t->joint, sizeof m.joint);
    const int bytes = tensormass_tool_state_t_encode(buffer, 0, sizeof buffer, &m);
    if (bytes > 0) lcm_publish(link->lcm, link->tool_channel, buffer, (unsigned)bytes);
}

static void link_publish_status(hrt_link *link, const hrt_status *s) {
    uint8_t buffer[BUFFER];
    char text[256], name[32];
    snprintf(text, sizeof text, "%s", s->fault_text);
    snprintf(name, sizeof name, "%s", hrt_extrapolator_name((hrt_extrapolator)s->extrapolator));
    tensormass_controller_status_t m = {.utime = s->utime,
                                        .seq = (int32_t)++link->status_seq,
                                        .session = s->session,
                                        .instrument = (int8_t)s->instrument,
                                        .state = (int8_t)s->state,
                                        .fault = s->fault,
                                        .fault_text = text,
                                        .limits = s->limits,
                                        .extrapolator = name,
                                        .passivity_on = (int8_t)s->passivity_on,
                                        .passivity_J = s->passivity_J,
                                        .sample_age_s = s->sample_age_s,
                                        .ticks = s->ticks,
                                        .missed_ticks = s->missed_ticks,
                                        .samples_received = s->samples_received,
                                        .samples_late = s->samples_late,
                                        .samples_lost = s->samples_lost,
                                        .samples_rejected = s->samples_rejected,
                                        .can_tx = s->can_tx,
                                        .can_rx = s->can_rx,
                                        .can_errors = s->can_errors};
    memcpy(m.force_N, s->force_N, sizeof m.force_N);
    memcpy(m.lateness_us, s->lateness_us, sizeof m.lateness_us);
    memcpy(m.duration_us, s->duration_us, sizeof m.duration_us);
    const int bytes = tensormass_controller_status_t_encode(buffer, 0, sizeof buffer, &m);
    if (bytes > 0) lcm_publish(link->lcm, link->status_channel, buffer, (unsigned)bytes);
}

static const hrt_link_counts *link_counts(const hrt_link *link) { return &link->counts; }

__attribute__((visibility("default"))) extern const hrt_link_api hrt_link_table;
const hrt_link_api hrt_link_table = {link_open, link_close, link_publish_tool, link_publish_status, link_counts};
