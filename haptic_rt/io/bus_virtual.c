/* The bus between processes, without kernel CAN: a ring buffer of frames in a mapped file. Sending and receiving take a
 * few loads and stores, no system call. Endpoints may join, leave or be killed at any time. */
#include <string.h>
#include <unistd.h>

#include "bus.h"
#include "bus_virtual_file.h"

static hrt_virtual_bus *memory_of(const hrt_bus *bus) {
    return atomic_load(&((const hrt_virtual_hold *)bus->shared)->memory);
}

static bool in_trouble(const hrt_bus *bus) {
    return atomic_load(&((const hrt_virtual_hold *)bus->shared)->trouble) != HRT_VIRTUAL_WELL;
}

static int virtual_send(hrt_bus *bus, const hrt_can_frame *frame) {
    hrt_virtual_bus *v = memory_of(bus);
    if (in_trouble(bus) || atomic_load(&v->off)) return -1;
    const uint64_t number = atomic_fetch_add(&v->head, 1);
    const uint64_t s = number % HRT_VIRTUAL_SLOTS;
    atomic_store(&v->slot[s].stamp, 0);
    atomic_thread_fence(memory_order_release);
    v->slot[s].writer = bus->self;
    v->slot[s].frame = *frame;
    atomic_store(&v->slot[s].stamp, number + 1);
    hrt_bus_count(bus, &bus->tx, frame);
    return 1;
}

static int virtual_receive(hrt_bus *bus, hrt_can_frame *frame) {
    hrt_virtual_bus *v = memory_of(bus);
    if (in_trouble(bus) || atomic_load(&v->off)) return -1;
    const uint64_t head = atomic_load(&v->head);
    if (head < bus->next) bus->next = head; /* the file was created again */
    if (head - bus->next > HRT_VIRTUAL_SLOTS / 2) {
        bus->dropped += head - bus->next;
        bus->next = head;
    }
    while (bus->next < head) {
        const uint64_t s = bus->next % HRT_VIRTUAL_SLOTS;
        const uint64_t stamp = atomic_load(&v->slot[s].stamp);
        if (stamp != bus->next + 1) {
            /* Being written, or its writer was killed; after 16 newer frames it is skipped. */
            if (head - bus->next < 16) return 0;
            bus->dropped++;
            bus->next++;
            continue;
        }
        const uint64_t writer = v->slot[s].writer;
        *frame = v->slot[s].frame;
        atomic_thread_fence(memory_order_acquire);
        const bool whole = atomic_load(&v->slot[s].stamp) == stamp;
        bus->next++;
        if (!whole) bus->dropped++;
        if (!whole || writer == bus->self) continue;
        hrt_bus_count(bus, &bus->rx, frame);
        return 1;
    }
    return 0;
}

/* Returns whether the file was overwritten; its contents are then invalid. */
static bool is_garbage(const hrt_bus *bus) { return atomic_load(&memory_of(bus)->magic) != HRT_VIRTUAL_MAGIC; }

static hrt_bus_state virtual_state(hrt_bus *bus) {
    if (in_trouble(bus)) return HRT_BUS_DOWN;
    return atomic_load(&memory_of(bus)->off) || is_garbage(bus) ? HRT_BUS_OFF : HRT_BUS_OK;
}

/* Initialises the file, by the first endpoint; frame numbers continue from its present head. */
static void begin_anew(hrt_virtual_bus *v) {
    atomic_store(&v->off, 0);
    atomic_store(&v->magic, HRT_VIRTUAL_MAGIC);
}

static void virtual_recover(hrt_bus *bus, int64_t now_us) {
    hrt_virtual_hold *hold = bus->shared;
    const bool ready = atomic_exchange(&hold->ready, false);
    if (!ready && (in_trouble(bus) || !is_garbage(bus) || now_us - bus->tried_us < 100000)) return;
    bus->tried_us = now_us;
    if (ready)
        atomic_store(&hold->trouble, HRT_VIRTUAL_WELL);
    else
        begin_anew(memory_of(bus));
    bus->next = atomic_load(&memory_of(bus)->head);
}

static void virtual_close(hrt_bus *bus) {
    hrt_virtual_close(bus->shared);
    bus->driver = NULL;
}

static int virtual_claim(hrt_bus *bus, int place) { return hrt_virtual_claim(bus->shared, place); }
static const char *virtual_look(hrt_bus *bus) { return hrt_virtual_look(bus->shared); }

static const hrt_bus_driver virtual_driver = {"virtual",     virtual_send,    virtual_receive,
                                              virtual_state, virtual_recover, virtual_close,
                                              virtual_claim, virtual_look,    NULL};

bool hrt_bus_virtual(hrt_bus *bus, const char *name, char *why, int why_size) {
    static _Atomic uint64_t opened;
    memset(bus, 0, sizeof *bus);
    if (!hrt_virtual_path(name, bus->name, (int)sizeof bus->name, why, why_size)) return false;
    hrt_virtual_hold *hold = hrt_virtual_open(bus->name, why, why_size);
    if (!hold) return false;
    bus->driver = &virtual_driver;
    bus->shared = hold;
    bus->next = atomic_load(&memory_of(bus)->head);
    bus->self = ((uint64_t)getpid() << 32) | (atomic_fetch_add(&opened, 1) + 1);
    return true;
}
