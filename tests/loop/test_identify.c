/* Identification of a mass with friction that a hand holds: each constant is found from counts of 20 um, at two rates
 * and with a delay; a device that does not move is not identified. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "io/identify.h"

enum { LATE_MAX = 64 };
static const double COUNT_M = 20.0e-6, SECONDS = 2.5;

/* Plays the signal on a mass; `late` ticks pass before a command acts. */
static hrt_identify play(double tick_s, int late, const hrt_identified *is) {
    hrt_identify d = {.ticks = 0};
    double x = 0.0, v = 0.0, command[LATE_MAX] = {0};
    for (int n = 0; n * tick_s < SECONDS; n++) {
        const double force = hrt_identify_signal(n * tick_s, SECONDS);
        hrt_identify_take(&d, force, COUNT_M * rint(x / COUNT_M), tick_s);
        command[n % LATE_MAX] = force;
        const double acts = command[(n + LATE_MAX - late) % LATE_MAX];
        enum { PARTS = 20 };
        for (int k = 0; k < PARTS; k++) {
            const double dt = tick_s / PARTS, least = dt * is->friction_N / is->mass_kg;
            v += dt * (acts - is->damping_N_s_m * v - is->stiffness_N_m * x) / is->mass_kg;
            v = v > least ? v - least : v < -least ? v + least : 0.0;
            x += dt * v;
        }
    }
    return d;
}

static void check(double found, double is, double within) {
    if (!(fabs(found - is) <= within)) fail_msg("found %g where it is %g", found, is);
}

static void constants_are_found_from_counts(void **state) {
    (void)state;
    const hrt_identified light = {.mass_kg = 0.12, .damping_N_s_m = 11.0, .friction_N = 0.15, .stiffness_N_m = 300.0},
                         heavy = {.mass_kg = 0.35, .damping_N_s_m = 11.5, .friction_N = 0.05, .stiffness_N_m = 400.0};
    for (int k = 0; k < 4; k++) {
        const hrt_identified *is = k % 2 ? &heavy : &light;
        const double tick_s = k < 2 ? 0.002 : 0.001;
        const int late = k < 2 ? 1 : 4;
        const hrt_identify d = play(tick_s, late, is);
        hrt_identified f;
        assert_true(hrt_identify_solve(&d, &f));
        check(f.mass_kg, is->mass_kg, 0.15 * is->mass_kg);
        check(f.damping_N_s_m, is->damping_N_s_m, 0.15 * is->damping_N_s_m);
        check(f.friction_N, is->friction_N, 0.05);
        check(f.stiffness_N_m, is->stiffness_N_m, 0.08 * is->stiffness_N_m);
        check(f.delay_s, (late + 0.5) * tick_s, 0.0015);
        assert_true(f.residual < 0.05);
    }
}

static void a_device_that_stands_still_is_not_identified(void **state) {
    (void)state;
    hrt_identify d = {.ticks = 0};
    hrt_identified f;
    for (int n = 0; n < 1250; n++) hrt_identify_take(&d, hrt_identify_signal(0.002 * n, SECONDS), 0.1, 0.002);
    assert_false(hrt_identify_solve(&d, &f));
}

static void the_signal_stays_small_and_begins_and_ends_at_zero(void **state) {
    (void)state;
    double largest = 0.0;
    for (int n = 0; n <= 2500; n++) largest = fmax(largest, fabs(hrt_identify_signal(0.001 * n, SECONDS)));
    assert_true(largest > 0.5 && largest <= 1.2);
    assert_true(hrt_identify_signal(0.0, SECONDS) == 0.0 && hrt_identify_signal(SECONDS, SECONDS) == 0.0);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(constants_are_found_from_counts),
                                       cmocka_unit_test(a_device_that_stands_still_is_not_identified),
                                       cmocka_unit_test(the_signal_stays_small_and_begins_and_ends_at_zero)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
