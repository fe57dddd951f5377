/* "driver:name" to a bus. */
#include <stdio.h>
#include <string.h>

#include "bus.h"

bool hrt_bus_open(hrt_bus *bus, const char *address, char *why, int why_size) {
    if (strncmp(address, "virtual:", 8) == 0) return hrt_bus_open_virtual(bus, address + 8, why, why_size);
    if (strncmp(address, "socketcan:", 10) == 0) return hrt_bus_open_socketcan(bus, address + 10, why, why_size);
    snprintf(why, (size_t)why_size, "'%s' names no bus; use virtual:NAME or socketcan:INTERFACE", address);
    return false;
}

bool hrt_bus_claim(hrt_bus *bus, hrt_bus_role role, int32_t instrument, char *why, int why_size) {
    if (!bus->driver->claim || bus->driver->claim(bus, 2 * (int)role + instrument) > 0) return true;
    snprintf(why, (size_t)why_size,
             "another %s is already %s %d on this bus; end it, or choose another --instrument or --bus",
             role == HRT_BUS_DEVICE ? "tm-device" : "haptic-rt", role == HRT_BUS_DEVICE ? "device" : "controller",
             instrument);
    return false;
}
