/* Converts generated structs to authenticated bytes and back, for all drivers. */
#include <stdlib.h>
#include <string.h>

#include "link_internal.h"

app_link *app_link_new(size_t bytes, const app_link_driver *driver, const app_link_def *def) {
    if (def->topics > APP_TOPICS_MAX) return NULL;
    app_link *link = calloc(1, bytes);
    if (!link) return NULL;
    link->driver = driver;
    link->def = *def;
    if (def->topics) memcpy(link->topic, def->topic, sizeof *def->topic * (size_t)def->topics);
    link->def.topic = link->topic;
    if (def->key) link->key = *def->key;
    link->def.key = &link->key;
    return link;
}

void app_link_free(app_link *link) {
    free(link->buffer);
    free(link);
}

/* --- sending --- */

static bool reserve(app_link *link, int bytes) {
    if (bytes <= link->capacity) return true;
    uint8_t *larger = realloc(link->buffer, 2 * (size_t)bytes);
    if (!larger) return false;
    link->buffer = larger;
    link->capacity = 2 * bytes;
    return true;
}

bool app_link_wanted(const app_link *link, app_message_kind kind, int instrument) {
    char channel[APP_CHANNEL_CAPACITY];
    app_channel_name(kind, instrument, channel);
    return link->def.copy || !link->driver->wanted || link->driver->wanted(link, channel);
}

bool app_link_publish(app_link *link, app_message_kind kind, int instrument, int64_t utime, const void *message) {
    char channel[APP_CHANNEL_CAPACITY];
    if (!app_link_wanted(link, kind, instrument)) return true;
    const int bytes = app_message_size(kind, message);
    if (bytes <= 0 || !reserve(link, bytes)) return false;
    if (app_message_encode(kind, link->buffer, bytes, message) != bytes) return false;
    app_channel_name(kind, instrument, channel);
    if (app_message_has_tag(kind)) app_auth_tag(&link->key, channel, link->buffer, bytes);
    app_link *copy = link->def.copy;
    const bool copied = !copy || copy->driver->send(copy, channel, utime, link->buffer, bytes);
    return link->driver->send(link, channel, utime, link->buffer, bytes) && copied;
}

/* --- receiving --- */

static const app_topic *topic_of(const app_link *link, app_message_kind kind, int instrument) {
    for (int t = 0; t < link->def.topics; t++)
        if (link->topic[t].kind == kind && link->topic[t].instrument == instrument) return &link->topic[t];
    return NULL;
}

bool app_link_hears(const app_link *link, const char *channel) {
    app_message_kind kind;
    int instrument;
    return app_channel_find(channel, &kind, &instrument) && topic_of(link, kind, instrument);
}

static void count(_Atomic int64_t *counter) { atomic_fetch_add(counter, 1); }

void app_link_give(app_link *link, const char *channel, int64_t utime, const void *bytes, int size) {
    app_message message;
    app_message_kind kind;
    int instrument;
    if (!app_channel_find(channel, &kind, &instrument)) return;
    const app_topic *topic = topic_of(link, kind, instrument);
    if (!topic) return;
    if (app_message_has_tag(kind) && !app_auth_check(&link->key, channel, bytes, size)) {
        count(&link->counts.forged);
        return;
    }
    if (!app_message_decode(kind, bytes, size, &message)) {
        count(&link->counts.malformed);
        return;
    }
    const app_verdict verdict = topic->take(topic->user, instrument, utime, &message);
    app_message_cleanup(kind, &message);
    if (verdict == APP_FORGED) count(&link->counts.forged);
    if (verdict != APP_TAKEN) return;
    count(&link->counts.taken);
    if (link->def.copy) link->def.copy->driver->send(link->def.copy, channel, utime, bytes, size);
}

void app_link_came(app_link *link, const char *channel, int64_t utime, const void *bytes, int size) {
    if (link->def.keep)
        link->def.keep(link->def.user, channel, utime, bytes, size);
    else
        app_link_give(link, channel, utime, bytes, size);
}

/* --- calls of the driver --- */

int app_link_receive(app_link *link, int64_t wait_us, int most) { return link->driver->receive(link, wait_us, most); }

int64_t app_link_now_us(const app_link *link) { return link->driver->now_us(link); }

app_link_counts *app_link_counted(app_link *link) { return &link->counts; }

app_packet_counts app_link_packets(const app_link *link) {
    return link->driver->packets ? link->driver->packets(link) : (app_packet_counts){0};
}

bool app_link_close(app_link *link) { return !link || link->driver->close(link); }
