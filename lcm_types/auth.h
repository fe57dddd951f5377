/* A key shared by simulation and controller, and what it does to a message: its last field, `tag`, is the
 * authentication code of everything before it and of the channel's name. SipHash-2-4 (Aumasson and Bernstein, 2012): 64
 * bits from a key of 128, a few dozen lines without tables or memory, so that a microcontroller can do it too. */
#ifndef TM_AUTH_H
#define TM_AUTH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct app_key {
    bool known; /* false: nothing is sealed, nothing is asked for */
    uint8_t byte[16];
} app_key;

/* From a file of 32 hexadecimal digits that nobody but its owner may touch. False, with `why` and what to do. */
bool app_key_read(const char *path, app_key *key, char *why, int why_size);
/* The key for messages at `url`: read from `path` when that is given; else none, and false when messages leave this
 * machine and `no_key` does not say that they may without. */
bool app_key_for(const char *url, const char *path, bool no_key, app_key *key, char *why, int why_size);

/* In two parts, one after the other; either may be empty. */
uint64_t app_siphash(const uint8_t key[16], const void *first, size_t first_size, const void *second,
                     size_t second_size);

/* Writes the tag into the last 8 bytes of an encoded message; without a key leaves them. */
void app_auth_tag(const app_key *key, const char *channel, void *message, int size);
/* Without a key always true. */
bool app_auth_check(const app_key *key, const char *channel, const void *message, int size);

/* What was heard on a channel, so that a sealed message counts once: seq of each of the last sessions. */
enum { APP_SESSIONS = 64 };
typedef struct app_replay {
    struct {
        int64_t session;
        uint32_t seq;
        uint64_t used; /* 0: never */
    } heard[APP_SESSIONS];
    uint64_t clock;
} app_replay;
/* True once for each seq of a session, in rising order (modulo 2^32). */
bool app_replay_fresh(app_replay *replay, int64_t session, uint32_t seq);

#endif
