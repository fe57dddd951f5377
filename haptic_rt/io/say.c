#include "say.h"

#include "app.h"

#include <inttypes.h>
#include <stdarg.h>
#include <stdio.h>

#include "log_line.h"

static const double again_s = 1.0;

void hrt_say_line(double time_s, const char *format, ...) {
    char line[512];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(line, sizeof line, format, arguments);
    va_end(arguments);
    app_say("haptic-rt %.3f s: %s", time_s, line);
}

static void say_now(hrt_said *said, double time_s) {
    if (said->count > 1)
        hrt_say_line(time_s, "%s (%" PRId64 " times since it was said last)", said->text, said->count);
    else
        hrt_say_line(time_s, "%s", said->text);
    said->count = 0;
    said->ever = true;
    said->said_s = time_s;
}

static bool is_due(const hrt_said *said, double time_s) { return !said->ever || time_s >= said->said_s + again_s; }

/* At most one line a second of each kind: what comes sooner is counted, its last text kept, and said when due. */
static void __attribute__((format(printf, 4, 5)))
say_kind(hrt_teller *t, int kind, const hrt_facts *f, const char *format, ...) {
    hrt_said *said = &t->said[kind];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(said->text, sizeof said->text, format, arguments);
    va_end(arguments);
    said->count++;
    said->came_s = f->time_s;
    if (is_due(said, f->time_s)) say_now(said, f->time_s);
}

/* What was counted, in the order in which it came. */
static void say_owed(hrt_teller *t, const hrt_facts *f) {
    hrt_said *next;
    do {
        next = NULL;
        for (int k = 0; k < HRT_SAID_KINDS; k++) {
            hrt_said *said = &t->said[k];
            if (said->count > 0 && is_due(said, f->time_s) && (!next || said->came_s < next->came_s)) next = said;
        }
        if (next) say_now(next, f->time_s);
    } while (next);
}

/* In pairs, and at most one pair a second: a simulation at the edge of its time would fill the log. */
static void say_silence(hrt_teller *t, const hrt_facts *f) {
    const int64_t fresh = f->stale - t->told.stale;
    t->told.stale = f->stale;
    if (fresh > 0 && (t->told.silent || f->time_s < t->told.silent_s + again_s)) {
        t->told.unsaid += fresh;
        return;
    }
    if (fresh > 0) {
        const int64_t more = t->told.unsaid + fresh - 1;
        if (more > 0)
            hrt_say_line(f->time_s, "the simulation went silent, and %" PRId64 " times since it was said last", more);
        else
            hrt_say_line(f->time_s, "the simulation went silent; force fades to zero");
        t->told.silent = true;
        t->told.silent_s = f->time_s;
        t->told.unsaid = 0;
    } else if (t->told.silent && f->state == HRT_ENGAGED) {
        hrt_say_line(f->time_s, "the simulation is back");
        t->told.silent = false;
    }
}

static void say_state(hrt_teller *t, const hrt_facts *f) {
    const int before = t->told.state;
    if ((int)f->state == before) return;
    t->told.state = (int)f->state;
    if (before == HRT_FAULT) say_kind(t, HRT_SAID_RESET, f, "reset: begins anew");
    if (before == HRT_BOOT && f->state != HRT_FAULT && !app_is_quiet())
        say_kind(t, HRT_SAID_DEVICE, f, "device %d is here", t->instrument);
    if (f->state == HRT_ENGAGED && before != HRT_STALE && !app_is_quiet()) say_kind(t, HRT_SAID_ENGAGED, f, "engaged");
    if (f->state == HRT_FAULT)
        say_kind(t, HRT_SAID_FAULT, f, "fault %s (%d): %s", hrt_fault_name(f->fault), f->detail,
                 hrt_fault_text(f->fault));
    t->told.wait_s = f->time_s;
    if (f->state != HRT_SELF_TEST) t->told.wait = 0;
}

enum { WAITS_NOT, WAITS_DEVICE, WAITS_QUIET, WAITS_POSE, WAITS_SAMPLES, WAITS_RESET };

static int waits_for(const hrt_facts *f) {
    if (f->state == HRT_BOOT) return WAITS_DEVICE;
    if (f->state == HRT_FAULT) return WAITS_RESET;
    if (f->state != HRT_IDLE) return WAITS_NOT;
    if (f->device_quiet) return WAITS_QUIET;
    return f->pose_known ? WAITS_SAMPLES : WAITS_POSE;
}

static void say_wait(hrt_teller *t, const hrt_facts *f, int wait, bool again) {
    const int64_t come = f->samples - t->told.samples, taken = f->taken - t->told.taken;
    if (wait == WAITS_DEVICE && again)
        say_kind(t, HRT_SAID_WAIT + wait, f,
                 "%" PRId64 " frames came on %s, no encoders of device %d among them; see --instrument",
                 f->frames - t->told.frames, t->bus, t->instrument);
    else if (wait == WAITS_DEVICE)
        say_kind(t, HRT_SAID_WAIT + wait, f, "waiting for device %d on %s (start tm-device; any order is fine)",
                 t->instrument, t->bus);
    else if (wait == WAITS_QUIET)
        say_kind(t, HRT_SAID_WAIT + wait, f, "device %d stopped speaking: its motors get no torque until it is back",
                 t->instrument);
    else if (wait == WAITS_POSE)
        say_kind(t, HRT_SAID_WAIT + wait, f,
                 "waiting for the trocar's pose: SIM_STATUS of tm-sim (any order is fine), or give --trocar");
    else if (wait == WAITS_SAMPLES && again)
        say_kind(t, HRT_SAID_WAIT + wait, f,
                 "waiting for fresh samples: of %" PRId64 " that came %" PRId64 " were taken; %s", come, taken,
                 f->refusal ? f->refusal : "they are too old");
    else if (wait == WAITS_SAMPLES)
        say_kind(t, HRT_SAID_WAIT + wait, f, "waiting for fresh samples: %s",
                 t->from_file ? "the file's" : "FORCE of tm-sim (any order is fine)");
    else if (again)
        say_kind(t, HRT_SAID_WAIT + wait, f, "still in fault %s: waiting for a reset (%s)", hrt_fault_name(f->fault),
                 hrt_fault_text(f->fault));
}

/* Once when it begins; again each second while somebody speaks who is not taken up. */
static void say_waiting(hrt_teller *t, const hrt_facts *f) {
    const int wait = waits_for(f);
    const bool begins = wait != t->told.wait, due = f->time_s - t->told.wait_s >= again_s;
    const bool spoken = wait == WAITS_DEVICE  ? f->frames != t->told.frames
                        : wait == WAITS_RESET ? f->device_here || f->samples != t->told.samples
                        : wait == WAITS_QUIET ? false
                                              : f->samples != t->told.samples;
    if (wait != WAITS_NOT && (begins || (due && spoken))) say_wait(t, f, wait, !begins);
    if (!begins && !due) return;
    t->told.wait = wait;
    t->told.wait_s = f->time_s;
    t->told.samples = f->samples;
    t->told.taken = f->taken;
    t->told.frames = f->frames;
}

/* In use too: somebody else plays the simulation, or answers another controller. */
static void say_refused(hrt_teller *t, const hrt_facts *f) {
    if (f->refused == t->told.refused || f->time_s < t->told.refused_s + again_s) return;
    hrt_say_line(f->time_s, "samples refused: %" PRId64 ", the last: %s", f->refused - t->told.refused,
                 f->refusal ? f->refusal : "not for this controller");
    t->told.refused = f->refused;
    t->told.refused_s = f->time_s;
}

static void say_gaps(hrt_teller *t, const hrt_facts *f) {
    if (f->command_gaps == t->told.gaps || f->time_s < t->told.gaps_s + again_s) return;
    hrt_say_line(f->time_s, "the device missed %" PRId64 " commands; look at the bus's load, cable and termination",
                 f->command_gaps - t->told.gaps);
    t->told.gaps = f->command_gaps;
    t->told.gaps_s = f->time_s;
}

static void say_unstable(hrt_teller *t, const hrt_facts *f) {
    if (f->unstable == t->told.unstable || f->time_s < t->told.unstable_s + again_s) return;
    hrt_say_line(f->time_s, "the simulation says that its step failed; force fades to zero");
    t->told.unstable = f->unstable;
    t->told.unstable_s = f->time_s;
}

void hrt_say(hrt_teller *teller, const hrt_facts *facts) {
    say_unstable(teller, facts);
    say_silence(teller, facts);
    say_state(teller, facts);
    say_waiting(teller, facts);
    say_refused(teller, facts);
    say_gaps(teller, facts);
    say_owed(teller, facts);
}
