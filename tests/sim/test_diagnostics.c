/* The list of diagnostics is bounded and counts the entries that do not fit. */
#include "../fixture.h"

#include "scene/host.h"

static int32_t told;
static void count(void *user, const tm_diagnostic *d) { (void)user, (void)d, told++; }

static void add(const app_host *host, tm_severity severity, int n) {
    char text[40];
    snprintf(text, sizeof text, "what %d; do", n);
    app_host_tell(host, severity, TM_OK, "file", n, text);
}

static void a_full_list_keeps_faults_and_counts_the_rest(void **state) {
    (void)state;
    tm_diagnostics list = {.on_diagnostic = count};
    const app_host host = {.diagnostics = &list};
    for (int i = 0; i < TM_DIAGNOSTICS_MAX + 20; i++) add(&host, i == 7 ? TM_FAULT : TM_WARNING, i);
    assert_int_equal(list.count, TM_DIAGNOSTICS_MAX);
    assert_int_equal(list.lost, 20);
    add(&host, TM_FAULT, 5000);
    assert_int_equal(list.count, TM_DIAGNOSTICS_MAX);
    assert_int_equal(list.item[TM_DIAGNOSTICS_MAX - 1].line, 5000);
    assert_int_equal(list.item[TM_DIAGNOSTICS_MAX - 2].line, TM_DIAGNOSTICS_MAX - 2);
    for (int i = 0; i < 2 * TM_DIAGNOSTICS_MAX; i++) add(&host, TM_FAULT, i);
    assert_int_equal(list.count, TM_DIAGNOSTICS_MAX);
    assert_int_equal(list.item[0].line, 7);
    assert_int_equal(list.item[1].line, 5000);
    assert_string_equal(list.item[2].what, "what 0");
    assert_int_equal(told, list.count + list.lost); /* all, and no line twice */
    tm_diagnostics_clear(&list);
    assert_int_equal(list.count + list.lost, 0);
    add(&host, TM_REMARK, 1);
    assert_int_equal(list.count, 1);
    tm_diagnostics_clear(&list);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(a_full_list_keeps_faults_and_counts_the_rest)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
