/* The status log of haptic-rt: at most one line a second of each kind, with the number of omitted ones; and the
 * report of which peer is silent. */
#include "../fixture.h"

#include "io/status_log.c"

static struct {
    char text[200];
    double time_s;
} line[512];
static int lines;
static double now_s;

/* Replaces the program's log. */
void app_say(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    assert_true(lines < 512);
    vsnprintf(line[lines].text, sizeof line[lines].text, format, arguments);
    line[lines++].time_s = now_s;
    va_end(arguments);
}
bool app_is_quiet(void) { return false; }

static hrt_teller teller_new(void) {
    lines = 0;
    return (hrt_teller){
        .bus = "virtual:t",
        .logged = {.state = -1, .silent_s = -1e9, .refused_s = -1e9, .gaps_s = -1e9, .unstable_s = -1e9}};
}

static void look(hrt_teller *teller, hrt_facts facts) {
    now_s = facts.time_s;
    hrt_status_log(teller, &facts);
}

static int said(const char *words, double from_s, double to_s) {
    int count = 0;
    for (int i = 0; i < lines; i++)
        count += strstr(line[i].text, words) && line[i].time_s >= from_s && line[i].time_s < to_s;
    return count;
}

/* A simulation at the limit of real time: alternately engaged and waiting, ten times a second for half a minute. */
static void at_most_one_line_a_second_of_each_kind(void **state) {
    (void)state;
    hrt_teller teller = teller_new();
    const double last_s = 30;
    for (int i = 0; i < 20 * (int)last_s; i++)
        look(&teller, (hrt_facts){.time_s = i / 20.0,
                                  .state = i % 2 ? HRT_ENGAGED : HRT_IDLE,
                                  .samples = i,
                                  .taken = i,
                                  .pose_known = true,
                                  .device_here = true});
    for (double from_s = 0; from_s < last_s; from_s += 0.05) {
        assert_true(said("engaged", from_s, from_s + 0.999) <= 1);
        assert_true(said("waiting for new samples", from_s, from_s + 0.999) <= 1);
    }
    const int engaged = said("engaged", 0, last_s);
    print_message("  %d lines in %.0f s of 600 changes\n", lines, last_s);
    assert_in_range(engaged, 20, 30);
    assert_true(strstr(line[lines - 1].text, "times since the last such message"));
    int64_t counted = 0;
    for (int i = 0; i < lines; i++) {
        const char *count = strstr(line[i].text, "engaged (");
        counted += count ? strtoll(count + 9, NULL, 10) : strstr(line[i].text, "engaged") != NULL;
    }
    assert_in_range(counted, 280, 300); /* 300 times; those of the last second may still be due */
}

/* The last line of a kind is printed even if it came too soon. */
static void omitted_lines_are_printed_when_due(void **state) {
    (void)state;
    hrt_teller teller = teller_new();
    for (int i = 0; i < 60; i++) {
        const bool engaged = i == 1 || i >= 4;
        look(&teller, (hrt_facts){.time_s = i / 20.0, .state = engaged ? HRT_ENGAGED : HRT_IDLE, .pose_known = true});
    }
    assert_int_equal(said("engaged", 0, 1), 1);
    assert_int_equal(said("engaged", 1, 1.2), 1);
    assert_string_not_equal(line[lines - 1].text, line[0].text);
    assert_non_null(strstr(line[lines - 1].text, "engaged"));
}

static void silent_device_and_silent_simulation_are_distinguished(void **state) {
    (void)state;
    hrt_teller teller = teller_new();
    for (int i = 0; i < 40; i++)
        look(&teller, (hrt_facts){.time_s = i / 20.0,
                                  .state = i < 10   ? HRT_ENGAGED
                                           : i < 12 ? HRT_IDLE
                                                    : HRT_BOOT,
                                  .pose_known = true,
                                  .device_quiet = i >= 10});
    assert_int_equal(said("samples", 0, 2), 0);
    assert_int_equal(said("device 0 stopped sending", 0.4, 0.6), 1);
    assert_int_equal(said("waiting for device 0", 0.5, 0.8), 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(at_most_one_line_a_second_of_each_kind),
                                       cmocka_unit_test(omitted_lines_are_printed_when_due),
                                       cmocka_unit_test(silent_device_and_silent_simulation_are_distinguished)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
