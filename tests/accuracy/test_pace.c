/* Verdicts on a promised cost on simulated machines: frames cost more because the machine was slower, or because the
 * setting is costlier. Only one check reads the clock. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "studies/accuracy/study.h"

enum { FRAMES = 250 };
static const double WORK_S = 2e-4, ALLOWED_S = 0.02;
static double cost_s[FRAMES], work_s[FRAMES];

/* Judges FRAMES frames that cost `share` of the budget. In frames `from` to `to` the machine is `slower` and the
 * setting `costlier` by these factors. Every fortieth timed piece of work is interrupted. */
static study_speed plant(double share, int from, int to, double slower, double costlier) {
    for (int k = 0; k < FRAMES; k++) {
        const bool within = k >= from && k < to;
        work_s[k] = WORK_S * (within ? slower : 1) * (k % 40 ? 1 : 9);
        cost_s[k] = ALLOWED_S * share * (within ? slower * costlier : 1);
    }
    return study_judge_pace(cost_s, work_s, FRAMES, WORK_S, ALLOWED_S);
}

/* Returns the verdict's text, for a promise that holds otherwise. */
static const char *said(study_speed held, bool in_time) {
    static char text[500];
    study_choice c = {.fits = true, .held = held, .real_time = in_time, .kept = held.costlier <= STUDY_OVER};
    study_verdict(&c, text, sizeof text);
    return text;
}

static void test_same_machine_speed_keeps_the_promise(void **state) {
    (void)state;
    const study_speed held = plant(0.7, 0, 0, 1, 1);
    assert_true(held.slower == 1 && held.over == 0 && held.costlier == 0);
    assert_string_equal(said(held, true), "The promise was kept, and real time.");
    assert_non_null(strstr(said(held, false), "other programs had the processors"));
}

static void test_slower_machine_does_not_break_the_promise(void **state) {
    (void)state;
    const study_speed held = plant(0.7, 100, 220, 1.8, 1);
    assert_true(fabs(held.slower - 1.8) < 1e-9);
    assert_true(fabs(held.over - 120.0 / FRAMES) < 1e-9 && held.costlier == 0);
    assert_non_null(strstr(said(held, false),
                           "The promise was kept: the setting is no costlier. The machine was 1.8 times "
                           "slower"));
    assert_non_null(strstr(said(held, false), "REAL TIME WAS NOT KEPT"));
    assert_null(strstr(said(held, true), "REAL TIME"));
    const study_speed milder = plant(0.5, 100, 220, 1.8, 1); /* within the budget, but late */
    assert_true(milder.over == 0);
    assert_non_null(strstr(said(milder, false), "when the machine is itself. The machine was 1.8 times slower"));
}

static void test_costlier_setting_breaks_the_promise(void **state) {
    (void)state;
    const study_speed held = plant(0.7, 100, 220, 1, 1.8);
    assert_true(held.slower == 1 && fabs(held.costlier - 120.0 / FRAMES) < 1e-9 && held.over == held.costlier);
    assert_string_equal(said(held, true), "THE PROMISE WAS NOT KEPT.");
    const study_speed both = plant(0.7, 100, 220, 1.3, 1.8);
    assert_true(fabs(both.costlier - 120.0 / FRAMES) < 1e-9);
    assert_non_null(strstr(said(both, true), "THE PROMISE WAS NOT KEPT. The machine was 1.3 times slower"));
    assert_non_null(strstr(said(both, true), "costlier than that explains"));
}

static void test_faster_or_unknown_machine_leaves_the_verdict_unchanged(void **state) {
    (void)state;
    const study_speed faster = plant(0.7, 0, FRAMES, 0.5, 3.2); /* 1.12 of the budget */
    assert_true(faster.slower == 1 && fabs(faster.costlier - 1) < 1e-9);
    plant(0.7, 0, FRAMES, 1.8, 1);
    const study_speed unknown = study_judge_pace(cost_s, work_s, FRAMES, 0, ALLOWED_S);
    assert_true(unknown.slower == 1 && fabs(unknown.costlier - 1) < 1e-9);
    const study_speed none = study_judge_pace(cost_s, work_s, 0, WORK_S, ALLOWED_S);
    assert_true(none.over == 1 && none.costlier == 1);
}

/* Checks only that the work takes time and is repeatable, not how long it takes. */
static void test_reference_work_takes_time_and_repeats(void **state) {
    (void)state;
    for (int i = 0; i < 50; i++) assert_true(study_work_s() > 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_same_machine_speed_keeps_the_promise),
        cmocka_unit_test(test_slower_machine_does_not_break_the_promise),
        cmocka_unit_test(test_costlier_setting_breaks_the_promise),
        cmocka_unit_test(test_faster_or_unknown_machine_leaves_the_verdict_unchanged),
        cmocka_unit_test(test_reference_work_takes_time_and_repeats),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
