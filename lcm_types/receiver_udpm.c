/* Receives LCM's UDP multicast wire format within bounds: "LC02" short messages, "LC03" fragments (liblcm's
 * udpm_util.h). */
#include <arpa/inet.h>
#include <errno.h>
#include <ifaddrs.h>
#include <linux/filter.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "libtensormass/platform/clock.h"
#include "receiver_internal.h"

enum { SHORT_HEAD = 8, LONG_HEAD = 20, NAME_MAX_BYTES = 64, UDP_HEAD = 8, BUFFER_BYTES = 1 << 20, LOOK_US = 1000000 };
#define MAGIC_SHORT 0x4c433032u
#define MAGIC_LONG 0x4c433033u

static uint32_t word(const uint8_t *p) {
    return (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3];
}

/* ---------------------------------------------------------------------------------------------- packets */

static void count(_Atomic int64_t *counter) { atomic_fetch_add(counter, 1); }

/* Returns the size of the channel's name with its zero; 0 if it has none. */
static int name_bytes(const uint8_t *at, int left) {
    const uint8_t *end = memchr(at, 0, (size_t)(left < NAME_MAX_BYTES ? left : NAME_MAX_BYTES));
    return end ? (int)(end - at) + 1 : 0;
}

static void take_short(app_receiver *r, const uint8_t *p, int size) {
    const int name = size > SHORT_HEAD ? name_bytes(p + SHORT_HEAD, size - SHORT_HEAD) : 0;
    if (!name) {
        count(&r->counts.malformed);
        return;
    }
    const int channel = app_receiver_find(r, (const char *)p + SHORT_HEAD);
    if (channel >= 0) app_receiver_dispatch(r, channel, p + SHORT_HEAD + name, size - SHORT_HEAD - name);
}

static bool same_sender(const app_fragmented *f, const struct sockaddr_in *from) {
    return f->from.sin_addr.s_addr == from->sin_addr.s_addr && f->from.sin_port == from->sin_port;
}

/* Returns the slot to assemble this message in: its own, a free one, or the oldest. A sender's next message ends its
 * previous one. Returns null for a message before it. */
static app_fragmented *place(app_receiver *r, const struct sockaddr_in *from, uint32_t seq, int64_t now_us) {
    app_fragmented *best = NULL;
    for (int i = 0; i < APP_FRAGMENTED; i++) {
        app_fragmented *f = &r->fragmented[i];
        if (f->used && same_sender(f, from)) {
            const bool young = now_us - f->since_us < APP_FRAGMENT_US;
            if (young && f->seq == seq) return f;
            if (young && (int32_t)(seq - f->seq) < 0) return NULL;
            best = f;
            break;
        }
        if (!best || (best->used && (!f->used || f->since_us < best->since_us))) best = f;
    }
    if (best->used) count(&r->counts.abandoned);
    best->used = false;
    return best;
}

static void begin(app_fragmented *f, const struct sockaddr_in *from, uint32_t seq, uint32_t size, uint32_t fragments,
                  int64_t now_us) {
    f->used = true;
    f->from = *from;
    f->seq = seq;
    f->size = size;
    f->fragments = fragments;
    f->come = f->bytes = 0;
    f->since_us = now_us;
    f->channel = -1;
    memset(f->seen, 0, (fragments + 7) / 8);
}

static void take_fragment(app_receiver *r, const struct sockaddr_in *from, const uint8_t *p, int size, int64_t now_us) {
    if (size <= LONG_HEAD) {
        count(&r->counts.malformed);
        return;
    }
    const uint32_t seq = word(p + 4), whole = word(p + 8), offset = word(p + 12);
    const uint32_t number = word(p + 16) >> 16, fragments = word(p + 16) & 0xffff;
    if (whole > (uint32_t)r->largest) {
        count(&r->counts.oversized);
        return;
    }
    const uint8_t *data = p + LONG_HEAD;
    uint32_t bytes = (uint32_t)(size - LONG_HEAD);
    int name = 0;
    if (number == 0 && !(name = name_bytes(data, (int)bytes))) {
        count(&r->counts.malformed);
        return;
    }
    const char *channel = (const char *)data;
    data += name;
    bytes -= (uint32_t)name;
    if (number >= fragments || offset > whole || bytes > whole - offset) {
        count(&r->counts.malformed);
        return;
    }
    app_fragmented *f = place(r, from, seq, now_us);
    if (!f) return;
    if (!f->used) begin(f, from, seq, whole, fragments, now_us);
    const bool twice = f->seen[number / 8] >> (number % 8) & 1;
    if (f->size != whole || f->fragments != fragments || twice) {
        if (!twice) count(&r->counts.malformed);
        return;
    }
    f->seen[number / 8] = (uint8_t)(f->seen[number / 8] | 1u << (number % 8));
    f->come++;
    f->bytes += bytes;
    if (name) f->channel = app_receiver_find(r, channel);
    memcpy(f->data + offset, data, bytes);
    if (f->come < f->fragments) return;
    f->used = false;
    if (f->bytes != f->size)
        count(&r->counts.malformed);
    else if (f->channel >= 0)
        app_receiver_dispatch(r, f->channel, f->data, (int)f->size);
}

void app_udpm_packet(app_receiver *r, const struct sockaddr_in *from, const uint8_t *packet, int size, int64_t now_us) {
    const uint32_t magic = size >= SHORT_HEAD ? word(packet) : 0;
    if (magic == MAGIC_SHORT)
        take_short(r, packet, size);
    else if (magic == MAGIC_LONG)
        take_fragment(r, from, packet, size, now_us);
    else
        count(&r->counts.malformed);
}

/* ---------------------------------------------------------------------------------------------- whose packets */

static void look_up_addresses(app_receiver *r, int64_t now_us) {
    struct ifaddrs *list = NULL;
    r->looked_us = now_us;
    if (getifaddrs(&list) != 0) return;
    r->local_count = 0;
    for (const struct ifaddrs *a = list; a && r->local_count < APP_ADDRESSES; a = a->ifa_next)
        if (a->ifa_addr && a->ifa_addr->sa_family == AF_INET) {
            struct sockaddr_in in;
            memcpy(&in, a->ifa_addr, sizeof in);
            r->local[r->local_count++] = in.sin_addr.s_addr;
        }
    freeifaddrs(list);
}

static bool listed(const app_receiver *r, uint32_t address) {
    for (int i = 0; i < r->local_count; i++)
        if (r->local[i] == address) return true;
    return false;
}

/* Returns whether a packet comes from this machine. The kernel drops external packets with an address of this machine,
 * of loopback or none ("martians"), so the sender's address suffices. On loopback alone it is 0.0.0.0. Addresses may
 * change: an unknown one causes a new lookup, at most once a second. */
static bool from_here(app_receiver *r, const struct sockaddr_in *from, int64_t now_us) {
    const uint32_t address = from->sin_addr.s_addr;
    if (!r->local_only || address == 0 || ntohl(address) >> 24 == 127 || listed(r, address)) return true;
    if (now_us - r->looked_us < LOOK_US) return false;
    look_up_addresses(r, now_us);
    return listed(r, address);
}

/* ---------------------------------------------------------------------------------------------- the socket */

/* Filters packets in the kernel, so that neither the simulation's own surfaces nor a flood on other channels fill the
 * socket's buffer. Accepts short messages of our channels and of valid length, and fragments of messages that are not
 * too long. */
static bool set_filter(const app_receiver *r) {
    enum { HEAD = 11, EACH = 2 * (APP_CHANNEL_NAME / 4 + 3) + 1 };
    struct sock_filter code[HEAD + APP_CHANNELS_MAX * EACH + 1];
    const struct sock_filter head[HEAD] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, UDP_HEAD),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, MAGIC_LONG, 0, 4),
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, UDP_HEAD + 8), /* announced length of a fragmented message */
        BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, (uint32_t)r->largest, 1, 0),
        BPF_STMT(BPF_RET | BPF_K, UINT32_MAX),
        BPF_STMT(BPF_RET | BPF_K, 0),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, MAGIC_SHORT, 1, 0),
        BPF_STMT(BPF_RET | BPF_K, 0),
        BPF_STMT(BPF_LD | BPF_W | BPF_LEN, 0),
        BPF_JUMP(BPF_JMP | BPF_JGT | BPF_K, (uint32_t)(UDP_HEAD + SHORT_HEAD + NAME_MAX_BYTES + r->largest), 0, 1),
        BPF_STMT(BPF_RET | BPF_K, 0),
    };
    int n = HEAD;
    memcpy(code, head, sizeof head);
    for (int c = 0; c < r->channel_count; c++) {
        const uint8_t *name = (const uint8_t *)r->name[c];
        const int bytes = (int)strlen(r->name[c]) + 1;
        const int words = bytes / 4, half = bytes / 2 % 2, byte = bytes % 2, end = n + 2 * (words + half + byte) + 1;
        for (int at = 0; at < bytes;) {
            const int width = bytes - at >= 4 ? 4 : bytes - at >= 2 ? 2 : 1;
            uint32_t value = 0;
            for (int i = 0; i < width; i++) value = value << 8 | name[at + i];
            code[n++] = (struct sock_filter)BPF_STMT((uint16_t)(BPF_LD | BPF_ABS |
                                                                (width == 4   ? BPF_W
                                                                 : width == 2 ? BPF_H
                                                                              : BPF_B)),
                                                     (uint32_t)(UDP_HEAD + SHORT_HEAD + at));
            code[n] = (struct sock_filter)BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, value, 0, (uint8_t)(end - n - 1));
            n++;
            at += width;
        }
        code[n++] = (struct sock_filter)BPF_STMT(BPF_RET | BPF_K, UINT32_MAX);
    }
    code[n++] = (struct sock_filter)BPF_STMT(BPF_RET | BPF_K, 0);
    const struct sock_fprog program = {.len = (unsigned short)n, .filter = code};
    return setsockopt(r->fd, SOL_SOCKET, SO_ATTACH_FILTER, &program, sizeof program) == 0;
}

static bool open_socket(app_receiver *r, const app_udpm_url *url) {
    const int one = 1, zero = 0, size = url->recv_buf_size ? url->recv_buf_size : BUFFER_BYTES;
    const struct ip_mreq group = {.imr_multiaddr.s_addr = url->group, .imr_interface.s_addr = htonl(INADDR_ANY)};
    const struct sockaddr_in here = {
        .sin_family = AF_INET, .sin_port = htons(url->port), .sin_addr.s_addr = url->group};
    r->fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (r->fd < 0 || !set_filter(r)) return false;
    setsockopt(r->fd, SOL_SOCKET, SO_RCVBUF, &size, sizeof size); /* the kernel may limit it */
    setsockopt(r->fd, IPPROTO_IP, IP_MULTICAST_ALL, &zero, sizeof zero);
    return setsockopt(r->fd, SOL_SOCKET, SO_REUSEADDR, &one, sizeof one) == 0 &&
           setsockopt(r->fd, SOL_SOCKET, SO_REUSEPORT, &one, sizeof one) == 0 &&
           bind(r->fd, (const struct sockaddr *)&here, sizeof here) == 0 &&
           setsockopt(r->fd, IPPROTO_IP, IP_ADD_MEMBERSHIP, &group, sizeof group) == 0;
}

static bool udpm_open(app_receiver *r, const char *url, char *why, int why_size) {
    app_udpm_url parsed;
    if (!app_udpm_parse(url, &parsed)) {
        snprintf(why, (size_t)why_size, "'%s' is not a multicast URL; write udpm://239.255.76.67:7667?ttl=0", url);
        return false;
    }
    r->local_only = parsed.ttl == 0;
    r->store = calloc(APP_FRAGMENTED, (size_t)r->largest);
    if (!r->store) return false;
    for (int i = 0; i < APP_FRAGMENTED; i++) r->fragmented[i].data = r->store + (size_t)i * (size_t)r->largest;
    if (!open_socket(r, &parsed)) {
        snprintf(why, (size_t)why_size,
                 "LCM cannot open '%s' (%s); for a multicast route within this machine type: ip link set lo up; ip "
                 "route add 224.0.0.0/4 dev lo",
                 url, strerror(errno));
        return false;
    }
    look_up_addresses(r, app_monotonic_us());
    return true;
}

static int udpm_receive(app_receiver *r, int64_t wait_us, int most) {
    struct pollfd fd = {.fd = r->fd, .events = POLLIN};
    const struct timespec wait = {wait_us / 1000000, wait_us % 1000000 * 1000};
    if (wait_us > 0 && ppoll(&fd, 1, &wait, NULL) <= 0) return 0;
    int read = 0;
    for (; read < most; read++) {
        struct sockaddr_in from = {0};
        socklen_t length = sizeof from;
        const ssize_t size =
            recvfrom(r->fd, r->packet, sizeof r->packet, MSG_DONTWAIT, (struct sockaddr *)&from, &length);
        if (size < 0) return errno == EAGAIN || errno == EINTR || errno == ECONNREFUSED ? read : read ? read : -1;
        const int64_t now_us = app_monotonic_us();
        if (from_here(r, &from, now_us))
            app_udpm_packet(r, &from, r->packet, (int)size, now_us);
        else
            count(&r->counts.foreign);
    }
    return read;
}

static void udpm_close(app_receiver *r) {
    if (r->fd >= 0) close(r->fd);
    free(r->store);
}

const app_receiver_driver app_receiver_udpm = {"udpm:", udpm_open, udpm_receive, udpm_close};
