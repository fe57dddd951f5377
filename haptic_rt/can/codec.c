/* Converts frames to messages and back, in the layout of impulse_engine.dbc; tests compare bit by bit. Device 1 has the
 * layout of device 0 with ids one higher. Numbers are little-endian. The last byte is the checksum. The byte before it,
 * except in DeviceFault, holds the counter, and a flag in its top bit. */
#include "codec.h"

#if HRT_WITH_FREE
static const float HANDLE_UNIT_NM = 2.0e-4f;
#endif
const float hrt_can_torque_unit[HRT_MOTORS] = {1.0e-4f, 1.0e-4f, 1.0e-3f};

enum { RESET_KEY = 0xA5, COUNTER_MASK = 0x7F, FLAG = 0x80 };

typedef struct layout {
    hrt_can_kind kind;
    uint16_t id; /* id for device 0 */
    uint8_t length;
} layout;

static const layout layouts[] = {
    {HRT_CAN_COMMAND, 0x100, 8},         {HRT_CAN_ENCODER_A, 0x110, 8}, {HRT_CAN_ENCODER_B, 0x118, 6},
    {HRT_CAN_DEVICE_FAULT, 0x80, 4},     {HRT_CAN_RESET, 0x90, 3},      {HRT_CAN_DEVICE_BEAT, 0x700, 8},
    {HRT_CAN_CONTROLLER_BEAT, 0x710, 8}, {HRT_CAN_ENCODER_C, 0x114, 6},
#if HRT_WITH_FREE
    {HRT_CAN_HANDLE, 0x108, 8},
#endif
};
enum { LAYOUTS = (int)(sizeof layouts / sizeof layouts[0]) };

/* Computes CRC-8 SAE J1850 over the id's low byte and all bytes but the last. The id is included so that a frame with a
 * wrong id is rejected. */
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

/* Rounds a value and clamps it to the range; not a number: zero. */
static int16_t to_int16(float value) {
    const bool inside = value > -32768.0f && value < 32767.0f;
    if (inside) return count_to_int16((int32_t)(value < 0.0f ? value - 0.5f : value + 0.5f));
    if (value > 0.0f) return INT16_MAX;
    return value < 0.0f ? INT16_MIN : 0;
}

static void put16(uint8_t at[2], uint32_t value) {
    at[0] = (uint8_t)(value & 0xFFu);
    at[1] = (uint8_t)(value >> 8 & 0xFFu);
}

static uint16_t get16(const uint8_t at[2]) { return (uint16_t)(at[0] | (uint32_t)at[1] << 8); }

static void put_counts(uint8_t *at, const int32_t *count, size_t n) {
    for (size_t i = 0; i < n; i++) put16(&at[2 * i], (uint32_t)count_to_int16(count[i]));
}

static void get_counts(const uint8_t *at, int32_t *count, size_t n) {
    for (size_t i = 0; i < n; i++) count[i] = (int16_t)get16(&at[2 * i]);
}

static bool pack_payload(const hrt_can_message *m, uint8_t *d, uint8_t *tail) {
    if (m->kind != HRT_CAN_DEVICE_FAULT) *tail = m->counter & COUNTER_MASK;
    switch (m->kind) {
    case HRT_CAN_COMMAND:
        for (size_t i = 0; i < HRT_MOTORS; i++)
            put16(&d[2 * i], (uint32_t)to_int16(m->torque[i] / hrt_can_torque_unit[i]));
        if (m->motors_on) *tail |= FLAG;
        return true;
    case HRT_CAN_ENCODER_A: put_counts(d, m->count, 3); return true;
    case HRT_CAN_ENCODER_C: put_counts(d, m->tilt, 2); return true;
#if HRT_WITH_FREE
    case HRT_CAN_HANDLE:
        for (size_t i = 0; i < 3; i++) put16(&d[2 * i], (uint32_t)to_int16(m->handle_Nm[i] / HANDLE_UNIT_NM));
        return true;
#else
    case HRT_CAN_HANDLE: return false;
#endif
    case HRT_CAN_ENCODER_B:
        put_counts(d, &m->count[3], 2);
        if (m->pedal) *tail |= FLAG;
        return true;
    case HRT_CAN_DEVICE_BEAT:
    case HRT_CAN_CONTROLLER_BEAT:
        d[0] = m->state;
        d[1] = m->fault;
        if (m->kind == HRT_CAN_DEVICE_BEAT) put16(&d[2], m->session);
        put16(&d[4], m->gaps);
        return true;
    case HRT_CAN_DEVICE_FAULT:
        d[0] = m->fault;
        put16(&d[1], m->detail);
        return true;
    case HRT_CAN_RESET: d[0] = RESET_KEY; return true;
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
        frame->id = (uint32_t)layouts[i].id + (uint32_t)message->instrument;
        frame->length = layouts[i].length;
        if (!pack_payload(message, frame->data, &frame->data[frame->length - 2])) return false;
        frame->data[frame->length - 1] = checksum(frame);
        return true;
    }
    return false;
}

/* Unpacks the payload. Returns false for a value that no valid sender uses. */
static bool unpack_payload(const uint8_t *d, uint8_t tail, hrt_can_message *m) {
    if (m->kind != HRT_CAN_DEVICE_FAULT) m->counter = tail & COUNTER_MASK;
    const bool flag = (tail & FLAG) != 0;
    switch (m->kind) {
    case HRT_CAN_COMMAND:
        for (size_t i = 0; i < HRT_MOTORS; i++)
            m->torque[i] = (float)(int16_t)get16(&d[2 * i]) * hrt_can_torque_unit[i];
        m->motors_on = flag;
        return true;
    case HRT_CAN_ENCODER_A: get_counts(d, m->count, 3); return !flag;
    case HRT_CAN_ENCODER_C: get_counts(d, m->tilt, 2); return !flag;
#if HRT_WITH_FREE
    case HRT_CAN_HANDLE:
        for (size_t i = 0; i < 3; i++) m->handle_Nm[i] = (float)(int16_t)get16(&d[2 * i]) * HANDLE_UNIT_NM;
        return !flag;
#else
    case HRT_CAN_HANDLE: return false;
#endif
    case HRT_CAN_ENCODER_B:
        get_counts(d, &m->count[3], 2);
        m->pedal = flag;
        return true;
    case HRT_CAN_DEVICE_BEAT:
    case HRT_CAN_CONTROLLER_BEAT:
        m->state = d[0];
        m->fault = d[1];
        m->gaps = get16(&d[4]);
        if (m->kind == HRT_CAN_CONTROLLER_BEAT) return m->state < HRT_STATE_COUNT;
        m->session = get16(&d[2]);
        return m->state <= 2 && m->session != 0;
    case HRT_CAN_DEVICE_FAULT:
        m->fault = d[0];
        m->detail = get16(&d[1]);
        return m->fault != 0;
    case HRT_CAN_RESET: return d[0] == RESET_KEY;
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
            !unpack_payload(frame->data, frame->data[frame->length - 2], message))
            message->kind = HRT_CAN_CORRUPT;
        return;
    }
}
