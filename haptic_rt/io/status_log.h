/* Status log of haptic-rt on stderr: events, conditions waited for, and, once a second, why messages are rejected. Each
 * line has the seconds since the loop's start, as in --record. */
#ifndef HRT_STATUS_LOG_H
#define HRT_STATUS_LOG_H

#include <stdbool.h>
#include <stdint.h>

#include "hrt.h"

/* State of the loop, input of the log. */
typedef struct hrt_facts {
    double time_s;
    hrt_state state;
    hrt_fault fault;
    int detail;
    int64_t stale;          /* times the simulation went silent in use */
    int64_t unstable;       /* times a simulation step failed */
    int64_t samples, taken; /* received; accepted of these */
    int64_t refused;        /* rejected, other than those out of order */
    const char *refusal;    /* reason of the last rejection; null: none */
    int64_t frames;         /* received on the bus */
    int64_t command_gaps;
    bool pose_known, device_here;
    bool device_quiet; /* no encoders for longer than the controller tolerates */
} hrt_facts;

/* Kinds of lines, each at most once a second; one per condition waited for. */
enum { HRT_LOG_RESET, HRT_LOG_DEVICE, HRT_LOG_ENGAGED, HRT_LOG_FAULT, HRT_LOG_WAIT, HRT_LOG_KINDS = HRT_LOG_WAIT + 6 };

typedef struct hrt_status_log_state {
    bool ever;
    double logged_s, came_s; /* times of the last logged line and of the last event */
    int64_t count;           /* events since the last logged line */
    char text[320];
} hrt_status_log_state;

typedef struct hrt_teller {
    /* set by the caller */
    const char *bus;
    int32_t instrument;
    const char *source; /* of samples that come from no network; null: they do */
    bool drive;         /* the device is not on a bus (drive.h) */
    /* internal; start with logged = {.state = -1} */
    struct {
        int state, wait;
        bool silent;
        int64_t stale, unsaid, unstable, samples, taken, refused, frames, gaps;
        double silent_s, wait_s, refused_s, gaps_s, unstable_s;
    } logged;
    hrt_status_log_state log[HRT_LOG_KINDS];
} hrt_teller;

/* Logs changes; call it from a thread that may block, about 20 times a second. */
void hrt_status_log(hrt_teller *teller, const hrt_facts *facts);
/* Logs one line. */
void hrt_status_log_line(double time_s, const char *format, ...) __attribute__((format(printf, 2, 3)));

#endif
