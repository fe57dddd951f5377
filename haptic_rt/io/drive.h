/* A device that reports the position of a cursor and renders a force there, through a service or a maker's library
 * instead of a bus. Its driver (drive_NAME.c) runs in a thread of its own, or of the library, and may block there. The
 * tick exchanges the newest state and the newest force with it, without locks or system calls.
 *
 * The controller keeps all it promises: limits, states and faults are the core's. The driver's last stage is here too,
 * the same for all: hrt_drive_force returns zero where the tick's command is older than HRT_DRIVE_SILENCE_US or the
 * device's own state is, and never more than the device's limit. */
#ifndef HRT_DRIVE_H
#define HRT_DRIVE_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>

#include "hrt.h"
#include "workspace.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    HRT_DRIVE_BUTTONS = 4,
    HRT_DRIVE_SILENCE_US = 20000, /* age of a command, or of a state, at which the driver sends zero force */
    HRT_DRIVE_REFUSED_MAX = 10,   /* unusable states in a row that are a fault of the device */
    HRT_DRIVE_NAME = 128
};
/* Codes of the fault `device_reported`. */
typedef enum hrt_drive_fault {
    HRT_DRIVE_FINE = 0,
    HRT_DRIVE_NONSENSE = 21, /* HRT_DRIVE_REFUSED_MAX unusable states in a row */
    HRT_DRIVE_FLOODS = 22,   /* far more states than were asked for */
    HRT_DRIVE_FAILS = 23     /* a call of the device's library failed */
} hrt_drive_fault;

/* State of a device. Axes of a cursor: x right, y away, z up. Of a device of joints, cursor_m holds the driven joints
 * in their units. */
typedef struct hrt_drive_state {
    int64_t time_us; /* of the measurement, never later than it; 0: none */
    double cursor_m[3];
    double orientation[4]; /* x, y, z, w of the handle; all zero: unknown */
    double trigger;        /* 0 to 1; negative: none */
    bool button[HRT_DRIVE_BUTTONS];
    bool withheld; /* the operator permits no force */
} hrt_drive_state;

typedef struct hrt_drive_command {
    int64_t time_us;
    uint8_t state;      /* hrt_state */
    float force_N[3];   /* at the cursor, in its axes; of a device of joints, the torques */
    float torque_Nm[3]; /* at the handle, in the cursor's axes */
} hrt_drive_command;

typedef struct hrt_drive hrt_drive;

/* A kind of device: row of HRT_DRIVES in drive_table.c. */
typedef struct hrt_drive_driver {
    const char *kind, *address, *device; /* address "KIND:NUMBER"; device: of hrt_device_types */
    bool joints; /* motors of joints: no workspace, and any device of hrt_device_types may be built with them */
    const char *text;
    int rate_max; /* largest rate of ticks, Hz */
    bool torque;  /* sends the torque at the handle; the other drivers are refused for a type that states one */
    /* Starts the device of this name (after "KIND:"); it then posts states until `close`. Returns false with `why`. */
    bool (*open)(hrt_drive *drive, const char *name, char *why, int why_size);
    /* Sends zero force and ends; returns within half a second. */
    void (*close)(hrt_drive *drive);
    /* Prints a line for each device that is there, or why none is; returns within a second. */
    void (*list)(FILE *file);
} hrt_drive_driver;

struct hrt_drive {
    const hrt_drive_driver *driver;
    char name[HRT_DRIVE_NAME];
    float force_max_N;           /* last limit, at the cursor */
    const hrt_device_type *type; /* what is driven */
    void *own;                   /* the driver's */
    int claim_fd;
    pthread_t thread;
    _Atomic bool stop;
    int64_t period_us, tick_us; /* between two commands, half a tick; of a tick */
    /* driver to tick */
    hrt_drive_state state[3];
    uint32_t state_write, state_read;
    _Atomic uint32_t state_between;
    _Atomic int64_t state_us;    /* time of the newest state */
    _Atomic bool up;             /* connected, and its states are current */
    _Atomic uint32_t session;    /* number of the connection */
    _Atomic int fault;           /* hrt_drive_fault */
    _Atomic(const char *) event; /* to be logged once; null: none */
    _Atomic uint32_t states, refused, commands, withheld;
    uint32_t refused_in_a_row;
    /* tick to driver */
    hrt_drive_command command[3];
    uint32_t command_write, command_read;
    _Atomic uint32_t command_between;
    /* the tick's */
    hrt_workspace workspace;
    int64_t taken_us;
    bool here;
};

/* Opens a device by its address; `drive` holds the settings of `workspace` and `period_us`. Returns false, with the
 * reason and the remedy, if that is none or it does not start. */
bool hrt_drive_open(hrt_drive *drive, const char *address, char *why, int why_size);
void hrt_drive_close(hrt_drive *drive);
/* Returns the row of an address, null if it names no such device. */
const hrt_drive_driver *hrt_drive_find(const char *address);
/* Lists the kinds for a message: "haply:, touch:, ...". */
const char *hrt_drive_kinds(void);
/* Prints what is there, by kind. */
void hrt_drive_list(FILE *file);
/* Reads "scale=S,depth=M,clutch=BUTTON,grip=BUTTON", any of them. Returns false with `why`. */
bool hrt_drive_workspace(const char *text, hrt_workspace *workspace, char *why, int why_size);

/* --- the tick's thread --- */

/* Fills the input from the newest state. While the clutch is pressed, `enable` is withdrawn. */
void hrt_drive_take(hrt_drive *drive, int64_t now_us, const hrt_controller *controller, hrt_input *input);
void hrt_drive_give(hrt_drive *drive, int64_t now_us, const hrt_result *result, bool reset);

/* --- the driver's thread --- */

/* Prepares a drive for this device; call it before hrt_drive_open. */
void hrt_drive_start(hrt_drive *drive, const hrt_device_type *device);
/* Sets a fault, with the words for the log; the first stays until a reset. */
void hrt_drive_fail(hrt_drive *drive, hrt_drive_fault fault, const char *event);
/* Posts a state. Refuses one that is not finite or a metre from the device's origin; ten in a row are a fault. Returns
 * whether it was taken. */
bool hrt_drive_post(hrt_drive *drive, const hrt_drive_state *state);
/* Counts an answer that is no state. */
void hrt_drive_refuse(hrt_drive *drive);
/* Returns the force to send now, N; `fault` set, silence of the tick or silence of the device make it zero. */
void hrt_drive_force(hrt_drive *drive, int64_t now_us, float force_N[3]);
/* The same, and the torque at the handle, N m. */
void hrt_drive_wrench(hrt_drive *drive, int64_t now_us, float force_N[3], float torque_Nm[3]);
/* Returns the controller's state at the command that hrt_drive_force last read. */
hrt_state hrt_drive_controller(const hrt_drive *drive);
/* Sets whether the device is connected; a new connection is a new session. */
void hrt_drive_up(hrt_drive *drive, bool up, const char *event);

#ifdef __cplusplus
}
#endif
#endif
