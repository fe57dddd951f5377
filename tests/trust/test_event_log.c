/* Damaged or malicious LCM logs: complete messages are read, and announced sizes allocate nothing. */
// clang-format off
#include <setjmp.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <malloc.h>
#include <cmocka.h>
// clang-format on

#include "event_log.h"

static char path[64];
static FILE *file;

static int setup(void **state) {
    (void)state;
    strcpy(path, "/tmp/tm-log-XXXXXX");
    file = fdopen(mkstemp(path), "wb");
    return file == NULL;
}

static int teardown(void **state) {
    (void)state;
    unlink(path);
    return 0;
}

static void put(uint64_t value, int bytes) {
    for (int i = bytes - 1; i >= 0; i--) putc((int)(value >> 8 * i & 255), file);
}

static void event(int64_t at, const char *channel, uint32_t channel_size, uint32_t data_size, int fill,
                  size_t written) {
    put(0xeda1da01, 4);
    put(7, 8);
    put((uint64_t)at, 8);
    put(channel_size, 4);
    put(data_size, 4);
    fputs(channel, file);
    for (size_t i = 0; i < written; i++) putc(fill, file);
}

static int read_all(int64_t *last_us, bool *damaged) {
    fclose(file);
    app_log *log = app_log_open(path);
    assert_non_null(log);
    int count = 0, again = 0;
    for (const app_log_event *e; (e = app_log_next(log));) {
        assert_string_equal(e->channel, "AB");
        for (int i = 0; i < e->size; i++) assert_int_equal(e->data[i], 5);
        *last_us = e->timestamp;
        count++;
    }
    *damaged = app_log_damaged(log);
    assert_true(app_log_rewind(log));
    while (app_log_next(log)) again++;
    assert_int_equal(again, count);
    app_log_close(log);
    return count;
}

static void whole(void **state) {
    (void)state;
    int64_t last = 0;
    bool damaged;
    event(1, "AB", 2, 0, 5, 0);
    event(-3, "AB", 2, 300000, 5, 300000);
    event((int64_t)1 << 50, "AB", 2, 7, 5, 7);
    assert_int_equal(read_all(&last, &damaged), 3);
    assert_true(last == (int64_t)1 << 50 && !damaged);
}

static void giants(void **state) {
    (void)state;
    int64_t last = 0;
    bool damaged;
    event(1, "AB", 2, 7, 5, 7);
    event(2, "AB", 2, 0x7fffffff, 5, 7);
    event(2, "AB", 2, 0xffffffff, 5, 7);
    event(2, "AB", 0x7fffffff, 7, 5, 7);
    event(2, "AB", 0, 7, 5, 7);
    event(2, "AB", 0x80000000, 7, 5, 7);
    event(9, "AB", 2, 7, 5, 7);
    const size_t before = mallinfo2().hblkhd;
    assert_int_equal(read_all(&last, &damaged), 2);
    assert_true(last == 9 && damaged && mallinfo2().hblkhd == before);
}

static void cut_short(void **state) {
    (void)state;
    int64_t last = 0;
    bool damaged;
    event(1, "AB", 2, 7, 5, 7);
    event(2, "AB", 2, APP_LOG_EVENT_MAX, 5, 100); /* all that may be announced, and not there */
    assert_int_equal(read_all(&last, &damaged), 1);
    assert_true(damaged);
}

static void rubbish_between(void **state) {
    (void)state;
    int64_t last = 0;
    bool damaged;
    fputs("rubbish", file);
    event(1, "AB", 2, 7, 5, 7);
    put(0xeda1da, 3);
    event(2, "AB", 2, 7, 5, 7);
    put(0xed, 1);
    assert_int_equal(read_all(&last, &damaged), 2);
    assert_true(last == 2 && damaged);
}

static void nothing(void **state) {
    (void)state;
    int64_t last = 0;
    bool damaged;
    assert_int_equal(read_all(&last, &damaged), 0);
    assert_false(damaged);
    assert_null(app_log_open("/no/such/log"));
}

int main(void) {
#define TEST(f) cmocka_unit_test_setup_teardown(f, setup, teardown)
    const struct CMUnitTest tests[] = {TEST(whole), TEST(giants), TEST(cut_short), TEST(rubbish_between),
                                       TEST(nothing)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
