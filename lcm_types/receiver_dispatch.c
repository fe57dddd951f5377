/* Finds a message's channel and delivers the message, for all drivers. */
#include <string.h>

#include "libtensormass/platform/clock.h"
#include "receiver_internal.h"

int app_receiver_find(const app_receiver *r, const char *name) {
    for (int c = 0; c < r->channel_count; c++)
        if (strcmp(r->name[c], name) == 0) return c;
    return -1;
}

void app_receiver_dispatch(app_receiver *r, int channel, const void *data, int size) {
    const app_channel *c = &r->channel[channel];
    if (size > c->max_bytes) {
        atomic_fetch_add(&r->counts.oversized, 1);
        return;
    }
    atomic_fetch_add(&r->counts.messages, 1);
    c->take(c->user, c->name, app_clock_us(CLOCK_REALTIME), data, size);
}
