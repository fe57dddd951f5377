/* Deterministic bus within a process: one queue per port. */
#include <string.h>

#include "bus.h"

static int loopback_send(hrt_bus *bus, const hrt_can_frame *frame) {
    hrt_loopback *l = bus->shared;
    if (l->off) return -1;
    for (uint64_t p = 0; p < HRT_LOOPBACK_PORTS; p++) {
        if (!l->port[p].open || p == bus->self) continue;
        if (l->port[p].head - l->port[p].tail == HRT_LOOPBACK_DEPTH)
            bus->dropped++;
        else
            l->port[p].frame[l->port[p].head++ % HRT_LOOPBACK_DEPTH] = *frame;
    }
    hrt_bus_count(bus, &bus->tx, frame);
    return 1;
}

static int loopback_receive(hrt_bus *bus, hrt_can_frame *frame) {
    hrt_loopback *l = bus->shared;
    if (l->off) return -1;
    if (l->port[bus->self].head == l->port[bus->self].tail) return 0;
    *frame = l->port[bus->self].frame[l->port[bus->self].tail++ % HRT_LOOPBACK_DEPTH];
    hrt_bus_count(bus, &bus->rx, frame);
    return 1;
}

static hrt_bus_state loopback_state(hrt_bus *bus) {
    return ((const hrt_loopback *)bus->shared)->off ? HRT_BUS_OFF : HRT_BUS_OK;
}

static void loopback_recover(hrt_bus *bus, int64_t now_us) { bus->tried_us = now_us; }

static void loopback_close(hrt_bus *bus) {
    hrt_loopback *l = bus->shared;
    l->port[bus->self].open = false;
    bus->driver = NULL;
}

static const hrt_bus_driver loopback_driver = {
    "loopback", loopback_send, loopback_receive, loopback_state, loopback_recover, loopback_close, NULL, NULL, NULL};

void hrt_loopback_init(hrt_loopback *loopback) { memset(loopback, 0, sizeof *loopback); }

bool hrt_bus_open_loopback(hrt_bus *bus, hrt_loopback *loopback) {
    memset(bus, 0, sizeof *bus);
    for (uint64_t p = 0; p < HRT_LOOPBACK_PORTS; p++) {
        if (loopback->port[p].open) continue;
        loopback->port[p].open = true;
        loopback->port[p].head = loopback->port[p].tail = 0;
        bus->driver = &loopback_driver;
        bus->shared = loopback;
        bus->self = p;
        return true;
    }
    return false;
}
