/* Internal functions of the receiver, shared by its drivers. */
#ifndef TM_RECEIVER_INTERNAL_H
#define TM_RECEIVER_INTERNAL_H

#include <netinet/in.h>

#include "receiver.h"

enum {
    APP_PACKET = 65536,
    APP_FRAGMENTED = 4,        /* messages assembled concurrently; the oldest is dropped for a new one */
    APP_FRAGMENTS = 1 << 16,   /* maximum per message: 16 bits in the header */
    APP_FRAGMENT_US = 1000000, /* maximum age of an incomplete message */
    APP_ADDRESSES = 32
};

/* An incomplete message and its fragments. */
typedef struct app_fragmented {
    bool used;
    struct sockaddr_in from;
    uint32_t seq, size, fragments, come, bytes;
    int64_t since_us;
    int channel; /* -1: first fragment not received yet */
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
    /* other schemes */
    void *lcm;
};

/* Returns the number of a channel, -1 if it has no listener. */
int app_receiver_find(const app_receiver *receiver, const char *name);
void app_receiver_dispatch(app_receiver *receiver, int channel, const void *data, int size);
/* Processes one packet; for the socket and the fuzzer. */
void app_udpm_packet(app_receiver *receiver, const struct sockaddr_in *from, const uint8_t *packet, int size,
                     int64_t now_us);

extern const app_receiver_driver app_receiver_udpm, app_receiver_lcm;

#endif
