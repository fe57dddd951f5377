/* Receiving LCM messages from a network that is not trusted. For `udpm:` URLs this is LCM's wire format read by
 * ourselves, within bounds that liblcm has not: nothing longer than its channel allows is kept or allocated for,
 * whatever a packet announces; all memory is taken when it is opened. Other URLs (memq:, tcpq:, file:) are liblcm's.
 *
 * With ttl=0 only packets of this machine are heard: liblcm sends none further then, but would hear others' all the
 * same. Sending is liblcm's, always. */
#ifndef TM_RECEIVER_H
#define TM_RECEIVER_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

enum { APP_CHANNELS_MAX = 12, APP_CHANNEL_NAME = 32 };

typedef struct app_channel {
    const char *name; /* exactly; shorter than APP_CHANNEL_NAME; copied */
    int max_bytes;    /* of a message; longer ones are dropped */
    /* `data` is valid during the call. utime: us since 1970, when it came. */
    void (*take)(void *user, const char *channel, int64_t utime, const void *data, int size);
    void *user;
} app_channel;

/* Of packets, but for `messages`. What a filter in the kernel drops (other channels, too long) is not among them. */
typedef struct app_receiver_counts {
    _Atomic int64_t messages;  /* handed over */
    _Atomic int64_t malformed; /* not LCM's wire format, or a fragment that fits nothing */
    _Atomic int64_t oversized; /* longer than their channel allows */
    _Atomic int64_t foreign;   /* of another machine, though the URL has ttl=0 */
    _Atomic int64_t abandoned; /* messages of which fragments are missing */
} app_receiver_counts;

typedef struct app_receiver app_receiver;

typedef struct app_receiver_driver {
    const char *scheme; /* null: any other */
    bool (*open)(app_receiver *receiver, const char *url, char *why, int why_size);
    /* Waits at most `wait_us` for the first packet, then hands over what is there, at most `most` packets. How many it
     * read; -1: the connection is lost. */
    int (*receive)(app_receiver *receiver, int64_t wait_us, int most);
    void (*close)(app_receiver *receiver);
} app_receiver_driver;

/* Null, with `why` (and what to do), when it cannot be opened. */
app_receiver *app_receiver_open(const char *url, const app_channel *channels, int count, char *why, int why_size);
int app_receiver_receive(app_receiver *receiver, int64_t wait_us, int most);
void app_receiver_close(app_receiver *receiver); /* null: nothing */
const app_receiver_counts *app_receiver_counted(const app_receiver *receiver);

/* udpm://[GROUP[:PORT]][?ttl=N&recv_buf_size=BYTES] */
typedef struct app_udpm_url {
    uint32_t group; /* network order */
    uint16_t port;
    int ttl, recv_buf_size; /* 0: as the kernel likes */
} app_udpm_url;
bool app_udpm_parse(const char *url, app_udpm_url *parsed);
/* May messages sent there leave this machine, or come from elsewhere? */
bool app_url_leaves(const char *url);

#endif
