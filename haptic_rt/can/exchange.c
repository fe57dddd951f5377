/* The controller's side of the bus: counters, faults and frames of one device. */
#include "can/exchange.h"

/* LATE: a counter at least half its range back is an old frame, not a gap. GAPS_SPARE: gaps that a start of either side
 * may add. SILENT_US: silence after which any counter is newer: at 4000 Hz half the range is 16 ms. FIRST_US: two
 * heartbeats of the device. */
enum { COUNTER_MASK = 0x7F, LATE = 64, GAPS_SPARE = 128, SILENT_US = 20000, FIRST_US = 120000 };

void hrt_can_exchange_init(hrt_can_exchange *exchange, int32_t instrument) {
    static const hrt_can_exchange zero = {0};
    *exchange = zero;
    exchange->instrument = instrument;
}

void hrt_can_exchange_reset(hrt_can_exchange *exchange, int64_t now_us, hrt_input *input) {
    exchange->reset_us = now_us;
    input->device_fault = 0;
    input->device_watchdog = false;
}

_Static_assert((int)HRT_CAN_JOINTS <= (int)HRT_JOINTS, "an input has a slot for every count in the frames");

static void take_encoders(hrt_can_exchange *exchange, int64_t now_us, const hrt_can_message *m, hrt_input *input) {
    const bool tilt = !exchange->tilts || (exchange->tilt_waits && exchange->tilt_counter == m->counter);
    const bool whole = exchange->half_waits && exchange->half_counter == m->counter && tilt;
    const uint8_t step = (uint8_t)((m->counter - exchange->encoder_counter) & COUNTER_MASK);
    exchange->half_waits = exchange->tilt_waits = false;
    if (!whole) return; /* the next complete set's counter shows the gap */
    const bool silent = now_us - input->encoder_us > SILENT_US;
    if (exchange->encoder_known && (step == 0 || (step >= LATE && !silent))) {
        exchange->can.repeated++;
        return;
    }
    if (exchange->encoder_known && step < LATE) exchange->can.lost += step - 1u;
    exchange->encoder_known = true;
    exchange->encoder_counter = m->counter;
    for (int32_t j = 0; j < HRT_CAN_JOINTS; j++)
        input->count[j] = j < HRT_MOTORS ? exchange->half_count[j] : m->count[j];
#if HRT_WITH_FREE
    for (int32_t j = 0; j < 2 && exchange->tilts; j++) input->count[HRT_TILT + j] = exchange->tilt[j];
#endif
    input->pedal = m->pedal;
    input->encoder_us = now_us;
}

static void take_half(hrt_can_exchange *exchange, const hrt_can_message *m) {
    for (int32_t i = 0; i < HRT_MOTORS; i++) exchange->half_count[i] = m->count[i];
    exchange->half_counter = m->counter;
    exchange->half_waits = true;
}

static void take_tilt(hrt_can_exchange *exchange, const hrt_can_message *m) {
    for (int32_t i = 0; i < 2; i++) exchange->tilt[i] = m->tilt[i];
    exchange->tilt_counter = m->counter;
    exchange->tilt_waits = true;
}

/* Handles a fault of the device. Watchdog and bus-off are not faults here: they dropped the torque, and end when the
 * device receives "motors off", which idle sends. */
static void take_device_fault(const hrt_can_exchange *exchange, int64_t now_us, uint8_t code, hrt_input *input) {
    if (exchange->reset_us != 0 && now_us - exchange->reset_us < HRT_CAN_EXCHANGE_RESET_QUIET_US) return;
    input->device_watchdog = code == 1 || code == 3;
    input->device_fault = input->device_watchdog ? 0 : code;
}

static void take_gaps(hrt_can_exchange *exchange, int64_t now_us, const hrt_can_message *m, hrt_input *input) {
    const uint16_t fresh = (uint16_t)(m->gaps - exchange->gaps);
    /* A controller's first count is no gap: the first heartbeats only give the device's state. */
    if (m->session != input->device_session || now_us - exchange->began_us < FIRST_US) exchange->gaps_known = false;
    if (exchange->gaps_known) {
        exchange->can.command_gaps += fresh;
        if (fresh > exchange->commands_since + GAPS_SPARE) input->bus_conflict_us = now_us;
    }
    exchange->gaps_known = true;
    exchange->gaps = m->gaps;
    exchange->commands_since = 0;
}

void hrt_can_exchange_take(hrt_can_exchange *exchange, int64_t now_us, const hrt_can_message *m, hrt_input *input) {
    const bool ours = m->instrument == exchange->instrument;
    switch (m->kind) {
    case HRT_CAN_FOREIGN: exchange->can.foreign++; break;
    case HRT_CAN_CORRUPT: exchange->can.corrupt++; break;
    case HRT_CAN_ERROR_FRAME: exchange->can.error++; break;
    case HRT_CAN_ENCODER_A:
        if (ours) take_half(exchange, m);
        break;
    case HRT_CAN_ENCODER_C:
        if (ours) take_tilt(exchange, m);
        break;
    case HRT_CAN_ENCODER_B:
        if (ours) take_encoders(exchange, now_us, m, input);
        break;
    case HRT_CAN_DEVICE_BEAT:
        if (!ours) break;
        take_gaps(exchange, now_us, m, input);
        if (m->session != input->device_session)
            exchange->encoder_known = false; /* after a restart, any counter is valid */
        input->device_session = m->session;
        take_device_fault(exchange, now_us, m->fault, input);
        break;
    case HRT_CAN_DEVICE_FAULT:
        if (ours) take_device_fault(exchange, now_us, m->fault, input);
        break;
    case HRT_CAN_COMMAND:
    case HRT_CAN_HANDLE:
    case HRT_CAN_CONTROLLER_BEAT:
    case HRT_CAN_RESET:
        if (ours) input->bus_conflict_us = now_us;
        break;
    }
}

int32_t hrt_can_exchange_frames(hrt_can_exchange *exchange, int64_t now_us, const hrt_result *result, bool reset,
                                hrt_can_frame frame[HRT_CAN_EXCHANGE_FRAMES]) {
    int32_t count = 0;
    if (reset) {
        const hrt_can_message message = {
            .kind = HRT_CAN_RESET, .instrument = exchange->instrument, .counter = exchange->command_counter};
        count += hrt_can_pack(&message, &frame[count]);
    }
#if HRT_WITH_FREE
    if (exchange->turns) {
        hrt_can_message handle = {
            .kind = HRT_CAN_HANDLE, .instrument = exchange->instrument, .counter = exchange->command_counter};
        for (int32_t i = 0; i < 3; i++) handle.handle_Nm[i] = result->handle_torque_Nm[i];
        count += hrt_can_pack(&handle, &frame[count]);
    }
#endif
    hrt_can_message command = {.kind = HRT_CAN_COMMAND,
                               .instrument = exchange->instrument,
                               .counter = exchange->command_counter++,
                               .motors_on = result->motors_on};
    for (int32_t i = 0; i < HRT_MOTORS; i++) command.torque[i] = result->torque[i];
    if (!exchange->began_us) exchange->began_us = now_us;
    exchange->commands_since++;
    count += hrt_can_pack(&command, &frame[count]);
    if (exchange->beat_us != 0 && now_us - exchange->beat_us < HRT_CAN_EXCHANGE_BEAT_US) return count;
    const hrt_can_message beat = {.kind = HRT_CAN_CONTROLLER_BEAT,
                                  .instrument = exchange->instrument,
                                  .counter = exchange->beat_counter++,
                                  .state = (uint8_t)result->state,
                                  .fault = (uint8_t)result->fault,
                                  .gaps = (uint16_t)exchange->can.lost};
    exchange->beat_us = now_us;
    return count + hrt_can_pack(&beat, &frame[count]);
}

bool hrt_can_exchange_off(hrt_can_exchange *exchange, hrt_can_frame *frame) {
    const hrt_can_message off = {
        .kind = HRT_CAN_COMMAND, .instrument = exchange->instrument, .counter = exchange->command_counter++};
    return hrt_can_pack(&off, frame);
}
