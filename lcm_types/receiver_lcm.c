/* Receives through liblcm, for URLs other than udpm. */
#include <lcm/lcm.h>
#include <poll.h>
#include <stdio.h>
#include <time.h>

#include "receiver_internal.h"

static void take(const lcm_recv_buf_t *raw, const char *channel, void *user) {
    app_receiver *r = user;
    const int c = app_receiver_find(r, channel);
    if (c < 0) return;
    if (raw->data_size > (uint32_t)r->channel[c].max_bytes)
        atomic_fetch_add(&r->counts.oversized, 1);
    else
        app_receiver_dispatch(r, c, raw->data, (int)raw->data_size);
}

static bool lcm_driver_open(app_receiver *r, const char *url, char *why, int why_size) {
    r->lcm = lcm_create(url);
    for (int c = 0; r->lcm && c < r->channel_count; c++) {
        lcm_subscription_t *subscription = lcm_subscribe(r->lcm, r->name[c], take, r);
        if (subscription) lcm_subscription_set_queue_capacity(subscription, 100);
    }
    if (!r->lcm)
        snprintf(why, (size_t)why_size, "LCM cannot open '%s'; give a URL such as udpm://239.255.76.67:7667?ttl=0",
                 url);
    return r->lcm != NULL;
}

static int lcm_driver_receive(app_receiver *r, int64_t wait_us, int most) {
    struct pollfd fd = {.fd = lcm_get_fileno(r->lcm), .events = POLLIN};
    struct timespec wait = {wait_us / 1000000, wait_us % 1000000 * 1000};
    int count = 0;
    for (; count < most && ppoll(&fd, 1, &wait, NULL) > 0; count++) {
        if (lcm_handle(r->lcm)) return -1;
        wait = (struct timespec){0, 0};
    }
    return count;
}

static void lcm_driver_close(app_receiver *r) {
    if (r->lcm) lcm_destroy(r->lcm);
}

const app_receiver_driver app_receiver_lcm = {NULL, lcm_driver_open, lcm_driver_receive, lcm_driver_close};
