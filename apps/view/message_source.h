/* Source of pictures from messages, live or from a log. */
#ifndef VIEW_FEED_H
#define VIEW_FEED_H

#include "picture.h"
#include "tensormass/base.h"

typedef struct view_feed view_feed;

typedef struct view_log_facts {
    double seconds; /* time from the first tissue message to the last */
    int64_t tissues, events;
    double peak_force_N; /* maximum over all instruments */
    bool damaged;        /* the log contains other bytes than events, or ends within an event */
} view_log_facts;

typedef struct view_feed_counts {
    int64_t accepted, rejected;
    char why[160]; /* reason for the last refused message */
} view_feed_counts;

/* Some fields of lcm_types/hand_command_t.lcm and controller_command_t.lcm. */
typedef struct view_hand {
    int instrument;
    int32_t joints; /* joints of the device */
    double joint[HRT_JOINTS];
    bool active;
} view_hand;
typedef struct view_command {
    int instrument;
    const char *extrapolator; /* or "" */
    int passivity;            /* -1: unchanged */
    bool reset_fault;
} view_command;

typedef struct view_live_key {
    const char *path; /* null: none */
    bool none;        /* no key is required, although the URL leaves this machine */
} view_live_key;

/* Opens a log and reads it once for its facts. */
tm_status view_feed_open_log(const char *path, view_feed **feed, view_log_facts *facts, tm_error *error);
/* Opens a live source. `url` in LCM's syntax; null: LCM_DEFAULT_URL, else LCM's default, which stays on this
 * machine. */
tm_status view_feed_open_live(const char *url, const view_live_key *key, view_feed **feed, tm_error *error);
void view_feed_close(view_feed *feed); /* null: does nothing */
/* Log: reads everything up to `time_s` after the first tissue. Returns false at the end of the log. */
bool view_feed_advance(view_feed *feed, double time_s, view_picture *picture);
/* Live: receives for up to `timeout_ms`, or until no message is left. */
void view_feed_listen(view_feed *feed, int timeout_ms, view_picture *picture);
view_feed_counts view_feed_counted(const view_feed *feed);
/* Live: returns false if the message could not be sent. */
bool view_feed_send_hand(view_feed *feed, const view_hand *hand);
bool view_feed_send_command(view_feed *feed, const view_command *command);

#endif
