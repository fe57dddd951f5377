/* Recorded inputs of the firmware's loop, and its outputs, as files: little-endian, packed field by field, the same
 * on every machine.
 *
 * replay.in   per tick: uint32 size, then events: uint8 kind, uint8 device, body (kinds below)
 * replay.out  per tick: uint8 OUT_FRAME and a frame, or uint8 OUT_RESULT and hrt_result field by field, in the order
 * of sending
 * replay.cost per tick: uint32 instructions of hrt_tick of each device, then of the check of a patch of each (0: no
 * patch, or not counted) */
#ifndef REPLAY_H
#define REPLAY_H

#include "firmware/loop.h"

enum { EVENT_FRAME = 1, EVENT_SAMPLE, EVENT_PATCH, EVENT_COMMAND, EVENT_BUS };
enum { OUT_FRAME = 1, OUT_RESULT };
enum { REPLAY_TICK_MAX = 28 * 1024 };

/* A buffer that is read or written sequentially; `failed` is set once the end was exceeded. */
typedef struct replay_bytes {
    uint8_t *at, *end;
    bool write, failed;
} replay_bytes;

void replay_frame(replay_bytes *bytes, hrt_can_frame *frame);
void replay_sample(replay_bytes *bytes, hrt_sample *sample);
void replay_patch(replay_bytes *bytes, hrt_patch *patch);
void replay_command(replay_bytes *bytes, fw_news *news);
void replay_result(replay_bytes *bytes, hrt_result *result);
void replay_u8(replay_bytes *bytes, uint8_t *value);

#endif
