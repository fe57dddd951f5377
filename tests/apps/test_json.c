/* Adds members of reports by a list of names (app_json_add). */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "json_file.h"

static void members_have_their_names_and_types(void **state) {
    (void)state;
    cJSON *object = cJSON_CreateObject();
    assert_ptr_equal(app_json_add(object, "half %g three %d word %s yes %hhd", 0.5, 3, "a %d b", true), object);
    char *text = cJSON_PrintUnformatted(object);
    assert_string_equal(text, "{\"half\":0.5,\"three\":3,\"word\":\"a %d b\",\"yes\":true}");
    cJSON_free(text);
    cJSON_Delete(object);
}

static void non_finite_numbers_are_null_or_omitted(void **state) {
    (void)state;
    cJSON *object = cJSON_CreateObject();
    app_json_add(object, "null %g out %f in %f", NAN, INFINITY, 2.0);
    char *text = cJSON_PrintUnformatted(object);
    assert_string_equal(text, "{\"null\":null,\"in\":2}");
    cJSON_free(text);
    cJSON_Delete(object);
}

static void an_array_gets_a_row(void **state) {
    (void)state;
    cJSON *rows = cJSON_CreateArray(), *row = app_json_add(rows, "a %d", 1);
    app_json_add(row, "b %d", 2);
    app_json_add(rows, "a %d", 3);
    char *text = cJSON_PrintUnformatted(rows);
    assert_string_equal(text, "[{\"a\":1,\"b\":2},{\"a\":3}]");
    cJSON_free(text);
    cJSON_Delete(rows);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(members_have_their_names_and_types),
        cmocka_unit_test(non_finite_numbers_are_null_or_omitted),
        cmocka_unit_test(an_array_gets_a_row),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
