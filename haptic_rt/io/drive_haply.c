/* Haply Inverse3, by its service: JSON over a WebSocket (libwebsockets). The service answers each message with one
 * state, and says nothing else after its inventory. One message is under way at a time, so that no old force waits in a
 * socket where the service stands still, and the time of sending bounds the age of the state that answers it. */
#include "drive.h"

#ifdef HRT_WITH_HAPLY

#include <libwebsockets.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>

#include "clock.h"
#include "drive_haply_json.h"

enum {
    PORT = 10001,
    CONNECT_EVERY_US = 250000,
    SILENT_US = 10000, /* without an answer: zero force is sent once more, every WAIT_US */
    WAIT_US = 100000,
    GONE_US = 1000000, /* without an answer: the connection is given up */
    UNASKED_MAX = 50,  /* states that nobody asked for */
    WAYS = 16          /* messages under way at most */
};

typedef struct haply {
    hrt_drive *drive;
    FILE *list; /* print the inventory, and end */
    bool listed;
    struct lws_context *context;
    struct lws *wsi;
    bool established, known, first;
    char host[64], why[200];
    int port;
    int32_t number;
    hrt_haply_device device;
    int64_t connect_us, sent_us[WAYS], last_us;
    uint32_t sent, answered, unasked;
    size_t length;
    bool overlong, filters_told;
    char text[HRT_HAPLY_MESSAGE_MAX + 1];
} haply;

static uint32_t under_way(const haply *h) { return h->sent - h->answered; }

static void lose(haply *h, const char *event) {
    h->wsi = NULL;
    h->established = h->known = false;
    h->connect_us = app_monotonic_us() + CONNECT_EVERY_US;
    if (h->drive) hrt_drive_up(h->drive, false, h->drive && atomic_load(&h->drive->up) ? event : NULL);
}

static int take_inventory(haply *h) {
    if (h->list) {
        h->listed = hrt_haply_print(h->text, h->list) >= 0;
        return -1;
    }
    if (!hrt_haply_inventory(h->text, h->number, &h->device, h->why, sizeof h->why)) {
        atomic_store(&h->drive->event, h->why);
        return -1;
    }
    h->known = h->first = true;
    h->filters_told = false;
    h->sent = h->answered = h->unasked = 0;
    return 0;
}

static void tell_filters(haply *h) {
    if (h->filters_told || !h->device.is_3_5 || h->answered > 10) return;
    if (h->device.force_gate == 0.0 && h->device.damping <= 0.0)
        h->filters_told = true;
    else if (h->answered == 10)
        atomic_store(&h->drive->event,
                     "the service's filters change the force: force_gate or damping would not be switched off");
}

static int take_state(haply *h) {
    hrt_drive_state state;
    const char *trouble;
    const bool asked = under_way(h) > 0;
    if (!asked && ++h->unasked > UNASKED_MAX) {
        hrt_drive_fail(h->drive, HRT_DRIVE_FLOODS, NULL);
        return -1;
    }
    if (!asked) return 0; /* of unknown age */
    const int64_t time_us = h->sent_us[h->answered++ % WAYS];
    if (h->unasked > 0) h->unasked--;
    if (!hrt_haply_state(h->text, &h->device, &state, &trouble)) return hrt_drive_refuse(h->drive), 0;
    tell_filters(h);
    state.time_us = time_us;
    if (hrt_drive_post(h->drive, &state)) hrt_drive_up(h->drive, !trouble, trouble);
    return 0;
}

static int receive(haply *h, const char *in, size_t length, bool whole) {
    if (h->length + length > HRT_HAPLY_MESSAGE_MAX)
        h->overlong = true;
    else {
        memcpy(h->text + h->length, in, length);
        h->length += length;
    }
    if (!whole) return 0;
    h->text[h->overlong ? 0 : h->length] = 0;
    h->length = 0;
    h->overlong = false;
    return h->known ? take_state(h) : take_inventory(h);
}

static int send_command(haply *h) {
    unsigned char space[LWS_PRE + HRT_HAPLY_COMMAND_MAX];
    float force_N[3];
    const int64_t now_us = app_monotonic_us();
    if (!h->known || under_way(h) >= WAYS) return 0;
    hrt_drive_force(h->drive, now_us, force_N);
    if (under_way(h) > 0 || atomic_load(&h->drive->stop)) memset(force_N, 0, sizeof force_N);
    const int length = hrt_haply_command((char *)space + LWS_PRE, &h->device, force_N, h->first);
    h->first = false;
    h->sent_us[h->sent++ % WAYS] = h->last_us = now_us;
    return lws_write(h->wsi, space + LWS_PRE, (size_t)length, LWS_WRITE_TEXT) < length ? -1 : 0;
}

static int called(struct lws *wsi, enum lws_callback_reasons reason, void *user, void *in, size_t length) {
    haply *h = lws_context_user(lws_get_context(wsi));
    (void)user;
    switch (reason) {
    case LWS_CALLBACK_CLIENT_ESTABLISHED:
        h->established = true;
        h->length = 0;
        h->last_us = app_monotonic_us();
        return 0;
    case LWS_CALLBACK_CLIENT_RECEIVE:
        return receive(h, in, length, lws_is_final_fragment(wsi) && lws_remaining_packet_payload(wsi) == 0);
    case LWS_CALLBACK_CLIENT_WRITEABLE: return send_command(h);
    case LWS_CALLBACK_CLIENT_CONNECTION_ERROR: lose(h, NULL); return 0;
    case LWS_CALLBACK_CLIENT_CLOSED: lose(h, "the service closed the connection"); return 0;
    default: return 0;
    }
}

static const struct lws_protocols protocols[] = {{"haply", called, 0, 4096, 0, NULL, 0},
                                                 {NULL, NULL, 0, 0, 0, NULL, 0}};

static void connect_now(haply *h) {
    struct lws_client_connect_info info;
    memset(&info, 0, sizeof info);
    info.context = h->context;
    info.address = info.host = info.origin = h->host;
    info.port = h->port;
    info.path = "/";
    info.local_protocol_name = "haply";
    info.pwsi = &h->wsi;
    h->connect_us = app_monotonic_us() + CONNECT_EVERY_US;
    h->last_us = app_monotonic_us();
    lws_client_connect_via_info(&info);
}

/* Returns when the next message is due: at the pace of the drive, or while an answer is missing, seldom. */
static int64_t due_us(const haply *h) {
    if (!h->known) return INT64_MAX;
    if (under_way(h) == 0) return h->last_us + h->drive->period_us;
    return h->last_us + (under_way(h) == 1 ? SILENT_US : WAIT_US);
}

static void wait_until(const haply *h, int64_t us) {
    const int64_t now_us = app_monotonic_us(), most = 2000, left = us - now_us;
    const int64_t wait = left < 0 ? 0 : left > most ? most : left;
    const struct timespec t = {0, 1000 * wait};
    struct pollfd fd = {.fd = h->wsi ? (int)lws_get_socket_fd(h->wsi) : -1, .events = POLLIN};
    ppoll(&fd, h->established ? 1 : 0, &t, NULL);
}

static void step(haply *h) {
    const int64_t now_us = app_monotonic_us();
    if (!h->wsi && now_us >= h->connect_us) connect_now(h);
    if (h->wsi && now_us - h->last_us > GONE_US && (under_way(h) > 0 || !h->known))
        lws_set_timeout(h->wsi, PENDING_TIMEOUT_USER_OK, LWS_TO_KILL_ASYNC);
    if (h->wsi && h->established && now_us >= due_us(h)) lws_callback_on_writable(h->wsi);
    lws_service(h->context, -1);
    wait_until(h, due_us(h));
}

static void *run(void *user) {
    haply *h = user;
    while (!atomic_load(&h->drive->stop)) step(h);
    /* The last words are zero force, once the answer under way has come. */
    const int64_t end_us = app_monotonic_us() + 100000;
    const uint32_t said = h->sent;
    while (h->wsi && h->known && h->sent == said && app_monotonic_us() < end_us) step(h);
    lws_service(h->context, -1);
    return NULL;
}

static bool make(haply *h, char *why, int why_size) {
    struct lws_context_creation_info info;
    memset(&info, 0, sizeof info);
    lws_set_log_level(0, NULL);
    info.port = CONTEXT_PORT_NO_LISTEN;
    info.protocols = protocols;
    info.gid = info.uid = (gid_t)-1;
    info.user = h;
    h->context = lws_create_context(&info);
    if (!h->context)
        snprintf(why, (size_t)why_size,
                 "no WebSocket can be opened: out of memory or descriptors; close other programs");
    return h->context != NULL;
}

/* Reads "NUMBER" or "NUMBER@HOST:PORT". */
static bool read_name(const char *name, haply *h, char *why, int why_size) {
    char tail;
    const char *where = strchr(name, '@') ? NULL : getenv("TM_HAPLY");
    if (where && strncmp(where, "ws://", 5) == 0) where += 5;
    strcpy(h->host, "127.0.0.1");
    h->port = PORT;
    if (where && sscanf(where, "%63[^:]:%d%c", h->host, &h->port, &tail) != 2)
        return snprintf(why, (size_t)why_size, "$TM_HAPLY is '%s'; write HOST:PORT", where), false;
    const int got = sscanf(name, "%d@%63[^:]:%d%c", &h->number, h->host, &h->port, &tail);
    const bool plain = got == 1 && strspn(name, "0123456789") == strlen(name);
    if ((plain || got == 3) && h->number >= 0 && h->port > 0 && h->port < 65536) return true;
    snprintf(why, (size_t)why_size, "'haply:%s' is not a device address; write haply:0 or haply:0@127.0.0.1:10001",
             name);
    return false;
}

static void haply_close(hrt_drive *d) {
    haply *h = d->own;
    if (!h) return;
    atomic_store(&d->stop, true);
    pthread_join(d->thread, NULL);
    lws_context_destroy(h->context);
    free(h);
    d->own = NULL;
}

static bool haply_open(hrt_drive *d, const char *name, char *why, int why_size) {
    haply *h = calloc(1, sizeof *h);
    if (!h) return snprintf(why, (size_t)why_size, "out of memory; close other programs"), false;
    h->drive = d;
    if (!read_name(name, h, why, why_size) || !make(h, why, why_size)) return free(h), false;
    d->own = h;
    if (pthread_create(&d->thread, NULL, run, h) == 0) return true;
    snprintf(why, (size_t)why_size, "no thread can be started; close other programs");
    lws_context_destroy(h->context);
    free(h);
    d->own = NULL;
    return false;
}

static void haply_list(FILE *file) {
    char why[200];
    haply *h = calloc(1, sizeof *h);
    if (!h) return;
    h->list = file;
    if (read_name("0", h, why, sizeof why) && make(h, why, sizeof why)) {
        connect_now(h);
        const int64_t end_us = app_monotonic_us() + 700000;
        while (h->wsi && !h->listed && app_monotonic_us() < end_us) {
            lws_service(h->context, -1);
            wait_until(h, INT64_MAX);
        }
        if (!h->listed)
            fprintf(file, "  haply            no service at %s:%d; start the Haply Inverse Service\n", h->host,
                    h->port);
        lws_context_destroy(h->context);
    } else
        fprintf(file, "  haply            %s\n", why);
    free(h);
}

#else /* built without libwebsockets */

static bool haply_open(hrt_drive *d, const char *name, char *why, int why_size) {
    (void)d, (void)name;
    snprintf(why, (size_t)why_size,
             "this haptic-rt was built without libwebsockets; install libwebsockets-dev and build again");
    return false;
}

static void haply_close(hrt_drive *d) { (void)d; }

static void haply_list(FILE *file) {
    fputs("  haply            not built in: libwebsockets-dev was missing when haptic-rt was built\n", file);
}

#endif

const hrt_drive_driver hrt_drive_haply = {.kind = "haply",
                                          .address = "haply:NUMBER[@HOST:PORT]",
                                          .device = "inverse3",
                                          .text = "Haply Inverse3, by its Inverse Service",
                                          .rate_max = 4000,
                                          .open = haply_open,
                                          .close = haply_close,
                                          .list = haply_list};
