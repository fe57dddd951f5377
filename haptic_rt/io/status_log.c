/* Logs events and waiting conditions of haptic-rt, with a limited rate. */
#include "status_log.h"

#include "app.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>

#include "log_line.h"

static const double again_s = 1.0;

void hrt_status_log_line(double time_s, const char *format, ...) {
    char line[512];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(line, sizeof line, format, arguments);
    va_end(arguments);
    app_say("haptic-rt %.3f s: %s", time_s, line);
}

static void log_now(hrt_status_log_state *said, double time_s) {
    if (said->count > 1)
        hrt_status_log_line(time_s, "%s (%" PRId64 " times since the last such message)", said->text, said->count);
    else
        hrt_status_log_line(time_s, "%s", said->text);
    said->count = 0;
    said->ever = true;
    said->logged_s = time_s;
}

static bool is_due(const hrt_status_log_state *said, double time_s) {
    return !said->ever || time_s >= said->logged_s + again_s;
}

/* Logs at most one line a second of each kind. Earlier events are counted, and their last text is logged when due. */
static void __attribute__((format(printf, 4, 5)))
log_kind(hrt_teller *t, int kind, const hrt_facts *f, const char *format, ...) {
    hrt_status_log_state *said = &t->log[kind];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(said->text, sizeof said->text, format, arguments);
    va_end(arguments);
    said->count++;
    said->came_s = f->time_s;
    if (is_due(said, f->time_s)) log_now(said, f->time_s);
}

/* Logs the counted events that are due, in their order. */
static void log_owed(hrt_teller *t, const hrt_facts *f) {
    hrt_status_log_state *next;
    do {
        next = NULL;
        for (int k = 0; k < HRT_LOG_KINDS; k++) {
            hrt_status_log_state *said = &t->log[k];
            if (said->count > 0 && is_due(said, f->time_s) && (!next || said->came_s < next->came_s)) next = said;
        }
        if (next) log_now(next, f->time_s);
    } while (next);
}

/* Logs silence and its end in pairs, at most one pair a second: a simulation at the edge of real time would fill the
 * log. */
static void log_silence(hrt_teller *t, const hrt_facts *f) {
    const int64_t fresh = f->stale - t->logged.stale;
    t->logged.stale = f->stale;
    if (fresh > 0 && (t->logged.silent || f->time_s < t->logged.silent_s + again_s)) {
        t->logged.unsaid += fresh;
        return;
    }
    if (fresh > 0) {
        const int64_t more = t->logged.unsaid + fresh - 1;
        if (more > 0)
            hrt_status_log_line(
                f->time_s, "no samples from the simulation, and %" PRId64 " times since the last such message", more);
        else
            hrt_status_log_line(f->time_s, "no samples from the simulation; force ramps down to zero");
        t->logged.silent = true;
        t->logged.silent_s = f->time_s;
        t->logged.unsaid = 0;
    } else if (t->logged.silent && f->state == HRT_ENGAGED) {
        hrt_status_log_line(f->time_s, "samples from the simulation again");
        t->logged.silent = false;
    }
}

static void log_state(hrt_teller *t, const hrt_facts *f) {
    const int before = t->logged.state;
    if ((int)f->state == before) return;
    t->logged.state = (int)f->state;
    if (before == HRT_FAULT) log_kind(t, HRT_LOG_RESET, f, "fault reset; starting again");
    if (before == HRT_BOOT && f->state != HRT_FAULT && !app_is_quiet())
        log_kind(t, HRT_LOG_DEVICE, f, "device %d is connected", t->instrument);
    if (f->state == HRT_ENGAGED && before != HRT_STALE && !app_is_quiet()) log_kind(t, HRT_LOG_ENGAGED, f, "engaged");
    if (f->state == HRT_FAULT)
        log_kind(t, HRT_LOG_FAULT, f, "fault %s (%d): %s", hrt_fault_name(f->fault), f->detail,
                 hrt_fault_text(f->fault));
    t->logged.wait_s = f->time_s;
    if (f->state != HRT_SELF_TEST) t->logged.wait = 0;
}

enum { WAITS_NOT, WAITS_DEVICE, WAITS_QUIET, WAITS_POSE, WAITS_SAMPLES, WAITS_RESET };

static int waits_for(const hrt_facts *f) {
    if (f->state == HRT_BOOT) return WAITS_DEVICE;
    if (f->state == HRT_FAULT) return WAITS_RESET;
    if (f->state != HRT_IDLE) return WAITS_NOT;
    if (f->device_quiet) return WAITS_QUIET;
    return f->pose_known ? WAITS_SAMPLES : WAITS_POSE;
}

static void log_wait(hrt_teller *t, const hrt_facts *f, int wait, bool again) {
    const int64_t come = f->samples - t->logged.samples, taken = f->taken - t->logged.taken;
    if (wait == WAITS_DEVICE && again)
        log_kind(t, HRT_LOG_WAIT + wait, f,
                 "%" PRId64 " frames received on %s, none with encoders of device %d; check --instrument",
                 f->frames - t->logged.frames, t->bus, t->instrument);
    else if (wait == WAITS_DEVICE)
        log_kind(t, HRT_LOG_WAIT + wait, f, "waiting for device %d on %s; %s", t->instrument, t->bus,
                 t->drive ? "connect it, or start its service" : "start tm-device, in any order");
    else if (wait == WAITS_QUIET)
        log_kind(t, HRT_LOG_WAIT + wait, f, "device %d stopped sending; its motors get no torque until it sends again",
                 t->instrument);
    else if (wait == WAITS_POSE)
        log_kind(t, HRT_LOG_WAIT + wait, f,
                 "waiting for the trocar's pose in SIM_STATUS of tm-sim; start tm-sim, or give --trocar");
    else if (wait == WAITS_SAMPLES && again)
        log_kind(t, HRT_LOG_WAIT + wait, f,
                 "waiting for new samples: of %" PRId64 " received %" PRId64 " were accepted; %s", come, taken,
                 f->refusal ? f->refusal : "they are too old");
    else if (wait == WAITS_SAMPLES)
        log_kind(t, HRT_LOG_WAIT + wait, f, "waiting for new samples: %s",
                 t->source ? t->source : "start tm-sim, or wait for its FORCE messages");
    else if (again)
        log_kind(t, HRT_LOG_WAIT + wait, f, "still in fault %s, waiting for a reset (%s)", hrt_fault_name(f->fault),
                 hrt_fault_text(f->fault));
}

/* Logs a condition waited for when it begins, and again each second while messages are rejected. */
static void log_waiting(hrt_teller *t, const hrt_facts *f) {
    const int wait = waits_for(f);
    const bool begins = wait != t->logged.wait, due = f->time_s - t->logged.wait_s >= again_s;
    const bool spoken = wait == WAITS_DEVICE  ? f->frames != t->logged.frames
                        : wait == WAITS_RESET ? f->device_here || f->samples != t->logged.samples
                        : wait == WAITS_QUIET ? false
                                              : f->samples != t->logged.samples;
    if (wait != WAITS_NOT && (begins || (due && spoken))) log_wait(t, f, wait, !begins);
    if (!begins && !due) return;
    t->logged.wait = wait;
    t->logged.wait_s = f->time_s;
    t->logged.samples = f->samples;
    t->logged.taken = f->taken;
    t->logged.frames = f->frames;
}

/* Logs rejected messages, in use too: another simulation sends, or answers another controller. */
static void log_refused(hrt_teller *t, const hrt_facts *f) {
    if (f->refused == t->logged.refused || f->time_s < t->logged.refused_s + again_s) return;
    hrt_status_log_line(f->time_s, "samples refused: %" PRId64 ", the last: %s", f->refused - t->logged.refused,
                        f->refusal ? f->refusal : "not for this controller");
    t->logged.refused = f->refused;
    t->logged.refused_s = f->time_s;
}

static void log_gaps(hrt_teller *t, const hrt_facts *f) {
    if (f->command_gaps == t->logged.gaps || f->time_s < t->logged.gaps_s + again_s) return;
    hrt_status_log_line(f->time_s,
                        "the device missed %" PRId64 " commands; check load, cable and termination of the bus",
                        f->command_gaps - t->logged.gaps);
    t->logged.gaps = f->command_gaps;
    t->logged.gaps_s = f->time_s;
}

static void log_unstable(hrt_teller *t, const hrt_facts *f) {
    if (f->unstable == t->logged.unstable || f->time_s < t->logged.unstable_s + again_s) return;
    hrt_status_log_line(f->time_s, "the simulation reports that its step failed; force ramps down to zero");
    t->logged.unstable = f->unstable;
    t->logged.unstable_s = f->time_s;
}

void hrt_status_log(hrt_teller *teller, const hrt_facts *facts) {
    log_unstable(teller, facts);
    log_silence(teller, facts);
    log_state(teller, facts);
    log_waiting(teller, facts);
    log_refused(teller, facts);
    log_gaps(teller, facts);
    log_owed(teller, facts);
}
