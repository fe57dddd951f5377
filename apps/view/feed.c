#include "feed.h"

#include <lcm/lcm.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/time.h>
#include <time.h>

#include "event_log.h"
#include "inbox.h"
#include "intake.h"
#include "lcm_types/tensormass_controller_command_t.h"
#include "lcm_types/tensormass_controller_status_t.h"
#include "lcm_types/tensormass_hand_command_t.h"
#include "seal.h"
#include "wire.h"

struct view_feed {
    view_intake intake;
    app_log *log;
    const app_log_event *pending; /* read, but not yet due */
    int64_t begin_us;             /* of the first tissue (log), or of opening (live) */
    view_inbox *inbox;
    lcm_t *lcm; /* for sending */
    app_key key;
    int64_t session; /* ours, for hand commands */
    int32_t hand_seq;
    struct commanded {
        int64_t session;     /* of the controller, as it said last */
        int32_t command_seq; /* the newest that it took, or that was sent to it */
    } commanded[VIEW_INSTRUMENTS];
};

static tm_status failed(tm_error *error, tm_status status, const char *format, const char *name) {
    if (error) {
        error->status = status, error->entity = -1;
        snprintf(error->message, sizeof error->message, format, name);
    }
    return status;
}

static int64_t clock_us(clockid_t clock) {
    struct timespec now;
    clock_gettime(clock, &now);
    return (int64_t)now.tv_sec * 1000000 + now.tv_nsec / 1000;
}

static void feed_close(view_feed *feed) {
    if (!feed) return;
    app_log_close(feed->log);
    view_inbox_close(feed->inbox);
    if (feed->lcm) lcm_destroy(feed->lcm);
    free(feed);
}

/* LCM's reader hunts through any file for something like an event; a log begins with one. */
static bool begins_like_log(const char *path) {
    uint8_t head[4] = {0};
    FILE *file = fopen(path, "rb");
    bool good = file && fread(head, 1, 4, file) == 4 && head[0] == 0xed && head[1] == 0xa1 && head[2] == 0xda &&
                head[3] == 0x01;
    if (file) fclose(file);
    return good;
}

static void read_facts(view_feed *feed, view_log_facts *facts) {
    view_picture scratch;
    memset(&scratch, 0, sizeof scratch);
    view_intake intake;
    view_intake_begin(&intake);
    int64_t last_us = 0;
    const app_log_event *event;
    while ((event = app_log_next(feed->log))) {
        facts->events++;
        if (!strcmp(event->channel, "TISSUE")) {
            if (!facts->tissues++) feed->begin_us = event->timestamp;
            last_us = event->timestamp;
        } else if (!strcmp(event->channel, "SIM_STATUS"))
            view_intake_message(&intake, &scratch, 0, event->channel, event->data, event->size);
        const view_trace *t = &scratch.trace;
        if (t->count)
            for (int i = 0; i < VIEW_INSTRUMENTS; i++)
                facts->peak_force_N =
                    fmax(facts->peak_force_N, (double)t->force_N[i][(t->next + VIEW_TRACE - 1) % VIEW_TRACE]);
    }
    facts->damaged = app_log_damaged(feed->log);
    facts->seconds = facts->tissues ? (double)(last_us - feed->begin_us) * 1e-6 : 0;
}

static tm_status open_log(const char *path, view_feed **out, view_log_facts *facts, tm_error *error) {
    memset(facts, 0, sizeof *facts);
    FILE *file = fopen(path, "rb");
    if (!file)
        return failed(error, TM_ERR_FILE, "cannot be read (%s); give the path of an LCM log",
                      "no such file, or no permission");
    fclose(file);
    if (!begins_like_log(path))
        return failed(error, TM_ERR_FILE,
                      "is no LCM log (it does not begin with an event)%s; record one with lcm-logger", "");
    view_feed *feed = calloc(1, sizeof *feed);
    if (!feed) return failed(error, TM_ERR_MEMORY, "no memory%s", "");
    view_intake_begin(&feed->intake);
    feed->log = app_log_open(path);
    if (feed->log) read_facts(feed, facts);
    if (!feed->log || !facts->tissues || !app_log_rewind(feed->log)) {
        feed_close(feed);
        return failed(error, TM_ERR_FILE,
                      "holds no TISSUE message%s; record a running tm-sim --realtime with lcm-logger", "");
    }
    *out = feed;
    return TM_OK;
}

static bool advance(view_feed *feed, double time_s, view_picture *picture) {
    for (;;) {
        if (!feed->pending) feed->pending = app_log_next(feed->log);
        if (!feed->pending) break;
        double at_s = (double)(feed->pending->timestamp - feed->begin_us) * 1e-6;
        if (at_s > time_s) break;
        view_intake_message(&feed->intake, picture, at_s, feed->pending->channel, feed->pending->data,
                            feed->pending->size);
        feed->pending = NULL;
    }
    view_intake_age(&feed->intake, picture, time_s);
    return feed->pending != NULL;
}

static double live_s(const view_feed *feed) { return (double)(clock_us(CLOCK_MONOTONIC) - feed->begin_us) * 1e-6; }

/* Whom a command is for, and what it must come after. */
static void note_controller(view_feed *feed, int i, const view_letter *letter) {
    char none[] = "";
    tensormass_controller_status_t m = {.fault_text = none, .extrapolator = none};
    if (!app_wire_sound_head("26.s4.s", 30, 2, tensormass_controller_status_t_encoded_size(&m), letter->data,
                             letter->size) ||
        tensormass_controller_status_t_decode(letter->data, 0, letter->size, &m) != letter->size)
        return;
    struct commanded *c = &feed->commanded[i];
    if (c->session != m.session || (int32_t)((uint32_t)m.command_seq - (uint32_t)c->command_seq) > 0)
        *c = (struct commanded){m.session, m.command_seq};
    tensormass_controller_status_t_decode_cleanup(&m);
}

static void take_letter(view_feed *feed, view_picture *picture, const view_letter *letter) {
    bool sealed = strcmp(letter->channel, "TISSUE") != 0;
    if (sealed && !app_sealed(&feed->key, letter->channel, letter->data, letter->size)) {
        feed->intake.counts.rejected++;
        snprintf(feed->intake.counts.why, sizeof feed->intake.counts.why, "%s: without the key's tag", letter->channel);
        return;
    }
    if (!strncmp(letter->channel, "CONTROLLER_", 11)) note_controller(feed, letter->channel[11] - '0', letter);
    view_intake_message(&feed->intake, picture, live_s(feed), letter->channel, letter->data, letter->size);
}

static tm_status open_live(const char *url, const view_live_key *key, view_feed **out, tm_error *error) {
    char why[400];
    const char *set = getenv("LCM_DEFAULT_URL");
    view_feed *feed = calloc(1, sizeof *feed);
    if (!feed) return failed(error, TM_ERR_MEMORY, "no memory%s", "");
    if (!url) url = set && *set ? set : "udpm://239.255.76.67:7667?ttl=0";
    view_intake_begin(&feed->intake);
    feed->begin_us = clock_us(CLOCK_MONOTONIC);
    if (getrandom(&feed->session, sizeof feed->session, 0) < 0) feed->session = feed->begin_us;
    if (!app_key_for(url, key->path, key->none, &feed->key, why, sizeof why)) {
        feed_close(feed);
        return failed(error, TM_ERR_ARGUMENT, "%s", why);
    }
    feed->lcm = lcm_create(url);
    if (feed->lcm) feed->inbox = view_inbox_open(url, why, sizeof why);
    if (!feed->inbox) {
        feed_close(feed);
        return failed(
            error, TM_ERR_FILE,
            "LCM cannot be opened at %s: usually no multicast route; "
            "run `ip link set lo up; ip route add 224.0.0.0/4 dev lo` as root, or see docs/troubleshooting.md",
            url);
    }
    *out = feed;
    return TM_OK;
}

static bool listen_live(view_feed *feed, int timeout_ms, view_picture *picture) {
    int64_t until_us = clock_us(CLOCK_MONOTONIC) + (int64_t)timeout_ms * 1000;
    for (;;) {
        int64_t left_us = until_us - clock_us(CLOCK_MONOTONIC);
        view_letter *letter = view_inbox_take(feed->inbox, left_us > 0 ? (int)(left_us / 1000) : 0);
        if (!letter) break;
        take_letter(feed, picture, letter);
        free(letter);
        if (left_us <= -100000) break; /* a flood must not keep the picture from being drawn */
    }
    view_intake_age(&feed->intake, picture, live_s(feed));
    return true;
}

static view_feed_counts feed_counts(const view_feed *feed) { return feed->intake.counts; }

enum { MESSAGE = 512 };

static bool send(view_feed *feed, const char *channel, uint8_t *bytes, int size) {
    if (size <= 0) return false;
    app_seal(&feed->key, channel, bytes, size);
    return lcm_publish(feed->lcm, channel, bytes, (unsigned)size) == 0;
}

static bool send_hand(view_feed *feed, const view_hand *hand) {
    tensormass_hand_command_t m = {.utime = clock_us(CLOCK_REALTIME),
                                   .seq = ++feed->hand_seq,
                                   .session = feed->session,
                                   .instrument = (int8_t)hand->instrument,
                                   .active = hand->active};
    memcpy(m.joint, hand->joint, sizeof m.joint);
    char channel[16];
    uint8_t bytes[MESSAGE];
    snprintf(channel, sizeof channel, "HAND_%d", hand->instrument);
    return send(feed, channel, bytes, tensormass_hand_command_t_encode(bytes, 0, sizeof bytes, &m));
}

static bool send_command(view_feed *feed, const view_command *command) {
    char extrapolator[24], channel[32];
    snprintf(extrapolator, sizeof extrapolator, "%s", command->extrapolator);
    tensormass_controller_command_t m = {.utime = clock_us(CLOCK_REALTIME),
                                         .seq = ++feed->commanded[command->instrument].command_seq,
                                         .session = feed->commanded[command->instrument].session,
                                         .instrument = (int8_t)command->instrument,
                                         .extrapolator = extrapolator,
                                         .passivity = (int8_t)command->passivity,
                                         .reset_fault = command->reset_fault};
    uint8_t bytes[MESSAGE];
    snprintf(channel, sizeof channel, "CONTROLLER_COMMAND_%d", command->instrument);
    return send(feed, channel, bytes, tensormass_controller_command_t_encode(bytes, 0, sizeof bytes, &m));
}

__attribute__((visibility("default"))) extern const view_feed_api view_messages;
const view_feed_api view_messages = {open_log,    open_live,   feed_close, advance,
                                     listen_live, feed_counts, send_hand,  send_command};
