/* Elementary functions with identical bits on every machine: +, -, *, / and sqrt alone, in one order. A C library's own
 * differ from machine to machine in the last digit, and with them every state that follows an instrument.
 * Errors: at most 7e-16 of the result, or of 1 for sines and cosines (tests/unit/test_elementary.c). */
#ifndef TM_ELEMENTARY_H
#define TM_ELEMENTARY_H

#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#define TM_PI 3.14159265358979323846

/* Subtracts quarter turns in three parts (the first two have 33 bits, so that their products are exact), then sums the
 * Taylor series on +-pi/4. */
static inline void tm_sine_cosine(double angle, double *sine, double *cosine) {
    const double x = fabs(angle) < 1e6 ? angle : fmod(angle, 2 * TM_PI);
    const double turns = floor(x * 0.63661977236758138 + 0.5);
    const double r = ((x - turns * 1.57079632673412561417) - turns * 6.07710050630396597660e-11) -
                     turns * 2.02226624879595063154e-21;
    const double r2 = r * r;
    const double s =
        r + r * r2 *
                (-1.0 / 6 +
                 r2 * (1.0 / 120 +
                       r2 * (-1.0 / 5040 + r2 * (1.0 / 362880 + r2 * (-1.0 / 39916800 +
                                                                      r2 * (1.0 / 6227020800 - r2 / 1307674368000))))));
    const double c =
        1 - r2 * (0.5 - r2 * (1.0 / 24 -
                              r2 * (1.0 / 720 -
                                    r2 * (1.0 / 40320 - r2 * (1.0 / 3628800 -
                                                              r2 * (1.0 / 479001600 - r2 * (1.0 / 87178291200 -
                                                                                            r2 / 20922789888000)))))));
    const int32_t quarter = (int32_t)turns;
    const bool swap = (quarter & 1) != 0;
    *sine = (swap ? c : s) * ((quarter & 2) != 0 ? -1 : 1);
    *cosine = (swap ? s : c) * (((quarter + 1) & 2) != 0 ? -1 : 1);
}

static inline double tm_sine(double angle) {
    double sine, cosine;
    tm_sine_cosine(angle, &sine, &cosine);
    return sine;
}

static inline double tm_cosine(double angle) {
    double sine, cosine;
    tm_sine_cosine(angle, &sine, &cosine);
    return cosine;
}

/* Angle of (x, y) in [-pi, pi]; 0 for (0, 0). Halves the angle to below 0.2, then sums the series. */
static inline double tm_arctangent2(double y, double x) {
    const double a = fabs(y), b = fabs(x), large = a > b ? a : b, small = a > b ? b : a;
    if (!(large > 0)) return 0;
    const double t = small / large;
    const bool past = t > 0.41421356237309503; /* tan(pi/8) */
    const double u = past ? (small - large) / (small + large) : t, z = u / (1 + sqrt(1 + u * u)), z2 = z * z;
    double sum = 0;
    for (int i = 25; i >= 3; i -= 2) sum = (1.0 / i - sum) * z2;
    double angle = 2 * (z - z * sum);
    if (past) angle += TM_PI / 4;
    if (a > b) angle = TM_PI / 2 - angle;
    if (x < 0) angle = TM_PI - angle;
    return y < 0 ? -angle : angle;
}

/* Of -1 <= x <= 1. */
static inline double tm_arcsine(double x) { return tm_arctangent2(x, sqrt((1 - x) * (1 + x))); }

/* Returns e^r - 1 of x = n ln 2 + r, |r| < ln 2/2, by the series. x is limited to +-800: e^x is 0 or infinite there. */
static inline double tm_exponential_reduced(double x, int *n) {
    x = x < -800 ? -800 : x > 800 ? 800 : x;
    const double whole = floor(x * 1.4426950408889634 + 0.5);
    const double r = (x - whole * 6.93147180369123816490e-01) - whole * 1.90821492927058770002e-10;
    double sum = 0, over = 6227020800.0; /* 13! */
    for (int i = 13; i >= 2; over /= i--) sum = (sum + 1 / over) * r;
    *n = (int)whole;
    return (sum + 1) * r;
}

static inline double tm_exponential(double x) {
    int n;
    const double less = tm_exponential_reduced(x, &n);
    return ldexp(1 + less, n);
}

static inline double tm_exponential_less_1(double x) {
    int n;
    const double less = tm_exponential_reduced(x, &n);
    return n == 0 ? less : ldexp(less, n) + (ldexp(1, n) - 1);
}

#endif
