/* Authentication: the key's file, the code, and single use of an authenticated message. */
// clang-format off
#include <setjmp.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <cmocka.h>
// clang-format on

#include "auth.h"

/* vectors.h of the reference implementation (github.com/veorq/SipHash): key 00..0f, message 00..(n-1). */
static void siphash_agrees_with_its_reference(void **state) {
    (void)state;
    static const struct {
        size_t size;
        uint8_t tag[8];
    } row[] = {
        {0, {0x31, 0x0e, 0x0e, 0xdd, 0x47, 0xdb, 0x6f, 0x72}},  {1, {0xfd, 0x67, 0xdc, 0x93, 0xc5, 0x39, 0xf8, 0x74}},
        {7, {0x37, 0xd1, 0x01, 0x8b, 0xf5, 0x00, 0x02, 0xab}},  {8, {0x62, 0x24, 0x93, 0x9a, 0x79, 0xf5, 0xf5, 0x93}},
        {15, {0xe5, 0x45, 0xbe, 0x49, 0x61, 0xca, 0x29, 0xa1}}, {63, {0x72, 0x45, 0x06, 0xeb, 0x4c, 0x32, 0x8a, 0x95}}};
    uint8_t key[16], message[64];
    for (int i = 0; i < 64; i++) message[i] = (uint8_t)i;
    memcpy(key, message, sizeof key);
    for (size_t k = 0; k < sizeof row / sizeof *row; k++)
        for (size_t cut = 0; cut <= row[k].size; cut++) {
            uint64_t tag = app_siphash(key, message, cut, message + cut, row[k].size - cut);
            for (int i = 0; i < 8; i++) assert_int_equal(tag >> 8 * i & 0xff, row[k].tag[i]);
        }
}

static void every_changed_bit_is_detected(void **state) {
    (void)state;
    const app_key key = {.known = true, .byte = {1, 2, 3}}, other = {.known = true, .byte = {1, 2, 4}},
                  none = {.known = false};
    uint8_t message[40] = {9, 8, 7};
    assert_true(app_auth_check(&none, "FORCE_0", message, sizeof message));
    assert_false(app_auth_check(&key, "FORCE_0", message, sizeof message));
    app_auth_tag(&key, "FORCE_0", message, sizeof message);
    assert_true(app_auth_check(&key, "FORCE_0", message, sizeof message));
    assert_false(app_auth_check(&key, "FORCE_1", message, sizeof message));
    assert_false(app_auth_check(&other, "FORCE_0", message, sizeof message));
    assert_false(app_auth_check(&key, "FORCE_0", message, sizeof message - 1));
    assert_false(app_auth_check(&key, "FORCE_0", message, 8));
    for (size_t bit = 0; bit < 8 * sizeof message; bit++) {
        message[bit / 8] ^= (uint8_t)(1u << bit % 8);
        assert_false(app_auth_check(&key, "FORCE_0", message, sizeof message));
        message[bit / 8] ^= (uint8_t)(1u << bit % 8);
    }
}

static void repeated_message_is_rejected(void **state) {
    (void)state;
    static app_replay replay;
    assert_true(app_replay_fresh(&replay, 5, UINT32_MAX));
    assert_false(app_replay_fresh(&replay, 5, UINT32_MAX));
    assert_true(app_replay_fresh(&replay, 5, 3)); /* it wraps around */
    assert_false(app_replay_fresh(&replay, 5, UINT32_MAX));
    for (int session = 100; session < 100 + APP_SESSIONS - 1; session++)
        assert_true(app_replay_fresh(&replay, session, 1));
    assert_false(app_replay_fresh(&replay, 5, 3)); /* earlier sessions are remembered */
    for (int session = 100; session < 100 + APP_SESSIONS - 1; session++)
        assert_false(app_replay_fresh(&replay, session, 1));
}

static void key_files_are_checked(void **state) {
    (void)state;
    char path[] = "/tmp/tm-key-XXXXXX", why[300];
    app_key key;
    static const struct {
        const char *text;
        int mode;
        const char *expected; /* null: valid */
    } row[] = {{"000102030405060708090a0b0c0d0e0F\n", 0600, NULL},
               {"000102030405060708090a0b0c0d0e0F", 0400, NULL},
               {"000102030405060708090a0b0c0d0e0F\n", 0640, "chmod 600"},
               {"000102030405060708090a0b0c0d0e0F\n", 0602, "chmod 600"},
               {"000102030405060708090a0b0c0d0e0\n", 0600, "32 hexadecimal digits"},
               {"000102030405060708090a0b0c0d0e0F0\n", 0600, "32 hexadecimal digits"},
               {"000102030405060708090a0b0c0d0e0x\n", 0600, "32 hexadecimal digits"},
               {"", 0600, "32 hexadecimal digits"}};
    const int fd = mkstemp(path);
    assert_true(fd >= 0);
    for (size_t k = 0; k < sizeof row / sizeof *row; k++) {
        assert_int_equal(ftruncate(fd, 0), 0);
        assert_int_equal(pwrite(fd, row[k].text, strlen(row[k].text), 0), strlen(row[k].text));
        assert_int_equal(fchmod(fd, (mode_t)row[k].mode), 0);
        const bool good = app_key_read(path, &key, why, sizeof why);
        assert_true(good == !row[k].expected && good == key.known);
        if (!good) assert_non_null(strstr(why, row[k].expected));
        for (int i = 0; good && i < 16; i++) assert_int_equal(key.byte[i], i);
    }
    close(fd);
    unlink(path);
    assert_false(app_key_read(path, &key, why, sizeof why));
    assert_non_null(strstr(why, "cannot be read"));
    assert_false(app_key_read("/tmp", &key, why, sizeof why));
    assert_non_null(strstr(why, "not a regular file"));
}

/* A key is required as soon as messages leave the machine. */
static void key_is_required_off_this_machine(void **state) {
    (void)state;
    char why[300];
    app_key key;
    assert_true(app_key_for("udpm://239.255.76.67:7667?ttl=0", NULL, false, &key, why, sizeof why) && !key.known);
    assert_false(app_key_for("udpm://239.255.76.67:7667?ttl=1", NULL, false, &key, why, sizeof why));
    assert_non_null(strstr(why, "--key"));
    assert_true(app_key_for("udpm://239.255.76.67:7667?ttl=1", NULL, true, &key, why, sizeof why) && !key.known);
    assert_false(app_key_for("udpm://239.255.76.67:7667?ttl=0", "/no/such/key", true, &key, why, sizeof why));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(siphash_agrees_with_its_reference), cmocka_unit_test(every_changed_bit_is_detected),
        cmocka_unit_test(repeated_message_is_rejected), cmocka_unit_test(key_files_are_checked),
        cmocka_unit_test(key_is_required_off_this_machine)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
