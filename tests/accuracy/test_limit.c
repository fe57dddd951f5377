/* Start and continuation of a study within its time limit, with prescribed run times. No simulation runs; the real
 * clock matters only by many seconds. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "bandwidth.h"
#include "common/program_host.h"
#include "scene/solve_api.h"
#include "studies/accuracy/study.h"

/* A study of ten minutes whose scene took 4 s for 100 frames; over_s of the limit has passed. */
static study *plan(double over_s, bool recommends) {
    study *t = calloc(1, sizeof *t);
    assert_non_null(t);
    t->limit_s = 600, t->hold_s = 10, t->duration_s = t->asked_s = 4, t->slower = 1;
    t->choice.wanted = recommends;
    t->time.began_s = app_seconds() - over_s;
    t->run[0] = (study_run){.knob = "own", .frames = 100, .wall_s = 0.04, .cpu_s = 0.03, .frame_s = 0.04, .done = true};
    t->run[1] = (study_run){.knob = "mesh", .name = "finest", .frames = 100, .mesh = 1};
    t->run_count = 2;
    t->mesh[0].tets = 1000, t->mesh[1] = (study_mesh){.tets = 8000, .step = 0.5};
    return t;
}

static void a_run_starts_only_where_it_fits(void **state) {
    (void)state;
    study *t = plan(0, false);
    assert_true(fabs(study_expected_s(t, &t->run[1]) - 4 * 8 / 0.5 * 1.5) < 1e-9);
    assert_true(study_may_start(t, &t->run[1], 100));
    assert_false(study_may_start(t, &t->run[1], 200)); /* more than a quarter */
    assert_true(t->run[1].left_out);
    assert_string_equal(t->run[1].why,
                        "by the scene as it is it needs about 3 min 20 s, and has 2 min 30 s; raise --limit");
    free(t);
    t = plan(560, false);
    assert_true(study_may_start(t, &t->run[1], 30));
    assert_false(study_may_start(t, &t->run[1], 50));
    free(t);
    t = plan(560, true); /* reserved: two attempts of 8 s and 10 s of verification */
    assert_true(study_may_start(t, &t->run[1], 5));
    assert_false(study_may_start(t, &t->run[1], 20));
    free(t);
    t = plan(700, false);
    assert_false(study_may_start(t, &t->run[1], 0.1));
    assert_non_null(strstr(t->run[1].why, "no time is left"));
    free(t);
}

static void a_run_is_given_up_if_its_first_frames_take_too_long(void **state) {
    (void)state;
    study *t = plan(100, false);
    t->time.run_began_s = app_seconds() - 10, t->time.run_allowed_s = 60;
    assert_true(study_goes_on(t, &t->run[1], 2)); /* too few frames for an estimate */
    assert_true(study_goes_on(t, &t->run[1], 50));
    assert_false(study_goes_on(t, &t->run[1], 10)); /* 100 s if all frames cost the same */
    assert_non_null(strstr(t->run[1].why, "by its own first frames it needs about 1 min 40 s, and has 1 min"));
    /* The scene's own first tenth took half of its time: the estimate is then 20 s. */
    t->time.path = calloc(100, sizeof *t->time.path);
    for (int k = 0; k < 100; k++) t->time.path[k] = k < 10 ? 0.2 * (k + 1) : 2 + 2.0 * (k - 9) / 90;
    assert_true(study_goes_on(t, &t->run[1], 10));
    free(t->time.path);
    free(t);
}

static void the_path_is_shortened_if_the_scene_itself_takes_too_long(void **state) {
    (void)state;
    double force_N[300] = {0};
    study *t = plan(0, false);
    t->run[0].instruments = 1, t->run[0].force_N = force_N;
    t->time.run_began_s = app_seconds() - 10;
    assert_true(study_goes_on(t, &t->run[0], 20)); /* a fortieth is 15 s */
    t->time.run_began_s = app_seconds() - 30;
    assert_true(study_goes_on(t, &t->run[0], 40)); /* no contact yet: up to a tenth is allowed */
    force_N[3 * 30 + 2] = 0.1;
    assert_false(study_goes_on(t, &t->run[0], 41));
    assert_int_equal(t->time.cut_at, 41);
    force_N[3 * 30 + 2] = 0;
    t->time.run_began_s = app_seconds() - 70;
    assert_false(study_goes_on(t, &t->run[0], 60));
    assert_int_equal(t->time.cut_at, 60);
    free(t->time.path);
    free(t);
}

static void a_solver_is_stopped_at_its_time_limit(void **state) {
    (void)state;
    app_be_quiet();
    app_solve_allow(30);
    assert_true(app_solve_progress(NULL, "factor", 0.1, -1));
    assert_true(app_solve_progress(NULL, "factor", 0.1, 5));
    assert_true(app_solve_beyond() == 0);
    assert_false(app_solve_progress(NULL, "factor", 0.2, 90));
    assert_true(app_solve_beyond() >= 90);
    app_solve_allow(INFINITY);
    assert_true(app_solve_progress(NULL, "factor", 0.2, 1e9) && app_solve_beyond() == 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_run_starts_only_where_it_fits),
        cmocka_unit_test(a_run_is_given_up_if_its_first_frames_take_too_long),
        cmocka_unit_test(the_path_is_shortened_if_the_scene_itself_takes_too_long),
        cmocka_unit_test(a_solver_is_stopped_at_its_time_limit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
