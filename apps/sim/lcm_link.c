/* The module `lcm`: the one place of tm-sim that calls liblcm. */
#include <errno.h>
#include <fcntl.h>
#include <lcm/eventlog.h>
#include <lcm/lcm.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "lcm_link.h"
#include "wire.h"

enum { INSTRUMENTS = 2, CHANNEL_MAX = 64 };

struct sim_lcm {
    lcm_t *lcm;
    lcm_eventlog_t *log;
    bool failed;
    uint8_t *buffer;
    int capacity;
    struct heard {
        sim_lcm *link;
        int instrument;
        void (*tool)(void *, int, const tensormass_tool_state_t *);
        void (*controller)(void *, int, const tensormass_controller_status_t *);
        void *tool_user, *controller_user;
        tensormass_tool_state_t_subscription_t *subscription;
    } heard[INSTRUMENTS];
};

static sim_lcm *fail(sim_lcm *link, tm_error *error, const char *format, const char *what) {
    error->status = TM_ERR_FILE;
    snprintf(error->message, sizeof error->message, format, what);
    if (link && link->lcm) lcm_destroy(link->lcm);
    if (link && link->log) lcm_eventlog_destroy(link->log);
    free(link);
    return NULL;
}

static sim_lcm *link_open(const char *url, const char *log, tm_error *error) {
    sim_lcm *link = calloc(1, sizeof *link);
    if (!link) return fail(link, error, "out of memory for messages%s; close other programs", "");
    if (url) link->lcm = lcm_create(url);
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
    for (int i = 0; i < INSTRUMENTS; ++i)
        if (link->heard[i].subscription) tensormass_tool_state_t_unsubscribe(link->lcm, link->heard[i].subscription);
    if (link->lcm) lcm_destroy(link->lcm);
    if (link->log) {
        good = !fflush(link->log->f) && !ferror(link->log->f) && good;
        lcm_eventlog_destroy(link->log);
    }
    free(link->buffer);
    free(link);
    return good;
}

typedef struct codec {
    int (*size)(const void *);
    int (*encode)(void *, int, int, const void *);
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
    [SIM_FORCE] = {force_sample_t_size_any, force_sample_t_encode_any},
    [SIM_PATCH] = {contact_patch_t_size_any, contact_patch_t_encode_any},
    [SIM_TISSUE] = {tissue_t_size_any, tissue_t_encode_any},
    [SIM_CUT] = {cut_event_t_size_any, cut_event_t_encode_any},
    [SIM_STATUS] = {sim_status_t_size_any, sim_status_t_encode_any},
    [SIM_TOOL] = {tool_state_t_size_any, tool_state_t_encode_any},
    [SIM_CONTROLLER] = {controller_status_t_size_any, controller_status_t_encode_any},
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
    /* What a controller sends in lockstep goes into the log alone. */
    if (link->lcm && kind != SIM_TOOL && kind != SIM_CONTROLLER)
        lcm_publish(link->lcm, channel, link->buffer, (unsigned)bytes);
    if (link->log) write_event(link, channel, utime, link->buffer, bytes);
}

static void tool_came(const lcm_recv_buf_t *raw, const char *channel, const tensormass_tool_state_t *message,
                      void *user) {
    struct heard *h = user;
    if (h->link->log) write_event(h->link, channel, raw->recv_utime, raw->data, (int)raw->data_size);
    h->tool(h->tool_user, h->instrument, message);
}

/* Generated decoders believe the lengths of strings; a foreign message must not end the simulation. */
static void controller_came(const lcm_recv_buf_t *raw, const char *channel, void *user) {
    struct heard *h = user;
    char none[] = "";
    tensormass_controller_status_t m = {.fault_text = none, .extrapolator = none};
    int size = (int)raw->data_size;
    if (!app_wire_sound_head("26.s4.s", 30, 2, tensormass_controller_status_t_encoded_size(&m), raw->data, size))
        return;
    if (h->link->log) write_event(h->link, channel, raw->recv_utime, raw->data, size);
    if (tensormass_controller_status_t_decode(raw->data, 0, size, &m) != size) return;
    h->controller(h->controller_user, h->instrument, &m);
    tensormass_controller_status_t_decode_cleanup(&m);
}

static void link_on_tool(sim_lcm *link, int instrument, void (*take)(void *, int, const tensormass_tool_state_t *),
                         void *user) {
    char channel[CHANNEL_MAX];
    struct heard *h = &link->heard[instrument];
    h->link = link;
    h->instrument = instrument;
    h->tool = take;
    h->tool_user = user;
    snprintf(channel, sizeof channel, "TOOL_%d", instrument);
    h->subscription = tensormass_tool_state_t_subscribe(link->lcm, channel, tool_came, h);
    if (h->subscription) tensormass_tool_state_t_subscription_set_queue_capacity(h->subscription, 100);
}

static void link_on_controller(sim_lcm *link, int instrument,
                               void (*take)(void *, int, const tensormass_controller_status_t *), void *user) {
    char channel[CHANNEL_MAX];
    struct heard *h = &link->heard[instrument];
    h->link = link;
    h->instrument = instrument;
    h->controller = take;
    h->controller_user = user;
    snprintf(channel, sizeof channel, "CONTROLLER_%d", instrument);
    lcm_subscribe(link->lcm, channel, controller_came, h);
}

static void link_receive(sim_lcm *link, int64_t wait_us) {
    struct pollfd fd = {.fd = lcm_get_fileno(link->lcm), .events = POLLIN};
    struct timespec wait = {wait_us / 1000000, wait_us % 1000000 * 1000};
    /* One message a call of lcm_handle; a flood is left for the next frame. */
    for (int i = 0; i < 256 && ppoll(&fd, 1, &wait, NULL) > 0; ++i) {
        if (lcm_handle(link->lcm)) return;
        wait = (struct timespec){0, 0};
    }
}

__attribute__((visibility("default"))) const sim_lcm_api sim_lcm_functions = {
    link_open, link_close, link_on_tool, link_on_controller, link_send, link_receive,
};
