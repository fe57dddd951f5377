/* Messages over any path: the network, a log, or a queue within this process. One interface to the generated structs
 * (message.h). Received data are not trusted. A message is delivered only if it is complete, within its kind's size
 * limit, and carries the key's tag. The listener decides which sender to accept. */
#ifndef TM_LINK_H
#define TM_LINK_H

#include <stdatomic.h>

#include "message.h"
#include "auth.h"

#define APP_LINK_URL "udpm://239.255.76.67:7667?ttl=0"

typedef struct app_link app_link;

/* Result of a listener. */
typedef enum app_verdict {
    APP_TAKEN, /* accepted; copied into the link's log, if there is one */
    APP_LEFT,  /* not for this listener */
    APP_FORGED /* with a key: replayed, or for another receiver; counted */
} app_verdict;

typedef struct app_topic {
    app_message_kind kind;
    int instrument; /* 0 if the kind has one channel */
    /* `message` is valid during the call. utime, us, is the time of reception: since 1970; of a log, its own; of a
     * queue, on its clock. */
    app_verdict (*take)(void *user, int instrument, int64_t utime, const void *message);
    void *user;
} app_topic;

enum { APP_TOPICS_MAX = 12 };

typedef struct app_link_def {
    const app_topic *topic; /* copied */
    int topics;
    const app_key *key; /* copied; null or unknown: messages are neither tagged nor checked */
    app_link *copy;     /* log that gets the sent and the accepted messages; not closed with this link; null: none */
    /* Stores received bytes instead of decoding them; pass them to app_link_give later, from any single thread. Null:
     * decode. */
    void (*keep)(void *user, const char *channel, int64_t utime, const void *bytes, int size);
    void *user;
} app_link_def;

typedef struct app_link_counts {
    _Atomic int64_t taken;
    _Atomic int64_t malformed; /* not a complete message of its kind */
    _Atomic int64_t forged;    /* without the key's tag, or APP_FORGED */
} app_link_counts;

/* Packets of a network that yielded no message. */
typedef struct app_packet_counts {
    int64_t malformed; /* not LCM's wire format */
    int64_t oversized; /* longer than their kind allows */
    int64_t foreign;   /* from another machine, although the URL has ttl=0 */
} app_packet_counts;

/* Returns whether a message of this kind has a receiver or a log; always true for a network. */
bool app_link_wanted(const app_link *link, app_message_kind kind, int instrument);
/* Sends a message. Returns false if it could not be sent or written. Call it from one thread at a time. */
bool app_link_publish(app_link *link, app_message_kind kind, int instrument, int64_t utime, const void *message);
/* Waits at most `wait_us`, then delivers waiting messages, at most `most`. Returns how many; -1 if the connection is
 * lost. A log and a queue never wait; 0: nothing left. */
int app_link_receive(app_link *link, int64_t wait_us, int most);
/* Returns the time on the listeners' clock: monotonic; of a log, the last event's; of a queue, its own. */
int64_t app_link_now_us(const app_link *link);
void app_link_give(app_link *link, const char *channel, int64_t utime, const void *bytes, int size);
app_link_counts *app_link_counted(app_link *link);
app_packet_counts app_link_packets(const app_link *link);
/* Closes a link. Returns false if a log is incomplete. Null: no effect, true. */
bool app_link_close(app_link *link);

/* --- network: the module `lcm`, the only one that links LCM --- */

/* Type of the module's only symbol. Returns null, with reason and remedy in `why`, if the URL cannot be opened. */
typedef app_link *app_network_opener(const char *url, const app_link_def *def, char *why, int why_size);
#define APP_NETWORK_MODULE "lcm"
#define APP_NETWORK_SYMBOL "app_network_open"

/* --- logs in the format of lcm-logger --- */

/* Creates a log. Returns null if it cannot be written. */
app_link *app_link_write_log(const char *path, const app_link_def *def);
/* Opens a log. Returns null if it cannot be read. Invalid events are skipped. */
app_link *app_link_read_log(const char *path, const app_link_def *def);
/* Returns the time of the next event; INT64_MAX if there is none. */
int64_t app_link_next_utime(app_link *log);
bool app_link_rewind(app_link *log);
/* Returns whether invalid data were found so far. */
bool app_link_damaged(const app_link *log);

/* --- a queue within this process, for simulated time --- */

typedef struct app_queue app_queue;

/* Network impairments on the way to a link. Messages sent at the same instant share delay and loss. Order is preserved.
 */
typedef struct app_impairments {
    double latency_s, jitter_s, loss; /* jitter: additional delay, uniform from 0; loss: probability */
    uint64_t *random;                 /* state of the generator (splitmix64); several links may share it */
} app_impairments;

app_queue *app_queue_create(int64_t now_us);
void app_queue_set_clock(app_queue *queue, int64_t now_us);
/* Adds a link that receives from all other links of the queue, by its topics. `impairments` null: no delay, no loss. */
app_link *app_link_join(app_queue *queue, const app_link_def *def, const app_impairments *impairments);
/* Destroys the queue; close its links before. Null: no effect. */
void app_queue_destroy(app_queue *queue);

#endif
