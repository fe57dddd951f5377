/* Opens a bus by its address "driver:name". */
#include <stdio.h>
#include <string.h>

#include "bus.h"
#include "can/codec.h"

#define OR(kind, name, rate) " or " #kind ":" name
#define KIND(kind, name, rate) {#kind ":", hrt_bus_##kind, rate},
static const struct {
    const char *before;
    hrt_bus_opener *open;
    int rate_max;
} kinds[] = {HRT_BUSES(KIND)};

const char *hrt_bus_kinds(void) { return &HRT_BUSES(OR)[4]; }

int hrt_bus_rate_max(const char *address) {
    for (size_t k = 0; k < sizeof kinds / sizeof kinds[0]; k++)
        if (strncmp(address, kinds[k].before, strlen(kinds[k].before)) == 0) return kinds[k].rate_max;
    return 0;
}

bool hrt_bus_is(const char *address) { return hrt_bus_rate_max(address) > 0; }

bool hrt_bus_open(hrt_bus *bus, const char *address, char *why, int why_size) {
    for (size_t k = 0; k < sizeof kinds / sizeof kinds[0]; k++) {
        const size_t length = strlen(kinds[k].before);
        if (strncmp(address, kinds[k].before, length) == 0) return kinds[k].open(bus, address + length, why, why_size);
    }
    snprintf(why, (size_t)why_size, "'%s' is not a bus address; use %s", address, hrt_bus_kinds());
    return false;
}

bool hrt_bus_carries(const hrt_device_type *device, char *why, int why_size) {
    if (device->joints <= HRT_CAN_JOINTS || device->tilts) return true;
    snprintf(why, (size_t)why_size,
             "a %s has %d joints, and the CAN frames carry %d; choose a device with at most that many", device->name,
             device->joints, HRT_CAN_JOINTS);
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
