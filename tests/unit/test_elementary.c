/* Elementary functions of numeric/elementary.h against the C library's, and their bits, which must be the same
 * everywhere. */
#include "libtensormass/numeric/elementary.h"

#include "../fixture.h"

static double worst(double worst_yet, double value, double reference, double scale) {
    return fmax(worst_yet, scale > 0 ? fabs(value - reference) / scale : fabs(value));
}

static uint64_t hash_of(uint64_t hash, double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    return (hash ^ bits) * UINT64_C(1099511628211);
}

/* A number of either sign, of magnitudes 10^low to 10^(low + 6). */
static double any(fix_random *random, int low) {
    return (2 * fix_uniform(random) - 1) * pow(10, low + (int)(7 * fix_uniform(random)));
}

static void values_are_within_the_stated_errors(void **state) {
    (void)state;
    fix_random random = {11};
    double error[4] = {0};
    for (int i = 0; i < 200000; i++) {
        const double x = any(&random, -1), y = any(&random, -3), u = 2 * fix_uniform(&random) - 1,
                     small = any(&random, -4);
        error[0] = worst(error[0], tm_sine(x), sin(x), 1);
        error[0] = worst(error[0], tm_cosine(x), cos(x), 1);
        error[1] = worst(error[1], tm_arctangent2(y, x), atan2(y, x), fabs(atan2(y, x)));
        error[2] = worst(error[2], tm_arcsine(u), asin(u), fabs(asin(u)));
        error[3] = worst(error[3], tm_exponential(small), exp(small), exp(small));
        error[3] = worst(error[3], tm_exponential_less_1(small), expm1(small), fabs(expm1(small)));
    }
    for (int i = 0; i < 4; i++) assert_true(error[i] < 7e-16);
}

static void ends_of_the_ranges_are_exact(void **state) {
    (void)state;
    assert_true(tm_arctangent2(0, 0) == 0 && tm_sine(0) == 0 && tm_cosine(0) == 1 && tm_exponential(0) == 1);
    assert_true(fabs(tm_arctangent2(0, -1) - (TM_PI)) < 1e-15);
    assert_true(fabs(tm_arctangent2(-1, 0) - (-TM_PI / 2)) < 1e-15);
    assert_true(fabs(tm_arcsine(-1) - (-TM_PI / 2)) < 1e-15);
    assert_true(tm_exponential(-1e9) == 0 && tm_exponential_less_1(-1e9) == -1 && isinf(tm_exponential(1e9)));
    assert_true(fabs(tm_sine(1e15)) <= 1 && fabs(tm_cosine(1e300)) <= 1);
}

/* A hash of the bits, as they are on x86-64, ARM and WebAssembly. */
static void bits_are_the_same_on_every_machine(void **state) {
    (void)state;
    uint64_t hash = UINT64_C(14695981039346656037);
    for (int i = -500; i <= 500; i++) {
        const double x = i / 16.0, u = i / 512.0;
        hash = hash_of(hash, tm_sine(x));
        hash = hash_of(hash, tm_cosine(x));
        hash = hash_of(hash, tm_arctangent2(u, 0.25));
        hash = hash_of(hash, tm_arcsine(u));
        hash = hash_of(hash, tm_exponential(x));
        hash = hash_of(hash, tm_exponential_less_1(u));
    }
    assert_int_equal(hash, UINT64_C(0x708c0eabc8ef4460));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(values_are_within_the_stated_errors),
        cmocka_unit_test(ends_of_the_ranges_are_exact),
        cmocka_unit_test(bits_are_the_same_on_every_machine),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
