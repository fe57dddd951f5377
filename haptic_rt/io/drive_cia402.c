/* Motors of joints by CANopen drives with the profile CiA 402, cyclic synchronous torque. Our master does what a device
 * needs of CiA 301 and no more: network commands, expedited SDO, two PDO, SYNC, heartbeats both ways, EMCY.
 *
 * Once a tick each motor gets its control word and torque (RPDO 1, in thousandths of its rated torque), then SYNC; each
 * answers with status word and position (TPDO 1). The drive is configured to watch our heartbeat, so that it ends the
 * torque when we are gone. EMCY, or the status "fault", is a fault of the device, with the drive's code. */
#include "drive_motors.h"

#include <math.h>

enum {
    NMT = 0x000,
    SYNC = 0x080,
    EMCY = 0x080,
    TPDO = 0x180,
    RPDO = 0x200,
    SDO_ANSWER = 0x580,
    SDO_ASK = 0x600,
    HEARTBEAT = 0x700,
    NODE_MASK = 0x7f,
    MASTER = 0x7f,
    OPERATIONAL = 5,
    NMT_START = 0x01,
    NMT_PREPARE = 0x80,
    CST = 10,
    ANSWER_US = 100000,
    BEAT_US = 50000,
    BEAT_MS = 50,
    GONE_MS = 100,
    UNNAMED_ERROR = 0xff00
};
/* Status word, CiA 402 table of states: value under STATE_MASK, or the wider one. */
enum {
    STATE_MASK = 0x6f,
    WIDE_MASK = 0x4f,
    FAULT = 0x08,
    SWITCH_ON_DISABLED = 0x40,
    READY = 0x21,
    SWITCHED_ON = 0x23,
    ENABLED = 0x27
};
enum { SHUT_DOWN = 0x06, SWITCH_ON = 0x07, ENABLE = 0x0f, DISABLE = 0x00, RESET = 0x80 };

/* A step of configuration: an entry of the object dictionary to write, or to read where `bytes` is 0. */
typedef struct entry {
    uint16_t index;
    uint8_t subindex, bytes;
    uint32_t value;
    bool node; /* the node is added */
} entry;

#define VALID 0x00000000u
#define INVALID 0x80000000u
static const entry entries[] = {{0x1016, 1, 4, (uint32_t)MASTER << 16 | GONE_MS, false},
                                {0x1017, 0, 2, BEAT_MS, false},
                                {0x1800, 1, 4, INVALID | TPDO, true},
                                {0x1800, 2, 1, 1, false}, /* sent at each SYNC */
                                {0x1A00, 0, 1, 0, false},
                                {0x1A00, 1, 4, 0x60410010, false},
                                {0x1A00, 2, 4, 0x60640020, false},
                                {0x1A00, 0, 1, 2, false},
                                {0x1800, 1, 4, VALID | TPDO, true},
                                {0x1400, 1, 4, INVALID | RPDO, true},
                                {0x1400, 2, 1, 1, false}, /* takes effect at SYNC */
                                {0x1600, 0, 1, 0, false},
                                {0x1600, 1, 4, 0x60400010, false},
                                {0x1600, 2, 4, 0x60710010, false},
                                {0x1600, 0, 1, 2, false},
                                {0x1400, 1, 4, VALID | RPDO, true},
                                {0x6060, 0, 1, CST, false},
                                {0x6076, 0, 0, 0, false},  /* rated torque, mN m */
                                {0x608F, 1, 0, 0, false},  /* counts */
                                {0x608F, 2, 0, 0, false}}; /* per so many turns */
enum { ENTRIES = sizeof entries / sizeof entries[0] };

static void send_frame(hrt_motors *m, uint32_t id, uint8_t length, uint32_t first, uint32_t second) {
    hrt_can_frame frame = {.id = id, .length = length};
    hrt_put_u32(frame.data, first);
    hrt_put_u32(frame.data + 4, second);
    hrt_bus_send(&m->bus, &frame);
}

static void network(hrt_motors *m, uint32_t what, uint32_t node) { send_frame(m, NMT, 2, what | node << 8, 0); }

static bool is_configured(const hrt_motor *motor) { return motor->phase >= ENTRIES; }

static bool is_ready(const hrt_motor *motor) {
    return is_configured(motor) && (motor->state & STATE_MASK) == ENABLED && motor->rated_mNm && motor->counts;
}

/* ---------------------------------------------------------------------------------------------- receiving */

static void take_value(hrt_motor *motor, const entry *e, uint32_t value) {
    if (e->index == 0x6076) motor->rated_mNm = value;
    if (e->index == 0x608F && e->subindex == 1) motor->counts = value;
    if (e->index == 0x608F && e->subindex == 2) motor->per_turns = value ? value : 1;
}

/* Takes the answer to the SDO that is under way; another's is ignored, an abort is an error of the drive. */
static void take_answer(hrt_motor *motor, const uint8_t *data) {
    if (is_configured(motor)) return;
    const entry *e = &entries[motor->phase];
    if (data[1] != (e->index & 0xff) || data[2] != e->index >> 8 || data[3] != e->subindex) return;
    const uint32_t value = hrt_get_u32(data + 4), unused = (uint32_t)(data[0] >> 2 & 3);
    if (data[0] == 0x80)
        motor->error = e->index;
    else if (e->bytes == 0 && (data[0] & 0xe3) == 0x43)
        take_value(motor, e, value & 0xffffffffu >> 8 * unused);
    else if (e->bytes == 0 || data[0] != 0x60)
        return;
    motor->asked_us = 0;
    if (data[0] != 0x80) motor->phase++;
}

static bool take_position(const hrt_motors *m, hrt_motor *motor, const hrt_can_frame *frame, int64_t now_us) {
    if (!is_configured(motor) || motor->counts == 0) return true;
    if (frame->length != 6) return false;
    motor->state = (uint32_t)frame->data[0] | (uint32_t)frame->data[1] << 8;
    if ((motor->state & WIDE_MASK) == FAULT && motor->error == 0 && !hrt_motors_clearing(m, now_us))
        motor->error = UNNAMED_ERROR;
    motor->turns = (double)(int32_t)hrt_get_u32(frame->data + 2) * motor->per_turns / motor->counts;
    motor->turns_us = now_us;
    return true;
}

/* A drive that reports its start, or is not operational after it was, is configured anew. */
static void take_beat(hrt_motor *motor, uint8_t state, int64_t now_us) {
    motor->heard_us = now_us;
    if (is_configured(motor) && state != OPERATIONAL && now_us - motor->asked_us > ANSWER_US) {
        motor->phase = 0;
        motor->state = 0;
        motor->asked_us = 0;
    }
}

static bool take(hrt_motors *m, const hrt_can_frame *frame, int64_t now_us) {
    hrt_motor *motor = frame->flags ? NULL : hrt_motors_of(m, frame->id & NODE_MASK);
    if (!motor || frame->id == SYNC) return true;
    switch (frame->id & ~(uint32_t)NODE_MASK) {
    case EMCY:
        if (frame->length != 8) return false;
        motor->error = (uint32_t)frame->data[0] | (uint32_t)frame->data[1] << 8;
        return true;
    case SDO_ANSWER:
        if (frame->length != 8) return false;
        motor->heard_us = now_us;
        take_answer(motor, frame->data);
        return true;
    case TPDO: return take_position(m, motor, frame, now_us);
    case HEARTBEAT:
        if (frame->length != 1) return false;
        take_beat(motor, frame->data[0], now_us);
        return true;
    default: return true;
    }
}

/* ---------------------------------------------------------------------------------------------- sending */

static void send_entry(hrt_motors *m, const hrt_motor *motor) {
    const entry *e = &entries[motor->phase];
    const uint32_t head = e->bytes ? 0x23u | (4u - e->bytes) << 2 : 0x40u;
    send_frame(m, SDO_ASK + motor->node, 8, head | (uint32_t)e->index << 8 | (uint32_t)e->subindex << 24,
               e->value + (e->node ? motor->node : 0));
}

/* Configures the drives, entry by entry; the last answer starts a drive. */
static void ask(hrt_motors *m, int64_t now_us, bool cleared) {
    if (now_us - m->beat_us >= BEAT_US) {
        send_frame(m, HEARTBEAT + MASTER, 1, OPERATIONAL, 0);
        m->beat_us = now_us;
    }
    for (int i = 0; i < m->motors; i++) {
        hrt_motor *motor = &m->motor[i];
        if (cleared) {
            motor->error = 0;
            motor->word = DISABLE; /* the drive resets at the rising bit */
        }
        if (motor->error || (motor->asked_us && now_us - motor->asked_us < ANSWER_US)) continue;
        if (is_configured(motor)) {
            if (motor->asked_us == 0) {
                network(m, NMT_START, motor->node);
                motor->asked_us = now_us;
            }
            continue;
        }
        if (motor->phase == 0) network(m, NMT_PREPARE, motor->node);
        motor->asked_us = now_us;
        send_entry(m, motor);
    }
}

static uint16_t word_for(uint32_t status) {
    if ((status & WIDE_MASK) == FAULT) return RESET;
    if ((status & WIDE_MASK) == SWITCH_ON_DISABLED) return SHUT_DOWN;
    if ((status & STATE_MASK) == READY) return SWITCH_ON;
    if ((status & STATE_MASK) == SWITCHED_ON || (status & STATE_MASK) == ENABLED) return ENABLE;
    return DISABLE;
}

static int16_t thousandths(const hrt_motor *motor, float torque_Nm) {
    const double share = motor->rated_mNm ? 1.0e6 * (double)torque_Nm / motor->rated_mNm : 0.0;
    return (int16_t)lrint(fmin(fmax(share, -32767.0), 32767.0));
}

static void send_torque(hrt_motors *m, hrt_motor *motor, uint16_t word, int16_t torque) {
    motor->word = word;
    send_frame(m, RPDO + motor->node, 4, (uint32_t)word | (uint32_t)(uint16_t)torque << 16, 0);
}

static void command(hrt_motors *m, int64_t now_us, const float torque_Nm[HRT_MOTORS]) {
    (void)now_us;
    for (int i = 0; i < m->motors; i++) {
        hrt_motor *motor = &m->motor[i];
        if (!is_configured(motor)) continue;
        const bool off = hrt_motors_at_fault(m) || motor->error;
        const uint16_t word = off ? DISABLE : word_for(motor->state);
        /* The reset is a rising bit: between two there is a word without it. */
        send_torque(m, motor, word == RESET && motor->word == RESET ? DISABLE : word,
                    off ? 0 : thousandths(motor, torque_Nm[i]));
    }
    send_frame(m, SYNC, 0, 0, 0);
}

static void stop(hrt_motors *m) {
    for (int i = 0; i < m->motors; i++)
        if (is_configured(&m->motor[i])) send_torque(m, &m->motor[i], DISABLE, 0);
    send_frame(m, SYNC, 0, 0, 0);
    for (int i = 0; i < m->motors; i++) {
        network(m, NMT_PREPARE, m->motor[i].node);
        send_frame(m, SDO_ASK + m->motor[i].node, 8, 0x23u | 0x1016u << 8 | 1u << 24, 0); /* it need not miss us */
    }
}

static const hrt_motor_protocol protocol = {.name = "CiA 402",
                                            .node_min = 1,
                                            .node_max = MASTER - 1,
                                            .every = 2,
                                            .silence_us = 200000,
                                            .ready = is_ready,
                                            .take = take,
                                            .ask = ask,
                                            .command = command,
                                            .stop = stop};

static bool cia402_open(hrt_drive *d, const char *name, char *why, int why_size) {
    return hrt_motors_open(d, &protocol, name, why, why_size);
}

static void cia402_list(FILE *file) {
    fputs("  cia402           motors of any device type, by name of bus and nodes\n", file);
}

const hrt_drive_driver hrt_drive_cia402 = {.kind = "cia402",
                                           .address = "cia402:BUS/NODE:TURNS,...",
                                           .device = "impulse_engine",
                                           .text = "motors of joints by CANopen drives, CiA 402 cyclic torque",
                                           .rate_max = 1000,
                                           .joints = true,
                                           .open = cia402_open,
                                           .close = hrt_motors_close,
                                           .list = cia402_list};
