/* The kernel's CAN: a non-blocking raw socket. If the interface disappears, the checking thread opens another socket
 * and later closes the old one. The tick's thread takes the new one over with loads and stores only. */
#include <errno.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "bus.h"

/* Sockets passed between the two threads. Only the checking thread sets `fresh_fd` to a socket or clears `old_fd`; only
 * the tick's thread clears `fresh_fd` or sets `old_fd`. */
typedef struct handover {
    _Atomic bool down;            /* a new socket is needed */
    _Atomic int fresh_fd, old_fd; /* -1: none */
} handover;

static int attach(const hrt_bus *bus) {
    const unsigned index = if_nametoindex(bus->name);
    if (index == 0) return -1;
    const int fd = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
    if (fd < 0) return -1;
    const can_err_mask_t wanted =
        CAN_ERR_BUSOFF | CAN_ERR_CRTL | CAN_ERR_RESTARTED | CAN_ERR_BUSERROR | CAN_ERR_ACK | CAN_ERR_PROT;
    struct sockaddr_can address;
    memset(&address, 0, sizeof address);
    address.can_family = AF_CAN;
    address.can_ifindex = (int)index;
    const int yes = 1;
    setsockopt(fd, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &yes, sizeof yes); /* a kernel without CAN-FD sends classical ones */
    if (setsockopt(fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &wanted, sizeof wanted) != 0 ||
        bind(fd, (const struct sockaddr *)&address, sizeof address) != 0) {
        const int reason = errno;
        close(fd);
        errno = reason;
        return -1;
    }
    return fd;
}

static int failed(hrt_bus *bus) {
    if (errno == EAGAIN || errno == EINTR) return 0;
    if (errno == ENOBUFS) { /* the interface's queue is full */
        bus->dropped++;
        if (bus->now == HRT_BUS_OK) bus->now = HRT_BUS_WARNING;
        return 0;
    }
    bus->now = HRT_BUS_DOWN;
    atomic_store(&((handover *)bus->shared)->down, true);
    return -1;
}

static int socketcan_send(hrt_bus *bus, const hrt_can_frame *frame) {
    if (bus->now >= HRT_BUS_OFF) return -1;
    struct canfd_frame
        out; /* a classical frame is the beginning of the struct; the size received distinguishes the two */
    const bool fd = frame->flags & HRT_CAN_FD;
    const size_t size = fd ? CANFD_MTU : CAN_MTU;
    memset(&out, 0, sizeof out);
    out.can_id = frame->id | ((frame->flags & HRT_CAN_EXTENDED) ? CAN_EFF_FLAG : 0u) |
                 ((frame->flags & HRT_CAN_REMOTE) ? CAN_RTR_FLAG : 0u);
    out.len = frame->length;
    out.flags = fd ? CANFD_BRS : 0;
    memcpy(out.data, frame->data, fd ? CANFD_MAX_DLEN : CAN_MAX_DLEN);
    if (send(bus->fd, &out, size, MSG_DONTWAIT) != (ssize_t)size) return failed(bus);
    hrt_bus_count(bus, &bus->tx, frame);
    return 1;
}

static void note_error(hrt_bus *bus, const struct canfd_frame *in) {
    bus->errors++;
    if (in->can_id & CAN_ERR_BUSOFF)
        bus->now = HRT_BUS_OFF;
    else if (in->can_id & CAN_ERR_RESTARTED)
        bus->now = HRT_BUS_OK;
    else if (bus->now == HRT_BUS_OK)
        bus->now = HRT_BUS_WARNING;
}

static int socketcan_receive(hrt_bus *bus, hrt_can_frame *frame) {
    struct canfd_frame in;
    if (bus->now == HRT_BUS_DOWN) return -1;
    const ssize_t got = recv(bus->fd, &in, sizeof in, MSG_DONTWAIT);
    if (got < 0) return failed(bus);
    if (got != CAN_MTU && got != CANFD_MTU) return 0;
    const uint8_t most = got == CANFD_MTU ? CANFD_MAX_DLEN : CAN_MAX_DLEN;
    memset(frame, 0, sizeof *frame);
    frame->id = in.can_id & ((in.can_id & CAN_EFF_FLAG) ? CAN_EFF_MASK : CAN_SFF_MASK);
    frame->flags = (uint8_t)(((in.can_id & CAN_EFF_FLAG) ? HRT_CAN_EXTENDED : 0) |
                             ((in.can_id & CAN_RTR_FLAG) ? HRT_CAN_REMOTE : 0) |
                             ((in.can_id & CAN_ERR_FLAG) ? HRT_CAN_ERROR : 0) | (got == CANFD_MTU ? HRT_CAN_FD : 0));
    frame->length = in.len > most ? most : in.len;
    memcpy(frame->data, in.data, most);
    if (in.can_id & CAN_ERR_FLAG)
        note_error(bus, &in);
    else {
        if (bus->now == HRT_BUS_WARNING) bus->now = HRT_BUS_OK;
        hrt_bus_count(bus, &bus->rx, frame);
    }
    return 1;
}

static hrt_bus_state socketcan_state(hrt_bus *bus) { return bus->now; }

/* Recovers, in the tick's thread. A kernel with restart-ms restarts the controller by itself; sending again shows
 * whether it did. After loss of the interface, takes over the new socket once there is one; frames already wait in it.
 */
static void socketcan_recover(hrt_bus *bus, int64_t now_us) {
    handover *h = bus->shared;
    if (bus->now == HRT_BUS_DOWN) {
        if (atomic_load(&h->fresh_fd) < 0 || atomic_load(&h->old_fd) >= 0) return;
        atomic_store(&h->down, false); /* before the exchange, so that `look` opens no second socket */
        const int fresh = atomic_exchange(&h->fresh_fd, -1);
        atomic_store(&h->old_fd, bus->fd);
        bus->fd = fresh;
    } else {
        if (now_us - bus->tried_us < 100000) return;
        bus->tried_us = now_us;
    }
    bus->now = HRT_BUS_OK;
}

/* Checks the interface, in another thread. */
static const char *socketcan_look(hrt_bus *bus) {
    handover *h = bus->shared;
    const int old = atomic_exchange(&h->old_fd, -1);
    if (old >= 0) close(old);
    if (atomic_load(&h->fresh_fd) < 0 && atomic_load(&h->down)) atomic_store(&h->fresh_fd, attach(bus));
    return NULL;
}

static void socketcan_close(hrt_bus *bus) {
    handover *h = bus->shared;
    const int open[] = {bus->fd, bus->claim_fd, atomic_load(&h->fresh_fd), atomic_load(&h->old_fd)};
    for (int i = 0; i < 4; i++)
        if (open[i] >= 0) close(open[i]);
    bus->fd = bus->claim_fd = -1;
    free(h);
    bus->shared = NULL;
    bus->driver = NULL;
}

/* Claims an abstract socket name, in the interface's network namespace; the kernel drops it with the socket. */
static int socketcan_claim(hrt_bus *bus, int place) {
    struct sockaddr_un name;
    memset(&name, 0, sizeof name);
    name.sun_family = AF_UNIX;
    const int length = snprintf(name.sun_path + 1, sizeof name.sun_path - 1, "tensormass/%s/%d", bus->name, place);
    const int fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (fd < 0) return 1;
    const socklen_t size = (socklen_t)(offsetof(struct sockaddr_un, sun_path) + 1 + (size_t)length);
    if (bind(fd, (const struct sockaddr *)&name, size) != 0) {
        const bool taken = errno == EADDRINUSE;
        close(fd);
        return taken ? 0 : 1;
    }
    bus->claim_fd = fd;
    return 1;
}

/* An interface that carries CAN-FD has room for its frames. */
static bool socketcan_has_fd(const hrt_bus *bus) {
    struct ifreq request;
    memset(&request, 0, sizeof request);
    memcpy(request.ifr_name, bus->name, IFNAMSIZ - 1);
    return ioctl(bus->fd, SIOCGIFMTU, &request) == 0 && request.ifr_mtu >= (int)CANFD_MTU;
}

static const hrt_bus_driver socketcan_driver = {"socketcan",     socketcan_send,    socketcan_receive,
                                                socketcan_state, socketcan_recover, socketcan_close,
                                                socketcan_claim, socketcan_look,    socketcan_has_fd};

bool hrt_bus_socketcan(hrt_bus *bus, const char *interface, char *why, int why_size) {
    memset(bus, 0, sizeof *bus);
    bus->fd = bus->claim_fd = -1;
    if (interface[0] == 0 || strlen(interface) >= IFNAMSIZ) {
        snprintf(why, (size_t)why_size, "'%s' is not an interface name; use for example socketcan:can0", interface);
        return false;
    }
    snprintf(bus->name, sizeof bus->name, "%s", interface);
    handover *h = malloc(sizeof *h);
    if (!h) {
        snprintf(why, (size_t)why_size, "cannot open %s: out of memory; close other programs", interface);
        return false;
    }
    *h = (handover){.fresh_fd = -1, .old_fd = -1};
    bus->fd = attach(bus);
    if (bus->fd < 0) {
        const int reason = errno;
        free(h);
        const char *advice =
            reason == EAFNOSUPPORT ? "this kernel has no CAN (modprobe can can_raw), or use virtual:NAME"
            : reason == ENODEV
                ? "no such interface; see `ip link`, set it up with `ip link set NAME up type can bitrate 1000000`"
                : "see `ip -details link show`";
        snprintf(why, (size_t)why_size, "cannot open %s (%s); %s", interface, strerror(reason), advice);
        return false;
    }
    bus->shared = h;
    bus->driver = &socketcan_driver;
    return true;
}
