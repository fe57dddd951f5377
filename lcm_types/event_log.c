/* Reads LCM logs that may be damaged, in bounded memory. */
#include "event_log.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { HEAD = 24, FIRST_BYTES = 1 << 16 };

static const uint8_t magic[4] = {0xed, 0xa1, 0xda, 0x01};

struct app_log {
    FILE *file;
    app_log_event event;
    uint8_t *data;
    size_t capacity;
    bool damaged;
};

app_log *app_log_open(const char *path) {
    app_log *log = calloc(1, sizeof *log);
    if (log) log->file = fopen(path, "rb");
    if (log && log->file) return log;
    free(log);
    return NULL;
}

void app_log_close(app_log *log) {
    if (!log) return;
    fclose(log->file);
    free(log->data);
    free(log);
}

bool app_log_damaged(const app_log *log) { return log->damaged; }

bool app_log_rewind(app_log *log) {
    log->damaged = false;
    return fseek(log->file, 0, SEEK_SET) == 0;
}

static int64_t big(const uint8_t *p, int bytes) {
    uint64_t x = 0;
    for (int i = 0; i < bytes; i++) x = x << 8 | p[i];
    return bytes == 4 ? (int32_t)(uint32_t)x : (int64_t)x;
}

/* Skips to just behind the next magic number. Returns false if there is none. */
static bool find_magic(app_log *log) {
    uint8_t last[4];
    size_t have = fread(last, 1, 4, log->file);
    if (have < 4) {
        log->damaged = log->damaged || have > 0;
        return false;
    }
    while (memcmp(last, magic, 4) != 0) {
        const int c = getc(log->file);
        log->damaged = true;
        if (c == EOF) return false;
        memmove(last, last + 1, 3);
        last[3] = (uint8_t)c;
    }
    return true;
}

/* Reads `size` bytes into log->data, which grows with the bytes actually read. */
static bool read_data(app_log *log, size_t size) {
    for (size_t have = 0; have < size || !log->data;) {
        if (have == log->capacity) {
            const size_t room = log->capacity ? 2 * log->capacity : FIRST_BYTES;
            uint8_t *larger = realloc(log->data, room);
            if (!larger) return false;
            log->data = larger;
            log->capacity = room;
        }
        const size_t wanted = (size < log->capacity ? size : log->capacity) - have;
        const size_t got = fread(log->data + have, 1, wanted, log->file);
        if (got < wanted) return false;
        have += got;
    }
    return true;
}

const app_log_event *app_log_next(app_log *log) {
    app_log_event *e = &log->event;
    while (find_magic(log)) {
        uint8_t head[HEAD];
        const bool whole = fread(head, 1, HEAD, log->file) == HEAD;
        const int64_t channel = big(head + 16, 4), size = big(head + 20, 4);
        if (whole && (channel < 1 || channel >= APP_LOG_CHANNEL || size < 0 || size > APP_LOG_EVENT_MAX)) {
            log->damaged = true;
            continue;
        }
        if (!whole || fread(e->channel, 1, (size_t)channel, log->file) != (size_t)channel ||
            !read_data(log, (size_t)size)) {
            log->damaged = true;
            return NULL;
        }
        e->channel[channel] = 0;
        e->timestamp = big(head + 8, 8);
        e->data = log->data;
        e->size = (int)size;
        return e;
    }
    return NULL;
}
