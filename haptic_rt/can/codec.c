/* Frames <-> messages. The layout of device 1 is that of device 0 with every id one higher (tests hold the DBC file to
 * it), so one set of generated functions serves both. */
#include "codec.h"

#include "impulse_engine.h"

const float hrt_can_torque_unit[HRT_MOTORS] = {1.0e-4f, 1.0e-4f, 1.0e-3f};

enum { RESET_KEY = 0xA5, COUNTER_MASK = 0x7F };

typedef struct layout {
    hrt_can_kind kind;
    uint16_t id; /* of device 0 */
    uint8_t length;
} layout;

static const layout layouts[] = {
    {HRT_CAN_COMMAND, IMPULSE_ENGINE_MOTOR_COMMAND0_FRAME_ID, IMPULSE_ENGINE_MOTOR_COMMAND0_LENGTH},
    {HRT_CAN_ENCODER_A, IMPULSE_ENGINE_ENCODER_A0_FRAME_ID, IMPULSE_ENGINE_ENCODER_A0_LENGTH},
    {HRT_CAN_ENCODER_B, IMPULSE_ENGINE_ENCODER_B0_FRAME_ID, IMPULSE_ENGINE_ENCODER_B0_LENGTH},
    {HRT_CAN_DEVICE_FAULT, IMPULSE_ENGINE_DEVICE_FAULT0_FRAME_ID, IMPULSE_ENGINE_DEVICE_FAULT0_LENGTH},
    {HRT_CAN_RESET, IMPULSE_ENGINE_RESET0_FRAME_ID, IMPULSE_ENGINE_RESET0_LENGTH},
    {HRT_CAN_DEVICE_BEAT, IMPULSE_ENGINE_DEVICE_HEARTBEAT0_FRAME_ID, IMPULSE_ENGINE_DEVICE_HEARTBEAT0_LENGTH},
    {HRT_CAN_CONTROLLER_BEAT, IMPULSE_ENGINE_CONTROLLER_HEARTBEAT0_FRAME_ID,
     IMPULSE_ENGINE_CONTROLLER_HEARTBEAT0_LENGTH},
};
enum { LAYOUTS = (int)(sizeof layouts / sizeof layouts[0]) };

/* CRC-8 SAE J1850 over the id's low byte and all bytes but the last. The id is in it so that a frame under a wrong id
 * is refused. */
static uint8_t checksum(const hrt_can_frame *frame) {
    uint32_t crc = 0xFFu;
    for (int i = -1; i < (int)frame->length - 1; i++) {
        crc ^= i < 0 ? frame->id & 0xFFu : frame->data[i];
        for (int bit = 0; bit < 8; bit++) crc = (crc & 0x80u) != 0u ? ((crc << 1) ^ 0x1Du) & 0xFFu : (crc << 1) & 0xFFu;
    }
    return (uint8_t)(crc ^ 0xFFu);
}

static int16_t count_to_int16(int32_t count) {
    if (count < INT16_MIN) return INT16_MIN;
    if (count > INT16_MAX) return INT16_MAX;
    return (int16_t)count;
}

/* Rounded; beyond the wire's range its end; not a number: zero. */
static int16_t to_int16(float value) {
    const bool inside = value > -32768.0f && value < 32767.0f;
    if (inside) return count_to_int16((int32_t)(value < 0.0f ? value - 0.5f : value + 0.5f));
    if (value > 0.0f) return INT16_MAX;
    return value < 0.0f ? INT16_MIN : 0;
}

static bool pack_payload(const hrt_can_message *m, hrt_can_frame *f) {
    const uint8_t counter = m->counter & COUNTER_MASK;
    switch (m->kind) {
    case HRT_CAN_COMMAND: {
        const struct impulse_engine_motor_command0_t s = {
            .torque_pitch = to_int16(m->torque[0] / hrt_can_torque_unit[0]),
            .torque_yaw = to_int16(m->torque[1] / hrt_can_torque_unit[1]),
            .force_insertion = to_int16(m->torque[2] / hrt_can_torque_unit[2]),
            .counter = counter,
            .motors_on = m->motors_on ? 1u : 0u};
        return impulse_engine_motor_command0_pack(f->data, &s, sizeof f->data) > 0;
    }
    case HRT_CAN_ENCODER_A: {
        const struct impulse_engine_encoder_a0_t s = {.pitch = count_to_int16(m->count[0]),
                                                      .yaw = count_to_int16(m->count[1]),
                                                      .insertion = count_to_int16(m->count[2]),
                                                      .counter = counter};
        return impulse_engine_encoder_a0_pack(f->data, &s, sizeof f->data) > 0;
    }
    case HRT_CAN_ENCODER_B: {
        const struct impulse_engine_encoder_b0_t s = {.roll = count_to_int16(m->count[3]),
                                                      .grip = count_to_int16(m->count[4]),
                                                      .counter = counter,
                                                      .pedal = m->pedal ? 1u : 0u};
        return impulse_engine_encoder_b0_pack(f->data, &s, sizeof f->data) > 0;
    }
    case HRT_CAN_DEVICE_BEAT: {
        const struct impulse_engine_device_heartbeat0_t s = {
            .state = m->state, .fault = m->fault, .session = m->session, .command_gaps = m->gaps, .counter = counter};
        return impulse_engine_device_heartbeat0_pack(f->data, &s, sizeof f->data) > 0;
    }
    case HRT_CAN_CONTROLLER_BEAT: {
        const struct impulse_engine_controller_heartbeat0_t s = {
            .state = m->state, .fault = m->fault, .encoder_gaps = m->gaps, .counter = counter};
        return impulse_engine_controller_heartbeat0_pack(f->data, &s, sizeof f->data) > 0;
    }
    case HRT_CAN_DEVICE_FAULT: {
        const struct impulse_engine_device_fault0_t s = {.code = m->fault, .detail = m->detail};
        return impulse_engine_device_fault0_pack(f->data, &s, sizeof f->data) > 0;
    }
    case HRT_CAN_RESET: {
        const struct impulse_engine_reset0_t s = {.key = RESET_KEY, .counter = counter};
        return impulse_engine_reset0_pack(f->data, &s, sizeof f->data) > 0;
    }
    case HRT_CAN_FOREIGN:
    case HRT_CAN_CORRUPT:
    case HRT_CAN_ERROR_FRAME: break;
    }
    return false;
}

bool hrt_can_pack(const hrt_can_message *message, hrt_can_frame *frame) {
    static const hrt_can_frame zero = {.id = 0};
    *frame = zero;
    if (message->instrument < 0 || message->instrument > 1) return false;
    for (int i = 0; i < LAYOUTS; i++) {
        if (layouts[i].kind != message->kind) continue;
        if (!pack_payload(message, frame)) return false;
        frame->id = (uint32_t)layouts[i].id + (uint32_t)message->instrument;
        frame->length = layouts[i].length;
        frame->data[frame->length - 1] = checksum(frame);
        return true;
    }
    return false;
}

/* False: a value that no sender of ours can mean. */
static bool unpack_device_beat(const hrt_can_frame *f, hrt_can_message *m) {
    struct impulse_engine_device_heartbeat0_t s;
    if (impulse_engine_device_heartbeat0_unpack(&s, f->data, f->length) != 0) return false;
    m->state = s.state;
    m->fault = s.fault;
    m->session = s.session;
    m->gaps = s.command_gaps;
    m->counter = s.counter;
    return s.state <= 2 && s.session != 0;
}

static bool unpack_controller_beat(const hrt_can_frame *f, hrt_can_message *m) {
    struct impulse_engine_controller_heartbeat0_t s;
    if (impulse_engine_controller_heartbeat0_unpack(&s, f->data, f->length) != 0) return false;
    m->state = s.state;
    m->fault = s.fault;
    m->gaps = s.encoder_gaps;
    m->counter = s.counter;
    return s.state < HRT_STATE_COUNT;
}

static bool unpack_payload(const hrt_can_frame *f, hrt_can_message *m) {
    const size_t size = f->length;
    switch (m->kind) {
    case HRT_CAN_COMMAND: {
        struct impulse_engine_motor_command0_t s;
        if (impulse_engine_motor_command0_unpack(&s, f->data, size) != 0) return false;
        const int16_t raw[HRT_MOTORS] = {s.torque_pitch, s.torque_yaw, s.force_insertion};
        for (int i = 0; i < HRT_MOTORS; i++) m->torque[i] = (float)raw[i] * hrt_can_torque_unit[i];
        m->counter = s.counter;
        m->motors_on = s.motors_on != 0;
        return true;
    }
    case HRT_CAN_ENCODER_A: {
        struct impulse_engine_encoder_a0_t s;
        if (impulse_engine_encoder_a0_unpack(&s, f->data, size) != 0) return false;
        m->count[0] = s.pitch;
        m->count[1] = s.yaw;
        m->count[2] = s.insertion;
        m->counter = s.counter;
        return (f->data[6] & 0x80u) == 0u;
    }
    case HRT_CAN_ENCODER_B: {
        struct impulse_engine_encoder_b0_t s;
        if (impulse_engine_encoder_b0_unpack(&s, f->data, size) != 0) return false;
        m->count[3] = s.roll;
        m->count[4] = s.grip;
        m->counter = s.counter;
        m->pedal = s.pedal != 0;
        return true;
    }
    case HRT_CAN_DEVICE_BEAT: return unpack_device_beat(f, m);
    case HRT_CAN_CONTROLLER_BEAT: return unpack_controller_beat(f, m);
    case HRT_CAN_DEVICE_FAULT: {
        struct impulse_engine_device_fault0_t s;
        if (impulse_engine_device_fault0_unpack(&s, f->data, size) != 0) return false;
        m->fault = s.code;
        m->detail = s.detail;
        return s.code != 0;
    }
    case HRT_CAN_RESET: {
        struct impulse_engine_reset0_t s;
        if (impulse_engine_reset0_unpack(&s, f->data, size) != 0) return false;
        m->counter = s.counter;
        return s.key == RESET_KEY;
    }
    case HRT_CAN_FOREIGN:
    case HRT_CAN_CORRUPT:
    case HRT_CAN_ERROR_FRAME: break;
    }
    return false;
}

void hrt_can_unpack(const hrt_can_frame *frame, hrt_can_message *message) {
    static const hrt_can_message zero = {.kind = HRT_CAN_FOREIGN};
    *message = zero;
    if ((frame->flags & HRT_CAN_ERROR) != 0) {
        message->kind = HRT_CAN_ERROR_FRAME;
        return;
    }
    if (frame->flags != 0 || frame->length > 8) return;
    for (int i = 0; i < LAYOUTS; i++) {
        if ((frame->id & ~1u) != layouts[i].id) continue;
        message->kind = layouts[i].kind;
        message->instrument = (int32_t)(frame->id & 1u);
        if (frame->length != layouts[i].length || frame->data[frame->length - 1] != checksum(frame) ||
            !unpack_payload(frame, message))
            message->kind = HRT_CAN_CORRUPT;
        return;
    }
}
