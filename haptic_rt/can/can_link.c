#include "can/can_link.h"

/* LATE: half a turn back or more is an old frame, not a gap. GAPS_SPARE: what a start of either side may add.
 * FIRST_COMMANDS: two beats of the device. */
enum { COUNTER_MASK = 0x7F, LATE = 64, GAPS_SPARE = 128, FIRST_COMMANDS = 60 };

void hrt_can_link_init(hrt_can_link *link, int32_t instrument) {
    static const hrt_can_link zero = {0};
    *link = zero;
    link->instrument = instrument;
}

void hrt_can_link_reset(hrt_can_link *link, int64_t now_us, hrt_input *input) {
    link->reset_us = now_us;
    input->device_fault = 0;
    input->device_watchdog = false;
}

static void take_encoders(hrt_can_link *link, int64_t now_us, const hrt_can_message *m, hrt_input *input) {
    const bool whole = link->half_waits && link->half_counter == m->counter;
    const uint8_t step = (uint8_t)((m->counter - link->encoder_counter) & COUNTER_MASK);
    link->half_waits = false;
    if (!whole) return; /* the gap shows in the next whole set's counter */
    if (link->encoder_known && (step == 0 || step >= LATE)) {
        link->can.repeated++;
        return;
    }
    if (link->encoder_known) link->can.lost += step - 1u;
    link->encoder_known = true;
    link->encoder_counter = m->counter;
    for (int32_t j = 0; j < HRT_JOINTS; j++) input->count[j] = j < HRT_MOTORS ? link->half_count[j] : m->count[j];
    input->pedal = m->pedal;
    input->encoder_us = now_us;
}

static void take_half(hrt_can_link *link, const hrt_can_message *m) {
    for (int32_t i = 0; i < HRT_MOTORS; i++) link->half_count[i] = m->count[i];
    link->half_counter = m->counter;
    link->half_waits = true;
}

/* Watchdog and bus-off dropped the torque and end when the device hears "motors off", which idle says: no fault here.
 */
static void take_device_fault(const hrt_can_link *link, int64_t now_us, uint8_t code, hrt_input *input) {
    if (link->reset_us != 0 && now_us - link->reset_us < HRT_CAN_LINK_RESET_QUIET_US) return;
    input->device_watchdog = code == 1 || code == 3;
    input->device_fault = input->device_watchdog ? 0 : code;
}

static void take_gaps(hrt_can_link *link, int64_t now_us, const hrt_can_message *m, hrt_input *input) {
    const uint16_t fresh = (uint16_t)(m->gaps - link->gaps);
    /* Where a controller begins to count is no gap: the first beats only say where the device stands. */
    if (m->session != input->device_session || link->commands < FIRST_COMMANDS) link->gaps_known = false;
    if (link->gaps_known) {
        link->can.command_gaps += fresh;
        if (fresh > link->commands_since + GAPS_SPARE) input->rival_us = now_us;
    }
    link->gaps_known = true;
    link->gaps = m->gaps;
    link->commands_since = 0;
}

void hrt_can_link_take(hrt_can_link *link, int64_t now_us, const hrt_can_message *m, hrt_input *input) {
    const bool ours = m->instrument == link->instrument;
    switch (m->kind) {
    case HRT_CAN_FOREIGN: link->can.foreign++; break;
    case HRT_CAN_CORRUPT: link->can.corrupt++; break;
    case HRT_CAN_ERROR_FRAME: link->can.error++; break;
    case HRT_CAN_ENCODER_A:
        if (ours) take_half(link, m);
        break;
    case HRT_CAN_ENCODER_B:
        if (ours) take_encoders(link, now_us, m, input);
        break;
    case HRT_CAN_DEVICE_BEAT:
        if (!ours) break;
        take_gaps(link, now_us, m, input);
        if (m->session != input->device_session)
            link->encoder_known = false; /* started anew, it counts from anywhere */
        input->device_session = m->session;
        take_device_fault(link, now_us, m->fault, input);
        break;
    case HRT_CAN_DEVICE_FAULT:
        if (ours) take_device_fault(link, now_us, m->fault, input);
        break;
    case HRT_CAN_COMMAND:
    case HRT_CAN_CONTROLLER_BEAT:
    case HRT_CAN_RESET:
        if (ours) input->rival_us = now_us;
        break;
    }
}

int32_t hrt_can_link_frames(hrt_can_link *link, int64_t now_us, const hrt_output *output, bool reset,
                            hrt_can_frame frame[HRT_CAN_LINK_FRAMES]) {
    int32_t count = 0;
    if (reset) {
        const hrt_can_message message = {
            .kind = HRT_CAN_RESET, .instrument = link->instrument, .counter = link->command_counter};
        count += hrt_can_pack(&message, &frame[count]);
    }
    hrt_can_message command = {.kind = HRT_CAN_COMMAND,
                               .instrument = link->instrument,
                               .counter = link->command_counter++,
                               .motors_on = output->motors_on};
    for (int32_t i = 0; i < HRT_MOTORS; i++) command.torque[i] = output->torque[i];
    link->commands++;
    link->commands_since++;
    count += hrt_can_pack(&command, &frame[count]);
    if (link->beat_us != 0 && now_us - link->beat_us < HRT_CAN_LINK_BEAT_US) return count;
    const hrt_can_message beat = {.kind = HRT_CAN_CONTROLLER_BEAT,
                                  .instrument = link->instrument,
                                  .counter = link->beat_counter++,
                                  .state = (uint8_t)output->state,
                                  .fault = (uint8_t)output->fault,
                                  .gaps = (uint16_t)link->can.lost};
    link->beat_us = now_us;
    return count + hrt_can_pack(&beat, &frame[count]);
}

bool hrt_can_link_off(hrt_can_link *link, hrt_can_frame *frame) {
    const hrt_can_message off = {
        .kind = HRT_CAN_COMMAND, .instrument = link->instrument, .counter = link->command_counter++};
    return hrt_can_pack(&off, frame);
}
