/* haptic-rt: the controller as a Linux program. A loop thread ticks; this thread says what happens and writes the
 * figures. Over 400 lines: options, threads and figures of one program. */
#include <cjson/cJSON.h>
#include <getopt.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "app.h"
#include "live.h"
#include "loop.h"
#include "network.h"
#include "profile.h"
#include "record.h"
#include "report.h"
#include "samples.h"
#include "say.h"

enum { STATUS_EVERY_US = 100000, DEVICE_HERE_US = 100000 };

typedef struct program {
    /* options */
    const char *bus, *url, *samples_path, *json, *record_path, *key_path;
    hrt_node_config config;
    int rate, priority;
    double duration_s, auto_reset_s;
    bool stats, replay, no_key;
    /* running */
    hrt_bus wires;
    hrt_node node;
    hrt_samples samples;
    hrt_live *live;
    app_key key;
    hrt_live_sent sent;
    hrt_live_refused told_refused;
    hrt_loop loop;
    tensormass_tool_state_t tool;
    int64_t status_us;
    app_output json_out;
    hrt_record record;
    hrt_histogram stage[HRT_NODE_STAGES + 1];
    double force_square, force_peak_N;
    int64_t force_ticks;
    /* told to the other thread */
    _Atomic int state, fault, detail;
    _Atomic bool pose_known, device_here, samples_over;
    _Atomic int64_t went_stale, went_unstable, samples_come, samples_taken, samples_refused, frames, command_gaps,
        resets;
} program;

static void usage(void) {
    puts(
        "usage: haptic-rt --bus ADDRESS [options]\n"
        "The controller of one Impulse Engine: 500 times a second encoders in, torques out, forces from tm-sim extrapolated between its frames.\n"
        "\n"
        "  --bus, --device ADDRESS " HRT_BUS_ADDRESSES "\n"
        "  --instrument N           0 or 1: channels TOOL_N, FORCE_N, PATCH_N, CONTROLLER_N and the device's ids on the bus (0)\n"
        "  --mode NAME              probe, grasper or cautery (probe)\n"
        "  --extrapolator NAME     " HRT_EXTRAPOLATOR_NAMES " (contact)\n"
        "  --passivity              passivity control on\n"
        "  --coupling               virtual coupling on\n"
        "  --trocar X,Y,Z --axis X,Y,Z --up X,Y,Z   the trocar's pose, m, world; without them it is learned from SIM_STATUS\n"
        "  --profile FILE           device profile and parameters\n"
        "  --set NAME=VALUE         one parameter; may be repeated\n"
        "  --params                 print all parameters with range and unit, and end\n"
        "  --lcm-url URL            LCM (" APP_LINK_URL "; $LCM_DEFAULT_URL when set)\n"
        "  --key FILE               shared with tm-sim: only messages sealed with it are taken (docs/trust.md)\n"
        "  --no-key                 take anybody's messages, though the URL lets them come from other machines\n"
        "  --samples FILE           recorded samples (CSV) instead of LCM; with --lcm-url, beside it\n"
        "  --replay                 samples come from lcm-logplayer: take them though they answered another controller\n"
        "  --rate HZ                ticks a second, 100..2000 (500)\n"
        "  --duration S             end after so long (never)\n"
        "  --priority N             SCHED_FIFO 1..99, 0 for normal scheduling (80)\n"
        "  --idle-states            let idle processors sleep: less power, later ticks\n"
        "  --auto-reset S           reset a fault by itself after so long; for demonstrations and tests\n"
        "  --stats                  timing figures at the end\n"
        "  --json FILE              all figures at the end\n"
        "  --record FILE            every tick as CSV\n"
        "  --quiet                  trouble alone is said, not that all is well\n"
        "  --list                   names of extrapolators, modes and buses\n"
        "  -h, --help, --version\n"
        "\n"
        "Exit 0: done. 2: bad input. 1: anything else. States, faults and limits: docs/controller.md.");
}

/* ---------------------------------------------------------------------------------------------- options */

static bool read_vector(const char *option, const char *text, double v[3]) {
    char tail;
    if (sscanf(text, "%lf,%lf,%lf%c", &v[0], &v[1], &v[2], &tail) == 3 && isfinite(v[0]) && isfinite(v[1]) &&
        isfinite(v[2]))
        return true;
    app_bad_input(option, 0, "'%s' is no vector; write X,Y,Z", text);
    return false;
}

static bool read_mode(const char *text, int8_t *mode) {
    static const char *const name[3] = {"probe", "grasper", "cautery"};
    for (int8_t m = 0; m < 3; m++)
        if (strcmp(text, name[m]) == 0) {
            *mode = m;
            return true;
        }
    app_bad_input("--mode", 0, "'%s' is no mode; use probe, grasper or cautery", text);
    return false;
}

enum {
    O_BUS = 1,
    O_INSTRUMENT,
    O_MODE,
    O_EXTRAPOLATOR,
    O_PASSIVITY,
    O_COUPLING,
    O_TROCAR,
    O_AXIS,
    O_UP,
    O_PROFILE,
    O_SET,
    O_PARAMS,
    O_URL,
    O_SAMPLES,
    O_RATE,
    O_DURATION,
    O_PRIORITY,
    O_AUTO_RESET,
    O_STATS,
    O_JSON,
    O_RECORD,
    O_REPLAY,
    O_IDLE_STATES,
    O_KEY,
    O_NO_KEY,
    O_QUIET,
    O_LIST,
    O_VERSION,
    O_HELP = 'h'
};
/* "url" is the old name of "lcm-url". */
static const struct option options[] = {{"bus", 1, 0, O_BUS},
                                        {"device", 1, 0, O_BUS},
                                        {"instrument", 1, 0, O_INSTRUMENT},
                                        {"mode", 1, 0, O_MODE},
                                        {"extrapolator", 1, 0, O_EXTRAPOLATOR},
                                        {"passivity", 0, 0, O_PASSIVITY},
                                        {"coupling", 0, 0, O_COUPLING},
                                        {"trocar", 1, 0, O_TROCAR},
                                        {"axis", 1, 0, O_AXIS},
                                        {"up", 1, 0, O_UP},
                                        {"profile", 1, 0, O_PROFILE},
                                        {"set", 1, 0, O_SET},
                                        {"params", 0, 0, O_PARAMS},
                                        {"lcm-url", 1, 0, O_URL},
                                        {"url", 1, 0, O_URL},
                                        {"samples", 1, 0, O_SAMPLES},
                                        {"rate", 1, 0, O_RATE},
                                        {"duration", 1, 0, O_DURATION},
                                        {"priority", 1, 0, O_PRIORITY},
                                        {"auto-reset", 1, 0, O_AUTO_RESET},
                                        {"stats", 0, 0, O_STATS},
                                        {"json", 1, 0, O_JSON},
                                        {"record", 1, 0, O_RECORD},
                                        {"replay", 0, 0, O_REPLAY},
                                        {"idle-states", 0, 0, O_IDLE_STATES},
                                        {"key", 1, 0, O_KEY},
                                        {"no-key", 0, 0, O_NO_KEY},
                                        {"help", 0, 0, O_HELP},
                                        {"quiet", 0, 0, O_QUIET},
                                        {"list", 0, 0, O_LIST},
                                        {"version", 0, 0, O_VERSION},
                                        {0, 0, 0, 0}};

/* One option. False: bad, already told. */
static bool take_option(program *p, int option, const char *text) {
    double number = 0.0;
    switch (option) {
    case O_BUS: p->bus = text; return true;
    case O_INSTRUMENT:
        if (!hrt_option_number("--instrument", text, 0, 1, &number)) return false;
        p->config.instrument = (int32_t)number;
        return true;
    case O_MODE: return read_mode(text, &p->config.mode);
    case O_EXTRAPOLATOR:
        if (hrt_extrapolator_find(text, &p->config.extrapolator)) return true;
        app_bad_input("--extrapolator", 0, "'%s' is none; use one of" HRT_EXTRAPOLATOR_NAMES, text);
        return false;
    case O_PASSIVITY: p->config.passivity = true; return true;
    case O_COUPLING: p->config.coupling = true; return true;
    case O_TROCAR: p->config.pose_known = true; return read_vector("--trocar", text, p->config.pose.trocar_m);
    case O_AXIS: return read_vector("--axis", text, p->config.pose.axis);
    case O_UP: return read_vector("--up", text, p->config.pose.up);
    case O_PROFILE: return hrt_profile_read(text, &p->config.params);
    case O_SET: return hrt_profile_set(text, &p->config.params);
    case O_URL: p->url = text; return true;
    case O_KEY: p->key_path = text; return true;
    case O_NO_KEY: p->no_key = true; return true;
    case O_SAMPLES: p->samples_path = text; return true;
    case O_RATE:
        if (!hrt_option_number("--rate", text, 100, 2000, &number)) return false;
        p->rate = (int)number;
        return true;
    case O_DURATION: return hrt_option_number("--duration", text, 0.01, 1.0e6, &p->duration_s);
    case O_PRIORITY:
        if (!hrt_option_number("--priority", text, 0, 99, &number)) return false;
        p->priority = (int)number;
        return true;
    case O_AUTO_RESET: return hrt_option_number("--auto-reset", text, 0.05, 1.0e6, &p->auto_reset_s);
    case O_STATS: p->stats = true; return true;
    case O_QUIET: app_be_quiet(); return true;
    case O_REPLAY: p->replay = true; return true;
    case O_IDLE_STATES: p->loop.idle_states = true; return true;
    case O_JSON: p->json = text; return true;
    case O_RECORD: p->record_path = text; return true;
    default: return false;
    }
}

static bool consistent(program *p) {
    hrt_frame frame;
    const float axis[3] = {(float)p->config.pose.axis[0], (float)p->config.pose.axis[1], (float)p->config.pose.axis[2]};
    const float up[3] = {(float)p->config.pose.up[0], (float)p->config.pose.up[1], (float)p->config.pose.up[2]};
    if (!p->bus)
        app_bad_input("--bus", 0, "is missing; name one, for example --bus virtual:demo (see --help)");
    else if (!hrt_frame_from_axis(&frame, axis, up))
        app_bad_input("--axis", 0, "is zero or along --up; give two directions that differ");
    else if (hrt_params_check(&p->config.params) >= 0)
        app_bad_input("--set", 0, "%s: lower end not below upper end; mend it",
                      hrt_param_text[hrt_params_check(&p->config.params)].name);
    else
        return true;
    return false;
}

static void list(void) {
    printf("extrapolators");
    for (int i = 0; i < HRT_EXTRAPOLATOR_COUNT; i++) printf(" %s", hrt_extrapolator_name((hrt_extrapolator)i));
    printf("\nmodes probe grasper cautery\nbuses" HRT_BUS_ADDRESSES "\n");
}

/* -1: go on; else the exit code. */
static int read_options(program *p, int argc, char **argv) {
    opterr = 0;
    for (int option; (option = getopt_long(argc, argv, ":h", options, NULL)) != -1;) {
        if (option == '?') return app_bad_input(argv[optind - 1], 0, "no such option; see haptic-rt --help");
        if (option == ':') return app_bad_input(argv[optind - 1], 0, "needs a value; see haptic-rt --help");
        if (option == O_HELP) return usage(), APP_DONE;
        if (option == O_VERSION) return printf("haptic-rt %s\n", tm_version()), APP_DONE;
        if (option == O_LIST) return list(), APP_DONE;
        if (option == O_PARAMS) return hrt_profile_write(stdout, &p->config.params), APP_DONE;
        if (!take_option(p, option, optarg)) return APP_BAD_INPUT;
    }
    if (optind < argc) return app_bad_input(argv[optind], 0, "not an option; see haptic-rt --help");
    return consistent(p) ? -1 : APP_BAD_INPUT;
}

/* ---------------------------------------------------------------------------------------------- the loop's thread */

static void figures(program *p, int64_t publish_ns) {
    for (int s = 0; s < HRT_NODE_STAGES; s++) hrt_histogram_add(&p->stage[s], p->node.stage_ns[s]);
    hrt_histogram_add(&p->stage[HRT_NODE_STAGES], publish_ns);
    const float *f = p->node.output.force_N;
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
    hrt_live_say_status(p->live, &status);
}

/* What the other thread says in words. */
static void tell(program *p, int64_t now_us) {
    const hrt_counters *c = &p->node.controller.counters;
    const int64_t turned_away = (int64_t)atomic_load(&p->node.rejected) + atomic_load(&p->node.late);
    const int64_t encoder_us = p->node.input.encoder_us;
    /* `stale` may be over before the other thread looks. */
    const bool unstable = (p->node.output.limits & HRT_LIMIT_UNSTABLE) != 0;
    if (p->node.output.state == HRT_STALE && atomic_load(&p->state) != HRT_STALE)
        atomic_fetch_add(unstable ? &p->went_unstable : &p->went_stale, 1);
    atomic_store(&p->state, (int)p->node.output.state);
    atomic_store(&p->fault, (int)p->node.output.fault);
    atomic_store(&p->detail, p->node.output.fault_detail);
    atomic_store(&p->pose_known, p->node.config.pose_known);
    atomic_store(&p->device_here, encoder_us != 0 && now_us - encoder_us < DEVICE_HERE_US);
    atomic_store(&p->samples_come, (int64_t)c->samples_received + turned_away);
    atomic_store(&p->samples_taken, (int64_t)c->samples_received - c->samples_late - c->samples_rejected);
    atomic_store(&p->samples_refused, (int64_t)c->samples_rejected + atomic_load(&p->node.rejected));
    atomic_store(&p->frames, (int64_t)p->wires.rx);
    atomic_store(&p->command_gaps, (int64_t)p->node.line.can.command_gaps);
}

static void tick(void *user, int64_t now_us) {
    program *p = user;
    const bool meaningful = hrt_node_tick(&p->node, now_us, &p->tool);
    const int64_t begin_ns = hrt_clock_ns();
    if (p->samples_path && !hrt_samples_feed(&p->samples, &p->node, &p->tool, now_us))
        atomic_store(&p->samples_over, true);
    if (p->live && meaningful) hrt_live_say_tool(p->live, &p->tool);
    if (p->live && now_us - p->status_us >= STATUS_EVERY_US) {
        publish_status(p);
        p->status_us = now_us;
    }
    figures(p, hrt_clock_ns() - begin_ns);
    if (p->record_path) hrt_record_put(&p->record, 1.0e-6 * (double)(now_us - p->loop.start_us), &p->node.output);
    tell(p, now_us);
}

/* At once, before the device's watchdog wonders. */
static void end(void *user) {
    program *p = user;
    hrt_node_stop(&p->node);
}

/* ---------------------------------------------------------------------------------------------- this thread */

static hrt_facts facts_now(const program *p) {
    const int64_t start_us = p->loop.start_us ? p->loop.start_us : hrt_clock_ns() / 1000;
    return (hrt_facts){.time_s = 1.0e-6 * (double)(hrt_clock_ns() / 1000 - start_us),
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
                       .device_here = atomic_load(&p->device_here)};
}

static void reset_by_itself(program *p, const hrt_facts *facts, double *since_s) {
    if (facts->state != HRT_FAULT || p->auto_reset_s <= 0.0) *since_s = facts->time_s;
    if (facts->time_s < *since_s + p->auto_reset_s || facts->state != HRT_FAULT || p->auto_reset_s <= 0.0) return;
    const hrt_command reset = {.extrapolator = -1, .passivity = -1, .coupling = -1, .enable = -1, .reset = true};
    hrt_say_line(facts->time_s, "reset by --auto-reset");
    hrt_node_post_command(&p->node, &reset);
    atomic_fetch_add(&p->resets, 1);
    *since_s = facts->time_s;
}

static void watch(program *p) {
    hrt_teller teller = {
        .bus = p->bus,
        .instrument = p->config.instrument,
        .from_file = p->samples_path != NULL,
        .told = {.state = -1, .silent_s = -1.0e9, .refused_s = -1.0e9, .gaps_s = -1.0e9, .unstable_s = -1.0e9}};
    double fault_since_s = 0.0;
    enum { LOOKS_PER_SECOND = 20 };
    int looks = 0;
    while (!atomic_load(&p->loop.done)) {
        nanosleep(&(const struct timespec){0, 50000000}, NULL);
        const hrt_facts facts = facts_now(p);
        const char *lost = hrt_bus_look(&p->wires);
        if (lost) hrt_say_line(facts.time_s, "%s: %s", p->bus, lost);
        if (atomic_load(&p->loop.ticks) > 50) hrt_say(&teller, &facts);
        if (p->record_path) hrt_record_write(&p->record);
        char who[48];
        snprintf(who, sizeof who, "haptic-rt %.3f s", facts.time_s);
        if (p->live && ++looks % LOOKS_PER_SECOND == 0) hrt_say_refused(who, p->live, &p->told_refused);
        reset_by_itself(p, &facts, &fault_since_s);
    }
    pthread_join(p->loop.thread, NULL);
}

static const char *const stage_name[HRT_NODE_STAGES + 1] = {"receive", "control", "send", "publish"};

static cJSON *figures_json(program *p) {
    cJSON *json = cJSON_CreateObject();
    tensormass_controller_status_t s;
    hrt_node_status(&p->node, &s);
    cJSON_AddNumberToObject(json, "instrument", p->config.instrument);
    cJSON_AddNumberToObject(json, "rate_Hz", p->rate);
    hrt_report_loop(json, &p->loop);
    cJSON *stages = cJSON_AddObjectToObject(json, "stage_us");
    for (int i = 0; i <= HRT_NODE_STAGES; i++) hrt_report_quantiles(stages, stage_name[i], &p->stage[i]);
    cJSON_AddStringToObject(json, "state", hrt_state_name((hrt_state)s.state));
    cJSON_AddStringToObject(json, "fault", hrt_fault_name((hrt_fault)s.fault));
    cJSON_AddNumberToObject(json, "resets", (double)p->resets);
    cJSON_AddStringToObject(json, "extrapolator", s.extrapolator);
    cJSON *force = cJSON_AddObjectToObject(json, "force_N");
    cJSON_AddNumberToObject(force, "rms", p->force_ticks ? sqrt(p->force_square / (double)p->force_ticks) : 0.0);
    cJSON_AddNumberToObject(force, "peak", p->force_peak_N);
    cJSON *samples = cJSON_AddObjectToObject(json, "samples");
    cJSON_AddNumberToObject(samples, "received", (double)s.samples_received);
    cJSON_AddNumberToObject(samples, "late", (double)s.samples_late);
    cJSON_AddNumberToObject(samples, "lost", (double)s.samples_lost);
    cJSON_AddNumberToObject(samples, "rejected", (double)s.samples_rejected);
    hrt_report_can(json, &p->wires, &p->node.line.can, (double)p->loop.ticks / p->rate);
    if (p->live) hrt_report_refused(json, p->live);
    return json;
}

static int write_json(program *p, cJSON *json) {
    if (p->live) {
        cJSON *sent = cJSON_AddObjectToObject(json, "sent");
        cJSON_AddNumberToObject(sent, "tools", (double)p->sent.tools);
        cJSON_AddNumberToObject(sent, "skipped", (double)p->sent.skipped);
        hrt_report_quantiles(sent, "lay_us", &p->sent.lay);
    }
    return hrt_report_write(json, &p->json_out);
}

static void print_stats(const program *p) {
    printf("haptic-rt: %lld ticks, %lld missed, %s%s\n", (long long)p->loop.ticks, (long long)p->loop.missed,
           p->loop.real_time ? "SCHED_FIFO" : "normal scheduling",
           p->loop.awake_fd >= 0 ? ", idle states held off" : "");
    hrt_print_quantiles("lateness", &p->loop.lateness);
    hrt_print_quantiles("duration", &p->loop.duration);
    for (int i = 0; i <= HRT_NODE_STAGES; i++) hrt_print_quantiles(stage_name[i], &p->stage[i]);
    printf("  bus        %llu sent, %llu received, load %.1f %% of 1 Mbit/s\n", (unsigned long long)p->wires.tx,
           (unsigned long long)p->wires.rx, 100.0 * (double)p->wires.bits / (1.0e6 * (double)p->loop.ticks / p->rate));
}

static int open_link(program *p) {
    char why[300];
    const char *set = getenv("LCM_DEFAULT_URL"), *url = p->url ? p->url : set && *set ? set : APP_LINK_URL;
    const hrt_peer_def def = {
        .instrument = p->config.instrument, .node = &p->node, .key = &p->key, .replay = p->replay};
    if (p->samples_path && !p->url) return APP_DONE; /* without LCM */
    if (!app_key_for(url, p->key_path, p->no_key, &p->key, why, sizeof why))
        return app_bad_input("--key", 0, "%s", why);
    tm_error error = {.status = TM_OK};
    app_network_opener *network = hrt_network(&error);
    if (!network) return app_report("--lcm-url", 0, &error), APP_FAILED;
    /* The receive threads inherit: real-time, but below the loop. */
    const bool raised = p->priority > 1 && hrt_priority(p->priority > 20 ? p->priority - 20 : 1);
    p->live = hrt_live_open(network, url, &def, why, sizeof why);
    if (raised) hrt_priority(0);
    return p->live ? APP_DONE : app_bad_input("--lcm-url", 0, "%s", why);
}

static int open_all(program *p) {
    char why[300];
    if (p->samples_path && !hrt_samples_read(&p->samples, p->samples_path)) return APP_BAD_INPUT;
    if (!hrt_bus_open(&p->wires, p->bus, why, sizeof why) ||
        !hrt_bus_claim(&p->wires, HRT_BUS_CONTROLLER, p->config.instrument, why, sizeof why))
        return app_bad_input("--bus", 0, "%s", why);
    hrt_node_init(&p->node, &p->config, &p->wires);
    p->node.clock_ns = hrt_clock_ns;
    const int unlinked = open_link(p);
    if (unlinked) return unlinked;
    const int unwritable = hrt_output_begin(&p->json_out, p->json);
    if (unwritable) return unwritable;
    const int unrecorded = p->record_path ? hrt_record_begin(&p->record, p->record_path) : APP_DONE;
    if (unrecorded) app_output_abandon(&p->json_out);
    return unrecorded;
}

int main(int argc, char **argv) {
    static program p;
    app_check_stdout();
    p.config = hrt_node_config_default(0);
    p.config.session = app_session();
    p.rate = 500;
    p.priority = 80;
    const int bad = read_options(&p, argc, argv);
    if (bad >= 0) return bad;
    const int failed = open_all(&p);
    if (failed) return hrt_bus_close(&p.wires), failed;
    p.loop.program = "haptic-rt";
    p.loop.period_ns = 1000000000 / p.rate;
    p.loop.priority = p.priority;
    p.loop.ticks_max = p.duration_s > 0.0 ? (int64_t)(p.duration_s * p.rate + 0.5) : 0;
    p.loop.tick = tick;
    p.loop.end = end;
    p.loop.user = &p;
    hrt_stop_on_signals(&p.loop.stop);
    if (!hrt_loop_start(&p.loop)) {
        app_output_abandon(&p.json_out);
        if (p.record_path) hrt_record_abandon(&p.record);
        return hrt_bus_close(&p.wires), APP_FAILED;
    }
    watch(&p);
    if (p.stats) print_stats(&p);
    cJSON *json = p.json ? figures_json(&p) : NULL;
    if (p.live) hrt_live_close(p.live, &p.sent);
    int status = p.json ? write_json(&p, json) : APP_DONE;
    if (p.record_path && hrt_record_end(&p.record) != APP_DONE) status = APP_FAILED;
    hrt_bus_close(&p.wires);
    hrt_table_free(&p.samples.table);
    return status;
}
