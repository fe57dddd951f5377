/* The controller's side of the bus: messages into hrt_input, hrt_result into frames. No operating system, no heap:
 * hrt_node and the firmware both use it. What lost, late, repeated, corrupt and foreign frames do is defined here. */
#ifndef HRT_CAN_EXCHANGE_H
#define HRT_CAN_EXCHANGE_H

#include "can/codec.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { HRT_CAN_EXCHANGE_FRAMES = 3, HRT_CAN_EXCHANGE_BEAT_US = 50000, HRT_CAN_EXCHANGE_RESET_QUIET_US = 10000 };

typedef struct hrt_can_exchange {
    int32_t instrument;
    int32_t half_count[HRT_MOTORS]; /* EncoderA waits for its EncoderB */
    uint8_t half_counter;
    bool half_waits;
    bool encoder_known;
    uint8_t encoder_counter, command_counter, beat_counter;
    bool gaps_known;
    uint16_t gaps;                     /* as the device told last */
    uint32_t commands, commands_since; /* sent; of these since then */
    int64_t beat_us, reset_us;         /* 0: never */
    hrt_can_counters can;
} hrt_can_exchange;

void hrt_can_exchange_init(hrt_can_exchange *exchange, int32_t instrument);
/* Before the tick in which input->reset is set: what the device said about its fault until now, and says in the next 10
 * ms, is forgotten. */
void hrt_can_exchange_reset(hrt_can_exchange *exchange, int64_t now_us, hrt_input *input);
/* One received message; those of other instruments change nothing. Our own kinds come from a rival (the bus gives
 * nobody his own frames back), and so do more gaps in the commands than commands were sent. Encoder counts are taken
 * when both halves came under one counter newer than the last; a repeated or overtaken set is no sign of life. */
void hrt_can_exchange_take(hrt_can_exchange *exchange, int64_t now_us, const hrt_can_message *message,
                           hrt_input *input);
/* What to send after a tick: the reset when asked, the command, now and then the heartbeat. Returns how many of `frame`
 * were filled. */
int32_t hrt_can_exchange_frames(hrt_can_exchange *exchange, int64_t now_us, const hrt_result *result, bool reset,
                                hrt_can_frame frame[HRT_CAN_EXCHANGE_FRAMES]);

/* A last command: motors off. */
bool hrt_can_exchange_off(hrt_can_exchange *exchange, hrt_can_frame *frame);

#ifdef __cplusplus
}
#endif
#endif
