/* Motors of joints by ODrive over CANSimple (docs.odriverobotics.com, "CAN Protocol"; its DBC files of 0.5 and 0.6): id
 * = node << 5 | command. Takes the cyclic encoder estimates and heartbeats. A motor runs in closed loop, torque
 * control, passthrough; one that reports an error is a fault of the device. */
#include "drive_motors.h"

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
    ASK_EVERY_US = 100000
};

static void send_frame(hrt_motors *m, uint32_t node, uint32_t command, uint8_t length, uint32_t first,
                       uint32_t second) {
    hrt_can_frame frame = {.id = node << 5 | command, .length = length};
    hrt_put_u32(frame.data, first);
    hrt_put_u32(frame.data + 4, second);
    hrt_bus_send(&m->bus, &frame);
}

static bool is_ready(const hrt_motor *motor) { return motor->state == CLOSED_LOOP; }

static bool take(hrt_motors *m, const hrt_can_frame *frame, int64_t now_us) {
    hrt_motor *motor = frame->flags ? NULL : hrt_motors_of(m, frame->id >> 5);
    const uint32_t command = frame->id & 0x1f;
    if (!motor || (command != HEARTBEAT && command != ENCODER)) return true;
    if (frame->length != 8) return false;
    if (command == HEARTBEAT) {
        motor->error = hrt_get_u32(frame->data);
        motor->state = frame->data[4];
        motor->heard_us = now_us;
    } else {
        motor->turns = (double)hrt_get_float(frame->data);
        motor->turns_us = now_us;
    }
    return true;
}

/* Asks motors that are not in closed loop to be so, in torque control; after a reset, clears their errors first. */
static void ask(hrt_motors *m, int64_t now_us, bool cleared) {
    for (int i = 0; i < m->motors; i++) {
        hrt_motor *motor = &m->motor[i];
        if (cleared) {
            send_frame(m, motor->node, CLEAR_ERRORS, 1, 0, 0);
            motor->error = 0;
        }
        if (hrt_motors_at_fault(m) || motor->heard_us == 0 || motor->state == CLOSED_LOOP ||
            now_us - motor->asked_us < ASK_EVERY_US)
            continue;
        motor->asked_us = now_us;
        send_frame(m, motor->node, CONTROLLER_MODE, 8, TORQUE_CONTROL, PASSTHROUGH);
        send_frame(m, motor->node, AXIS_STATE, 8, CLOSED_LOOP, 0);
    }
}

static void command(hrt_motors *m, int64_t now_us, const float torque_Nm[HRT_MOTORS]) {
    (void)now_us;
    for (int i = 0; i < m->motors; i++) {
        hrt_can_frame frame = {.id = m->motor[i].node << 5 | INPUT_TORQUE, .length = 8};
        hrt_put_float(frame.data, torque_Nm[i]);
        hrt_bus_send(&m->bus, &frame);
    }
}

static void stop(hrt_motors *m) {
    const float none[HRT_MOTORS] = {0};
    command(m, 0, none);
    for (int i = 0; i < m->motors; i++) send_frame(m, m->motor[i].node, AXIS_STATE, 8, IDLE, 0);
}

static const hrt_motor_protocol protocol = {.name = "ODrive",
                                            .node_max = 0x3f,
                                            .every = 1,
                                            .silence_us = 500000,
                                            .ready = is_ready,
                                            .take = take,
                                            .ask = ask,
                                            .command = command,
                                            .stop = stop};

static bool odrive_open(hrt_drive *d, const char *name, char *why, int why_size) {
    return hrt_motors_open(d, &protocol, name, why, why_size);
}

static void odrive_list(FILE *file) {
    fputs("  odrive           motors of any device type, by name of bus and nodes\n", file);
}

const hrt_drive_driver hrt_drive_odrive = {.kind = "odrive",
                                           .address = "odrive:BUS/NODE:TURNS,...",
                                           .device = "impulse_engine",
                                           .text = "motors of joints by ODrive, CANSimple",
                                           .rate_max = 1000,
                                           .joints = true,
                                           .open = odrive_open,
                                           .close = hrt_motors_close,
                                           .list = odrive_list};
