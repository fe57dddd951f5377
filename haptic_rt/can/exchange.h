/* The controller's side of the bus: converts messages to hrt_input and hrt_result to frames. No operating system, no
 * heap: hrt_node and the firmware share it. It defines the effect of lost, late, repeated, corrupt and foreign frames.
 */
#ifndef HRT_CAN_EXCHANGE_H
#define HRT_CAN_EXCHANGE_H

#include "can/codec.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { HRT_CAN_EXCHANGE_FRAMES = 4, HRT_CAN_EXCHANGE_BEAT_US = 50000, HRT_CAN_EXCHANGE_RESET_QUIET_US = 10000 };

typedef struct hrt_can_exchange {
    int32_t instrument;
    bool tilts; /* a set of encoders has the device's tilt too */
    bool turns; /* a command has the torque at the handle too */
    int32_t tilt[2];
    uint8_t tilt_counter;
    bool tilt_waits;
    int32_t half_count[HRT_MOTORS]; /* counts of EncoderA, until its EncoderB comes */
    uint8_t half_counter;
    bool half_waits;
    bool encoder_known;
    uint8_t encoder_counter, command_counter, beat_counter;
    bool gaps_known;
    uint16_t gaps;                       /* last reported by the device */
    uint32_t commands_since;             /* commands sent since that report */
    int64_t began_us, beat_us, reset_us; /* first command, last heartbeat and reset; 0: never */
    hrt_can_counters can;
} hrt_can_exchange;

void hrt_can_exchange_init(hrt_can_exchange *exchange, int32_t instrument);
/* Prepares a reset; call it before the tick with input->reset. Discards fault reports of the device up to now and for
 * 10 ms more. */
void hrt_can_exchange_reset(hrt_can_exchange *exchange, int64_t now_us, hrt_input *input);
/* Processes a received message; those of other instruments have no effect. Our own kinds show a bus conflict, since the
 * bus does not return our own frames. So does a device that missed more commands than we sent. Encoder counts are used
 * once all its frames came with one counter newer than the last. A repeated or overtaken set is not a sign of life. */
void hrt_can_exchange_take(hrt_can_exchange *exchange, int64_t now_us, const hrt_can_message *message,
                           hrt_input *input);
/* Builds the frames to send after a tick: a requested reset, the command (after the torque at
 * the handle, if that is rendered), periodically the heartbeat. Returns how many
 * of `frame` are filled. */
int32_t hrt_can_exchange_frames(hrt_can_exchange *exchange, int64_t now_us, const hrt_result *result, bool reset,
                                hrt_can_frame frame[HRT_CAN_EXCHANGE_FRAMES]);

/* Builds the last command: motors off. */
bool hrt_can_exchange_off(hrt_can_exchange *exchange, hrt_can_frame *frame);

#ifdef __cplusplus
}
#endif
#endif
