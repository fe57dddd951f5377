#include "message_source.h"

#include <errno.h>
#include <malloc.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>

#include "clock.h"
#include "inbox.h"
#include "io/network.h"
#include "message_validation.h"

enum { TOPICS = 2 + VIEW_INSTRUMENTS };

struct view_feed {
    view_intake intake;
    app_link *link;
    view_inbox *inbox;        /* null: a log */
    int trims, small_tissues; /* remaining calls that return memory to the system; tissues since the last large one */
    int64_t begin_us;         /* time of the first tissue (log), or of opening (live) */
    /* Destination of messages that are read now, with the picture's time. */
    view_picture *picture;
    double time_s;
    int64_t session; /* session of this program, for hand commands */
    int32_t hand_seq;
    struct commanded {
        int64_t session;     /* last session that the controller reported */
        int32_t command_seq; /* the newest command that it accepted or that was sent to it */
    } commanded[VIEW_INSTRUMENTS];
};

void view_feed_close(view_feed *feed) {
    if (!feed) return;
    view_inbox_close(feed->inbox);
    app_link_close(feed->link);
    free(feed);
}

/* --- handlers of messages --- */

static app_verdict read_tissue(void *user, int instrument, int64_t utime, const void *message) {
    (void)instrument, (void)utime;
    view_feed *feed = user;
    view_intake_tissue(&feed->intake, feed->picture, feed->time_s, message);
    return APP_TAKEN;
}

static app_verdict read_status(void *user, int instrument, int64_t utime, const void *message) {
    (void)instrument, (void)utime;
    view_feed *feed = user;
    view_intake_status(&feed->intake, feed->picture, feed->time_s, message);
    return APP_TAKEN;
}

/* Also records the receiver of a command and the sequence number that it must exceed. */
static app_verdict read_controller(void *user, int instrument, int64_t utime, const void *message) {
    (void)utime;
    view_feed *feed = user;
    const tensormass_controller_status_t *m = message;
    struct commanded *c = &feed->commanded[instrument];
    if (c->session != m->session || (int32_t)((uint32_t)m->command_seq - (uint32_t)c->command_seq) > 0)
        *c = (struct commanded){m->session, m->command_seq};
    view_intake_controller(&feed->intake, feed->picture, feed->time_s, instrument, m);
    return APP_TAKEN;
}

/* Returns memory to the system. A large tissue leaves a heap of small free blocks (lcm decodes row by row), and so do
 * its derived pictures. This is repeated while tissues are small again, because pictures are derived later. */
static void give_memory_back(view_feed *feed, int size) {
    enum { LARGE = 1 << 20, EVERY = 20, TIMES = 16 };
    if (size > LARGE) feed->trims = TIMES, feed->small_tissues = 0;
    if (size > LARGE || !feed->trims || ++feed->small_tissues % EVERY) return;
    feed->trims--;
    malloc_trim(0);
}

/* Reads a message as received or as logged. */
static void read_bytes(view_feed *feed, const char *channel, int64_t utime, const void *bytes, int size) {
    app_message_kind kind;
    int instrument;
    const app_link_counts *c = app_link_counted(feed->link);
    const int64_t malformed = atomic_load(&c->malformed), forged = atomic_load(&c->forged);
    app_link_give(feed->link, channel, utime, bytes, size);
    if (!strcmp(channel, "TISSUE")) give_memory_back(feed, size);
    if (atomic_load(&c->malformed) != malformed && app_channel_find(channel, &kind, &instrument))
        view_intake_refuse(&feed->intake, channel, "not a complete %s of this version", app_message_type(kind));
    if (atomic_load(&c->forged) != forged) view_intake_refuse(&feed->intake, channel, "without the key's tag");
}

static view_feed *feed_new(app_topic topic[TOPICS]) {
    view_feed *feed = calloc(1, sizeof *feed);
    if (!feed) return NULL;
    view_intake_begin(&feed->intake);
    topic[0] = (app_topic){APP_TISSUE, 0, read_tissue, feed};
    topic[1] = (app_topic){APP_SIM_STATUS, 0, read_status, feed};
    for (int i = 0; i < VIEW_INSTRUMENTS; i++) topic[2 + i] = (app_topic){APP_CONTROLLER, i, read_controller, feed};
    return feed;
}

/* --- a log --- */

/* Returns whether a file begins with an event. LCM's reader would search any file for something similar. */
static bool begins_like_log(const char *path) {
    uint8_t head[4] = {0};
    FILE *file = fopen(path, "rb");
    bool good = file && fread(head, 1, 4, file) == 4 && head[0] == 0xed && head[1] == 0xa1 && head[2] == 0xda &&
                head[3] == 0x01;
    if (file) fclose(file);
    return good;
}

/* Facts from one pass through the log. */
typedef struct survey {
    view_feed *feed;
    view_log_facts *facts;
    int64_t last_us;
} survey;

static void survey_event(void *user, const char *channel, int64_t utime, const void *bytes, int size) {
    survey *v = user;
    const view_trace *t = &v->feed->picture->trace;
    v->facts->events++;
    if (!strcmp(channel, "TISSUE")) {
        if (!v->facts->tissues++) v->feed->begin_us = utime;
        v->last_us = utime;
    } else if (!strcmp(channel, "SIM_STATUS"))
        app_link_give(v->feed->link, channel, utime, bytes, size);
    if (t->count)
        for (int i = 0; i < VIEW_INSTRUMENTS; i++)
            v->facts->peak_force_N =
                fmax(v->facts->peak_force_N, (double)t->force_N[i][(t->next + VIEW_TRACE - 1) % VIEW_TRACE]);
}

/* Returns false if it cannot be opened: memory is exhausted, since the file was recognised as a log before. */
static bool read_facts(view_feed *feed, const char *path, app_link_def *def, view_log_facts *facts) {
    static view_picture scratch;
    survey v = {.feed = feed, .facts = facts};
    memset(&scratch, 0, sizeof scratch);
    feed->picture = &scratch;
    def->keep = survey_event;
    def->user = &v;
    feed->link = app_link_read_log(path, def);
    if (!feed->link) return false;
    while (app_link_receive(feed->link, 0, 1024) > 0) {
    }
    facts->damaged = app_link_damaged(feed->link);
    facts->seconds = facts->tissues ? (double)(v.last_us - feed->begin_us) * 1e-6 : 0;
    app_link_close(feed->link);
    feed->link = NULL;
    view_intake_begin(&feed->intake);
    return true;
}

static void log_event(void *user, const char *channel, int64_t utime, const void *bytes, int size) {
    view_feed *feed = user;
    feed->time_s = (double)(utime - feed->begin_us) * 1e-6;
    read_bytes(feed, channel, utime, bytes, size);
}

tm_status view_feed_open_log(const char *path, view_feed **out, view_log_facts *facts, tm_error *error) {
    memset(facts, 0, sizeof *facts);
    FILE *file = fopen(path, "rb");
    if (!file)
        return tm_fail(error, TM_ERR_FILE, -1, "cannot be read: %s; give the path of an LCM log", strerror(errno));
    fclose(file);
    if (!begins_like_log(path))
        return tm_fail(error, TM_ERR_FILE, -1,
                       "is not an LCM log (it does not begin with an event)%s; record one with lcm-logger", "");
    app_topic topic[TOPICS];
    view_feed *feed = feed_new(topic);
    if (!feed) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for received messages; close other programs");
    app_link_def def = {.topic = topic, .topics = TOPICS};
    bool readable = read_facts(feed, path, &def, facts);
    if (readable && facts->tissues > 0) {
        def.keep = log_event;
        def.user = feed;
        feed->link = app_link_read_log(path, &def);
        readable = feed->link != NULL;
    }
    if (feed->link) {
        *out = feed;
        return TM_OK;
    }
    view_feed_close(feed);
    if (!readable) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory to read it; close other programs");
    return tm_fail(error, TM_ERR_FILE, -1,
                   "contains no TISSUE message%s; record a running tm-sim --realtime with lcm-logger", "");
}

bool view_feed_advance(view_feed *feed, double time_s, view_picture *picture) {
    feed->picture = picture;
    while (app_link_next_utime(feed->link) < INT64_MAX &&
           (double)(app_link_next_utime(feed->link) - feed->begin_us) * 1e-6 <= time_s)
        app_link_receive(feed->link, 0, 1);
    view_intake_age(&feed->intake, picture, time_s);
    return app_link_next_utime(feed->link) < INT64_MAX;
}

/* --- live --- */

static double live_s(const view_feed *feed) { return (double)(app_clock_us(CLOCK_MONOTONIC) - feed->begin_us) * 1e-6; }

static bool connect(view_feed *feed, app_network_opener *network, const char *url, app_link_def *def) {
    char why[400];
    feed->inbox = view_inbox_create();
    def->keep = view_inbox_store;
    def->user = feed->inbox;
    if (feed->inbox) feed->link = network(url, def, why, sizeof why);
    return feed->link && view_inbox_start(feed->inbox, feed->link);
}

tm_status view_feed_open_live(const char *url, const view_live_key *key, view_feed **out, tm_error *error) {
    char why[400];
    const char *set = getenv("LCM_DEFAULT_URL");
    app_topic topic[TOPICS];
    app_key sealed;
    app_network_opener *network = hrt_network(error);
    if (!network) return error->status;
    view_feed *feed = feed_new(topic);
    if (!feed) return tm_fail(error, TM_ERR_MEMORY, -1, "no memory for received messages; close other programs");
    if (!url) url = set && *set ? set : APP_LINK_URL;
    feed->begin_us = app_clock_us(CLOCK_MONOTONIC);
    if (getrandom(&feed->session, sizeof feed->session, 0) < 0) feed->session = feed->begin_us;
    if (!app_key_for(url, key->path, key->none, &sealed, why, sizeof why)) {
        view_feed_close(feed);
        return tm_fail(error, TM_ERR_ARGUMENT, -1, "%s", why);
    }
    app_link_def def = {.topic = topic, .topics = TOPICS, .key = &sealed};
    if (!connect(feed, network, url, &def)) {
        view_feed_close(feed);
        return tm_fail(
            error, TM_ERR_FILE, -1,
            "LCM cannot be opened at %s: usually no multicast route; "
            "run `ip link set lo up; ip route add 224.0.0.0/4 dev lo` as root, or see docs/troubleshooting-network.md",
            url);
    }
    *out = feed;
    return TM_OK;
}

void view_feed_listen(view_feed *feed, int timeout_ms, view_picture *picture) {
    int64_t until_us = app_clock_us(CLOCK_MONOTONIC) + (int64_t)timeout_ms * 1000;
    feed->picture = picture;
    for (;;) {
        int64_t left_us = until_us - app_clock_us(CLOCK_MONOTONIC);
        view_letter *letter = view_inbox_take(feed->inbox, left_us > 0 ? (int)(left_us / 1000) : 0);
        if (!letter) break;
        feed->time_s = live_s(feed);
        read_bytes(feed, letter->channel, 0, letter->data, letter->size);
        free(letter);
        if (left_us <= -100000) break; /* a flood of messages must not delay the picture */
    }
    view_intake_age(&feed->intake, picture, live_s(feed));
}

view_feed_counts view_feed_counted(const view_feed *feed) { return feed->intake.counts; }

bool view_feed_send_hand(view_feed *feed, const view_hand *hand) {
    tensormass_hand_command_t m = {.utime = app_clock_us(CLOCK_REALTIME),
                                   .seq = ++feed->hand_seq,
                                   .session = feed->session,
                                   .instrument = (int8_t)hand->instrument,
                                   .joints = (int8_t)hand->joints,
                                   .active = hand->active};
    memcpy(m.joint, hand->joint, sizeof m.joint);
    return app_link_publish(feed->link, APP_HAND, hand->instrument, m.utime, &m);
}

bool view_feed_send_command(view_feed *feed, const view_command *command) {
    char extrapolator[24];
    snprintf(extrapolator, sizeof extrapolator, "%s", command->extrapolator);
    tensormass_controller_command_t m = {.utime = app_clock_us(CLOCK_REALTIME),
                                         .seq = ++feed->commanded[command->instrument].command_seq,
                                         .session = feed->commanded[command->instrument].session,
                                         .instrument = (int8_t)command->instrument,
                                         .extrapolator = extrapolator,
                                         .passivity = (int8_t)command->passivity,
                                         .reset_fault = command->reset_fault};
    return app_link_publish(feed->link, APP_COMMAND, command->instrument, m.utime, &m);
}
