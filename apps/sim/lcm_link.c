/* The module `lcm`: messages in through lcm_types/receiver.h, out through liblcm. */
#include <errno.h>
#include <fcntl.h>
#include <lcm/eventlog.h>
#include <lcm/lcm.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "lcm_link.h"
#include "receiver.h"
#include "wire.h"

enum { INSTRUMENTS = 2, KINDS = 2, TEXT_MESSAGE = 4096 };

struct sim_lcm {
    lcm_t *lcm; /* for sending */
    app_receiver *receiver;
    char *url;
    app_key key;
    int64_t session;
    lcm_eventlog_t *log;
    bool failed;
    uint8_t *buffer;
    int capacity;
    sim_listener listener;
    struct heard {
        sim_lcm *link;
        int instrument;
        app_replay tools, statuses;
    } heard[INSTRUMENTS];
    sim_refused refused;
};

static sim_lcm *fail(sim_lcm *link, tm_error *error, const char *format, const char *what) {
    error->status = TM_ERR_FILE;
    snprintf(error->message, sizeof error->message, format, what);
    if (link && link->lcm) lcm_destroy(link->lcm);
    if (link && link->log) lcm_eventlog_destroy(link->log);
    if (link) free(link->url);
    free(link);
    return NULL;
}

static sim_lcm *link_open(const char *url, const char *log, const app_key *key, int64_t session, tm_error *error) {
    sim_lcm *link = calloc(1, sizeof *link);
    if (!link) return fail(link, error, "out of memory for messages%s; close other programs", "");
    link->key = *key;
    link->session = session;
    if (url) link->lcm = lcm_create(url);
    if (url) link->url = strdup(url);
    if (url && !link->lcm)
        return fail(link, error,
                    "LCM cannot open '%s'; for a multicast route on this machine alone type: ip link set lo up; ip "
                    "route add 224.0.0.0/4 dev lo",
                    url);
    if (log) link->log = lcm_eventlog_create(log, "w");
    if (log && !link->log) return fail(link, error, "the log %s cannot be written; choose another place", log);
    return link;
}

static bool link_close(sim_lcm *link) {
    bool good = !link->failed;
    app_receiver_close(link->receiver);
    if (link->lcm) lcm_destroy(link->lcm);
    if (link->log) {
        good = !fflush(link->log->f) && !ferror(link->log->f) && good;
        lcm_eventlog_destroy(link->log);
    }
    free(link->buffer);
    free(link->url);
    free(link);
    return good;
}

typedef struct codec {
    int (*size)(const void *);
    int (*encode)(void *, int, int, const void *);
    bool sealed; /* ends with a tag */
} codec;

#define CODEC(type)                                                                                                    \
    static int type##_size_any(const void *m) { return tensormass_##type##_encoded_size(m); }                          \
    static int type##_encode_any(void *b, int o, int n, const void *m) {                                               \
        return tensormass_##type##_encode(b, o, n, m);                                                                 \
    }
CODEC(force_sample_t)
CODEC(contact_patch_t)
CODEC(tissue_t)
CODEC(cut_event_t)
CODEC(sim_status_t)
CODEC(tool_state_t)
CODEC(controller_status_t)

static const codec codecs[SIM_MESSAGE_COUNT] = {
    [SIM_FORCE] = {force_sample_t_size_any, force_sample_t_encode_any, true},
    [SIM_PATCH] = {contact_patch_t_size_any, contact_patch_t_encode_any, true},
    [SIM_TISSUE] = {tissue_t_size_any, tissue_t_encode_any, false},
    [SIM_CUT] = {cut_event_t_size_any, cut_event_t_encode_any, false},
    [SIM_STATUS] = {sim_status_t_size_any, sim_status_t_encode_any, true},
    [SIM_TOOL] = {tool_state_t_size_any, tool_state_t_encode_any, true},
    [SIM_CONTROLLER] = {controller_status_t_size_any, controller_status_t_encode_any, true},
};

static void write_event(sim_lcm *link, const char *channel, int64_t utime, void *data, int bytes) {
    lcm_eventlog_event_t event = {.timestamp = utime,
                                  .channellen = (int32_t)strlen(channel),
                                  .datalen = bytes,
                                  .channel = (char *)(uintptr_t)channel,
                                  .data = data};
    if (lcm_eventlog_write_event(link->log, &event)) link->failed = true;
}

static void link_send(sim_lcm *link, sim_message kind, const char *channel, int64_t utime, const void *message) {
    int bytes = codecs[kind].size(message);
    if (bytes > link->capacity) {
        uint8_t *larger = realloc(link->buffer, 2 * (size_t)bytes);
        if (!larger) return;
        link->buffer = larger;
        link->capacity = 2 * bytes;
    }
    if (codecs[kind].encode(link->buffer, 0, bytes, message) != bytes) return;
    if (codecs[kind].sealed) app_seal(&link->key, channel, link->buffer, bytes);
    /* What a controller sends in lockstep goes into the log alone. */
    if (link->lcm && kind != SIM_TOOL && kind != SIM_CONTROLLER)
        lcm_publish(link->lcm, channel, link->buffer, (unsigned)bytes);
    if (link->log) write_event(link, channel, utime, link->buffer, bytes);
}

static bool refuse(int64_t *counter) {
    ++*counter;
    return false;
}

/* Sealed, and not heard before. */
static bool genuine(sim_lcm *link, const char *channel, const void *data, int size) {
    return app_sealed(&link->key, channel, data, size) || refuse(&link->refused.forged);
}

/* With a key a tool answers this very simulation, and once: recorded ones never fit. */
static void tool_came(void *user, const char *channel, int64_t utime, const void *data, int size) {
    struct heard *h = user;
    sim_lcm *link = h->link;
    tensormass_tool_state_t m = {0};
    if (!genuine(link, channel, data, size)) return;
    if (size != tensormass_tool_state_t_encoded_size(&m) || tensormass_tool_state_t_decode(data, 0, size, &m) != size) {
        refuse(&link->refused.malformed);
        return;
    }
    if (link->key.known &&
        (m.sim_session != link->session || !app_replay_fresh(&h->tools, m.session, (uint32_t)m.seq))) {
        if (m.sim_session != 0) refuse(&link->refused.forged); /* 0: it has not heard us yet */
        return;
    }
    if (link->log) write_event(link, channel, utime, (void *)(uintptr_t)data, size);
    link->listener.tool(link->listener.user, h->instrument, &m);
}

/* Generated decoders believe the lengths of strings; a foreign message must not end the simulation. */
static void controller_came(void *user, const char *channel, int64_t utime, const void *data, int size) {
    struct heard *h = user;
    sim_lcm *link = h->link;
    char none[] = "";
    tensormass_controller_status_t m = {.fault_text = none, .extrapolator = none};
    if (!genuine(link, channel, data, size)) return;
    if (!app_wire_sound_head("26.s4.s", 30, 2, tensormass_controller_status_t_encoded_size(&m), data, size) ||
        tensormass_controller_status_t_decode(data, 0, size, &m) != size) {
        refuse(&link->refused.malformed);
        return;
    }
    if (!link->key.known || app_replay_fresh(&h->statuses, m.session, (uint32_t)m.seq)) {
        if (link->log) write_event(link, channel, utime, (void *)(uintptr_t)data, size);
        link->listener.controller(link->listener.user, h->instrument, &m);
    } else
        refuse(&link->refused.forged);
    tensormass_controller_status_t_decode_cleanup(&m);
}

static bool link_listen(sim_lcm *link, int instruments, const sim_listener *listener, tm_error *error) {
    app_channel channel[KINDS * INSTRUMENTS];
    char name[KINDS * INSTRUMENTS][APP_CHANNEL_NAME];
    const tensormass_tool_state_t tool = {0};
    link->listener = *listener;
    int count = 0;
    for (int i = 0; i < instruments && i < INSTRUMENTS; i++) {
        struct heard *h = &link->heard[i];
        h->link = link;
        h->instrument = i;
        snprintf(name[count], sizeof name[count], "TOOL_%d", i);
        channel[count] = (app_channel){name[count], tensormass_tool_state_t_encoded_size(&tool), tool_came, h};
        count++;
        snprintf(name[count], sizeof name[count], "CONTROLLER_%d", i);
        channel[count] = (app_channel){name[count], TEXT_MESSAGE, controller_came, h};
        count++;
    }
    link->receiver = app_receiver_open(link->url, channel, count, error->message, sizeof error->message);
    if (!link->receiver) error->status = TM_ERR_FILE;
    return link->receiver != NULL;
}

/* A flood is left for the next frame. */
static void link_receive(sim_lcm *link, int64_t wait_us) { app_receiver_receive(link->receiver, wait_us, 1024); }

static sim_refused link_refused(const sim_lcm *link) {
    sim_refused all = link->refused;
    if (!link->receiver) return all;
    const app_receiver_counts *packets = app_receiver_counted(link->receiver);
    all.packets = atomic_load(&packets->malformed) + atomic_load(&packets->oversized);
    all.foreign = atomic_load(&packets->foreign);
    return all;
}

__attribute__((visibility("default"))) const sim_lcm_api sim_lcm_functions = {
    link_open, link_close, link_listen, link_send, link_receive, link_refused,
};
