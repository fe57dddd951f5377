/* app_scene_quote: quotes every file name that fits completely, and writes no byte beyond the buffer. */
#include "../fixture.h"

#include "scene/scene.h"

static void quotes_stay_within_the_buffer(void **state) {
    (void)state;
    enum { SIZE = 2048 };
    for (int quotes = 1000; quotes < 1030; quotes++)
        for (int plain = 0; plain < 40; plain++) {
            char text[1100], out[SIZE + 1];
            memset(text, '\'', (size_t)quotes);
            memset(text + quotes, 'x', (size_t)plain);
            text[quotes + plain] = 0;
            out[SIZE] = 'c';
            const bool fits = app_scene_quote(text, out, SIZE);
            assert_int_equal(out[SIZE], 'c');
            assert_int_equal(fits, 2 * quotes + plain + 3 <= SIZE);
            if (fits) assert_int_equal(strlen(out), 2 * quotes + plain + 2);
        }
    char out[16];
    assert_true(app_scene_quote("it's -", out, sizeof out));
    assert_string_equal(out, "'it''s -'");
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(quotes_stay_within_the_buffer)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
