/* What haptic-rt says on stderr while it runs: what happened, what it waits for, and, once a second, why somebody who
 * speaks is not taken up. Each line with the seconds since the loop's start, as in --record. */
#ifndef HRT_STATUS_LOG_H
#define HRT_STATUS_LOG_H

#include <stdbool.h>
#include <stdint.h>

#include "hrt.h"

/* What the loop knows, as of now. */
typedef struct hrt_facts {
    double time_s;
    hrt_state state;
    hrt_fault fault;
    int detail;
    int64_t stale;          /* how often the simulation went silent in use */
    int64_t unstable;       /* how often it said that its step had failed */
    int64_t samples, taken; /* come; of these taken */
    int64_t refused;        /* of these, but for those out of order */
    const char *refusal;    /* why the last that was not taken; null: none */
    int64_t frames;         /* heard on the bus */
    int64_t command_gaps;
    bool pose_known, device_here;
    bool device_quiet; /* no encoders for longer than the controller goes on without */
} hrt_facts;

/* Kinds of lines, each at most once a second; one for everything that is waited for. */
enum { HRT_LOG_RESET, HRT_LOG_DEVICE, HRT_LOG_ENGAGED, HRT_LOG_FAULT, HRT_LOG_WAIT, HRT_LOG_KINDS = HRT_LOG_WAIT + 6 };

typedef struct hrt_status_log_state {
    bool ever;
    double logged_s, came_s; /* when it was said last; when it came last */
    int64_t count;           /* how often it came since it was said */
    char text[320];
} hrt_status_log_state;

typedef struct hrt_teller {
    /* set before */
    const char *bus;
    int32_t instrument;
    bool from_file; /* samples do not come from a network */
    /* its own; start with told = {.state = -1} */
    struct {
        int state, wait;
        bool silent;
        int64_t stale, unsaid, unstable, samples, taken, refused, frames, gaps;
        double silent_s, wait_s, refused_s, gaps_s, unstable_s;
    } logged;
    hrt_status_log_state log[HRT_LOG_KINDS];
} hrt_teller;

/* From a thread that may take its time, some twenty times a second. */
void hrt_status_log(hrt_teller *teller, const hrt_facts *facts);
/* One line of that kind. */
void hrt_status_log_line(double time_s, const char *format, ...) __attribute__((format(printf, 2, 3)));

#endif
