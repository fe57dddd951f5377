/* A master by ROS 2, through the bridge `python -m tensormass.crtk_master` on this machine: one datagram a state, one
 * a force, on 127.0.0.1. The bridge does all that needs ROS; nothing here or in the tick waits for it.
 *
 * Datagrams, little-endian. State, 80 bytes: "TMS1", flags (u32: bits 0 to 3 buttons, 8 permission to render force),
 * time on this machine's monotonic clock (i64, us), cursor (3 f64, m), orientation (4 f64: x, y, z, w), gripper (f64, 0
 * open to 1 closed, negative: none). Force, 40 bytes: "TMF1", state and fault of the controller (u8, u8, 2 of zero),
 * time (i64, us), force at the cursor (3 f32, N), torque at the handle (3 f32, N m). */
#include <arpa/inet.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "clock.h"
#include "drive.h"

enum {
    STATE_BYTES = 80,
    FORCE_BYTES = 40,
    PERMISSION = 1 << 8,
    PORT = 10700,
    FLOOD_MAX = 1000, /* states in FLOOD_US: ten thousand a second */
    FLOOD_US = 100000,
    SILENT_US = 20000, /* age of the newest state at which the master counts as gone */
    ZERO_EVERY_US = 5000
};

typedef struct crtk {
    hrt_drive *drive;
    int fd;
    bool known; /* the bridge's address */
    struct sockaddr_in bridge;
    int64_t state_us, heard_us, said_us, window_us;
    int in_window;
} crtk;

static uint64_t get(const uint8_t *data) {
    uint64_t bits = 0;
    for (int i = 0; i < 8; i++) bits |= (uint64_t)data[i] << (8 * i);
    return bits;
}

static double get_double(const uint8_t *data) {
    const uint64_t bits = get(data);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static void put(uint8_t *data, uint64_t bits, int bytes) {
    for (int i = 0; i < bytes; i++) data[i] = (uint8_t)(bits >> (8 * i));
}

static void say(crtk *c, int64_t now_us, const float wrench[6]) {
    uint8_t data[FORCE_BYTES] = {'T', 'M', 'F', '1'};
    if (!c->known) return;
    data[4] = (uint8_t)hrt_drive_controller(c->drive);
    data[5] = (uint8_t)atomic_load(&c->drive->fault);
    put(data + 8, (uint64_t)now_us, 8);
    for (int i = 0; i < 6; i++) {
        uint32_t bits;
        memcpy(&bits, &wrench[i], sizeof bits);
        put(data + 16 + 4 * i, bits, 4);
    }
    sendto(c->fd, data, sizeof data, MSG_DONTWAIT, (const struct sockaddr *)&c->bridge, sizeof c->bridge);
    c->said_us = now_us;
}

/* Takes a state: of this machine's clock, not from the future, not late, and later than the last. */
static void take(crtk *c, const uint8_t *data, ssize_t length, int64_t now_us) {
    hrt_drive_state state = {.time_us = 0};
    if (length != STATE_BYTES || memcmp(data, "TMS1", 4) != 0) {
        hrt_drive_refuse(c->drive);
        return;
    }
    const uint32_t flags = (uint32_t)data[4] | (uint32_t)data[5] << 8;
    state.time_us = (int64_t)get(data + 8);
    for (int i = 0; i < 3; i++) state.cursor_m[i] = get_double(data + 16 + 8 * i);
    for (int i = 0; i < 4; i++) state.orientation[i] = get_double(data + 40 + 8 * i);
    state.trigger = get_double(data + 72);
    for (int b = 0; b < HRT_DRIVE_BUTTONS; b++) state.button[b] = (flags >> b & 1u) != 0;
    state.withheld = (flags & PERMISSION) == 0;
    if (state.time_us > now_us || now_us - state.time_us > SILENT_US || state.time_us <= c->state_us) return;
    c->heard_us = now_us;
    if (!hrt_drive_post(c->drive, &state)) return;
    c->state_us = state.time_us;
    hrt_drive_up(c->drive, true, NULL);
}

static void count(crtk *c, int64_t now_us) {
    if (now_us - c->window_us > FLOOD_US) {
        c->window_us = now_us;
        c->in_window = 0;
    }
    if (++c->in_window > FLOOD_MAX) hrt_drive_fail(c->drive, HRT_DRIVE_FLOODS, NULL);
}

/* Takes what waits. While a bridge is heard, datagrams of another are ignored. Returns whether a state came. */
static bool receive(crtk *c) {
    bool came = false;
    uint8_t data[STATE_BYTES + 1];
    struct sockaddr_in from;
    for (int k = 0; k < FLOOD_MAX; k++) {
        socklen_t size = sizeof from;
        const ssize_t length = recvfrom(c->fd, data, sizeof data, MSG_DONTWAIT, (struct sockaddr *)&from, &size);
        if (length < 0) break;
        const int64_t now_us = app_monotonic_us();
        const bool same = c->known && from.sin_port == c->bridge.sin_port;
        if (!same && c->known && now_us - c->heard_us < SILENT_US) continue;
        c->bridge = from;
        c->known = true;
        count(c, now_us);
        take(c, data, length, now_us);
        came = true;
    }
    return came;
}

static void step(crtk *c) {
    float wrench[6] = {0};
    struct pollfd fd = {.fd = c->fd, .events = POLLIN};
    const struct timespec wait = {0, 1000000};
    ppoll(&fd, 1, &wait, NULL);
    const bool came = receive(c);
    const int64_t now_us = app_monotonic_us();
    const bool silent = now_us - c->state_us > SILENT_US;
    if (silent && atomic_load(&c->drive->up))
        hrt_drive_up(c->drive, false, "no poses of the master come from the bridge");
    if (came || (silent && now_us - c->said_us > ZERO_EVERY_US)) {
        hrt_drive_wrench(c->drive, now_us, wrench, wrench + 3);
        say(c, now_us, wrench);
    }
}

static void *run(void *user) {
    crtk *c = user;
    while (!atomic_load(&c->drive->stop)) step(c);
    say(c, app_monotonic_us(), (const float[6]){0});
    return NULL;
}

static bool bind_port(crtk *c, const char *name, char *why, int why_size) {
    char tail;
    int port = PORT;
    if (*name && strcmp(name, "0") != 0 && (sscanf(name, "%d%c", &port, &tail) != 1 || port < 1024 || port > 65535))
        return snprintf(why, (size_t)why_size,
                        "'crtk:%s' is not a device address; write crtk:0 for port %d, or crtk:PORT within 1024..65535",
                        name, PORT),
               false;
    struct sockaddr_in here = {.sin_family = AF_INET, .sin_port = htons((uint16_t)port)};
    here.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    c->fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (c->fd >= 0 && bind(c->fd, (const struct sockaddr *)&here, sizeof here) == 0) return true;
    snprintf(why, (size_t)why_size, "port %d is taken; end the other program, or give another: crtk:PORT", port);
    if (c->fd >= 0) close(c->fd);
    return false;
}

static bool crtk_open(hrt_drive *d, const char *name, char *why, int why_size) {
    crtk *c = calloc(1, sizeof *c);
    if (!c) return snprintf(why, (size_t)why_size, "out of memory; close other programs"), false;
    c->drive = d;
    if (!bind_port(c, name, why, why_size)) return free(c), false;
    if (pthread_create(&d->thread, NULL, run, c) == 0) return d->own = c, true;
    snprintf(why, (size_t)why_size, "no thread can be started; close other programs");
    close(c->fd);
    return free(c), false;
}

static void crtk_close(hrt_drive *d) {
    crtk *c = d->own;
    atomic_store(&d->stop, true);
    pthread_join(d->thread, NULL);
    close(c->fd);
    free(c);
    d->own = NULL;
}

static void crtk_list(FILE *file) {
    fputs("  crtk:0           a master in ROS 2, by python -m tensormass.crtk_master NAMESPACE\n", file);
}

const hrt_drive_driver hrt_drive_crtk = {.kind = "crtk",
                                         .address = "crtk:0|PORT",
                                         .device = "crtk",
                                         .text = "CRTK master, by a bridge to ROS 2",
                                         .rate_max = 1000,
                                         .torque = true,
                                         .open = crtk_open,
                                         .close = crtk_close,
                                         .list = crtk_list};
