/* Messages whichever way they go: over the network, into a log or out of one, or through a queue within this process.
 * One interface, and nothing but generated structs (message.h). What comes is not trusted: it is handed over when it is
 * no longer than its kind allows, carries the key's tag, and is whole; whom to believe is the listener's affair. */
#ifndef TM_LINK_H
#define TM_LINK_H

#include <stdatomic.h>

#include "message.h"
#include "auth.h"

#define APP_LINK_URL "udpm://239.255.76.67:7667?ttl=0"

typedef struct app_link app_link;

/* What a listener makes of a message. */
typedef enum app_verdict {
    APP_TAKEN, /* it is copied into the link's log, if there is one */
    APP_LEFT,  /* it is not for us */
    APP_FORGED /* with a key: heard before, or made for somebody else; counted */
} app_verdict;

typedef struct app_topic {
    app_message_kind kind;
    int instrument; /* 0 where the kind has one channel */
    /* `message` is valid during the call. utime, us, when it came: since 1970; of a log, as it says; of a queue, on its
     * clock. */
    app_verdict (*take)(void *user, int instrument, int64_t utime, const void *message);
    void *user;
} app_topic;

enum { APP_TOPICS_MAX = 12 };

typedef struct app_link_def {
    const app_topic *topic; /* copied */
    int topics;
    const app_key *key; /* copied; null, or not known: nothing is sealed, nothing is asked for */
    app_link *copy;     /* a log that gets what is sent and what is taken; not closed with this link; null: none */
    /* Instead of decoding: bytes as they came, to be given to app_link_give later, from any one thread. Null: decode.
     */
    void (*keep)(void *user, const char *channel, int64_t utime, const void *bytes, int size);
    void *user;
} app_link_def;

typedef struct app_link_counts {
    _Atomic int64_t taken;
    _Atomic int64_t malformed; /* not whole messages of their kind */
    _Atomic int64_t forged;    /* without the key's tag, or APP_FORGED */
} app_link_counts;

/* Of a network: what never became a message. */
typedef struct app_packet_counts {
    int64_t malformed; /* not LCM's wire format */
    int64_t oversized; /* longer than their kind allows */
    int64_t foreign;   /* of another machine, though the URL has ttl=0 */
} app_packet_counts;

/* Is there anyone to hear it, or a log to write it to? A network always may. */
bool app_link_wanted(const app_link *link, app_message_kind kind, int instrument);
/* False: it could not be sent, or written. Not from several threads at once. */
bool app_link_publish(app_link *link, app_message_kind kind, int instrument, int64_t utime, const void *message);
/* Waits at most `wait_us` for something to come, then hands over what is there, at most `most`. How many; -1: the
 * connection is lost. A log and a queue never wait; 0: nothing (more) there. */
int app_link_receive(app_link *link, int64_t wait_us, int most);
/* The listeners' clock: monotonic; of a log, the last event's; of a queue, its own. */
int64_t app_link_now_us(const app_link *link);
void app_link_give(app_link *link, const char *channel, int64_t utime, const void *bytes, int size);
app_link_counts *app_link_counted(app_link *link);
app_packet_counts app_link_packets(const app_link *link);
/* False: not all of it reached the log. Null: nothing, true. */
bool app_link_close(app_link *link);

/* --- the network: the module `lcm`, the one place that links LCM --- */

/* The module's one symbol. Null, with `why` and what to do, when the URL cannot be opened. */
typedef app_link *app_network_opener(const char *url, const app_link_def *def, char *why, int why_size);
#define APP_NETWORK_MODULE "lcm"
#define APP_NETWORK_SYMBOL "app_network_open"

/* --- logs, as lcm-logger writes them --- */

/* Null: it cannot be written. */
app_link *app_link_write_log(const char *path, const app_link_def *def);
/* Null: it cannot be read. Events that are none are passed over. */
app_link *app_link_read_log(const char *path, const app_link_def *def);
/* When the next event was logged; INT64_MAX: there is none. */
int64_t app_link_next_utime(app_link *log);
bool app_link_rewind(app_link *log);
/* Not all of it was events, so far. */
bool app_link_damaged(const app_link *log);

/* --- a queue within this process, for a clock that stands still between calls --- */

typedef struct app_queue app_queue;

/* What befalls messages on their way to a link. What is sent to it at one instant goes together: it is late by the
 * same, and is lost as one. Nothing overtakes. */
typedef struct app_impairments {
    double latency_s, jitter_s, loss; /* jitter: up to this more, evenly; loss: share */
    uint64_t *random;                 /* state of the generator (splitmix64); several links may share it */
} app_impairments;

app_queue *app_queue_create(int64_t now_us);
void app_queue_set_clock(app_queue *queue, int64_t now_us);
/* Hears every other link of the queue, by its topics. `impairments` null: at once, and all. */
app_link *app_link_join(app_queue *queue, const app_link_def *def, const app_impairments *impairments);
/* After its links. Null: nothing. */
void app_queue_destroy(app_queue *queue);

#endif
