/* LCM's wire format in lcm_types/receiver_udpm.c: complete messages arrive, and announced sizes allocate nothing. */
// clang-format off
#include <setjmp.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <malloc.h>
#include <cmocka.h>
// clang-format on

#include "receiver_internal.h"

enum { SMALL = 64, LARGE = 300000 };

static struct got {
    int count, size;
    char channel[32];
    uint8_t data[LARGE];
} got;
static app_receiver *r;
static const struct sockaddr_in alice = {.sin_family = AF_INET, .sin_port = 1, .sin_addr.s_addr = 1},
                                bob = {.sin_family = AF_INET, .sin_port = 2, .sin_addr.s_addr = 2};

static void take(void *user, const char *channel, int64_t utime, const void *data, int size) {
    (void)utime;
    struct got *g = user;
    assert_true(size <= (strcmp(channel, "SMALL") == 0 ? SMALL : LARGE));
    g->count++;
    g->size = size;
    strcpy(g->channel, channel);
    memcpy(g->data, data, (size_t)size);
}

/* Without a socket: only the packets of the driver. */
static int setup(void **state) {
    (void)state;
    memset(&got, 0, sizeof got);
    r = calloc(1, sizeof *r);
    r->fd = -1;
    r->driver = &app_receiver_udpm;
    r->channel_count = 2;
    r->channel[0] = (app_channel){r->name[0], SMALL, take, &got};
    r->channel[1] = (app_channel){r->name[1], LARGE, take, &got};
    strcpy(r->name[0], "SMALL");
    strcpy(r->name[1], "LARGE");
    r->largest = LARGE;
    r->store = calloc(APP_FRAGMENTED, LARGE);
    for (int i = 0; i < APP_FRAGMENTED; i++) r->fragmented[i].data = r->store + (size_t)i * LARGE;
    return 0;
}

static int teardown(void **state) {
    (void)state;
    app_receiver_close(r);
    return 0;
}

static uint8_t *put(uint8_t *p, uint32_t value, int bytes) {
    for (int i = bytes - 1; i >= 0; i--) *p++ = (uint8_t)(value >> 8 * i);
    return p;
}

static void short_message(const char *channel, const void *data, int size) {
    uint8_t packet[1000], *p = put(put(packet, 0x4c433032, 4), 7, 4);
    p = (uint8_t *)stpcpy((char *)p, channel) + 1;
    memcpy(p, data, (size_t)size);
    app_udpm_packet(r, &alice, packet, (int)(p - packet) + size, 0);
}

typedef struct piece {
    const struct sockaddr_in *from;
    uint32_t seq, whole, offset;
    uint16_t number, count;
    const char *channel; /* of the first fragment */
    uint8_t fill;
    int size;
    int64_t at_us;
} piece;

static void fragment(piece f) {
    static uint8_t packet[APP_PACKET];
    uint8_t *p = put(put(put(put(packet, 0x4c433033, 4), f.seq, 4), f.whole, 4), f.offset, 4);
    p = put(put(p, f.number, 2), f.count, 2);
    if (f.channel) p = (uint8_t *)stpcpy((char *)p, f.channel) + 1;
    memset(p, f.fill, (size_t)f.size);
    app_udpm_packet(r, f.from ? f.from : &alice, packet, (int)(p - packet) + f.size, f.at_us);
}

static void short_messages(void **state) {
    (void)state;
    short_message("SMALL", "hello", 5);
    assert_int_equal(got.count, 1);
    assert_memory_equal(got.data, "hello", 5);
    short_message("OTHER", "hello", 5);
    short_message("SMALL2", "hello", 5);
    assert_int_equal(got.count, 1);
    uint8_t much[SMALL + 1] = {0};
    short_message("SMALL", much, SMALL + 1);
    assert_int_equal(got.count, 1);
    assert_int_equal(atomic_load(&r->counts.oversized), 1);
}

static void pieces_in_any_order(void **state) {
    (void)state;
    fragment((piece){.seq = 5, .whole = 150, .offset = 100, .number = 2, .count = 3, .fill = 3, .size = 50});
    fragment((piece){.seq = 5, .whole = 150, .number = 0, .count = 3, .channel = "LARGE", .fill = 1, .size = 40});
    fragment((piece){.seq = 5, .whole = 150, .number = 0, .count = 3, .channel = "LARGE", .fill = 1, .size = 40});
    assert_int_equal(got.count, 0);
    fragment((piece){.from = &bob, .seq = 5, .whole = 10, .number = 0, .count = 1, .channel = "LARGE", .size = 10});
    assert_int_equal(got.count, 1);
    fragment((piece){.seq = 5, .whole = 150, .offset = 40, .number = 1, .count = 3, .fill = 2, .size = 60});
    assert_int_equal(got.count, 2);
    assert_int_equal(got.size, 150);
    for (int i = 0; i < 150; i++) assert_int_equal(got.data[i], i < 40 ? 1 : i < 100 ? 2 : 3);
}

/* 2^28 - 1 bytes announced in a packet of 128, and other false sizes: rejected without allocation. */
static void giants_cost_nothing(void **state) {
    (void)state;
    const size_t before = mallinfo2().uordblks + mallinfo2().hblkhd;
    for (uint32_t i = 0; i < 100000; i++)
        fragment(
            (piece){.seq = i, .whole = (1u << 28) - 1, .number = 0, .count = 4100, .channel = "LARGE", .size = 100});
    assert_int_equal(atomic_load(&r->counts.oversized), 100000);
    fragment((piece){.seq = 1, .whole = UINT32_MAX, .offset = UINT32_MAX - 5, .number = 1, .count = 2, .size = 100});
    assert_int_equal(atomic_load(&r->counts.oversized), 100001);
    /* Small enough, but false. */
    fragment((piece){.seq = 1, .whole = 100, .offset = 90, .number = 1, .count = 2, .size = 11});
    fragment((piece){.seq = 1, .whole = 100, .offset = UINT32_MAX, .number = 1, .count = 2, .size = 11});
    fragment((piece){.seq = 1, .whole = 100, .number = 7, .count = 7, .size = 11});
    fragment((piece){.seq = 1, .whole = 100, .number = 0, .count = 0, .channel = "LARGE", .size = 11});
    assert_int_equal(atomic_load(&r->counts.malformed), 4);
    assert_int_equal(got.count, 0);
    assert_true(mallinfo2().uordblks + mallinfo2().hblkhd == before);
}

/* Messages that are never assembled: a fragment missing, doubled, of a changed size, too old, or overtaken by the
 * next message. */
static void what_is_not_whole_never_arrives(void **state) {
    (void)state;
    fragment((piece){.seq = 1, .whole = 100, .number = 0, .count = 2, .channel = "LARGE", .size = 50});
    fragment(
        (piece){.seq = 1, .whole = 100, .offset = 50, .number = 1, .count = 2, .size = 49}); /* a byte is missing */
    assert_int_equal(got.count, 0);
    fragment((piece){.seq = 2, .whole = 100, .number = 0, .count = 2, .channel = "LARGE", .size = 50});
    fragment((piece){.seq = 2, .whole = 99, .offset = 50, .number = 1, .count = 2, .size = 49});
    assert_int_equal(got.count, 0);
    fragment((piece){.seq = 3, .whole = 100, .number = 0, .count = 2, .channel = "LARGE", .size = 50});
    fragment((piece){.seq = 3, .whole = 100, .offset = 50, .number = 1, .count = 2, .size = 50, .at_us = 2000000});
    assert_int_equal(got.count, 0);
    fragment(
        (piece){.seq = 4, .whole = 100, .number = 0, .count = 2, .channel = "LARGE", .size = 50, .at_us = 2000000});
    fragment(
        (piece){.seq = 5, .whole = 100, .number = 0, .count = 2, .channel = "LARGE", .size = 50, .at_us = 2000000});
    fragment((piece){.seq = 4, .whole = 100, .offset = 50, .number = 1, .count = 2, .size = 50, .at_us = 2000000});
    assert_int_equal(got.count, 0);
    fragment((piece){.seq = 5, .whole = 100, .offset = 50, .number = 1, .count = 2, .size = 50, .at_us = 2000000});
    assert_int_equal(got.count, 1);
}

/* More simultaneous senders than capacity: the oldest message is dropped, the newest arrives. */
static void many_senders(void **state) {
    (void)state;
    for (uint32_t i = 0; i < 1000; i++) {
        const struct sockaddr_in from = {.sin_family = AF_INET, .sin_port = (uint16_t)i, .sin_addr.s_addr = i};
        fragment(
            (piece){.from = &from, .whole = LARGE, .number = 0, .count = 9, .channel = "LARGE", .size = 9, .at_us = i});
    }
    fragment((piece){
        .from = &bob, .seq = 1, .whole = 2, .number = 0, .count = 2, .channel = "SMALL", .size = 1, .at_us = 1001});
    fragment(
        (piece){.from = &bob, .seq = 1, .whole = 2, .offset = 1, .number = 1, .count = 2, .size = 1, .at_us = 1002});
    assert_int_equal(got.count, 1);
    assert_string_equal(got.channel, "SMALL");
}

static void urls(void **state) {
    (void)state;
    app_udpm_url u;
    assert_true(app_udpm_parse("udpm://239.1.2.3:1234?ttl=1&recv_buf_size=5000", &u));
    assert_int_equal(u.port, 1234);
    assert_int_equal(u.ttl, 1);
    assert_int_equal(u.recv_buf_size, 5000);
    assert_true(app_udpm_parse("udpm://", &u) && u.port == 7667 && u.ttl == 0);
    assert_true(app_udpm_parse("udpm://239.255.76.67:7667?ttl=0", &u) && u.ttl == 0);
    const char *const bad[] = {"udpm:",
                               "udpm://10.0.0.1:7667",
                               "udpm://239.1.2.3:0",
                               "udpm://239.1.2.3:x",
                               "udpm://nowhere",
                               "udpm://239.1.2.3:1?ttl",
                               "udpm://239.1.2.3?ttl=256",
                               "udpm://239.1.2.3:1?ttl=-1",
                               "udpm://239.1.2.3:1?ttl=1x",
                               "http://239.1.2.3:1"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) assert_false(app_udpm_parse(bad[i], &u));
    assert_false(app_url_leaves("udpm://239.255.76.67:7667?ttl=0"));
    assert_true(app_url_leaves("udpm://239.255.76.67:7667?ttl=1"));
    assert_true(app_url_leaves("udpm://239.255.76.67:7667?recv_buf_size=1&ttl=7"));
    assert_false(app_url_leaves("memq://"));
    assert_false(app_url_leaves("tcpq://127.0.0.1:7700"));
    assert_true(app_url_leaves("tcpq://10.0.0.7:7700"));
}

int main(void) {
#define TEST(f) cmocka_unit_test_setup_teardown(f, setup, teardown)
    const struct CMUnitTest tests[] = {TEST(short_messages),      TEST(pieces_in_any_order),
                                       TEST(giants_cost_nothing), TEST(what_is_not_whole_never_arrives),
                                       TEST(many_senders),        TEST(urls)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
