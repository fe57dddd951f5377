/* Converts the frames of impulse_engine.dbc to structs and back, with counters, checksums and ids. No operating system,
 * no heap. */
#ifndef HRT_CODEC_H
#define HRT_CODEC_H

#include <stdbool.h>
#include <stdint.h>

#include "can/frame.h"
#include "hrt.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hrt_can_counters {
    uint32_t lost;     /* gaps in a counter */
    uint32_t repeated; /* the same counter again */
    uint32_t corrupt;  /* checksum, length or value wrong */
    uint32_t foreign;  /* unknown id, extended or remote frame */
    uint32_t error;    /* error frames */
    uint32_t bus_off;
    uint32_t command_gaps; /* controller: missed commands, reported by the device */
} hrt_can_counters;

typedef enum hrt_can_kind {
    HRT_CAN_FOREIGN = 0,
    HRT_CAN_CORRUPT,
    HRT_CAN_ERROR_FRAME,
    HRT_CAN_ENCODER_A, /* device: pitch, yaw, insertion */
    HRT_CAN_ENCODER_B, /* device: roll, grip, pedal; completes the set of ENCODER_A with the same counter */
    HRT_CAN_DEVICE_BEAT,
    HRT_CAN_DEVICE_FAULT,
    HRT_CAN_COMMAND, /* controller: torques */
    HRT_CAN_CONTROLLER_BEAT,
    HRT_CAN_RESET,
    HRT_CAN_ENCODER_C, /* device that tilts: its tilt, between ENCODER_A and ENCODER_B of the same counter */
    HRT_CAN_HANDLE     /* controller: torque at the handle, before the COMMAND of the same counter */
} hrt_can_kind;

/* Number of counts in the first two encoder frames. */
enum { HRT_CAN_JOINTS = 5 };

typedef struct hrt_can_message {
    hrt_can_kind kind;
    int32_t instrument;
    uint8_t counter;
    int32_t count[HRT_CAN_JOINTS]; /* A: 0..2, B: 3..4 */
    bool pedal;
    bool motors_on;
    float torque[HRT_MOTORS];
    uint8_t state, fault; /* heartbeats; fault: DEVICE_FAULT too */
    uint16_t session;     /* device heartbeat: new at each start, never 0 */
    uint16_t gaps;        /* device heartbeat: commands missed, by their counter */
    uint16_t detail;      /* device fault */
    int32_t tilt[2];      /* C: counts */
#if HRT_WITH_FREE
    float handle_Nm[3]; /* HANDLE: along the joint axes */
#endif
} hrt_can_message;

/* Packs a message; values are clamped to the frame's ranges. Returns false for a kind that is never sent. */
bool hrt_can_pack(const hrt_can_message *message, hrt_can_frame *frame);
/* Unpacks a frame; its kind is CORRUPT or FOREIGN if it is invalid or unknown. */
void hrt_can_unpack(const hrt_can_frame *frame, hrt_can_message *message);

/* Returns the factor from a motor's torque to the frame's: where the first two motors slide too, 1 N goes as 0.1 N m,
 * so that all three have the range and the step of the third. */
static inline float hrt_can_torque_scale(const hrt_device_type *device, int32_t motor) {
    return device->slides && motor < 2 ? 0.1f : 1.0f;
}

/* Torque per count in a frame: N m, N m, N. */
extern const float hrt_can_torque_unit[HRT_MOTORS];

#ifdef __cplusplus
}
#endif
#endif
