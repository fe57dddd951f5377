/* A CAN frame, classical or CAN-FD, without any operating system's header. */
#ifndef HRT_CAN_FRAME_H
#define HRT_CAN_FRAME_H

#include <stdint.h>

/* HRT_CAN_FD: up to 64 bytes, the data at a second bit rate. */
enum { HRT_CAN_EXTENDED = 1, HRT_CAN_REMOTE = 2, HRT_CAN_ERROR = 4, HRT_CAN_FD = 8 };
#ifdef HRT_ONE_DEVICE /* firmware for the Impulse Engine alone, on a classical bus */
enum { HRT_CAN_DATA = 8 };
#else
enum { HRT_CAN_DATA = 64 };
#endif

typedef struct hrt_can_frame {
    uint32_t id;
    uint8_t length; /* 0..8; of CAN-FD also 12, 16, 20, 24, 32, 48, 64 */
    uint8_t flags;
    uint8_t data[HRT_CAN_DATA];
} hrt_can_frame;

/* Returns the bits on the wire of a classical frame with 11-bit id and `length` bytes, with worst-case stuffing and
 * interframe space. */
static inline uint32_t hrt_can_bits(uint32_t length) { return 47u + 8u * length + (34u + 8u * length - 1u) / 4u; }

/* Returns the time of a CAN-FD frame with 29-bit id in bits of the first rate, the data five times as fast (1 and 5
 * Mbit/s), with worst-case stuffing and interframe space. */
static inline uint32_t hrt_can_fd_bits(uint32_t length) {
    const uint32_t data = 8u * length + (length > 16u ? 21u : 17u) + 10u;
    return 36u + 36u / 4u + 13u + (data + data / 4u) / 5u;
}

/* Returns the shortest length of a CAN-FD frame that holds `bytes`, at most 64. */
static inline uint8_t hrt_can_fd_length(uint32_t bytes) {
    static const uint8_t above[] = {12, 16, 20, 24, 32, 48, 64};
    if (bytes <= 8u) return (uint8_t)bytes;
    for (int i = 0; i < 7; i++)
        if (bytes <= above[i]) return above[i];
    return 64;
}

#endif
