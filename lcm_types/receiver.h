/* Receives LCM messages from an untrusted network. For `udpm:` URLs we parse LCM's wire format ourselves, within bounds
 * that liblcm lacks. Nothing longer than its channel allows is stored or allocated for, whatever a packet announces.
 * All memory is allocated at opening. liblcm handles other URLs (memq:, tcpq:, file:).
 *
 * With ttl=0 only packets of this machine are accepted: liblcm then sends none further, but would receive those of
 * others. liblcm does all sending. */
#ifndef TM_RECEIVER_H
#define TM_RECEIVER_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

enum { APP_CHANNELS_MAX = 12, APP_CHANNEL_NAME = 32 };

typedef struct app_channel {
    const char *name; /* exact name, shorter than APP_CHANNEL_NAME; copied */
    int max_bytes;    /* maximum size of a message; longer ones are dropped */
    /* `data` is valid during the call. utime: time of reception, us since 1970. */
    void (*take)(void *user, const char *channel, int64_t utime, const void *data, int size);
    void *user;
} app_channel;

/* Counts of packets, except `messages`. Packets that the kernel's filter drops (other channels, too long) are not
 * counted. */
typedef struct app_receiver_counts {
    _Atomic int64_t messages;  /* messages delivered */
    _Atomic int64_t malformed; /* not LCM's wire format, or a fragment of no known message */
    _Atomic int64_t oversized; /* longer than their channel allows */
    _Atomic int64_t foreign;   /* from another machine, although the URL has ttl=0 */
    _Atomic int64_t abandoned; /* incomplete messages given up */
} app_receiver_counts;

typedef struct app_receiver app_receiver;

typedef struct app_receiver_driver {
    const char *scheme; /* null: any other scheme */
    bool (*open)(app_receiver *receiver, const char *url, char *why, int why_size);
    /* Waits at most `wait_us` for the first packet, then delivers waiting packets, at most `most`. Returns how many it
     * read; -1 if the connection is lost. */
    int (*receive)(app_receiver *receiver, int64_t wait_us, int most);
    void (*close)(app_receiver *receiver);
} app_receiver_driver;

/* Opens a receiver. Returns null, with reason and remedy in `why`, if it cannot be opened. */
app_receiver *app_receiver_open(const char *url, const app_channel *channels, int count, char *why, int why_size);
int app_receiver_receive(app_receiver *receiver, int64_t wait_us, int most);
void app_receiver_close(app_receiver *receiver); /* null: no effect */
const app_receiver_counts *app_receiver_counted(const app_receiver *receiver);

/* A parsed URL udpm://[GROUP[:PORT]][?ttl=N&recv_buf_size=BYTES]. */
typedef struct app_udpm_url {
    uint32_t group; /* network order */
    uint16_t port;
    int ttl, recv_buf_size; /* 0: the kernel's default */
} app_udpm_url;
bool app_udpm_parse(const char *url, app_udpm_url *parsed);
/* Returns whether messages at this URL may leave this machine or come from another. */
bool app_url_leaves(const char *url);

#endif
