/* tm-device: a virtual device as a program on a CAN bus; its hand follows a script or LCM messages. */
#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "app.h"
#include "device.h"
#include "hand_file.h"
#include "io/command.h"
#include "io/loop.h"
#include "io/report.h"
#include "json_file.h"
#include "log_line.h"

enum { UNREAD = 4, LOOKS_PER_SECOND = 20, QUIET_LOOKS = 5 };

typedef struct program {
    hrt_common common;
    const char *hand, *start;
    double grasp; /* strength of the hand, a factor */
    hrt_device_config config;
    hrt_bus wires;
    hrt_device device;
    hrt_live *live;
    app_key key;
    hrt_live_refused reported_refused;
    hrt_loop loop;
    app_output json_out;
    double torque_peak[HRT_MOTORS], torque_square[HRT_MOTORS];
    /* Hand commands from the receive thread. It owns one slot, the loop another; the third is exchanged between them
     * (UNREAD: newer than the loop's). */
    struct {
        double joint[HRT_JOINTS];
        bool active;
    } hand_reported[3];
    uint32_t hand_write, hand_read;
    _Atomic uint32_t hand_between;
    bool hand_heard;
    _Atomic int fault;
    _Atomic uint32_t commands;
} program;

static void usage(void) {
    puts(
        "usage: tm-device --bus ADDRESS [options]\n"
        "A virtual device on a CAN bus: mass, friction, encoder counts, torque limits, a watchdog, and a hand that moves it.\n"
        "\n"
        "  --bus ADDRESS         " HRT_BUS_ADDRESSES "\n"
        "  --instrument N         0 or 1 (0)\n"
        "  --device-type NAME     type of device; haptic-rt --list lists them (impulse_engine)\n"
        "  --hand FILE            motion of the hand: CSV of time_s, joints by name, [active]; `lcm`: follow HAND_N (at rest)\n"
        "  --start A,B,...        first joint values; Impulse Engine: pitch, yaw rad, insertion m, roll rad, grip (0,0,0.1,0,0)\n"
        "  --repeat               repeat the file of --hand\n"
        "  --straight             interpolate rows by straight lines instead of minimum jerk\n"
        "  --tremor M             add tremor of this amplitude at the tip, m, about 9 Hz (0)\n"
        "  --grasp GAIN           strength of the hand: 1 as configured, 0 releases the device (1)\n"
        "  --noise COUNTS         add noise to the encoders, RMS counts (0), from --seed N (1)\n"
        "  --profile FILE, --set NAME=VALUE   read a device profile, set one parameter; --params prints all\n"
        "  --lcm-url URL          LCM for --hand lcm (" APP_LINK_URL "; $LCM_DEFAULT_URL when set)\n"
        "  --key FILE, --no-key   as of haptic-rt, for --hand lcm\n"
        "  --rate HZ              encoder frames a second, 100..4000 (500)\n"
        "  --duration S, --priority N, --stats, --json FILE, --quiet, -h, --help, --version   as of haptic-rt\n"
        "\n"
        "Exit 0: done. 2: bad input. 1: anything else. Frames: docs/can.md.");
}

enum { O_HAND = HRT_OPTION_OWN, O_START, O_REPEAT, O_STRAIGHT, O_TREMOR, O_GRASP, O_NOISE, O_SEED };
static const struct option options[] = {HRT_COMMON_OPTIONS,
                                        {"hand", 1, 0, O_HAND},
                                        {"start", 1, 0, O_START},
                                        {"repeat", 0, 0, O_REPEAT},
                                        {"straight", 0, 0, O_STRAIGHT},
                                        {"tremor", 1, 0, O_TREMOR},
                                        {"grasp", 1, 0, O_GRASP},
                                        {"noise", 1, 0, O_NOISE},
                                        {"seed", 1, 0, O_SEED},
                                        {0, 0, 0, 0}};

static bool read_start(const char *text, const hrt_device_type *device, double joint[HRT_JOINTS]) {
    const char *at = text;
    for (int j = 0; j < device->joints; j++) {
        char *end;
        joint[j] = strtod(at, &end);
        const bool good = end != at && fabs(joint[j]) < 100.0 && *end == (j + 1 < device->joints ? ',' : 0);
        if (!good)
            return app_bad_input(
                       "--start", 0,
                       "'%s' is not a list of joint values; a %s has %d joints, each below 100: write A,B,...", text,
                       device->name, device->joints),
                   false;
        at = end + 1;
    }
    return true;
}

static int checked(bool good) { return good ? -1 : APP_BAD_INPUT; }

static int take_option(void *user, int option, const char *text) {
    program *p = user;
    hrt_device_config *c = &p->config;
    double number = 0.0;
    switch (option) {
    case O_HAND: p->hand = text; return -1;
    case O_START: p->start = text; return -1;
    case O_REPEAT: c->hand.repeat = true; return -1;
    case O_STRAIGHT: c->hand.straight = true; return -1;
    case O_TREMOR: return checked(hrt_option_number("--tremor", text, 0, 0.01, &c->hand.tremor_m));
    case O_GRASP: return checked(hrt_option_number("--grasp", text, 0, 100, &p->grasp));
    case O_NOISE: return checked(hrt_option_number("--noise", text, 0, 1000, &c->noise_counts));
    case O_SEED:
        if (!hrt_option_number("--seed", text, 1, 9.0e15, &number)) return APP_BAD_INPUT;
        c->seed = (uint64_t)number;
        return -1;
    default: return APP_BAD_INPUT;
    }
}

/* Completes the settings that depend on the device type, which may come anywhere on the command line. */
static int complete(program *p) {
    const hrt_device_config set = p->config;
    hrt_device_config *c = &p->config;
    *c = hrt_device_config_of(p->common.params.device, p->common.instrument);
    c->profile = p->common.params;
    c->session = set.session, c->seed = set.seed, c->noise_counts = set.noise_counts, c->hand = set.hand;
    for (int j = 0; j < HRT_MOTORS; j++) {
        c->hand_stiffness[j] *= p->grasp;
        c->hand_damping[j] *= sqrt(p->grasp);
    }
    return p->start ? checked(read_start(p->start, c->profile.device, c->rest)) : -1;
}

/* Reads the options. Returns -1 to continue, else the exit code. */
static int read_options(program *p, int argc, char **argv) {
    const hrt_command_line line = {
        .program = "tm-device", .usage = usage, .option = options, .take = take_option, .user = p};
    p->config = hrt_device_config_default(0);
    p->config.session = (uint16_t)(1 + app_session() % 65535);
    p->grasp = 1.0;
    p->common = (hrt_common){.rate = 500, .priority = 70, .params = p->config.profile};
    const int code = hrt_command_read(&line, &p->common, argc, argv);
    return code >= 0 ? code : complete(p);
}

static void hand_reported(void *user, const double joint[HRT_JOINTS], bool active) {
    program *p = user;
    memcpy(p->hand_reported[p->hand_write].joint, joint, sizeof p->hand_reported[0].joint);
    p->hand_reported[p->hand_write].active = active;
    p->hand_write = atomic_exchange(&p->hand_between, p->hand_write | UNREAD) & 3u;
}

static void tick(void *user, int64_t now_us) {
    program *p = user;
    if ((atomic_load(&p->hand_between) & UNREAD) != 0) {
        p->hand_read = atomic_exchange(&p->hand_between, p->hand_read) & 3u;
        p->hand_heard = true;
    }
    if (p->hand_heard)
        hrt_device_hand(&p->device, p->hand_reported[p->hand_read].joint, p->hand_reported[p->hand_read].active);
    hrt_device_step(&p->device, now_us);
    for (int j = 0; j < HRT_MOTORS; j++) {
        p->torque_peak[j] = fmax(p->torque_peak[j], fabs(p->device.torque[j]));
        p->torque_square[j] += p->device.torque[j] * p->device.torque[j];
    }
    atomic_store(&p->fault, (int)p->device.fault);
    atomic_store(&p->commands, p->device.commands);
}

static int open_all(program *p) {
    char why[300];
    const bool follow = p->hand && strcmp(p->hand, "lcm") == 0;
    if (p->hand && !follow && !hrt_hand_file_read(p->hand, p->config.profile.device, &p->config.hand))
        return APP_BAD_INPUT;
    if (!hrt_bus_open(&p->wires, p->common.bus, why, sizeof why) ||
        !hrt_bus_claim(&p->wires, HRT_BUS_DEVICE, p->config.instrument, why, sizeof why))
        return app_bad_input("--bus", 0, "%s", why);
    hrt_device_init(&p->device, &p->config, &p->wires);
    p->hand_write = 1;
    p->hand_read = 2;
    hrt_peer_def def = {.instrument = p->config.instrument,
                        .joints = p->config.profile.device->joints,
                        .hand = hand_reported,
                        .user = p};
    const int unlinked = follow ? hrt_common_join(&p->common, &def, &p->key, &p->live) : APP_DONE;
    if (unlinked) return unlinked;
    return hrt_output_begin(&p->json_out, p->common.json);
}

/* Logs loss and return of commands, in pairs. */
static void log_commands(const program *p, uint32_t *seen, int *quiet_looks, bool *told) {
    const uint32_t commands = atomic_load(&p->commands);
    const bool come = commands != *seen, first = *seen == 0;
    *quiet_looks = come ? 0 : *quiet_looks + 1;
    *seen = commands;
    if (come && (*told || first))
        app_say("tm-device: receiving commands");
    else if (!come && !*told && *quiet_looks >= QUIET_LOOKS)
        app_say("tm-device: waiting for commands on %s; start haptic-rt, in any order", p->common.bus);
    *told = *told ? !come : *quiet_looks >= QUIET_LOOKS;
}

static void watch(program *p) {
    static const char *const fault_text[] = {
        "well again", "commands stopped: torque set to 0, waiting for the command \"motors off\"",
        "ten corrupt commands in a row: torque set to 0, waiting for a reset", "the bus is off: torque set to 0"};
    bool told_wait = false;
    int looks = 0, quiet_looks = 0, told_fault = 0;
    uint32_t seen = 0;
    while (!atomic_load(&p->loop.done)) {
        nanosleep(&(const struct timespec){0, 1000000000 / LOOKS_PER_SECOND}, NULL);
        const char *lost = hrt_bus_look(&p->wires);
        if (lost) app_say("tm-device: %s: %s", p->common.bus, lost);
        const int fault = atomic_load(&p->fault);
        log_commands(p, &seen, &quiet_looks, &told_wait);
        if (fault != told_fault && fault >= 0 && fault <= 3) app_say("tm-device: %s", fault_text[fault]);
        told_fault = fault;
        if (p->live && ++looks % LOOKS_PER_SECOND == 0) hrt_log_refused("tm-device", p->live, &p->reported_refused);
    }
    pthread_join(p->loop.thread, NULL);
}

static int write_json(program *p) {
    cJSON *json = app_json_add(cJSON_CreateObject(), "instrument %d", p->config.instrument);
    hrt_report_loop(json, &p->loop);
    app_json_add(json, "commands %g fault %d", (double)p->device.commands, (int)p->device.fault);
    const double ticks = fmax(1.0, (double)p->loop.ticks);
    double rms[HRT_MOTORS];
    for (int j = 0; j < HRT_MOTORS; j++) rms[j] = sqrt(p->torque_square[j] / ticks);
    cJSON_AddItemToObject(json, "torque_peak", cJSON_CreateDoubleArray(p->torque_peak, HRT_MOTORS));
    cJSON_AddItemToObject(json, "torque_rms", cJSON_CreateDoubleArray(rms, HRT_MOTORS));
    cJSON_AddItemToObject(json, "joint", cJSON_CreateDoubleArray(p->device.joint, p->config.profile.device->joints));
    hrt_report_can(json, &p->wires, &p->device.can, ticks / p->common.rate);
    return hrt_report_write(json, &p->json_out);
}

int main(int argc, char **argv) {
    static program p;
    app_check_stdout();
    const int bad = read_options(&p, argc, argv);
    if (bad >= 0) return bad;
    const int failed = open_all(&p);
    if (failed) return hrt_bus_close(&p.wires), failed;
    p.loop =
        (hrt_loop){.program = "tm-device",
                   .period_ns = 1000000000 / p.common.rate,
                   .priority = p.common.priority,
                   .idle_states = true,
                   .tick = tick,
                   .user = &p,
                   .ticks_max = p.common.duration_s > 0.0 ? (int64_t)(p.common.duration_s * p.common.rate + 0.5) : 0};
    p.device.config.period_us = 0.5e6 / p.common.rate; /* one set per tick; the loop keeps the rate */
    hrt_stop_on_signals(&p.loop.stop);
    if (!hrt_loop_start(&p.loop)) {
        app_output_abandon(&p.json_out);
        return hrt_bus_close(&p.wires), APP_FAILED;
    }
    watch(&p);
    if (p.live) hrt_live_close(p.live, NULL);
    if (p.common.stats) {
        printf("tm-device: %lld ticks, %lld missed, %u commands, %u gaps\n", (long long)p.loop.ticks,
               (long long)p.loop.missed, p.device.commands, p.device.can.lost);
        hrt_print_quantiles("lateness", &p.loop.lateness);
        hrt_print_quantiles("duration", &p.loop.duration);
    }
    const int status = p.common.json ? write_json(&p) : APP_DONE;
    hrt_bus_close(&p.wires);
    free((void *)(uintptr_t)p.config.hand.key);
    return status;
}
