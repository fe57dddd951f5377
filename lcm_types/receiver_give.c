/* What the drivers share: whose channel a message is, and handing it over. */
#include <string.h>
#include <time.h>

#include "receiver_internal.h"

int app_receiver_find(const app_receiver *r, const char *name) {
    for (int c = 0; c < r->channel_count; c++)
        if (strcmp(r->name[c], name) == 0) return c;
    return -1;
}

void app_receiver_give(app_receiver *r, int channel, const void *data, int size) {
    const app_channel *c = &r->channel[channel];
    struct timespec t;
    if (size > c->max_bytes) {
        atomic_fetch_add(&r->counts.oversized, 1);
        return;
    }
    clock_gettime(CLOCK_REALTIME, &t);
    atomic_fetch_add(&r->counts.messages, 1);
    c->take(c->user, c->name, (int64_t)t.tv_sec * 1000000 + t.tv_nsec / 1000, data, size);
}
