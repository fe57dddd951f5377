/* Reads keys, computes and checks authentication tags, detects replays. */
#include "auth.h"

#include <ctype.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "receiver.h"

enum { TAG = 8, DIGITS = 32 };

/* ---------------------------------------------------------------------------------------------- SipHash-2-4 */

typedef struct sip {
    uint64_t v[4], part;
    uint64_t bytes;
} sip;

static uint64_t turn(uint64_t x, int bits) { return x << bits | x >> (64 - bits); }

static void rounds(uint64_t v[4], int count) {
    for (int i = 0; i < count; i++) {
        v[0] += v[1], v[1] = turn(v[1], 13) ^ v[0], v[0] = turn(v[0], 32);
        v[2] += v[3], v[3] = turn(v[3], 16) ^ v[2];
        v[0] += v[3], v[3] = turn(v[3], 21) ^ v[0];
        v[2] += v[1], v[1] = turn(v[1], 17) ^ v[2], v[2] = turn(v[2], 32);
    }
}

static void take_word(sip *s) {
    s->v[3] ^= s->part;
    rounds(s->v, 2);
    s->v[0] ^= s->part;
    s->part = 0;
}

static void take(sip *s, const uint8_t *bytes, size_t size) {
    for (size_t i = 0; i < size; i++) {
        s->part |= (uint64_t)bytes[i] << 8 * (s->bytes % 8);
        if (++s->bytes % 8 == 0) take_word(s);
    }
}

static uint64_t little(const uint8_t *p) {
    uint64_t x = 0;
    for (int i = 7; i >= 0; i--) x = x << 8 | p[i];
    return x;
}

uint64_t app_siphash(const uint8_t key[16], const void *first, size_t first_size, const void *second,
                     size_t second_size) {
    const uint64_t k0 = little(key), k1 = little(key + 8);
    sip s = {
        .v = {k0 ^ 0x736f6d6570736575u, k1 ^ 0x646f72616e646f6du, k0 ^ 0x6c7967656e657261u, k1 ^ 0x7465646279746573u}};
    take(&s, first, first_size);
    take(&s, second, second_size);
    s.part |= s.bytes << 56;
    take_word(&s);
    s.v[2] ^= 0xff;
    rounds(s.v, 4);
    return s.v[0] ^ s.v[1] ^ s.v[2] ^ s.v[3];
}

/* ---------------------------------------------------------------------------------------------- messages */

static uint64_t tag_of(const app_key *key, const char *channel, const void *message, int size) {
    return app_siphash(key->byte, channel, strlen(channel) + 1, message, (size_t)(size - TAG));
}

void app_auth_tag(const app_key *key, const char *channel, void *message, int size) {
    if (!key->known || size < 2 * TAG) return;
    const uint64_t tag = tag_of(key, channel, message, size);
    uint8_t *end = (uint8_t *)message + size - TAG;
    for (int i = 0; i < TAG; i++) end[i] = (uint8_t)(tag >> (56 - 8 * i)); /* big-endian, as LCM encodes an int64_t */
}

bool app_auth_check(const app_key *key, const char *channel, const void *message, int size) {
    if (!key->known) return true;
    if (size < 2 * TAG) return false;
    const uint8_t *end = (const uint8_t *)message + size - TAG;
    uint64_t tag = 0;
    for (int i = 0; i < TAG; i++) tag = tag << 8 | end[i];
    return tag == tag_of(key, channel, message, size); /* one comparison, in constant time */
}

bool app_replay_fresh(app_replay *r, int64_t session, uint32_t seq) {
    int oldest = 0;
    r->clock++;
    for (int i = 0; i < APP_SESSIONS; i++) {
        if (r->heard[i].used && r->heard[i].session == session) {
            if ((int32_t)(seq - r->heard[i].seq) <= 0) return false;
            r->heard[i].seq = seq;
            r->heard[i].used = r->clock;
            return true;
        }
        if (r->heard[i].used < r->heard[oldest].used) oldest = i;
    }
    r->heard[oldest].session = session;
    r->heard[oldest].seq = seq;
    r->heard[oldest].used = r->clock;
    return true;
}

/* ---------------------------------------------------------------------------------------------- the file */

static bool read_digits(int fd, app_key *key) {
    char text[DIGITS + 3];
    ssize_t size = read(fd, text, sizeof text);
    while (size > 0 && isspace((unsigned char)text[size - 1])) size--;
    if (size != DIGITS) return false;
    for (int i = 0; i < DIGITS; i++) {
        const int c = tolower((unsigned char)text[i]);
        if (!isxdigit(c)) return false;
        const int digit = c <= '9' ? c - '0' : c - 'a' + 10;
        key->byte[i / 2] = (uint8_t)(i % 2 ? key->byte[i / 2] | digit : digit << 4);
    }
    return true;
}

bool app_key_read(const char *path, app_key *key, char *why, int why_size) {
    struct stat about;
    *key = (app_key){.known = false};
    const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (fd < 0 || fstat(fd, &about) != 0) {
        snprintf(
            why, (size_t)why_size,
            "%s: cannot be read (%s); make a key: (umask 077; head -c16 /dev/urandom | od -An -tx1 | tr -d ' ' > %s)",
            path, strerror(errno), path);
        if (fd >= 0) close(fd);
        return false;
    }
    /* A file from systemd (LoadCredential=) belongs to root; its group bits may let one more user read it. */
    const mode_t forbidden = about.st_uid == 0 && geteuid() != 0 ? 037 : 077;
    bool good = false;
    if (!S_ISREG(about.st_mode))
        snprintf(why, (size_t)why_size, "%s: is not a regular file; give the file of the key", path);
    else if (about.st_uid != geteuid() && about.st_uid != 0)
        snprintf(why, (size_t)why_size, "%s: belongs to another user; chown it to the user who runs this", path);
    else if (about.st_mode & forbidden)
        snprintf(why, (size_t)why_size, "%s: others may read or write it (mode %o); chmod 600 %s", path,
                 (unsigned)about.st_mode & 0777, path);
    else if (!(good = read_digits(fd, key)))
        snprintf(
            why, (size_t)why_size,
            "%s: does not contain a key of 32 hexadecimal digits; make one with: head -c16 /dev/urandom | od -An -tx1 | tr -d ' '",
            path);
    key->known = good;
    close(fd);
    return good;
}

bool app_key_for(const char *url, const char *path, bool no_key, app_key *key, char *why, int why_size) {
    *key = (app_key){.known = false};
    if (path) return app_key_read(path, key, why, why_size);
    if (no_key || !app_url_leaves(url)) return true;
    snprintf(why, (size_t)why_size,
             "messages to %s leave this machine, and any machine on that network could move the hand; give --key "
             "FILE (docs/trust.md), or --no-key",
             url);
    return false;
}
