/* The thread, the addresses and the checks that all protocols of motors share. */
#include "drive_motors.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "clock.h"

enum { FRAMES = 256 /* at once */, LOOK_EVERY_US = 50000, CLEARING_US = 50000 };
/* Shortest tick with two commands to each motor: the frames of three take 60 to 80 % of the bus by ODrive and moteus.
 * With one command they take as much at 1000 Hz. */
enum { TWICE_US_MIN = 2000 };
static const double PI = 3.14159265358979323846;

uint32_t hrt_get_u32(const uint8_t *data) {
    return (uint32_t)data[0] | (uint32_t)data[1] << 8 | (uint32_t)data[2] << 16 | (uint32_t)data[3] << 24;
}

void hrt_put_u32(uint8_t *data, uint32_t bits) {
    for (int i = 0; i < 4; i++) data[i] = (uint8_t)(bits >> (8 * i));
}

float hrt_get_float(const uint8_t *data) {
    const uint32_t bits = hrt_get_u32(data);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

void hrt_put_float(uint8_t *data, float value) {
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    hrt_put_u32(data, bits);
}

hrt_motor *hrt_motors_of(hrt_motors *m, uint32_t node) {
    for (int i = 0; i < m->motors; i++)
        if (m->motor[i].node == node) return &m->motor[i];
    return NULL;
}

bool hrt_motors_at_fault(const hrt_motors *m) { return atomic_load(&m->drive->fault) != HRT_DRIVE_FINE; }

bool hrt_motors_clearing(const hrt_motors *m, int64_t now_us) {
    return m->cleared_us != 0 && now_us - m->cleared_us < CLEARING_US;
}

/* Posts the joints once each motor has reported its own anew. */
static void post(hrt_motors *m) {
    hrt_drive_state state = {.time_us = INT64_MAX, .trigger = -1.0};
    for (int i = 0; i < m->motors; i++) {
        const hrt_motor *motor = &m->motor[i];
        if (motor->turns_us == 0) return;
        if (motor->turns_us < state.time_us) state.time_us = motor->turns_us;
        state.cursor_m[i] = motor->turns / motor->turns_per_unit;
    }
    for (int i = 0; i < m->motors; i++) m->motor[i].turns_us = 0;
    hrt_drive_post(m->drive, &state);
}

static void receive(hrt_motors *m, int64_t now_us) {
    hrt_can_frame frame;
    for (int k = 0; k < FRAMES && hrt_bus_receive(&m->bus, &frame) > 0; k++)
        if (!m->protocol->take(m, &frame, now_us)) hrt_drive_refuse(m->drive);
    post(m);
}

static bool ready(const hrt_motors *m, int64_t now_us) {
    for (int i = 0; i < m->motors; i++)
        if (m->motor[i].heard_us == 0 || now_us - m->motor[i].heard_us > m->protocol->silence_us ||
            !m->protocol->ready(&m->motor[i]))
            return false;
    return hrt_bus_state_now((hrt_bus *)&m->bus) < HRT_BUS_OFF;
}

/* Reports an error of a motor, except while a reset is clearing it. */
static bool check_errors(hrt_motors *m, int64_t now_us) {
    for (int i = 0; i < m->motors; i++) {
        if (m->motor[i].error == 0) continue;
        if (hrt_motors_clearing(m, now_us)) return false;
        if (!hrt_motors_at_fault(m)) {
            snprintf(m->why, sizeof m->why, "%s node %u reports error 0x%x", m->protocol->name, m->motor[i].node,
                     m->motor[i].error);
            hrt_drive_fail(m->drive, HRT_DRIVE_FAILS, m->why);
        }
        return false;
    }
    return true;
}

static void look(hrt_motors *m, int64_t now_us) {
    if (hrt_bus_state_now(&m->bus) >= HRT_BUS_OFF) hrt_bus_recover(&m->bus, now_us);
    if (now_us - m->looked_us <= LOOK_EVERY_US) return;
    const char *event = hrt_bus_look(&m->bus);
    if (event) atomic_store(&m->drive->event, event);
    m->looked_us = now_us;
}

static void step(hrt_motors *m) {
    const int64_t now_us = app_monotonic_us();
    float torque[3], motor_Nm[HRT_MOTORS] = {0};
    receive(m, now_us);
    look(m, now_us);
    const bool fault = hrt_motors_at_fault(m), cleared = m->was_fault && !fault;
    m->was_fault = fault;
    if (cleared) m->cleared_us = now_us;
    m->protocol->ask(m, now_us, cleared);
    hrt_drive_up(m->drive, check_errors(m, now_us) && ready(m, now_us), NULL);
    hrt_drive_force(m->drive, now_us, torque);
    for (int i = 0; i < m->motors && atomic_load(&m->drive->up); i++)
        motor_Nm[i] = (float)((double)torque[i] / (2.0 * PI * m->motor[i].turns_per_unit));
    if (m->steps++ % (uint32_t)m->every == 0) m->protocol->command(m, now_us, motor_Nm);
}

static void *run(void *user) {
    hrt_motors *m = user;
    const int64_t period_us = m->drive->period_us;
    int64_t next_us = app_monotonic_us();
    while (!atomic_load(&m->drive->stop)) {
        step(m);
        const int64_t now_us = app_monotonic_us();
        next_us = next_us + period_us > now_us ? next_us + period_us : now_us + 50;
        const struct timespec wait = {0, 1000 * (next_us - now_us)};
        nanosleep(&wait, NULL);
    }
    m->protocol->stop(m);
    return NULL;
}

/* ---------------------------------------------------------------------------------------------- opening */

/* Reads "BUS/NODE:TURNS,NODE:TURNS,...". */
static bool read_name(hrt_motors *m, const char *name, char bus[128]) {
    const char *slash = strrchr(name, '/');
    if (!slash || slash - name >= 128) return false;
    memcpy(bus, name, (size_t)(slash - name));
    bus[slash - name] = 0;
    for (const char *at = slash + 1; m->motors < HRT_MOTORS; m->motors++) {
        hrt_motor *motor = &m->motor[m->motors];
        int used = 0;
        if (sscanf(at, "%u:%lf%n", &motor->node, &motor->turns_per_unit, &used) < 2 ||
            motor->node < m->protocol->node_min || motor->node > m->protocol->node_max ||
            !(fabs(motor->turns_per_unit) > 1.0e-3 && fabs(motor->turns_per_unit) < 1.0e5) ||
            hrt_motors_of(m, motor->node))
            return false;
        at += used;
        if (*at == 0) return m->motors++, true;
        if (*at++ != ',') return false;
    }
    return false;
}

static bool open_bus(hrt_motors *m, const char *address, char *why, int why_size) {
    if (!hrt_bus_open(&m->bus, address, why, why_size)) return false;
    if (!m->protocol->fd || hrt_bus_has_fd(&m->bus)) return true;
    snprintf(why, (size_t)why_size,
             "%s carries no CAN-FD frames; set it up with `ip link set NAME up type can bitrate 1000000 dbitrate "
             "5000000 fd on`",
             address);
    hrt_bus_close(&m->bus);
    return false;
}

bool hrt_motors_open(hrt_drive *d, const hrt_motor_protocol *protocol, const char *name, char *why, int why_size) {
    char bus[128];
    const char *kind = d->driver->kind;
    hrt_motors *m = calloc(1, sizeof *m);
    if (!m) return snprintf(why, (size_t)why_size, "out of memory; close other programs"), false;
    m->drive = d;
    m->protocol = protocol;
    m->every = d->tick_us < TWICE_US_MIN ? 2 : protocol->every;
    if (!read_name(m, name, bus) || m->motors != d->type->motors)
        snprintf(
            why, (size_t)why_size,
            "'%s:%s' does not name %d axes; write %s:BUS/NODE:TURNS,..., TURNS (not 0) of the motor per rad or m of its joint, "
            "NODE within %u..%u",
            kind, name, d->type->motors, kind, protocol->node_min, protocol->node_max);
    else if (open_bus(m, bus, why, why_size)) {
        d->own = m;
        if (pthread_create(&d->thread, NULL, run, m) == 0) return true;
        snprintf(why, (size_t)why_size, "no thread can be started; close other programs");
        hrt_bus_close(&m->bus);
        d->own = NULL;
    }
    free(m);
    return false;
}

void hrt_motors_close(hrt_drive *d) {
    hrt_motors *m = d->own;
    atomic_store(&d->stop, true);
    pthread_join(d->thread, NULL);
    hrt_bus_close(&m->bus);
    free(m);
    d->own = NULL;
}
