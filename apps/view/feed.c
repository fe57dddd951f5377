#include "feed.h"

#include <lcm/eventlog.h>
#include <lcm/lcm.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/time.h>
#include <time.h>

#include "intake.h"
#include "lcm_types/tensormass_controller_command_t.h"
#include "lcm_types/tensormass_hand_command_t.h"

struct view_feed {
    view_intake intake;
    lcm_eventlog_t *log;
    lcm_eventlog_event_t *pending; /* read, but not yet due */
    int64_t begin_us;              /* of the first tissue (log), or of opening (live) */
    lcm_t *lcm;
    view_picture *picture; /* of the call under way */
    int32_t hand_seq, command_seq;
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
    if (feed->pending) lcm_eventlog_free_event(feed->pending);
    if (feed->log) lcm_eventlog_destroy(feed->log);
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

/* True if the file goes on after its last whole event. */
static bool rest_left(lcm_eventlog_t *log, long whole) {
    if (fseek(log->f, 0, SEEK_END)) return true;
    return ftell(log->f) != whole;
}

static void read_facts(view_feed *feed, view_log_facts *facts) {
    view_picture scratch;
    memset(&scratch, 0, sizeof scratch);
    view_intake intake;
    view_intake_begin(&intake);
    int64_t last_us = 0;
    long whole = 0;
    lcm_eventlog_event_t *event;
    while ((event = lcm_eventlog_read_next_event(feed->log))) {
        whole = ftell(feed->log->f);
        ++facts->events;
        if (!strcmp(event->channel, "TISSUE")) {
            if (!facts->tissues++) feed->begin_us = event->timestamp;
            last_us = event->timestamp;
        } else if (!strcmp(event->channel, "SIM_STATUS"))
            view_intake_message(&intake, &scratch, 0, event->channel, event->data, event->datalen);
        lcm_eventlog_free_event(event);
        const view_trace *t = &scratch.trace;
        if (t->count)
            for (int i = 0; i < VIEW_INSTRUMENTS; ++i)
                facts->peak_force_N =
                    fmax(facts->peak_force_N, (double)t->force_N[i][(t->next + VIEW_TRACE - 1) % VIEW_TRACE]);
    }
    facts->damaged = rest_left(feed->log, whole);
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
    feed->log = lcm_eventlog_create(path, "r");
    if (feed->log) read_facts(feed, facts);
    if (!feed->log || !facts->tissues || fseek(feed->log->f, 0, SEEK_SET)) {
        feed_close(feed);
        return failed(error, TM_ERR_FILE,
                      "holds no TISSUE message%s; record a running tm-sim --realtime with lcm-logger", "");
    }
    *out = feed;
    return TM_OK;
}

static bool advance(view_feed *feed, double time_s, view_picture *picture) {
    for (;;) {
        if (!feed->pending) feed->pending = lcm_eventlog_read_next_event(feed->log);
        if (!feed->pending) break;
        double at_s = (double)(feed->pending->timestamp - feed->begin_us) * 1e-6;
        if (at_s > time_s) break;
        view_intake_message(&feed->intake, picture, at_s, feed->pending->channel, feed->pending->data,
                            feed->pending->datalen);
        lcm_eventlog_free_event(feed->pending);
        feed->pending = NULL;
    }
    view_intake_age(&feed->intake, picture, time_s);
    return feed->pending != NULL;
}

static double live_s(const view_feed *feed) { return (double)(clock_us(CLOCK_MONOTONIC) - feed->begin_us) * 1e-6; }

static void on_message(const lcm_recv_buf_t *buffer, const char *channel, void *user) {
    view_feed *feed = user;
    view_intake_message(&feed->intake, feed->picture, live_s(feed), channel, buffer->data, (int)buffer->data_size);
}

static tm_status open_live(const char *url, view_feed **out, tm_error *error) {
    view_feed *feed = calloc(1, sizeof *feed);
    if (!feed) return failed(error, TM_ERR_MEMORY, "no memory%s", "");
    view_intake_begin(&feed->intake);
    feed->begin_us = clock_us(CLOCK_MONOTONIC);
    feed->lcm = lcm_create(url);
    if (!feed->lcm) {
        feed_close(feed);
        return failed(
            error, TM_ERR_FILE,
            "LCM cannot be opened at %s: usually no multicast route; "
            "run `ip link set lo up; ip route add 224.0.0.0/4 dev lo` as root, or see docs/troubleshooting.md",
            url ? url : "its default URL");
    }
    /* A viewer wants the newest; what it cannot draw in time it does not want. */
    lcm_subscription_set_queue_capacity(lcm_subscribe(feed->lcm, "TISSUE", on_message, feed), 2);
    lcm_subscribe(feed->lcm, "SIM_STATUS", on_message, feed);
    lcm_subscribe(feed->lcm, "CONTROLLER_[01]", on_message, feed);
    *out = feed;
    return TM_OK;
}

static bool listen_live(view_feed *feed, int timeout_ms, view_picture *picture) {
    feed->picture = picture;
    int64_t until_us = clock_us(CLOCK_MONOTONIC) + (int64_t)timeout_ms * 1000;
    int got = 1;
    while (got > 0) {
        int64_t left_us = until_us - clock_us(CLOCK_MONOTONIC);
        got = lcm_handle_timeout(feed->lcm, left_us > 0 ? (int)(left_us / 1000) : 0);
        if (left_us <= -100000) break; /* a flood must not keep the picture from being drawn */
    }
    view_intake_age(&feed->intake, picture, live_s(feed));
    return got >= 0;
}

static view_feed_counts feed_counts(const view_feed *feed) { return feed->intake.counts; }

static bool send_hand(view_feed *feed, const view_hand *hand) {
    tensormass_hand_command_t m = {.utime = clock_us(CLOCK_REALTIME),
                                   .seq = feed->hand_seq++,
                                   .instrument = (int8_t)hand->instrument,
                                   .active = hand->active};
    memcpy(m.joint, hand->joint, sizeof m.joint);
    char channel[16];
    snprintf(channel, sizeof channel, "HAND_%d", hand->instrument);
    return tensormass_hand_command_t_publish(feed->lcm, channel, &m) == 0;
}

static bool send_command(view_feed *feed, const view_command *command) {
    char extrapolator[24], channel[32];
    snprintf(extrapolator, sizeof extrapolator, "%s", command->extrapolator);
    tensormass_controller_command_t m = {.utime = clock_us(CLOCK_REALTIME),
                                         .seq = feed->command_seq++,
                                         .instrument = (int8_t)command->instrument,
                                         .extrapolator = extrapolator,
                                         .passivity = (int8_t)command->passivity,
                                         .reset_fault = command->reset_fault};
    snprintf(channel, sizeof channel, "CONTROLLER_COMMAND_%d", command->instrument);
    return tensormass_controller_command_t_publish(feed->lcm, channel, &m) == 0;
}

__attribute__((visibility("default"))) extern const view_feed_api view_messages;
const view_feed_api view_messages = {open_log,    open_live,   feed_close, advance,
                                     listen_live, feed_counts, send_hand,  send_command};
