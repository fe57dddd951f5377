/* The walk over a message's lengths before a generated decoder believes them. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "wire.h"

/* 8 bytes of fingerprint, 2 of whatever, string "ab", count 3, three of 4 bytes. */
static const uint8_t sound[] = {1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 0, 0, 0, 3, 'a', 'b', 0,
                                0, 0, 0, 3, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0,   3};
static const char layout[] = "2.s#*4.";

static void whole_message_is_sound(void **state) {
    (void)state;
    assert_true(app_wire_sound(layout, sound, sizeof sound));
}

static void every_truncation_is_refused(void **state) {
    (void)state;
    for (int size = 0; size < (int)sizeof sound; size++) assert_false(app_wire_sound(layout, sound, size));
}

static void trailing_bytes_are_refused(void **state) {
    (void)state;
    uint8_t longer[sizeof sound + 1] = {0};
    memcpy(longer, sound, sizeof sound);
    assert_false(app_wire_sound(layout, longer, sizeof longer));
}

static void with_byte(int at, uint8_t value, uint8_t *out) {
    memcpy(out, sound, sizeof sound);
    out[at] = value;
}

static void lying_lengths_are_refused(void **state) {
    (void)state;
    uint8_t m[sizeof sound];
    static const struct {
        int at;
        uint8_t value;
    } lies[] = {
        {10, 0xff}, /* string of negative length */
        {10, 0x7f}, /* longer than the message */
        {13, 0},    /* no room for its NUL */
        {16, 'c'},  /* no NUL at its end */
        {17, 0xff}, /* negative count */
        {17, 0x7f}, /* count times 4 beyond 32 bits */
        {20, 4},    /* one more than there are */
        {20, 2},    /* one fewer */
    };
    for (size_t i = 0; i < sizeof lies / sizeof lies[0]; i++) {
        with_byte(lies[i].at, lies[i].value, m);
        assert_false(app_wire_sound(layout, m, sizeof m));
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(whole_message_is_sound), cmocka_unit_test(every_truncation_is_refused),
        cmocka_unit_test(trailing_bytes_are_refused), cmocka_unit_test(lying_lengths_are_refused)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
