/* Message authentication with a key shared by simulation and controller. A message's last field, `tag`, authenticates
 * everything before it and the channel's name. SipHash-2-4 (Aumasson and Bernstein, 2012): 64 bits from a 128-bit key.
 * It needs a few dozen lines and no tables or memory, so a microcontroller can compute it too. */
#ifndef TM_AUTH_H
#define TM_AUTH_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct app_key {
    bool known; /* false: messages are neither tagged nor checked */
    uint8_t byte[16];
} app_key;

/* Reads a key from a file of 32 hexadecimal digits that only its owner may access. Returns false with reason and remedy
 * in `why`. */
bool app_key_read(const char *path, app_key *key, char *why, int why_size);
/* Gets the key for messages at `url`: from `path` if given, else none. Returns false if messages leave this machine
 * without a key and `no_key` is not set. */
bool app_key_for(const char *url, const char *path, bool no_key, app_key *key, char *why, int why_size);

/* Computes SipHash-2-4 of two concatenated parts; either may be empty. */
uint64_t app_siphash(const uint8_t key[16], const void *first, size_t first_size, const void *second,
                     size_t second_size);

/* Writes the tag into the last 8 bytes of an encoded message; without a key leaves them. */
void app_auth_tag(const app_key *key, const char *channel, void *message, int size);
/* Returns whether the tag is correct; without a key always true. */
bool app_auth_check(const app_key *key, const char *channel, const void *message, int size);

/* Replay protection of a channel: the newest seq of each of the last sessions. */
enum { APP_SESSIONS = 64 };
typedef struct app_replay {
    struct {
        int64_t session;
        uint32_t seq;
        uint64_t used; /* time of last use by `clock`; 0: never */
    } heard[APP_SESSIONS];
    uint64_t clock;
} app_replay;
/* Returns true once per seq of a session, in rising order (modulo 2^32). */
bool app_replay_fresh(app_replay *replay, int64_t session, uint32_t seq);

#endif
