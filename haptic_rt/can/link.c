#include "can/link.h"

void hrt_link_init(hrt_link *link, int32_t instrument) { *link = (hrt_link){.instrument = instrument}; }

/* True when `counter` is newer than the last; counts gaps and repetitions. Half a turn back or more is late, not a gap. */
static bool newer(hrt_link *link, uint8_t counter) {
    const uint8_t step = (uint8_t)(counter - link->encoder_counter);
    if (link->encoder_seen && (step == 0 || step >= 128)) {
        link->can.repeated++;
        return false;
    }
    if (link->encoder_seen) link->can.lost += step - 1u;
    return true;
}

static void take_half(hrt_link *link, const hrt_can_message *message) {
    for (int32_t i = 0; i < 3; i++) link->half[i] = message->count[i];
    link->half_counter = message->counter;
    link->half_seen = true;
}

static void take_set(hrt_link *link, int64_t now_us, const hrt_can_message *message, hrt_input *input) {
    if (!link->half_seen || link->half_counter != message->counter) return; /* its gap shows with the next whole set */
    link->half_seen = false;
    if (!newer(link, message->counter)) return;
    link->encoder_counter = message->counter;
    link->encoder_seen = true;
    for (int32_t i = 0; i < 3; i++) input->count[i] = link->half[i];
    for (int32_t i = 3; i < HRT_JOINTS; i++) input->count[i] = message->count[i];
    input->pedal = message->pedal;
    input->encoder_us = now_us;
}

/* A device that started anew counts from anywhere. */
static void take_beat(hrt_link *link, const hrt_can_message *message, hrt_input *input) {
    if (message->session != input->device_session) link->encoder_seen = false;
    input->device_session = message->session;
    input->device_fault = message->fault;
}

void hrt_link_take(hrt_link *link, int64_t now_us, const hrt_can_message *message, hrt_input *input) {
    const bool mine = message->instrument == link->instrument;
    switch (message->kind) {
    case HRT_CAN_FOREIGN: link->can.foreign++; break;
    case HRT_CAN_ERROR_FRAME: link->can.error++; break;
    case HRT_CAN_CORRUPT: link->can.corrupt += mine; break;
    case HRT_CAN_ENCODER_A:
        if (mine) take_half(link, message);
        break;
    case HRT_CAN_ENCODER_B:
        if (mine) take_set(link, now_us, message, input);
        break;
    case HRT_CAN_DEVICE_BEAT:
        if (mine) take_beat(link, message, input);
        break;
    case HRT_CAN_DEVICE_FAULT:
        if (mine) input->device_fault = message->fault;
        break;
    case HRT_CAN_COMMAND: /* a controller's own kinds: somebody else speaks for it */
    case HRT_CAN_CONTROLLER_BEAT:
    case HRT_CAN_RESET: link->can.foreign += mine; break;
    }
}

int32_t hrt_link_frames(hrt_link *link, int64_t now_us, const hrt_output *output, bool reset, hrt_can_frame frame[HRT_LINK_FRAMES]) {
    int32_t count = 0;
    hrt_can_message message = {.kind = HRT_CAN_COMMAND, .instrument = link->instrument, .counter = ++link->command_counter, .motors_on = output->motors_on,
                               .state = (uint8_t)output->state, .fault = (uint8_t)output->fault};
    for (int32_t i = 0; i < HRT_MOTORS; i++) message.torque[i] = output->torque[i];
    count += hrt_can_pack(&message, &frame[count]);
    if (!link->beaten || now_us - link->beat_us >= HRT_LINK_BEAT_US) {
        link->beaten = true;
        link->beat_us = now_us;
        message.kind = HRT_CAN_CONTROLLER_BEAT;
        count += hrt_can_pack(&message, &frame[count]);
    }
    if (reset) {
        message.kind = HRT_CAN_RESET;
        count += hrt_can_pack(&message, &frame[count]);
    }
    return count;
}
