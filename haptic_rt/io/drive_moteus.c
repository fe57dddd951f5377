/* Motors of joints by moteus over CAN-FD, 1 and 5 Mbit/s (mjbots, "moteus reference": registers, and the multiplex
 * protocol's subframes): id = reply << 15 | source << 8 | destination. Each command writes mode, torque, limit and
 * watchdog, and asks for mode, position, velocity, torque and fault, so one answer comes for each command. A motor runs
 * in position mode with its gains scaled to zero, so that the feed-forward torque alone acts; without a command for
 * WATCHDOG_S the motor's own watchdog ends the torque. */
#include "drive_motors.h"

#include <math.h>

enum {
    WRITE_INT8 = 0x00,
    WRITE_FLOAT = 0x0c,
    READ_INT8 = 0x10,
    READ_FLOAT = 0x1c,
    REPLY = 0x20,
    NOP = 0x50,
    REGISTER_MODE = 0x000,
    REGISTER_POSITION = 0x001, /* velocity 0x002, torque 0x003 */
    REGISTER_FAULT = 0x00f,
    REGISTER_COMMAND = 0x020, /* position, velocity, torque, scales of kp and kd, largest torque 0x025 */
    REGISTER_WATCHDOG = 0x027,
    STOPPED = 0,
    FAULT = 1,
    POSITION = 10,
    TIMEOUT = 11,
    MODE_UNKNOWN = 255,
    ASKS_REPLY = 0x8000,
    UNNAMED_ERROR = 0xff
};
static const float WATCHDOG_S = 0.02f;

/* ---------------------------------------------------------------------------------------------- commands */

static void put(hrt_can_frame *frame, uint8_t byte) { frame->data[frame->length++] = byte; }

static void put_value(hrt_can_frame *frame, float value) {
    hrt_put_float(frame->data + frame->length, value);
    frame->length = (uint8_t)(frame->length + 4);
}

static void put_mode(hrt_can_frame *frame, uint8_t mode) {
    put(frame, WRITE_INT8 | 1);
    put(frame, REGISTER_MODE);
    put(frame, mode);
}

static void put_torque(hrt_can_frame *frame, float torque_Nm, float torque_max_Nm) {
    const float value[] = {NAN, 0.0f, torque_Nm, 0.0f, 0.0f, torque_max_Nm};
    put(frame, WRITE_FLOAT); /* more than three: their number follows */
    put(frame, sizeof value / sizeof *value);
    put(frame, REGISTER_COMMAND);
    for (size_t i = 0; i < sizeof value / sizeof *value; i++) put_value(frame, value[i]);
    put(frame, WRITE_FLOAT | 1);
    put(frame, REGISTER_WATCHDOG);
    put_value(frame, WATCHDOG_S);
}

static void send_frame(hrt_motors *m, hrt_can_frame *frame) {
    const uint8_t asked[] = {READ_INT8 | 1,     REGISTER_MODE, READ_FLOAT | 3,
                             REGISTER_POSITION, READ_INT8 | 1, REGISTER_FAULT};
    for (size_t i = 0; i < sizeof asked; i++) put(frame, asked[i]);
    const uint8_t length = hrt_can_fd_length(frame->length);
    while (frame->length < length) put(frame, NOP);
    hrt_bus_send(&m->bus, frame);
}

/* Returns the largest torque of the motor by its joint's limit, N m. */
static float torque_max_of(const hrt_motors *m, int i) {
    return m->drive->type->torque_max[i] / (float)(2.0 * 3.14159265358979 * fabs(m->motor[i].turns_per_unit));
}

/* A motor that is at fault or whose watchdog has acted is stopped first: no other mode is taken from there. */
static void command(hrt_motors *m, int64_t now_us, const float torque_Nm[HRT_MOTORS]) {
    (void)now_us;
    for (int i = 0; i < m->motors; i++) {
        const hrt_motor *motor = &m->motor[i];
        hrt_can_frame frame = {.id = ASKS_REPLY | motor->node, .flags = HRT_CAN_EXTENDED | HRT_CAN_FD};
        const bool stopped = hrt_motors_at_fault(m) || motor->error || motor->heard_us == 0 || motor->state == FAULT ||
                             motor->state == TIMEOUT;
        put_mode(&frame, stopped ? STOPPED : POSITION);
        if (!stopped) put_torque(&frame, torque_Nm[i], torque_max_of(m, i));
        send_frame(m, &frame);
    }
}

static void stop(hrt_motors *m) {
    for (int i = 0; i < m->motors; i++) m->motor[i].heard_us = 0; /* commands a stop */
    command(m, 0, (const float[HRT_MOTORS]){0});
}

static void ask(hrt_motors *m, int64_t now_us, bool cleared) {
    (void)now_us;
    for (int i = 0; i < m->motors && cleared; i++) m->motor[i].error = 0;
}

static bool is_ready(const hrt_motor *motor) { return motor->state == POSITION; }

/* ---------------------------------------------------------------------------------------------- answers */

typedef struct answer {
    uint32_t mode, fault;
    float turns;
    bool has_turns;
} answer;

static void note(answer *a, uint32_t which, const uint8_t *data, int size) {
    if (which == REGISTER_MODE && size == 1) a->mode = data[0];
    if (which == REGISTER_FAULT && size == 1) a->fault = data[0];
    if (which == REGISTER_POSITION && size == 4) {
        a->turns = hrt_get_float(data);
        a->has_turns = true;
    }
}

/* Reads the registers of a reply. Returns false if it is cut short or holds other subframes. All numbers that were
 * asked for are below 128, one byte each. */
static bool read_answer(const hrt_can_frame *frame, answer *a) {
    static const int size_of_type[] = {1, 2, 4, 4};
    for (int at = 0; at < frame->length;) {
        const uint8_t head = frame->data[at++];
        if (head == NOP) continue;
        if ((head & 0xf0) != REPLY) return false;
        const int size = size_of_type[head >> 2 & 3];
        int count = head & 3;
        if (count == 0 && at < frame->length) count = frame->data[at++];
        if (at >= frame->length) return false;
        const uint32_t first = frame->data[at++];
        if (at + count * size > frame->length) return false;
        for (int k = 0; k < count; k++, at += size) note(a, first + (uint32_t)k, frame->data + at, size);
    }
    return true;
}

static bool take(hrt_motors *m, const hrt_can_frame *frame, int64_t now_us) {
    const bool other = frame->flags & (HRT_CAN_ERROR | HRT_CAN_REMOTE) || (frame->id & 0x7f) != 0 || frame->id > 0x7fff;
    hrt_motor *motor = other ? NULL : hrt_motors_of(m, frame->id >> 8);
    answer a = {.mode = MODE_UNKNOWN};
    if (!motor) return true;
    if (!read_answer(frame, &a) || a.mode == MODE_UNKNOWN || !a.has_turns) return false;
    motor->state = a.mode;
    if (a.mode == FAULT && !hrt_motors_clearing(m, now_us)) motor->error = a.fault ? a.fault : UNNAMED_ERROR;
    motor->turns = (double)a.turns;
    motor->heard_us = motor->turns_us = now_us;
    return true;
}

static const hrt_motor_protocol protocol = {.name = "moteus",
                                            .node_min = 1,
                                            .node_max = 0x7e,
                                            .every = 1,
                                            .silence_us = 100000,
                                            .fd = true,
                                            .ready = is_ready,
                                            .take = take,
                                            .ask = ask,
                                            .command = command,
                                            .stop = stop};

static bool moteus_open(hrt_drive *d, const char *name, char *why, int why_size) {
    return hrt_motors_open(d, &protocol, name, why, why_size);
}

static void moteus_list(FILE *file) {
    fputs("  moteus           motors of any device type, by name of a CAN-FD bus and nodes\n", file);
}

const hrt_drive_driver hrt_drive_moteus = {.kind = "moteus",
                                           .address = "moteus:BUS/NODE:TURNS,...",
                                           .device = "impulse_engine",
                                           .text = "motors of joints by moteus, CAN-FD",
                                           .rate_max = 1000,
                                           .joints = true,
                                           .open = moteus_open,
                                           .close = hrt_motors_close,
                                           .list = moteus_list};
