/* Motors of joints by ODrive over CANSimple (docs.odriverobotics.com, "CAN Protocol"; its DBC files of 0.5 and 0.6): id
 * = node << 5 | command. A thread of ours reads the cyclic encoder estimates and heartbeats, and sends the torques. An
 * axis runs in closed loop, torque control, passthrough; one that reports an error is a fault of the device. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bus.h"
#include "clock.h"
#include "drive.h"

enum {
    HEARTBEAT = 0x01,
    AXIS_STATE = 0x07,
    ENCODER = 0x09,
    CONTROLLER_MODE = 0x0B,
    INPUT_TORQUE = 0x0E,
    CLEAR_ERRORS = 0x18,
    IDLE = 1,
    CLOSED_LOOP = 8,
    TORQUE_CONTROL = 1,
    PASSTHROUGH = 1,
    AXES = HRT_MOTORS,
    FRAMES = 256, /* at once */
    ASK_EVERY_US = 100000,
    LOOK_EVERY_US = 50000,
    BEAT_MAX_US = 500000
};
static const double PI = 3.14159265358979323846;

typedef struct axis {
    uint32_t node;
    double turns_per_unit; /* motor turns per joint unit, with its sign */
    uint32_t error, state;
    int64_t beat_us, encoder_us; /* 0: none, or taken */
    double turns;
} axis;

typedef struct odrive {
    hrt_drive *drive;
    hrt_bus bus;
    axis axis[AXES];
    int32_t axes;
    int64_t asked_us, looked_us;
    bool was_fault;
    char why[120];
} odrive;

static uint32_t read_u32(const uint8_t *data) {
    return (uint32_t)data[0] | (uint32_t)data[1] << 8 | (uint32_t)data[2] << 16 | (uint32_t)data[3] << 24;
}

static float read_float(const uint8_t *data) {
    const uint32_t bits = read_u32(data);
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static void write_u32(uint8_t *data, uint32_t bits) {
    for (int i = 0; i < 4; i++) data[i] = (uint8_t)(bits >> (8 * i));
}

static void send_frame(odrive *o, const axis *a, uint32_t command, uint8_t length, uint32_t first, uint32_t second) {
    hrt_can_frame frame = {.id = a->node << 5 | command, .length = length};
    write_u32(frame.data, first);
    write_u32(frame.data + 4, second);
    hrt_bus_send(&o->bus, &frame);
}

static void send_torque(odrive *o, const axis *a, float joint_torque) {
    const float motor_Nm = (float)((double)joint_torque / (2.0 * PI * a->turns_per_unit));
    uint32_t bits;
    memcpy(&bits, &motor_Nm, sizeof bits);
    send_frame(o, a, INPUT_TORQUE, 8, bits, 0);
}

/* ---------------------------------------------------------------------------------------------- receiving */

static axis *axis_of(odrive *o, uint32_t node) {
    for (int i = 0; i < o->axes; i++)
        if (o->axis[i].node == node) return &o->axis[i];
    return NULL;
}

static void take_frame(odrive *o, const hrt_can_frame *frame, int64_t now_us) {
    axis *a = frame->flags ? NULL : axis_of(o, frame->id >> 5);
    const uint32_t command = frame->id & 0x1f;
    if (!a || (command != HEARTBEAT && command != ENCODER)) return;
    if (frame->length != 8) {
        hrt_drive_refuse(o->drive);
        return;
    }
    if (command == HEARTBEAT) {
        a->error = read_u32(frame->data);
        a->state = frame->data[4];
        a->beat_us = now_us;
    } else {
        a->turns = (double)read_float(frame->data);
        a->encoder_us = now_us;
    }
}

/* Posts the joints once each axis has told its own anew. */
static void post(odrive *o) {
    hrt_drive_state state = {.time_us = INT64_MAX, .trigger = -1.0};
    for (int i = 0; i < o->axes; i++) {
        if (o->axis[i].encoder_us == 0) return;
        if (o->axis[i].encoder_us < state.time_us) state.time_us = o->axis[i].encoder_us;
        state.cursor_m[i] = o->axis[i].turns / o->axis[i].turns_per_unit;
    }
    for (int i = 0; i < o->axes; i++) o->axis[i].encoder_us = 0;
    hrt_drive_post(o->drive, &state);
}

static void receive(odrive *o, int64_t now_us) {
    hrt_can_frame frame;
    for (int k = 0; k < FRAMES && hrt_bus_receive(&o->bus, &frame) > 0; k++) take_frame(o, &frame, now_us);
    post(o);
}

/* ---------------------------------------------------------------------------------------------- states */

static bool ready(const odrive *o, int64_t now_us) {
    for (int i = 0; i < o->axes; i++)
        if (o->axis[i].beat_us == 0 || now_us - o->axis[i].beat_us > BEAT_MAX_US || o->axis[i].state != CLOSED_LOOP)
            return false;
    return hrt_bus_state_now((hrt_bus *)&o->bus) < HRT_BUS_OFF;
}

static bool check_errors(odrive *o) {
    for (int i = 0; i < o->axes; i++) {
        if (o->axis[i].error == 0) continue;
        snprintf(o->why, sizeof o->why, "ODrive node %u reports error 0x%x", o->axis[i].node, o->axis[i].error);
        if (atomic_load(&o->drive->fault) == HRT_DRIVE_FINE) hrt_drive_fail(o->drive, HRT_DRIVE_FAILS, o->why);
        return false;
    }
    return true;
}

/* Asks axes that are not in closed loop to be so, in torque control; after a reset, clears their errors first. */
static void ask(odrive *o, int64_t now_us) {
    const bool fault = atomic_load(&o->drive->fault) != HRT_DRIVE_FINE;
    if (o->was_fault && !fault)
        for (int i = 0; i < o->axes; i++) {
            send_frame(o, &o->axis[i], CLEAR_ERRORS, 1, 0, 0);
            o->axis[i].error = 0;
        }
    o->was_fault = fault;
    if (fault || now_us - o->asked_us < ASK_EVERY_US) return;
    o->asked_us = now_us;
    for (int i = 0; i < o->axes; i++) {
        const axis *a = &o->axis[i];
        if (a->beat_us == 0 || a->state == CLOSED_LOOP) continue;
        send_frame(o, a, CONTROLLER_MODE, 8, TORQUE_CONTROL, PASSTHROUGH);
        send_frame(o, a, AXIS_STATE, 8, CLOSED_LOOP, 0);
    }
}

static void step(odrive *o) {
    const int64_t now_us = app_monotonic_us();
    float torque[3];
    receive(o, now_us);
    if (hrt_bus_state_now(&o->bus) >= HRT_BUS_OFF) hrt_bus_recover(&o->bus, now_us);
    if (now_us - o->looked_us > LOOK_EVERY_US) {
        const char *event = hrt_bus_look(&o->bus);
        if (event) atomic_store(&o->drive->event, event);
        o->looked_us = now_us;
    }
    ask(o, now_us);
    hrt_drive_up(o->drive, check_errors(o) && ready(o, now_us), NULL);
    hrt_drive_force(o->drive, now_us, torque);
    for (int i = 0; i < o->axes; i++) send_torque(o, &o->axis[i], atomic_load(&o->drive->up) ? torque[i] : 0.0f);
}

static void *run(void *user) {
    odrive *o = user;
    const int64_t period_us = o->drive->period_us;
    int64_t next_us = app_monotonic_us();
    while (!atomic_load(&o->drive->stop)) {
        step(o);
        const int64_t now_us = app_monotonic_us();
        next_us = next_us + period_us > now_us ? next_us + period_us : now_us + 50;
        const struct timespec wait = {0, 1000 * (next_us - now_us)};
        nanosleep(&wait, NULL);
    }
    for (int i = 0; i < o->axes; i++) {
        send_torque(o, &o->axis[i], 0.0f);
        send_frame(o, &o->axis[i], AXIS_STATE, 8, IDLE, 0);
    }
    return NULL;
}

/* ---------------------------------------------------------------------------------------------- opening */

/* Reads "BUS/NODE:TURNS,NODE:TURNS,...": turns of the motor per unit of its joint. */
static bool read_name(odrive *o, const char *name, char bus[128]) {
    const char *slash = strrchr(name, '/');
    if (!slash || slash - name >= 128) return false;
    memcpy(bus, name, (size_t)(slash - name));
    bus[slash - name] = 0;
    for (const char *at = slash + 1; o->axes < AXES; o->axes++) {
        axis *a = &o->axis[o->axes];
        int used = 0;
        if (sscanf(at, "%u:%lf%n", &a->node, &a->turns_per_unit, &used) < 2 || a->node > 0x3f ||
            !(fabs(a->turns_per_unit) > 1.0e-3 && fabs(a->turns_per_unit) < 1.0e5) || axis_of(o, a->node))
            return false;
        at += used;
        if (*at == 0) return o->axes++, true;
        if (*at++ != ',') return false;
    }
    return false;
}

static bool odrive_open(hrt_drive *d, const char *name, char *why, int why_size) {
    char bus[128];
    odrive *o = calloc(1, sizeof *o);
    if (!o) return snprintf(why, (size_t)why_size, "out of memory"), false;
    o->drive = d;
    if (!read_name(o, name, bus) || o->axes != d->type->motors)
        snprintf(
            why, (size_t)why_size,
            "'odrive:%s' names no %d axes; write odrive:BUS/NODE:TURNS,..., TURNS of the motor per rad or m of its joint",
            name, d->type->motors);
    else if (hrt_bus_open(&o->bus, bus, why, why_size)) {
        d->own = o;
        if (pthread_create(&d->thread, NULL, run, o) == 0) return true;
        snprintf(why, (size_t)why_size, "no thread can be started; close other programs");
        hrt_bus_close(&o->bus);
        d->own = NULL;
    }
    free(o);
    return false;
}

static void odrive_close(hrt_drive *d) {
    odrive *o = d->own;
    atomic_store(&d->stop, true);
    pthread_join(d->thread, NULL);
    hrt_bus_close(&o->bus);
    free(o);
    d->own = NULL;
}

static void odrive_list(FILE *file) {
    fputs("  odrive           motors of any device type, by name of bus and nodes\n", file);
}

const hrt_drive_driver hrt_drive_odrive = {.kind = "odrive",
                                           .address = "odrive:BUS/NODE:TURNS,...",
                                           .device = "impulse_engine",
                                           .text = "motors of joints by ODrive, CANSimple",
                                           .joints = true,
                                           .open = odrive_open,
                                           .close = odrive_close,
                                           .list = odrive_list};
