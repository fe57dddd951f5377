/* Messages into a picture, live or from a log. */
#ifndef VIEW_FEED_H
#define VIEW_FEED_H

#include "picture.h"
#include "tensormass/base.h"

typedef struct view_feed view_feed;

typedef struct view_log_facts {
    double seconds; /* from the first tissue to the last */
    int64_t tissues, events;
    double peak_force_N; /* largest of any instrument */
    bool damaged;        /* not all of it is events, or it ends in the middle of one */
} view_log_facts;

typedef struct view_feed_counts {
    int64_t accepted, rejected;
    char why[160]; /* the last one's reason */
} view_feed_counts;

/* lcm_types/hand_command_t.lcm and controller_command_t.lcm, in part. */
typedef struct view_hand {
    int instrument;
    int32_t joints; /* of the device */
    double joint[HRT_JOINTS];
    bool active;
} view_hand;
typedef struct view_command {
    int instrument;
    const char *extrapolator; /* or "" */
    int passivity;            /* -1 leaves it */
    bool reset_fault;
} view_command;

typedef struct view_live_key {
    const char *path; /* null: none */
    bool none;        /* none is wanted, though the URL leaves this machine */
} view_live_key;

/* Reads the log once through for its facts. */
tm_status view_feed_open_log(const char *path, view_feed **feed, view_log_facts *facts, tm_error *error);
/* `url` as LCM takes it; null: LCM_DEFAULT_URL, else LCM's default, which stays on this machine. */
tm_status view_feed_open_live(const char *url, const view_live_key *key, view_feed **feed, tm_error *error);
void view_feed_close(view_feed *feed); /* null: nothing */
/* Log: takes in everything up to `time_s` after the first tissue. False: the log has ended. */
bool view_feed_advance(view_feed *feed, double time_s, view_picture *picture);
/* Live: takes in what comes for up to `timeout_ms`, or until there is nothing more. */
void view_feed_listen(view_feed *feed, int timeout_ms, view_picture *picture);
view_feed_counts view_feed_counted(const view_feed *feed);
/* Live: false if it could not be sent. */
bool view_feed_send_hand(view_feed *feed, const view_hand *hand);
bool view_feed_send_command(view_feed *feed, const view_command *command);

#endif
