/* haptic-rt: the controller as a Linux program. A loop thread ticks; the main thread logs events and writes the
 * statistics. */
#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "app.h"
#include "json_file.h"
#include "loop.h"
#include "record.h"
#include "report.h"
#include "samples.h"
#include "settings.h"
#include "setup.h"
#include "status_log.h"

enum { STATUS_EVERY_US = 100000, DEVICE_HERE_US = 100000 };

typedef struct program {
    hrt_settings set;
    hrt_bus wires;
    hrt_drive drive; /* instead of the bus, where the address names one */
    hrt_node node;
    hrt_samples samples;
    hrt_setup setup;
    hrt_live *live;
    app_key key;
    hrt_live_sent sent;
    hrt_live_refused reported_refused;
    hrt_loop loop;
    tensormass_tool_state_t tool;
    int64_t status_us;
    app_output json_out;
    hrt_record record;
    hrt_histogram stage[HRT_NODE_STAGES + 1];
    double force_square, force_peak_N;
    int64_t force_ticks;
    /* read by the main thread */
    _Atomic int state, fault, detail;
    _Atomic bool pose_known, device_here, device_quiet, samples_over;
    _Atomic int64_t went_stale, went_unstable, samples_come, samples_taken, samples_refused, frames, command_gaps,
        resets;
} program;

/* ---------------------------------------------------------------------------------------------- the loop's thread */

static void figures(program *p, int64_t publish_ns) {
    for (int s = 0; s < HRT_NODE_STAGES; s++) hrt_histogram_add(&p->stage[s], p->node.stage_ns[s]);
    hrt_histogram_add(&p->stage[HRT_NODE_STAGES], publish_ns);
    const float *f = p->node.result.force_N;
    const double square = (double)(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
    p->force_square += square;
    p->force_ticks++;
    p->force_peak_N = fmax(p->force_peak_N, sqrt(square));
}

static void publish_status(program *p) {
    tensormass_controller_status_t status;
    hrt_node_status(&p->node, &status);
    status.missed_ticks = atomic_load(&p->loop.missed);
    hrt_histogram_quantiles(&p->loop.lateness, status.lateness_us);
    hrt_histogram_quantiles(&p->loop.duration, status.duration_us);
    hrt_live_send_status(p->live, &status);
}

/* Updates the state that the main thread logs. */
static void tell(program *p, int64_t now_us) {
    const hrt_counters *c = &p->node.controller.counters;
    const int64_t turned_away = (int64_t)atomic_load(&p->node.rejected) + atomic_load(&p->node.late);
    const int64_t encoder_us = p->node.input.encoder_us;
    /* Count it here: `stale` may end before the main thread reads the state. */
    const bool unstable = (p->node.result.limits & HRT_LIMIT_UNSTABLE) != 0;
    if (p->node.result.state == HRT_STALE && atomic_load(&p->state) != HRT_STALE)
        atomic_fetch_add(unstable ? &p->went_unstable : &p->went_stale, 1);
    atomic_store(&p->state, (int)p->node.result.state);
    atomic_store(&p->fault, (int)p->node.result.fault);
    atomic_store(&p->detail, p->node.result.fault_detail);
    atomic_store(&p->pose_known, p->node.config.pose_known);
    atomic_store(&p->device_here, encoder_us != 0 && now_us - encoder_us < DEVICE_HERE_US);
    atomic_store(&p->device_quiet, (double)(now_us - encoder_us) > (double)p->node.config.params.device_pause_us);
    atomic_store(&p->samples_come, (int64_t)c->samples_received + turned_away);
    atomic_store(&p->samples_taken, (int64_t)c->samples_received - c->samples_late - c->samples_rejected);
    atomic_store(&p->samples_refused, (int64_t)c->samples_rejected + atomic_load(&p->node.rejected));
    atomic_store(&p->frames, p->set.common.drive ? (int64_t)atomic_load(&p->drive.states) : (int64_t)p->wires.rx);
    atomic_store(&p->command_gaps, (int64_t)p->node.exchange.can.command_gaps);
}

static void tick(void *user, int64_t now_us) {
    program *p = user;
    const bool meaningful = hrt_node_tick(&p->node, now_us, &p->tool);
    const int64_t begin_ns = app_monotonic_ns();
    if (!p->set.setup && p->set.samples_path && !hrt_samples_feed(&p->samples, &p->node, &p->tool, now_us))
        atomic_store(&p->samples_over, true);
    if (p->set.setup && !hrt_setup_feed(&p->setup, &p->node, &p->tool, now_us)) atomic_store(&p->loop.stop, true);
    if (p->live && meaningful) hrt_live_send_tool(p->live, &p->tool);
    if (p->live && now_us - p->status_us >= STATUS_EVERY_US) {
        publish_status(p);
        p->status_us = now_us;
    }
    figures(p, app_monotonic_ns() - begin_ns);
    if (p->set.record_path) hrt_record_put(&p->record, 1.0e-6 * (double)(now_us - p->loop.start_us), &p->node.result);
    tell(p, now_us);
}

/* Turns the motors off at once, before the device's watchdog acts. */
static void end(void *user) {
    program *p = user;
    hrt_node_stop(&p->node);
}

/* ---------------------------------------------------------------------------------------------- this thread */

static hrt_facts facts_now(const program *p) {
    const int64_t start_us = p->loop.start_us ? p->loop.start_us : app_monotonic_us();
    return (hrt_facts){.time_s = 1.0e-6 * (double)(app_monotonic_us() - start_us),
                       .state = (hrt_state)atomic_load(&p->state),
                       .fault = (hrt_fault)atomic_load(&p->fault),
                       .detail = atomic_load(&p->detail),
                       .stale = atomic_load(&p->went_stale),
                       .unstable = atomic_load(&p->went_unstable),
                       .samples = atomic_load(&p->samples_come),
                       .taken = atomic_load(&p->samples_taken),
                       .refused = atomic_load(&p->samples_refused),
                       .refusal = atomic_load(&p->node.refusal),
                       .frames = atomic_load(&p->frames),
                       .command_gaps = atomic_load(&p->command_gaps),
                       .pose_known = atomic_load(&p->pose_known),
                       .device_here = atomic_load(&p->device_here),
                       .device_quiet = atomic_load(&p->device_quiet)};
}

static void reset_by_itself(program *p, const hrt_facts *facts, double *since_s) {
    if (facts->state != HRT_FAULT || p->set.auto_reset_s <= 0.0) *since_s = facts->time_s;
    if (facts->time_s < *since_s + p->set.auto_reset_s || facts->state != HRT_FAULT || p->set.auto_reset_s <= 0.0)
        return;
    const hrt_command reset = {.extrapolator = -1, .passivity = -1, .coupling = -1, .enable = -1, .reset = true};
    hrt_status_log_line(facts->time_s, "reset by --auto-reset");
    hrt_node_post_command(&p->node, &reset);
    atomic_fetch_add(&p->resets, 1);
    *since_s = facts->time_s;
}

static void watch(program *p) {
    hrt_teller teller = {
        .bus = p->set.common.bus,
        .instrument = p->set.node.instrument,
        .source = p->set.setup          ? "those of --setup"
                  : p->set.samples_path ? "those of the file"
                                        : NULL,
        .drive = p->set.common.drive,
        .logged = {.state = -1, .silent_s = -1.0e9, .refused_s = -1.0e9, .gaps_s = -1.0e9, .unstable_s = -1.0e9}};
    double fault_since_s = 0.0;
    enum { LOOKS_PER_SECOND = 20 };
    int looks = 0;
    while (!atomic_load(&p->loop.done)) {
        nanosleep(&(const struct timespec){0, 50000000}, NULL);
        const hrt_facts facts = facts_now(p);
        const char *lost = p->set.common.drive ? atomic_exchange(&p->drive.event, NULL) : hrt_bus_look(&p->wires);
        if (lost) hrt_status_log_line(facts.time_s, "%s: %s", p->set.common.bus, lost);
        if (10 * atomic_load(&p->loop.ticks) > p->set.common.rate) hrt_status_log(&teller, &facts);
        if (p->set.record_path) hrt_record_write(&p->record);
        char who[48];
        snprintf(who, sizeof who, "haptic-rt %.3f s", facts.time_s);
        if (p->live && ++looks % LOOKS_PER_SECOND == 0) hrt_log_refused(who, p->live, &p->reported_refused);
        reset_by_itself(p, &facts, &fault_since_s);
    }
    pthread_join(p->loop.thread, NULL);
}

static const char *const stage_name[HRT_NODE_STAGES + 1] = {"receive", "control", "send", "publish"};

static cJSON *statistics_json(program *p) {
    cJSON *json = cJSON_CreateObject();
    tensormass_controller_status_t s;
    hrt_node_status(&p->node, &s);
    app_json_add(json, "instrument %d rate_Hz %d", p->set.node.instrument, p->set.common.rate);
    hrt_report_loop(json, &p->loop);
    cJSON *stages = cJSON_AddObjectToObject(json, "stage_us");
    for (int i = 0; i <= HRT_NODE_STAGES; i++) hrt_report_quantiles(stages, stage_name[i], &p->stage[i]);
    app_json_add(json, "state %s fault %s resets %g extrapolator %s passivity %hhd", hrt_state_name((hrt_state)s.state),
                 hrt_fault_name((hrt_fault)s.fault), (double)p->resets, s.extrapolator, s.passivity_on);
    app_json_add(cJSON_AddObjectToObject(json, "force_N"), "rms %g peak %g",
                 p->force_ticks ? sqrt(p->force_square / (double)p->force_ticks) : 0.0, p->force_peak_N);
    app_json_add(cJSON_AddObjectToObject(json, "samples"), "received %g late %g lost %g superseded %g rejected %g",
                 (double)s.samples_received, (double)s.samples_late, (double)s.samples_lost, (double)p->node.superseded,
                 (double)s.samples_rejected);
    if (p->set.common.drive)
        hrt_report_drive(json, &p->drive);
    else
        hrt_report_can(json, &p->wires, &p->node.exchange.can, (double)p->loop.ticks / p->set.common.rate);
    if (p->live) hrt_report_refused(json, p->live);
    return json;
}

static int write_json(program *p, cJSON *json) {
    if (p->live) {
        cJSON *sent = app_json_add(cJSON_AddObjectToObject(json, "sent"), "tools %g skipped %g", (double)p->sent.tools,
                                   (double)p->sent.skipped);
        hrt_report_quantiles(sent, "lay_us", &p->sent.lay);
    }
    return hrt_report_write(json, &p->json_out);
}

static void print_stats(const program *p) {
    printf("haptic-rt: %lld ticks, %lld missed, %s%s\n", (long long)p->loop.ticks, (long long)p->loop.missed,
           p->loop.real_time ? "SCHED_FIFO" : "normal scheduling",
           p->loop.awake_fd >= 0 ? ", idle states disabled" : "");
    hrt_print_quantiles("lateness", &p->loop.lateness);
    hrt_print_quantiles("duration", &p->loop.duration);
    for (int i = 0; i <= HRT_NODE_STAGES; i++) hrt_print_quantiles(stage_name[i], &p->stage[i]);
    if (p->set.common.drive) {
        printf("  device     %u commands, %u states\n", atomic_load(&p->drive.commands), atomic_load(&p->drive.states));
        return;
    }
    printf("  bus        %llu sent, %llu received, load %.1f %% of 1 Mbit/s\n", (unsigned long long)p->wires.tx,
           (unsigned long long)p->wires.rx,
           100.0 * (double)p->wires.bits / (1.0e6 * (double)p->loop.ticks / p->set.common.rate));
}

static int open_link(program *p) {
    hrt_peer_def def = {.instrument = p->set.node.instrument, .node = &p->node, .replay = p->set.replay};
    if (p->set.setup || (p->set.samples_path && !p->set.common.url)) return APP_DONE; /* without LCM */
    return hrt_common_join(&p->set.common, &def, &p->key, &p->live);
}

static int open_bus(program *p) {
    char why[300];
    const char *address = p->set.common.bus, *option = p->set.common.bus_option;
    if (!hrt_bus_is(address))
        return app_bad_input(option, 0, "'%s' is not an address; use %s, or begin it with one of %s (haptic-rt --list)",
                             address, hrt_bus_kinds(), hrt_drive_kinds());
    if (hrt_bus_open(&p->wires, address, why, sizeof why) &&
        hrt_bus_claim(&p->wires, HRT_BUS_CONTROLLER, p->set.node.instrument, why, sizeof why))
        return APP_DONE;
    return app_bad_input(option, 0, "%s", why);
}

/* Opens a drive. Its thread inherits this scheduling: real-time, but below the loop. */
static int open_drive(program *p) {
    char why[300];
    const int priority = p->set.common.priority;
    const bool raised = priority > 1 && hrt_priority(priority > 10 ? priority - 10 : 1);
    p->drive.workspace = p->set.workspace;
    p->drive.tick_us = 1000000 / p->set.common.rate;
    p->drive.period_us = p->drive.tick_us / 2;
    hrt_drive_start(&p->drive, p->set.node.params.device);
    const bool good = hrt_drive_open(&p->drive, p->set.common.bus, why, sizeof why);
    if (raised) hrt_priority(0);
    return good ? APP_DONE : app_bad_input(p->set.common.bus_option, 0, "%s", why);
}

static void close_device(program *p) {
    hrt_bus_close(&p->wires);
    if (p->set.common.drive) hrt_drive_close(&p->drive);
}

static int open_all(program *p) {
    if (p->set.samples_path && !hrt_samples_read(&p->samples, p->set.samples_path)) return APP_BAD_INPUT;
    const int unopened = p->set.common.drive ? open_drive(p) : open_bus(p);
    if (unopened) return unopened;
    hrt_node_init(&p->node, &p->set.node, &p->wires);
    if (p->set.common.drive) p->node.drive = &p->drive;
    p->node.clock_ns = app_monotonic_ns;
    const int unlinked = open_link(p);
    if (unlinked) return unlinked;
    const int unwritable = hrt_output_begin(&p->json_out, p->set.common.json);
    if (unwritable) return unwritable;
    const int unrecorded =
        p->set.record_path ? hrt_record_begin(&p->record, p->set.node.params.device, p->set.record_path) : APP_DONE;
    if (unrecorded) app_output_abandon(&p->json_out);
    return unrecorded;
}

int main(int argc, char **argv) {
    static program p;
    app_check_stdout();
    const int code = hrt_settings_read(&p.set, argc, argv);
    if (code >= 0) return code;
    const int failed = open_all(&p);
    if (failed) return close_device(&p), failed;
    p.setup.tick_s = 1.0 / p.set.common.rate;
    p.loop.program = "haptic-rt";
    p.loop.period_ns = 1000000000 / p.set.common.rate;
    p.loop.priority = p.set.common.priority;
    p.loop.idle_states = p.set.idle_states;
    p.loop.ticks_max = p.set.common.duration_s > 0.0 ? (int64_t)(p.set.common.duration_s * p.set.common.rate + 0.5) : 0;
    p.loop.tick = tick;
    p.loop.end = end;
    p.loop.user = &p;
    hrt_stop_on_signals(&p.loop.stop);
    if (!hrt_loop_start(&p.loop)) {
        app_output_abandon(&p.json_out);
        if (p.set.record_path) hrt_record_abandon(&p.record);
        return close_device(&p), APP_FAILED;
    }
    watch(&p);
    const bool proved = !p.set.setup || hrt_setup_print(&p.setup);
    if (p.set.common.stats) print_stats(&p);
    cJSON *json = p.set.common.json ? statistics_json(&p) : NULL;
    if (p.live) hrt_live_close(p.live, &p.sent);
    int status = p.set.common.json ? write_json(&p, json) : APP_DONE;
    if (p.set.record_path && hrt_record_end(&p.record) != APP_DONE) status = APP_FAILED;
    close_device(&p);
    hrt_table_free(&p.samples.table);
    return proved || status != APP_DONE ? status : APP_FAILED;
}
