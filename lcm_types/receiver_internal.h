/* Shared by the receiver's drivers. */
#ifndef TM_RECEIVER_INTERNAL_H
#define TM_RECEIVER_INTERNAL_H

#include <netinet/in.h>

#include "receiver.h"

enum {
    APP_PACKET = 65536,
    APP_FRAGMENTED = 4,        /* messages put together at once; one more and the oldest is given up */
    APP_FRAGMENTS = 1 << 16,   /* of a message, by its header's 16 bits */
    APP_FRAGMENT_US = 1000000, /* older ones are given up */
    APP_ADDRESSES = 32
};

/* A message of which fragments have come. */
typedef struct app_fragmented {
    bool used;
    struct sockaddr_in from;
    uint32_t seq, size, fragments, come, bytes;
    int64_t since_us;
    int channel; /* -1: its first fragment has not come */
    uint8_t *data;
    uint8_t seen[APP_FRAGMENTS / 8];
} app_fragmented;

struct app_receiver {
    const app_receiver_driver *driver;
    app_channel channel[APP_CHANNELS_MAX];
    char name[APP_CHANNELS_MAX][APP_CHANNEL_NAME];
    int channel_count, largest;
    app_receiver_counts counts;
    /* udpm */
    int fd;
    bool local_only;
    uint32_t local[APP_ADDRESSES]; /* this machine's addresses, network order */
    int local_count;
    int64_t looked_us;
    uint8_t *store;
    app_fragmented fragmented[APP_FRAGMENTED];
    uint8_t packet[APP_PACKET];
    /* others */
    void *lcm;
};

/* Number of a channel, -1: not ours. */
int app_receiver_find(const app_receiver *receiver, const char *name);
void app_receiver_dispatch(app_receiver *receiver, int channel, const void *data, int size);
/* One packet as it came; for the socket and for the fuzzer. */
void app_udpm_packet(app_receiver *receiver, const struct sockaddr_in *from, const uint8_t *packet, int size,
                     int64_t now_us);

extern const app_receiver_driver app_receiver_udpm, app_receiver_lcm;

#endif
