/* A CAN bus behind a small table of functions: classical frames, never blocking. Drivers: `loopback` (in process),
 * `virtual` (between processes, no kernel CAN), `socketcan`. A bus endpoint hears every other endpoint's frames and not
 * its own. */
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
    HRT_BUS_WARNING = 1, /* error counters high, or a send queue that was full */
    HRT_BUS_OFF = 2,     /* the controller left the bus */
    HRT_BUS_DOWN = 3     /* no bus: interface gone */
} hrt_bus_state;

typedef struct hrt_bus hrt_bus;

typedef struct hrt_bus_driver {
    const char *name;
    /* 1 sent, 0 no room now (dropped), -1 bus off or down. */
    int (*send)(hrt_bus *bus, const hrt_can_frame *frame);
    /* 1 a frame, 0 none waits, -1 bus off or down. */
    int (*receive)(hrt_bus *bus, hrt_can_frame *frame);
    hrt_bus_state (*state)(hrt_bus *bus);
    /* One attempt to come back after off or down, at most every 100 ms. By the tick's thread: opens and closes nothing,
     * but takes over what `look` has opened. */
    void (*recover)(hrt_bus *bus, int64_t now_us);
    void (*close)(hrt_bus *bus);
    /* 1 the place is ours, 0 somebody else's. Null: nobody else can be on this bus. */
    int (*claim)(hrt_bus *bus, int place);
    /* From another thread, several times a second: what has happened to the bus, once each time. Opens anew what
     * `recover` then takes over, and closes what it left. Null: nothing can happen. */
    const char *(*look)(hrt_bus *bus);
} hrt_bus_driver;

/* What an address "KIND:name" opens: a row here, with the name as people are told it, and bus_KIND.c, which defines
 * hrt_bus_KIND. */
#define HRT_BUSES(ROW)                                                                                                 \
    ROW(virtual, "NAME")                                                                                               \
    ROW(socketcan, "INTERFACE")
typedef bool hrt_bus_opener(hrt_bus *bus, const char *name, char *why, int why_size);
#define HRT_BUS_DECLARED(kind, name) hrt_bus_opener hrt_bus_##kind;
HRT_BUSES(HRT_BUS_DECLARED)
#define HRT_BUS_ADDRESS(kind, name) " " #kind ":" name
#define HRT_BUS_ADDRESSES HRT_BUSES(HRT_BUS_ADDRESS) /* a string literal, each after a blank */

struct hrt_bus {
    const hrt_bus_driver *driver;
    hrt_bus_state now;
    int64_t tried_us;
    uint64_t tx, rx, errors, dropped; /* frames; dropped: no room to send, or overrun while not receiving */
    uint64_t bits;                    /* sent and received, on the wire with the worst stuffing */
    int fd, claim_fd;                 /* socketcan */
    char name[256];                   /* interface or file */
    void *shared;                     /* what threads or endpoints share; loopback: its hrt_loopback */
    uint64_t next, self;              /* virtual: next frame to read, own mark; loopback: port */
};

/* In-process bus: endpoints of one hrt_loopback. Caller-owned; ports 0..7. */
enum { HRT_LOOPBACK_PORTS = 8, HRT_LOOPBACK_DEPTH = 256 };
typedef struct hrt_loopback {
    struct {
        bool open;
        uint32_t head, tail;
        hrt_can_frame frame[HRT_LOOPBACK_DEPTH];
    } port[HRT_LOOPBACK_PORTS];
    bool off; /* bus-off for all */
} hrt_loopback;
void hrt_loopback_init(hrt_loopback *loopback);
/* False when all ports are taken. */
bool hrt_bus_open_loopback(hrt_bus *bus, hrt_loopback *loopback);

/* Keeps everybody else on this machine from being the same one on the same bus, until it is closed or the program ends
 * in whatever way. False with `why`: somebody is. */
typedef enum hrt_bus_role { HRT_BUS_CONTROLLER = 0, HRT_BUS_DEVICE = 1 } hrt_bus_role;
bool hrt_bus_claim(hrt_bus *bus, hrt_bus_role role, int32_t instrument, char *why, int why_size);

/* "virtual:NAME" (the file $TM_BUS_DIR/NAME.bus, by default in /dev/shm/tensormass-UID) or "socketcan:can0". On failure
 * `why` says what is wrong and what to do. */
bool hrt_bus_open(hrt_bus *bus, const char *address, char *why, int why_size);

/* False with `why`: the frames carry fewer joints than the device has. For whoever opens a bus for a device. */
bool hrt_bus_carries(const hrt_device_type *device, char *why, int why_size);

/* For the drivers: counts a frame's bits. */
static inline void hrt_bus_count(hrt_bus *bus, uint64_t *what, const hrt_can_frame *frame) {
    (*what)++;
    bus->bits += hrt_can_bits(frame->length);
}

static inline int hrt_bus_send(hrt_bus *bus, const hrt_can_frame *frame) { return bus->driver->send(bus, frame); }
static inline int hrt_bus_receive(hrt_bus *bus, hrt_can_frame *frame) { return bus->driver->receive(bus, frame); }
static inline hrt_bus_state hrt_bus_state_now(hrt_bus *bus) { return bus->driver->state(bus); }
static inline void hrt_bus_recover(hrt_bus *bus, int64_t now_us) { bus->driver->recover(bus, now_us); }
static inline const char *hrt_bus_look(hrt_bus *bus) { return bus->driver->look ? bus->driver->look(bus) : NULL; }
static inline void hrt_bus_close(hrt_bus *bus) {
    if (bus->driver) bus->driver->close(bus);
}

#ifdef __cplusplus
}
#endif
#endif
