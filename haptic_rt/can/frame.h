/* A classical CAN frame, without any operating system's header. */
#ifndef HRT_CAN_FRAME_H
#define HRT_CAN_FRAME_H

#include <stdint.h>

enum { HRT_CAN_EXTENDED = 1, HRT_CAN_REMOTE = 2, HRT_CAN_ERROR = 4 };

typedef struct hrt_can_frame {
    uint32_t id;
    uint8_t length; /* 0..8 */
    uint8_t flags;
    uint8_t data[8];
} hrt_can_frame;

/* Returns the bits on the wire of a classical frame with 11-bit id and `length` bytes, with worst-case stuffing and
 * interframe space. */
static inline uint32_t hrt_can_bits(uint32_t length) { return 47u + 8u * length + (34u + 8u * length - 1u) / 4u; }

#endif
