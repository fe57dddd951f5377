/* Motors of joints on a CAN bus, address "KIND:BUS/NODE:TURNS,...": what their protocols share. A protocol is one file
 * (drive_odrive.c, drive_moteus.c, drive_cia402.c) with a table of functions. One thread of ours serves all motors of a
 * device, twice in a tick: it receives, checks, and sends the torques. */
#ifndef HRT_DRIVE_MOTORS_H
#define HRT_DRIVE_MOTORS_H

#include "bus.h"
#include "drive.h"

typedef struct hrt_motor {
    uint32_t node;
    double turns_per_unit; /* of the motor per rad or m of its joint, with its sign */
    uint32_t state, error; /* as the protocol numbers them; error 0: none */
    int64_t heard_us;      /* last report of the state; 0: none */
    int64_t turns_us;      /* time of `turns`; 0: none, or posted */
    double turns;
    /* the protocol's own */
    uint32_t phase;
    int64_t asked_us;
    uint32_t rated_mNm, counts, per_turns;
    uint16_t word;
} hrt_motor;

typedef struct hrt_motors hrt_motors;

typedef struct hrt_motor_protocol {
    const char *name; /* in messages: "ODrive" */
    uint32_t node_min, node_max;
    int every;          /* steps between two commands: 1 twice in a tick, up to 500 Hz; 2 once */
    int64_t silence_us; /* age of the last report at which a motor counts as gone */
    bool fd;            /* needs CAN-FD */
    bool (*ready)(const hrt_motor *motor);
    /* Takes a frame; returns false if one of its own is unusable. */
    bool (*take)(hrt_motors *motors, const hrt_can_frame *frame, int64_t now_us);
    /* Brings the motors to where they take torques. cleared: a reset has just ended a fault. */
    void (*ask)(hrt_motors *motors, int64_t now_us, bool cleared);
    /* Sends each motor its torque, N m. */
    void (*command)(hrt_motors *motors, int64_t now_us, const float torque_Nm[HRT_MOTORS]);
    void (*stop)(hrt_motors *motors);
} hrt_motor_protocol;

struct hrt_motors {
    const hrt_motor_protocol *protocol;
    hrt_drive *drive;
    hrt_bus bus;
    hrt_motor motor[HRT_MOTORS];
    int32_t motors;
    int every; /* the protocol's, or 2 at a higher rate */
    int64_t looked_us, cleared_us, beat_us;
    uint32_t steps;
    bool was_fault;
    char why[120];
};

/* For the rows of HRT_DRIVES. */
bool hrt_motors_open(hrt_drive *drive, const hrt_motor_protocol *protocol, const char *name, char *why, int why_size);
void hrt_motors_close(hrt_drive *drive);

/* For the protocols. */
/* Returns whether a reset is still clearing the motors' errors, so that none is reported anew. */
bool hrt_motors_clearing(const hrt_motors *motors, int64_t now_us);
hrt_motor *hrt_motors_of(hrt_motors *motors, uint32_t node);
/* Returns whether a fault is set, so that no torque may be sent. */
bool hrt_motors_at_fault(const hrt_motors *motors);
void hrt_put_u32(uint8_t *data, uint32_t bits);
uint32_t hrt_get_u32(const uint8_t *data);
void hrt_put_float(uint8_t *data, float value);
float hrt_get_float(const uint8_t *data);

#endif
