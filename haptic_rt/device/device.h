/* The virtual device: mass, Coulomb and viscous friction, encoder counts, torque saturation and a simulated hand. Its
 * watchdog drops the torque when commands stop. It uses the frames of impulse_engine.dbc on any bus. tm-device and the
 * lockstep simulation call the same hrt_device_step. */
#ifndef HRT_DEVICE_H
#define HRT_DEVICE_H

#include "can/codec.h"
#include "handle.h"
#include "hrt.h"
#include "io/bus.h"
#include "motion/hand.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct hrt_device_config {
    int32_t instrument;
    hrt_params profile; /* counts, workspace, torque limits */
    /* Per driven joint, in the units of hrt_twin. */
    double inertia[HRT_MOTORS], viscous[HRT_MOTORS], coulomb[HRT_MOTORS];
    double hand_stiffness[HRT_MOTORS]; /* 0: no hand */
    double hand_damping[HRT_MOTORS];
    hrt_turning turning;
    double roll_grip_rate;   /* 1/s: rate at which joints without a motor follow the hand */
    double rest[HRT_JOINTS]; /* initial joints */
    double watchdog_us;      /* time without a command after which the torque drops; default 20000 */
    double period_us;        /* period of encoder frames; default 2000 */
    double delay_us;         /* from a command's arrival to its torque; default 0, at most 16 periods */
    double start_us;         /* delay of the script's time zero after the first step */
    uint64_t seed;           /* seed of the noise; 0: none */
    double noise_counts;     /* RMS noise of each encoder, before rounding */
    uint16_t session;        /* not 0 */
    hrt_hand_script hand;
} hrt_device_config;
/* Return the defaults of the first device of hrt_device_types, and of a given one. */
hrt_device_config hrt_device_config_default(int32_t instrument);
hrt_device_config hrt_device_config_of(const hrt_device_type *device, int32_t instrument);

typedef enum hrt_device_fault {
    HRT_DEVICE_FINE = 0,
    HRT_DEVICE_WATCHDOG = 1,    /* commands stopped while the motors were on */
    HRT_DEVICE_BAD_COMMAND = 2, /* ten corrupt commands in a row */
    HRT_DEVICE_BUS_OFF = 3
} hrt_device_fault;

enum { HRT_DEVICE_LATE = 16 };
typedef struct hrt_device {
    hrt_device_config config;
    hrt_bus *bus;
    bool started;
    int64_t start_us, now_us, sent_us, beat_us, command_us, heard_us;
    bool unplugged; /* for tests: neither receives nor sends */
    double joint[HRT_JOINTS], velocity[HRT_JOINTS];
    double torque[HRT_MOTORS]; /* current torque, N m or N */
    double handle_Nm[3];       /* current torque at the handle */
    struct {
        int64_t due_us;
        double torque[HRT_MOTORS], handle_Nm[3];
    } late[HRT_DEVICE_LATE]; /* commands that wait for config.delay_us, oldest first */
    int32_t late_count;
    hrt_handle handle;        /* of a device that renders torque there */
    double arm_m;             /* from the handle's point to the tip; 0 until a controller sends torque */
    double handle_sent_Nm[3]; /* of the frame that its command completes */
    uint8_t handle_counter;
    bool handle_waits;
    double target[HRT_JOINTS]; /* current target of the hand */
    bool external;             /* targets come from hrt_device_hand */
    double external_target[HRT_JOINTS];
    bool external_active;
    bool active, motors_on;
    hrt_device_fault fault;
    uint8_t encoder_counter, command_counter, beat_counter;
    bool command_counter_known;
    int32_t corrupt_in_a_row;
    uint64_t random;
    hrt_can_counters can;
    uint32_t commands; /* valid commands received */
} hrt_device;

/* Initialises the device. The caller opens the bus, which must outlive the device. */
void hrt_device_init(hrt_device *device, const hrt_device_config *config, hrt_bus *bus);
/* Receives commands, moves to `now_us` (steps of at most 250 us), and sends due encoder frames. In lockstep call it
 * before hrt_node_tick(now_us). */
void hrt_device_step(hrt_device *device, int64_t now_us);
/* Makes the hand follow these joints from now on, instead of the script. */
void hrt_device_hand(hrt_device *device, const double joint[HRT_JOINTS], bool active);

#ifdef __cplusplus
}
#endif
#endif
