/* Bytes of every kind of message: complete ones are decoded and encoded unchanged; others are rejected before a
 * generated decoder uses their lengths. */
// clang-format off
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>
// clang-format on

#include "message.h"

static void every_kind_is_decoded_and_encoded_unchanged(void **state) {
    (void)state;
    for (int k = 0; k < APP_KINDS; k++) {
        app_message none, back;
        app_message_empty((app_message_kind)k, &none);
        const int size = app_message_size((app_message_kind)k, &none);
        uint8_t *bytes = malloc((size_t)size), *again = malloc((size_t)size + 1);
        assert_int_equal(app_message_encode((app_message_kind)k, bytes, size, &none), size);
        assert_true(app_message_decode((app_message_kind)k, bytes, size, &back));
        assert_int_equal(app_message_encode((app_message_kind)k, again, size, &back), size);
        assert_memory_equal(again, bytes, (size_t)size);
        app_message_cleanup((app_message_kind)k, &back);
        for (int cut = 0; cut < size; cut++) {
            uint8_t *exact = malloc((size_t)cut + !cut); /* ASan detects an access beyond the end */
            memcpy(exact, bytes, (size_t)cut);
            assert_false(app_message_decode((app_message_kind)k, exact, cut, &back));
            free(exact);
        }
        memcpy(again, bytes, (size_t)size);
        again[size] = 0;
        assert_false(app_message_decode((app_message_kind)k, again, size + 1, &back));
        free(bytes);
        free(again);
    }
}

enum { FINGERPRINT = 8, FAULT_TEXT = FINGERPRINT + 26, ROOM = 512 };

static int controller_bytes(uint8_t bytes[ROOM]) {
    char fault[] = "ab", extrapolator[] = "hold";
    const tensormass_controller_status_t m = {.fault_text = fault, .extrapolator = extrapolator, .can_tx = 7};
    return app_message_encode(APP_CONTROLLER, bytes, ROOM, &m);
}

static void strings_of_false_length_are_rejected(void **state) {
    (void)state;
    uint8_t bytes[ROOM];
    app_message m;
    const int size = controller_bytes(bytes);
    assert_true(app_message_decode(APP_CONTROLLER, bytes, size, &m));
    assert_string_equal(m.CONTROLLER.fault_text, "ab");
    assert_string_equal(m.CONTROLLER.extrapolator, "hold");
    assert_int_equal(m.CONTROLLER.can_tx, 7);
    app_message_cleanup(APP_CONTROLLER, &m);
    static const struct {
        int at;
        uint8_t value;
    } lies[] = {{FAULT_TEXT, 0xff},     /* negative length */
                {FAULT_TEXT, 0x7f},     /* longer than the message */
                {FAULT_TEXT + 3, 0},    /* no space for its end */
                {FAULT_TEXT + 3, 4},    /* one more than there are */
                {FAULT_TEXT + 4, 0},    /* a terminator before the end */
                {FAULT_TEXT + 6, 'c'}}; /* no terminator */
    for (size_t i = 0; i < sizeof lies / sizeof *lies; i++) {
        controller_bytes(bytes);
        bytes[lies[i].at] = lies[i].value;
        assert_false(app_message_decode(APP_CONTROLLER, bytes, size, &m));
    }
}

/* tissue_t with three vertices, one triangle and one tie: three counts, one array of each. */
static int tissue_bytes(uint8_t bytes[ROOM]) {
    float p[3][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, *vertex[3] = {p[0], p[1], p[2]};
    int32_t id[3] = {4, 5, 6}, corners[3] = {0, 1, 2}, *triangle[1] = {corners};
    int8_t kind[1] = {1};
    float ends[6] = {0, 0, 0, 1, 0, 0}, *tie_m[1] = {ends};
    int32_t tie_id[1] = {2};
    const tensormass_tissue_t m = {.vertex_count = 3,
                                   .vertex_m = vertex,
                                   .vertex_id = id,
                                   .triangle_count = 1,
                                   .triangle = triangle,
                                   .triangle_kind = kind,
                                   .tie_total = 3,
                                   .tie_count = 1,
                                   .tie_id = tie_id,
                                   .tie_m = tie_m};
    return app_message_encode(APP_TISSUE, bytes, ROOM, &m);
}

static void false_counts_are_rejected(void **state) {
    (void)state;
    enum { VERTICES = FINGERPRINT + 32, TRIANGLES = VERTICES + 4 + 36 + 12, TIES = TRIANGLES + 4 + 12 + 1 + 4 };
    static const int at[] = {VERTICES, TRIANGLES, TIES};
    static const uint8_t lies[][4] = {
        {0xff, 0xff, 0xff, 0xff}, {0x7f, 0xff, 0xff, 0xff}, {0x20, 0, 0, 0}, {0, 0, 0, 4}, {0, 0, 0, 2},
        {0x55, 0x55, 0x55, 0x56}};
    uint8_t bytes[ROOM];
    app_message m;
    const int size = tissue_bytes(bytes);
    assert_int_equal(bytes[VERTICES + 3], 3);
    assert_int_equal(bytes[TRIANGLES + 3], 1);
    assert_int_equal(bytes[TIES + 3], 1);
    assert_true(app_message_decode(APP_TISSUE, bytes, size, &m));
    assert_true(m.TISSUE.vertex_m[1][0] == 1.0f && m.TISSUE.triangle[0][2] == 2);
    app_message_cleanup(APP_TISSUE, &m);
    for (size_t i = 0; i < sizeof lies / sizeof *lies; i++)
        for (int which = 0; which < 3; which++) {
            tissue_bytes(bytes);
            memcpy(bytes + at[which], lies[i], 4);
            assert_false(app_message_decode(APP_TISSUE, bytes, size, &m));
        }
}

static void channels_map_to_their_message_types(void **state) {
    (void)state;
    static const char *const none[] = {
        "", "TOOL", "TOOL_", "TOOL_2", "TOOL_00", "tool_0", "SIM_STATUS_0", "TISSUE0", "CONTROLLER_COMMAND", "FORCE_/"};
    app_message_kind kind = APP_KINDS;
    int instrument = -1;
    for (int k = 0; k < APP_KINDS; k++)
        for (int i = 0; i < APP_INSTRUMENTS; i++) {
            char name[APP_CHANNEL_CAPACITY];
            app_channel_name((app_message_kind)k, i, name);
            assert_true(app_channel_find(name, &kind, &instrument) && (int)kind == k);
            assert_true(instrument == i || name[strlen(name) - 1] > '9');
        }
    for (size_t i = 0; i < sizeof none / sizeof *none; i++) assert_false(app_channel_find(none[i], &kind, &instrument));
}

/* docs/trust.md: all messages but the pictures. */
static void tags_are_where_the_page_says(void **state) {
    (void)state;
    for (int k = 0; k < APP_KINDS; k++)
        assert_true(app_message_has_tag((app_message_kind)k) == (k != APP_TISSUE && k != APP_CUT));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_kind_is_decoded_and_encoded_unchanged),
        cmocka_unit_test(strings_of_false_length_are_rejected), cmocka_unit_test(false_counts_are_rejected),
        cmocka_unit_test(channels_map_to_their_message_types), cmocka_unit_test(tags_are_where_the_page_says)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
