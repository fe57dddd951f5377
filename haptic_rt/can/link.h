/* The controller's side of the bus: messages into hrt_input, hrt_output into frames. No operating system, no heap: hrt_node and the firmware
 * both use it. What lost, late, repeated, corrupt and foreign frames do is defined here. */
#ifndef HRT_LINK_H
#define HRT_LINK_H

#include "can/codec.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { HRT_LINK_FRAMES = 3, HRT_LINK_BEAT_US = 100000 };

typedef struct hrt_link {
    int32_t instrument;
    uint8_t command_counter, encoder_counter, half_counter;
    bool encoder_seen, half_seen;   /* half: ENCODER_A came, ENCODER_B of the same counter has not */
    int32_t half[3];
    bool beaten;
    int64_t beat_us;
    hrt_can_counters can;
} hrt_link;

void hrt_link_init(hrt_link *link, int32_t instrument);
/* One received message; of other instruments nothing is taken, and only errors and foreign frames are counted. A set of encoder frames is taken when both halves have come with one
 * counter that is newer than the last (a repeated or overtaken one does not count as a sign of life). */
void hrt_link_take(hrt_link *link, int64_t now_us, const hrt_can_message *message, hrt_input *input);
/* What to send after a tick: the command, now and then the heartbeat, a reset when asked. Returns how many of `frame` were filled. */
int32_t hrt_link_frames(hrt_link *link, int64_t now_us, const hrt_output *output, bool reset, hrt_can_frame frame[HRT_LINK_FRAMES]);

#ifdef __cplusplus
}
#endif
#endif
