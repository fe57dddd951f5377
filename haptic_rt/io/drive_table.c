/* The kinds of drives: opens, claims, lists. */
#include <errno.h>
#include <math.h>
#include <stddef.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "drive_table.h"

#define ROW_DECLARED(kind) extern const hrt_drive_driver hrt_drive_##kind;
HRT_DRIVES(ROW_DECLARED)
#define ROW_ENTRY(kind) &hrt_drive_##kind,
static const hrt_drive_driver *const drivers[] = {HRT_DRIVES(ROW_ENTRY)};
enum { DRIVERS = sizeof drivers / sizeof drivers[0] };

#define ROW_KIND(kind) ", " #kind ":"
const char *hrt_drive_kinds(void) { return &HRT_DRIVES(ROW_KIND)[2]; }

static const char *name_of(const hrt_drive_driver *driver, const char *address) {
    const size_t length = strlen(driver->kind);
    return strncmp(address, driver->kind, length) == 0 && address[length] == ':' ? address + length + 1 : NULL;
}

const hrt_drive_driver *hrt_drive_find(const char *address) {
    for (int k = 0; k < DRIVERS; k++)
        if (name_of(drivers[k], address)) return drivers[k];
    return NULL;
}

/* Claims the device for this process: an abstract socket name, which the kernel drops with its holder. */
static bool claim(hrt_drive *d, const char *address, char *why, int why_size) {
    struct sockaddr_un name;
    memset(&name, 0, sizeof name);
    name.sun_family = AF_UNIX;
    const int length = snprintf(name.sun_path + 1, sizeof name.sun_path - 1, "tensormass/device/%s", address);
    const int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    const socklen_t size = (socklen_t)(offsetof(struct sockaddr_un, sun_path) + 1 + (size_t)length);
    if (fd < 0 || length >= (int)sizeof name.sun_path - 1 || bind(fd, (const struct sockaddr *)&name, size) != 0) {
        snprintf(why, (size_t)why_size,
                 errno == EADDRINUSE ? "another haptic-rt uses %s; end it, or choose another device"
                                     : "%s cannot be claimed; give a shorter address, or close other programs",
                 address);
        if (fd >= 0) close(fd);
        return false;
    }
    d->claim_fd = fd;
    return true;
}

bool hrt_drive_open(hrt_drive *d, const char *address, char *why, int why_size) {
    const hrt_drive_driver *driver = hrt_drive_find(address);
    d->claim_fd = -1;
    if (!driver)
        return snprintf(why, (size_t)why_size, "'%s' is not a device address; see haptic-rt --list", address), false;
    if (d->type->handle_torque_max_Nm > 0.0f && !driver->torque)
        return snprintf(why, (size_t)why_size,
                        "%s: renders no torque at a handle, as '%s' does; choose --device-type %s", driver->kind,
                        d->type->name, driver->device),
               false;
    if (!claim(d, address, why, why_size)) return false;
    d->driver = driver;
    snprintf(d->name, sizeof d->name, "%s", address);
    if (driver->open(d, name_of(driver, address), why, why_size)) return true;
    hrt_drive_close(d);
    return false;
}

void hrt_drive_close(hrt_drive *d) {
    if (d->own) d->driver->close(d);
    if (d->driver && d->claim_fd >= 0) close(d->claim_fd);
    d->driver = NULL;
}

void hrt_drive_list(FILE *file) {
    for (int k = 0; k < DRIVERS; k++) {
        fprintf(file, "%s  (%s, up to %d Hz)\n", drivers[k]->address, drivers[k]->text, drivers[k]->rate_max);
        fflush(file);
        drivers[k]->list(file);
    }
}

static bool set(hrt_workspace *w, const char *name, double value) {
    if (strcmp(name, "scale") == 0)
        w->scale = value;
    else if (strcmp(name, "depth") == 0)
        w->depth_m = value;
    else if (strcmp(name, "clutch") == 0)
        w->clutch = (int32_t)value;
    else if (strcmp(name, "grip") == 0)
        w->grip = (int32_t)value;
    else
        return false;
    return true;
}

static bool good_button(double b) { return b >= -1.0 && b < HRT_DRIVE_BUTTONS; }

bool hrt_drive_workspace(const char *text, hrt_workspace *w, char *why, int why_size) {
    while (*text) {
        char name[16], end = 0;
        double value;
        int used = 0;
        const int got = sscanf(text, "%15[a-z]=%lf%n%c", name, &value, &used, &end);
        if (got < 2 || (got == 3 && end != ',') || !isfinite(value) || !set(w, name, value)) {
            snprintf(why, (size_t)why_size, "'%s' is not a setting; write scale=S,depth=M,clutch=BUTTON,grip=BUTTON",
                     text);
            return false;
        }
        text += used + (end == ',');
    }
    if (w->scale >= HRT_SCALE_MIN && w->scale <= HRT_SCALE_MAX && fabs(w->depth_m) <= 0.4 && good_button(w->clutch) &&
        good_button(w->grip))
        return true;
    snprintf(why, (size_t)why_size, "keep scale within %g..%g, depth within +-0.4 m, buttons within -1 (none) to %d",
             HRT_SCALE_MIN, HRT_SCALE_MAX, HRT_DRIVE_BUTTONS - 1);
    return false;
}
