/* The module `haptic`: messages in through lcm_types/receiver.h, out through liblcm. */
#include "lcm_link.h"
#include "wire.h"

#include <lcm/lcm.h>
#include <math.h>
#include <pthread.h>
#include <semaphore.h>
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

enum { CHANNEL = 32, BUFFER = 4096, TEXT_MESSAGE = 4096, REPLAY_AGE_US = 5000, RESET_EVERY_US = 1000000, UNREAD = 4 };

/* The newest of something, from the loop's thread to the sending one: each owns a slot, the third is between them. */
typedef struct letterbox {
    _Atomic uint32_t between; /* slot number, | UNREAD */
    uint32_t write, read;
} letterbox;

struct hrt_link {
    hrt_link_def def;
    app_key key;
    app_receiver *receiver;
    lcm_t *lcm; /* for sending */
    pthread_t receiving, sending;
    bool receives, sends;
    _Atomic bool stop;
    sem_t wake;
    hrt_link_counts counts;
    int64_t sim_session, replay_session, replay_offset_us, reset_us;
    _Atomic int64_t heard_session; /* of the simulation, for tool_state_t.sim_session */
    _Atomic uint32_t command_seq;
    app_replay statuses, hands;
    tensormass_contact_patch_t patch;
    char tool_channel[CHANNEL], status_channel[CHANNEL];
    uint32_t status_seq;
    letterbox tool_box, status_box;
    struct posted_tool {
        hrt_tool_state tool;
        int64_t at_ns;
    } tool[3];
    hrt_status status[3];
    hrt_link_sent sent;
    _Atomic int64_t skipped;
};

static uint32_t post(letterbox *box) { /* true: the one before was not read */
    const uint32_t old = atomic_exchange(&box->between, box->write | UNREAD);
    box->write = old & 3u;
    return old & UNREAD;
}

static bool collect(letterbox *box) {
    if ((atomic_load(&box->between) & UNREAD) == 0) return false;
    box->read = atomic_exchange(&box->between, box->read) & 3u;
    return true;
}

static int64_t now_ns(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static int64_t now_us(void) { return now_ns() / 1000; }

/* ---------------------------------------------------------------------------------------------- receiving */

static bool refuse(_Atomic int64_t *counter) {
    atomic_fetch_add(counter, 1);
    return false;
}

static bool genuine(hrt_link *link, const char *channel, const void *data, int size) {
    return app_sealed(&link->key, channel, data, size) || refuse(&link->counts.forged);
}

/* Sealed messages count once. */
static bool heard_once(hrt_link *link, app_replay *replay, int64_t session, int32_t seq) {
    return !link->key.known || app_replay_fresh(replay, session, (uint32_t)seq) || refuse(&link->counts.forged);
}

/* A message of fixed size: whole, or not at all. */
#define WHOLE(type, m)                                                                                                 \
    ((size == tensormass_##type##_encoded_size(m) && tensormass_##type##_decode(data, 0, size, m) == size) ||          \
     refuse(&link->counts.malformed))

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

static void take_force(hrt_link *link, const tensormass_force_sample_t *m) {
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

static void on_force(void *user, const char *channel, int64_t utime, const void *data, int size) {
    (void)utime;
    hrt_link *link = user;
    tensormass_force_sample_t m = {0};
    if (genuine(link, channel, data, size) && WHOLE(force_sample_t, &m)) take_force(link, &m);
}

static void take_patch(hrt_link *link, const tensormass_contact_patch_t *m) {
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
                                 .contact_length_m = m->contact_length_m,
                                 .film_s_m = m->film_s_m,
                                 .held = m->held,
                                 .hold_N = m->hold_N};
    hrt_node_post_patch(link->def.node, &p);
    atomic_fetch_add(&link->counts.patches, 1);
}

static void on_patch(void *user, const char *channel, int64_t utime, const void *data, int size) {
    (void)utime;
    hrt_link *link = user;
    tensormass_contact_patch_t *m = &link->patch; /* 11 kB */
    if (genuine(link, channel, data, size) && WHOLE(contact_patch_t, m)) take_patch(link, m);
}

static void take_sim_status(hrt_link *link, const tensormass_sim_status_t *m) {
    const int32_t i = link->def.instrument;
    if (!hrt_node_hears(link->def.node, m->session) || !heard_once(link, &link->statuses, m->session, m->seq)) return;
    atomic_store(&link->heard_session, m->session);
    if (i >= m->instrument_count) return;
    hrt_pose pose;
    memcpy(pose.trocar_m, m->trocar_m[i], sizeof pose.trocar_m);
    memcpy(pose.axis, m->axis[i], sizeof pose.axis);
    memcpy(pose.up, m->up[i], sizeof pose.up);
    hrt_node_post_pose(link->def.node, &pose);
    atomic_fetch_add(&link->counts.poses, 1);
}

/* Generated decoders believe the lengths of strings: messages that hold any are walked first. */
static void on_sim_status(void *user, const char *channel, int64_t utime, const void *data, int size) {
    (void)utime;
    hrt_link *link = user;
    char none[] = "";
    tensormass_sim_status_t m = {.scene = none, .model = none};
    if (!genuine(link, channel, data, size)) return;
    if (!app_wire_sound_head("20.ss", 20, 2, tensormass_sim_status_t_encoded_size(&m), data, size) ||
        tensormass_sim_status_t_decode(data, 0, size, &m) != size) {
        refuse(&link->counts.malformed);
        return;
    }
    take_sim_status(link, &m);
    tensormass_sim_status_t_decode_cleanup(&m);
}

/* Resets are a person's: not while force is rendered, not many a second. */
static bool reset_permitted(hrt_link *link) {
    const int64_t now = now_us();
    if (hrt_node_in_use(link->def.node) || (link->reset_us && now - link->reset_us < RESET_EVERY_US))
        return refuse(&link->counts.refused);
    link->reset_us = now;
    return true;
}

/* With a key a command is for this very controller and later than the last one: a recorded one never fits. */
static bool command_permitted(hrt_link *link, const tensormass_controller_command_t *m) {
    const bool own = m->session == link->def.node->config.session;
    if (m->instrument != link->def.instrument || (!own && (link->key.known || m->session != 0)))
        return refuse(&link->counts.refused);
    if (!link->key.known) return true;
    if (!hrt_seq_after((uint32_t)m->seq, atomic_load(&link->command_seq))) return refuse(&link->counts.forged);
    atomic_store(&link->command_seq, (uint32_t)m->seq);
    return true;
}

static void take_command(hrt_link *link, const tensormass_controller_command_t *m) {
    if (!command_permitted(link, m)) return;
    hrt_extrapolator which = HRT_HOLD;
    hrt_command command = {.extrapolator = -1, .passivity = m->passivity, .coupling = -1, .enable = -1};
    command.reset = m->reset_fault == 1 && reset_permitted(link);
    if (m->extrapolator && hrt_extrapolator_find(m->extrapolator, &which)) command.extrapolator = which;
    hrt_node_post_command(link->def.node, &command);
    atomic_fetch_add(&link->counts.commands, 1);
}

static void on_command(void *user, const char *channel, int64_t utime, const void *data, int size) {
    (void)utime;
    hrt_link *link = user;
    char none[] = "";
    tensormass_controller_command_t m = {.extrapolator = none};
    if (!genuine(link, channel, data, size)) return;
    if (!app_wire_sound_head("21.s", 21, 1, tensormass_controller_command_t_encoded_size(&m), data, size) ||
        tensormass_controller_command_t_decode(data, 0, size, &m) != size) {
        refuse(&link->counts.malformed);
        return;
    }
    take_command(link, &m);
    tensormass_controller_command_t_decode_cleanup(&m);
}

static void on_hand(void *user, const char *channel, int64_t utime, const void *data, int size) {
    (void)utime;
    hrt_link *link = user;
    tensormass_hand_command_t m = {0};
    if (!genuine(link, channel, data, size) || !WHOLE(hand_command_t, &m)) return;
    if (m.instrument != link->def.instrument || !heard_once(link, &link->hands, m.session, m.seq)) return;
    for (int j = 0; j < 5; j++)
        if (!(fabs(m.joint[j]) < 1.0e3)) return;
    link->def.hand(link->def.user, m.joint, m.active != 0);
    atomic_fetch_add(&link->counts.hands, 1);
}

static void *receive(void *user) {
    hrt_link *link = user;
    while (!atomic_load(&link->stop))
        if (app_receiver_receive(link->receiver, 100000, 256) < 0) {
            const struct timespec wait = {0, 100000000};
            nanosleep(&wait, NULL);
        }
    return NULL;
}

static bool listen_to(hrt_link *link, char *why, int why_size) {
    enum { MOST = 5 };
    app_channel channel[MOST];
    char name[MOST][CHANNEL];
    const int i = link->def.instrument;
    const tensormass_force_sample_t force = {0};
    const tensormass_contact_patch_t patch = {0};
    const tensormass_hand_command_t hand = {0};
    const struct {
        bool wanted;
        const char *format;
        int bytes;
        void (*take)(void *, const char *, int64_t, const void *, int);
    } row[MOST] = {{link->def.hand, "HAND_%d", tensormass_hand_command_t_encoded_size(&hand), on_hand},
                   {link->def.node, "FORCE_%d", tensormass_force_sample_t_encoded_size(&force), on_force},
                   {link->def.node, "PATCH_%d", tensormass_contact_patch_t_encoded_size(&patch), on_patch},
                   {link->def.node, "CONTROLLER_COMMAND_%d", TEXT_MESSAGE, on_command},
                   {link->def.node, "SIM_STATUS", TEXT_MESSAGE, on_sim_status}};
    int count = 0;
    for (int k = 0; k < MOST; k++) {
        if (!row[k].wanted) continue;
        snprintf(name[count], sizeof name[count], row[k].format, i);
        channel[count] =
            (app_channel){.name = name[count], .max_bytes = row[k].bytes, .take = row[k].take, .user = link};
        count++;
    }
    link->receiver = app_receiver_open(link->def.url, channel, count, why, why_size);
    return link->receiver != NULL;
}

/* ---------------------------------------------------------------------------------------------- sending */

static void send_tool(hrt_link *link) {
    uint8_t buffer[BUFFER];
    const struct posted_tool *posted = &link->tool[link->tool_box.read];
    const hrt_tool_state *t = &posted->tool;
    tensormass_tool_state_t m = {.utime = t->utime,
                                 .seq = (int32_t)t->seq,
                                 .session = t->session,
                                 .instrument = t->instrument,
                                 .mode = t->mode,
                                 .state = t->state,
                                 .active = t->active,
                                 .extrapolator = t->extrapolator,
                                 .sim_session = atomic_load(&link->heard_session)};
    memcpy(m.tip_m, t->tip_m, sizeof m.tip_m);
    memcpy(m.joint, t->joint, sizeof m.joint);
    const int bytes = tensormass_tool_state_t_encode(buffer, 0, sizeof buffer, &m);
    if (bytes <= 0) return;
    app_seal(&link->key, link->tool_channel, buffer, bytes);
    lcm_publish(link->lcm, link->tool_channel, buffer, (unsigned)bytes);
    hrt_histogram_add(&link->sent.lay, now_ns() - posted->at_ns);
    link->sent.tools++;
}

static void send_status(hrt_link *link) {
    const hrt_status *s = &link->status[link->status_box.read];
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
                                        .can_errors = s->can_errors,
                                        .command_seq = (int32_t)atomic_load(&link->command_seq)};
    memcpy(m.force_N, s->force_N, sizeof m.force_N);
    memcpy(m.lateness_us, s->lateness_us, sizeof m.lateness_us);
    memcpy(m.duration_us, s->duration_us, sizeof m.duration_us);
    const int bytes = tensormass_controller_status_t_encode(buffer, 0, sizeof buffer, &m);
    if (bytes <= 0) return;
    app_seal(&link->key, link->status_channel, buffer, bytes);
    lcm_publish(link->lcm, link->status_channel, buffer, (unsigned)bytes);
}

static void *send_all(void *user) {
    hrt_link *link = user;
    while (!atomic_load(&link->stop)) {
        if (sem_wait(&link->wake) != 0) continue;
        if (collect(&link->tool_box)) send_tool(link);
        if (collect(&link->status_box)) send_status(link);
    }
    return NULL;
}

static void link_publish_tool(hrt_link *link, const hrt_tool_state *t) {
    struct posted_tool *slot = &link->tool[link->tool_box.write];
    slot->tool = *t;
    slot->at_ns = now_ns();
    if (post(&link->tool_box)) atomic_fetch_add(&link->skipped, 1);
    sem_post(&link->wake);
}

static void link_publish_status(hrt_link *link, const hrt_status *s) {
    link->status[link->status_box.write] = *s; /* its sentence is a constant of the core's */
    post(&link->status_box);
    sem_post(&link->wake);
}

/* ---------------------------------------------------------------------------------------------- opening, closing */

static void link_close(hrt_link *link, hrt_link_sent *sent) {
    atomic_store(&link->stop, true);
    sem_post(&link->wake);
    if (link->receives) pthread_join(link->receiving, NULL);
    if (link->sends) pthread_join(link->sending, NULL);
    if (sent) {
        *sent = link->sent;
        sent->skipped = atomic_load(&link->skipped);
    }
    app_receiver_close(link->receiver);
    if (link->lcm) lcm_destroy(link->lcm);
    sem_destroy(&link->wake);
    free(link);
}

static bool start(hrt_link *link, char *why, int why_size) {
    if (!listen_to(link, why, why_size)) return false;
    snprintf(
        why, (size_t)why_size,
        "LCM cannot open '%s'; for a multicast route on this machine alone type: ip link set lo up; ip route add 224.0.0.0/4 dev lo",
        link->def.url);
    if (link->def.node) {
        link->lcm = lcm_create(link->def.url);
        if (!link->lcm) return false;
        link->sends = pthread_create(&link->sending, NULL, send_all, link) == 0;
        if (!link->sends) return false;
    }
    link->receives = pthread_create(&link->receiving, NULL, receive, link) == 0;
    return link->receives;
}

static hrt_link *link_open(const hrt_link_def *def, char *why, int why_size) {
    hrt_link *link = calloc(1, sizeof *link);
    snprintf(why, (size_t)why_size, "no memory for messages; close other programs");
    if (!link) return NULL;
    link->def = *def;
    if (def->key) link->key = *def->key;
    link->tool_box = link->status_box = (letterbox){.between = 0, .write = 1, .read = 2};
    sem_init(&link->wake, 0, 0);
    snprintf(link->tool_channel, CHANNEL, "TOOL_%d", def->instrument);
    snprintf(link->status_channel, CHANNEL, "CONTROLLER_%d", def->instrument);
    if (start(link, why, why_size)) return link;
    link_close(link, NULL);
    return NULL;
}

static const hrt_link_counts *link_counts(const hrt_link *link) { return &link->counts; }
static const app_receiver_counts *link_packets(const hrt_link *link) { return app_receiver_counted(link->receiver); }

__attribute__((visibility("default"))) extern const hrt_link_api hrt_link_table;
const hrt_link_api hrt_link_table = {link_open,           link_close,  link_publish_tool,
                                     link_publish_status, link_counts, link_packets};
