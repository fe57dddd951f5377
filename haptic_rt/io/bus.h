/* A CAN bus behind a table of functions: classical and CAN-FD frames, non-blocking calls. Drivers: `loopback` (in
 * process), `virtual` (between processes, without kernel CAN), `socketcan`. An endpoint receives the frames of all
 * other endpoints but not its own. */
#ifndef HRT_BUS_H
#define HRT_BUS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "can/frame.h"
#include "hrt.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum hrt_bus_state {
    HRT_BUS_OK = 0,
    HRT_BUS_WARNING = 1, /* error counters high, or the send queue was full */
    HRT_BUS_OFF = 2,     /* the CAN controller is bus-off */
    HRT_BUS_DOWN = 3     /* the interface is gone */
} hrt_bus_state;

typedef struct hrt_bus hrt_bus;

typedef struct hrt_bus_driver {
    const char *name;
    /* Sends a frame. Returns 1 if sent, 0 if dropped (queue full), -1 if bus-off or down. */
    int (*send)(hrt_bus *bus, const hrt_can_frame *frame);
    /* Receives a frame. Returns 1 if there is one, 0 if not, -1 if bus-off or down. */
    int (*receive)(hrt_bus *bus, hrt_can_frame *frame);
    hrt_bus_state (*state)(hrt_bus *bus);
    /* Tries to recover from bus-off or down, at most every 100 ms. Runs in the tick's thread: it opens and closes
     * nothing, but takes over what `look` has opened. */
    void (*recover)(hrt_bus *bus, int64_t now_us);
    void (*close)(hrt_bus *bus);
    /* Claims a role on the bus. Returns 1 if claimed, 0 if another process holds it. Null: no other process can be on
     * this bus. */
    int (*claim)(hrt_bus *bus, int place);
    /* Checks the bus; called from another thread, several times a second. Returns each new event once. Reopens what
     * `recover` then takes over, and closes what `recover` has left. Null: no events. */
    const char *(*look)(hrt_bus *bus);
    /* Returns whether the bus carries CAN-FD frames. Null: it does. */
    bool (*has_fd)(const hrt_bus *bus);
} hrt_bus_driver;

/* Kinds of address "KIND:name". Each has a row here, with the text of its name and the largest rate of ticks, Hz, and a
 * file bus_KIND.c that defines hrt_bus_KIND. SocketCAN: one device's frames at 2000 Hz are 80 % of 1 Mbit/s. */
#define HRT_BUSES(ROW)                                                                                                 \
    ROW(virtual, "NAME", 4000)                                                                                         \
    ROW(socketcan, "INTERFACE", 2000)
typedef bool hrt_bus_opener(hrt_bus *bus, const char *name, char *why, int why_size);
#define HRT_BUS_DECLARED(kind, name, rate) hrt_bus_opener hrt_bus_##kind;
HRT_BUSES(HRT_BUS_DECLARED)
#define HRT_BUS_ADDRESS(kind, name, rate) " " #kind ":" name
#define HRT_BUS_ADDRESSES HRT_BUSES(HRT_BUS_ADDRESS) /* a string literal, each after a blank */

struct hrt_bus {
    const hrt_bus_driver *driver;
    hrt_bus_state now;
    int64_t tried_us;
    uint64_t tx, rx, errors, dropped; /* numbers of frames; dropped: send queue full, or overrun while not receiving */
    uint64_t bits;                    /* sent and received on the wire, with worst-case stuffing */
    int fd, claim_fd;                 /* socketcan */
    char name[256];                   /* interface or file */
    void *shared;                     /* data shared by threads or endpoints; loopback: its hrt_loopback */
    uint64_t next, self;              /* virtual: next frame to read, own id; loopback: port */
};

/* In-process bus with endpoints at ports 0..7; owned by the caller. */
enum { HRT_LOOPBACK_PORTS = 8, HRT_LOOPBACK_DEPTH = 256 };
typedef struct hrt_loopback {
    struct {
        bool open;
        uint32_t head, tail;
        hrt_can_frame frame[HRT_LOOPBACK_DEPTH];
    } port[HRT_LOOPBACK_PORTS];
    bool off; /* bus-off for all endpoints */
} hrt_loopback;
void hrt_loopback_init(hrt_loopback *loopback);
/* Returns false if all ports are in use. */
bool hrt_bus_open_loopback(hrt_bus *bus, hrt_loopback *loopback);

/* Claims a role on a bus exclusively on this machine, until the bus is closed or the process ends. Returns false, with
 * `why`, if another process holds it. */
typedef enum hrt_bus_role { HRT_BUS_CONTROLLER = 0, HRT_BUS_DEVICE = 1 } hrt_bus_role;
bool hrt_bus_claim(hrt_bus *bus, hrt_bus_role role, int32_t instrument, char *why, int why_size);

/* Opens a bus by address: "virtual:NAME" (the file $TM_BUS_DIR/NAME.bus, by default in /dev/shm/tensormass-UID) or
 * "socketcan:can0". Returns false with the reason and the remedy in `why`. */
bool hrt_bus_open(hrt_bus *bus, const char *address, char *why, int why_size);

/* Returns true if the address begins with a kind of bus. */
bool hrt_bus_is(const char *address);
/* Returns the largest rate of ticks on the bus, Hz; 0 if the address is that of no bus. */
int hrt_bus_rate_max(const char *address);
/* Lists the forms of addresses for a message: "virtual:NAME or socketcan:INTERFACE". */
const char *hrt_bus_kinds(void);

/* Checks a device before its bus is opened. Returns false, with `why`, if it has more joints than the frames carry. */
bool hrt_bus_carries(const hrt_device_type *device, char *why, int why_size);

/* Counts a frame and its bits, for drivers. */
static inline void hrt_bus_count(hrt_bus *bus, uint64_t *what, const hrt_can_frame *frame) {
    (*what)++;
    bus->bits += frame->flags & HRT_CAN_FD ? hrt_can_fd_bits(frame->length) : hrt_can_bits(frame->length);
}

static inline int hrt_bus_send(hrt_bus *bus, const hrt_can_frame *frame) { return bus->driver->send(bus, frame); }
static inline int hrt_bus_receive(hrt_bus *bus, hrt_can_frame *frame) { return bus->driver->receive(bus, frame); }
static inline hrt_bus_state hrt_bus_state_now(hrt_bus *bus) { return bus->driver->state(bus); }
static inline void hrt_bus_recover(hrt_bus *bus, int64_t now_us) { bus->driver->recover(bus, now_us); }
static inline const char *hrt_bus_look(hrt_bus *bus) { return bus->driver->look ? bus->driver->look(bus) : NULL; }
static inline bool hrt_bus_has_fd(const hrt_bus *bus) { return !bus->driver->has_fd || bus->driver->has_fd(bus); }
static inline void hrt_bus_close(hrt_bus *bus) {
    if (bus->driver) bus->driver->close(bus);
}

#ifdef __cplusplus
}
#endif
#endif
