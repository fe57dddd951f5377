/* Opens a receiver: selects its driver and channels. */
#include "receiver.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "receiver_internal.h"

static const app_receiver_driver *const drivers[] = {&app_receiver_udpm, &app_receiver_lcm};

app_receiver *app_receiver_open(const char *url, const app_channel *channels, int count, char *why, int why_size) {
    app_receiver *r = calloc(1, sizeof *r);
    snprintf(why, (size_t)why_size, "no memory to receive messages; close other programs");
    if (!r || count > APP_CHANNELS_MAX) {
        free(r);
        return NULL;
    }
    r->fd = -1;
    r->channel_count = count;
    for (int c = 0; c < count; c++) {
        r->channel[c] = channels[c];
        snprintf(r->name[c], sizeof r->name[c], "%s", channels[c].name);
        r->channel[c].name = r->name[c];
        if (channels[c].max_bytes > r->largest) r->largest = channels[c].max_bytes;
    }
    for (size_t d = 0; d < sizeof drivers / sizeof *drivers && !r->driver; d++)
        if (!drivers[d]->scheme || strncmp(url, drivers[d]->scheme, strlen(drivers[d]->scheme)) == 0)
            r->driver = drivers[d];
    if (r->driver->open(r, url, why, why_size)) return r;
    app_receiver_close(r);
    return NULL;
}

int app_receiver_receive(app_receiver *r, int64_t wait_us, int most) { return r->driver->receive(r, wait_us, most); }

void app_receiver_close(app_receiver *r) {
    if (!r) return;
    r->driver->close(r);
    free(r);
}

const app_receiver_counts *app_receiver_counted(const app_receiver *r) { return &r->counts; }
