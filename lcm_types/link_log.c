/* Reads and writes logs in the format of lcm-logger: magic number, event number, time, lengths of channel and data, and
 * both (liblcm's eventlog.c). */
#include <stdio.h>
#include <string.h>

#include "event_log.h"
#include "link_internal.h"

typedef struct log_link {
    app_link link;
    FILE *out;
    int64_t number;
    app_log *in;
    const app_log_event *next; /* read but not yet delivered */
    int64_t last_us;
} log_link;

static uint8_t *put(uint8_t *at, uint64_t value, int bytes) {
    for (int i = 0; i < bytes; i++) at[i] = (uint8_t)(value >> 8 * (bytes - 1 - i));
    return at + bytes;
}

static bool log_send(app_link *link, const char *channel, int64_t utime, const void *bytes, int size) {
    log_link *l = (log_link *)link;
    const size_t length = strlen(channel);
    uint8_t head[28], *at = put(head, 0xeda1da01u, 4);
    if (!l->out) return false;
    at = put(at, (uint64_t)l->number++, 8);
    at = put(at, (uint64_t)utime, 8);
    at = put(at, length, 4);
    put(at, (uint64_t)size, 4);
    l->last_us = utime;
    return fwrite(head, sizeof head, 1, l->out) == 1 && fwrite(channel, 1, length, l->out) == length &&
           fwrite(bytes, 1, (size_t)size, l->out) == (size_t)size;
}

int64_t app_link_next_utime(app_link *log) {
    log_link *l = (log_link *)log;
    if (!l->next && l->in) l->next = app_log_next(l->in);
    return l->next ? l->next->timestamp : INT64_MAX;
}

static int log_receive(app_link *link, int64_t wait_us, int most) {
    (void)wait_us;
    log_link *l = (log_link *)link;
    int count = 0;
    for (; count < most && app_link_next_utime(link) < INT64_MAX; count++) {
        const app_log_event *e = l->next;
        l->next = NULL;
        l->last_us = e->timestamp;
        app_link_came(link, e->channel, e->timestamp, e->data, e->size);
    }
    return count;
}

static int64_t log_now_us(const app_link *link) { return ((const log_link *)link)->last_us; }

static bool log_close(app_link *link) {
    log_link *l = (log_link *)link;
    bool good = true;
    if (l->out) good = !ferror(l->out);
    if (l->out) good = fclose(l->out) == 0 && good;
    app_log_close(l->in);
    app_link_free(link);
    return good;
}

static const app_link_driver driver = {log_send, log_receive, log_now_us, NULL, NULL, log_close};

static log_link *opened(log_link *l, bool good) {
    if (good) return l;
    if (l) app_link_free(&l->link);
    return NULL;
}

app_link *app_link_write_log(const char *path, const app_link_def *def) {
    log_link *l = (log_link *)app_link_new(sizeof *l, &driver, def);
    l = opened(l, l && (l->out = fopen(path, "wb")));
    return l ? &l->link : NULL;
}

app_link *app_link_read_log(const char *path, const app_link_def *def) {
    log_link *l = (log_link *)app_link_new(sizeof *l, &driver, def);
    l = opened(l, l && (l->in = app_log_open(path)));
    return l ? &l->link : NULL;
}

bool app_link_rewind(app_link *log) {
    log_link *l = (log_link *)log;
    l->next = NULL;
    return app_log_rewind(l->in);
}

bool app_link_damaged(const app_link *log) { return app_log_damaged(((const log_link *)log)->in); }
