/* The module `lcm`: receives through receiver.h, sends through liblcm. */
#include <lcm/lcm.h>
#include <stdio.h>
#include <time.h>

#include "libtensormass/platform/clock.h"
#include "link_internal.h"
#include "receiver.h"

typedef struct network {
    app_link link;
    lcm_t *lcm; /* for sending */
    app_receiver *receiver;
} network;

static bool network_send(app_link *link, const char *channel, int64_t utime, const void *bytes, int size) {
    (void)utime;
    return lcm_publish(((network *)link)->lcm, channel, bytes, (unsigned)size) == 0;
}

static int network_receive(app_link *link, int64_t wait_us, int most) {
    network *n = (network *)link;
    return n->receiver ? app_receiver_receive(n->receiver, wait_us, most) : 0;
}

static int64_t network_now_us(const app_link *link) {
    (void)link;
    return app_monotonic_us();
}

static app_packet_counts network_packets(const app_link *link) {
    const network *n = (const network *)link;
    if (!n->receiver) return (app_packet_counts){0};
    const app_receiver_counts *c = app_receiver_counted(n->receiver);
    return (app_packet_counts){atomic_load(&c->malformed), atomic_load(&c->oversized), atomic_load(&c->foreign)};
}

static bool network_close(app_link *link) {
    network *n = (network *)link;
    app_receiver_close(n->receiver);
    if (n->lcm) lcm_destroy(n->lcm);
    app_link_free(link);
    return true;
}

static const app_link_driver driver = {network_send, network_receive, network_now_us,
                                       NULL,         network_packets, network_close};

static void came(void *user, const char *channel, int64_t utime, const void *data, int size) {
    app_link_came(user, channel, utime, data, size);
}

static bool listen_to(network *n, const char *url, char *why, int why_size) {
    app_channel channel[APP_TOPICS_MAX];
    char name[APP_TOPICS_MAX][APP_CHANNEL_CAPACITY];
    const int topics = n->link.def.topics;
    if (!topics) return true;
    for (int t = 0; t < topics; t++) {
        const app_topic *topic = &n->link.topic[t];
        _Static_assert((int)APP_CHANNEL_CAPACITY == (int)APP_CHANNEL_NAME &&
                           (int)APP_TOPICS_MAX <= (int)APP_CHANNELS_MAX,
                       "of one size");
        app_channel_name(topic->kind, topic->instrument, name[t]);
        channel[t] = (app_channel){name[t], app_message_max(topic->kind), came, n};
    }
    n->receiver = app_receiver_open(url, channel, topics, why, why_size);
    return n->receiver != NULL;
}

__attribute__((visibility("default"))) app_network_opener app_network_open;

app_link *app_network_open(const char *url, const app_link_def *def, char *why, int why_size) {
    network *n = (network *)app_link_new(sizeof *n, &driver, def);
    snprintf(why, (size_t)why_size, "no memory for messages; close other programs");
    if (!n) return NULL;
    if (listen_to(n, url, why, why_size)) {
        n->lcm = lcm_create(url);
        if (n->lcm) return &n->link;
        snprintf(
            why, (size_t)why_size,
            "LCM cannot open '%s'; for a multicast route within this machine type: ip link set lo up; ip route add 224.0.0.0/4 dev lo",
            url);
    }
    network_close(&n->link);
    return NULL;
}
