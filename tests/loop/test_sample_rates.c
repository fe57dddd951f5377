/* Consistency of every extrapolator: the error falls with the rate of force samples; with a sample in every tick the
 * force is that of `hold`, for any times of the samples. The reference is a stiffening spring with drag along the
 * surface, pressed, slid on and released by a trembling hand. */
#include "rig.h"

#include "../long.h"

static const double TICK_S = 0.002, SESSION_S = 12;
enum { TICKS = 6000 };

static hrt_params params;

/* Returns the tip position at a time, m: pressed to 6 mm and slid by 15 mm, with a tremor of 40 um. */
static void tip_at(double t, float tip[3]) {
    const double tremor = 40e-6 * sin(2 * M_PI * 9 * t);
    tip[0] = (float)(0.015 * sin(2 * M_PI * t / 3) + tremor);
    tip[1] = (float)(0.004 * sin(2 * M_PI * t / 5));
    tip[2] = (float)(0.1 + 0.0035 * sin(2 * M_PI * t / 2.5) + 0.0025 * sin(2 * M_PI * t / 1.7) + tremor);
}

/* Computes the tissue's force: it resists pressing, and drags. */
static void force_at(double t, float force[3]) {
    float tip[3], before[3];
    tip_at(t, tip), tip_at(t - 1e-4, before);
    const double depth = fmax((double)tip[2] - 0.0985, 0), pushed = 60 * depth + 9000 * depth * depth;
    for (int c = 0; c < 2; c++) force[c] = (float)(-2.0 * pushed * ((double)tip[c] - (double)before[c]) / 1e-4);
    force[2] = (float)-pushed;
}

typedef struct delivery {
    double sampled_s, arrives_s;
} delivery;

typedef enum line { LINE_EVEN, LINE_RANDOM, LINE_BURSTS, LINE_GAPS, LINE_COUNT } line;
static const char *const line_name[LINE_COUNT] = {"even", "random", "bursts", "gaps"};

/* Draws the times at which samples are taken and arrive; returns their number. Overtaken samples are omitted, as by
 * the controller. */
static int deliver(line kind, double rate_Hz, uint64_t seed, delivery *out) {
    const double period_s = 1 / rate_Hz;
    uint64_t random = seed;
    double last_s = -1, newest_s = -1;
    int count = 0;
    for (int k = 0; k * period_s < SESSION_S; k++) {
        delivery d = {k * period_s, k * period_s};
        if (kind == LINE_RANDOM)
            d.sampled_s += period_s * (double)rig_uniform(&random, 0, 1),
                d.arrives_s = d.sampled_s + period_s * (double)rig_uniform(&random, 0, 1);
        if (kind == LINE_BURSTS) d.arrives_s = (floor(k / 4.0) + 1) * 4 * period_s;
        if (kind == LINE_GAPS && (double)rig_uniform(&random, 0, 1) < 0.3) continue;
        if (d.sampled_s <= newest_s || d.arrives_s < last_s) continue;
        last_s = d.arrives_s, newest_s = d.sampled_s;
        out[count++] = d;
    }
    return count;
}

/* Returns the RMS error of an extrapolator over the reference's peak. */
static double error_of(hrt_extrapolator which, line kind, double rate_Hz, uint64_t seed) {
    static hrt_extrapolation x;
    static delivery line_of[2 * TICKS];
    const int count = deliver(kind, rate_Hz, seed, line_of);
    double sum = 0, peak = 0;
    int next = 0, judged = 0;
    hrt_extrapolation_reset(&x, which);
    for (int k = 0; k < TICKS; k++) {
        const double t = k * TICK_S;
        for (; next < count && line_of[next].arrives_s <= t + 1e-9; next++) {
            hrt_sample sample = {.session = SIM,
                                 .tool_session = SESSION,
                                 .t_us = (int64_t)(1e6 * line_of[next].sampled_s + 0.5),
                                 .seq = (uint32_t)next,
                                 .unilateral = true};
            tip_at(line_of[next].sampled_s, sample.tip_m);
            force_at(line_of[next].sampled_s, sample.force_N);
            hrt_extrapolation_sample(&x, &params, &sample);
        }
        float tip[3], force[3], truth[3];
        tip_at(t, tip), force_at(t, truth);
        hrt_extrapolation_force(&x, &params, (int64_t)(1e6 * t + 0.5), tip, force);
        double size2 = 0, miss2 = 0;
        for (int c = 0; c < 3; c++)
            size2 += (double)truth[c] * (double)truth[c],
                miss2 += ((double)force[c] - (double)truth[c]) * ((double)force[c] - (double)truth[c]);
        assert_true(miss2 < 1e3);
        peak = fmax(peak, size2);
        if (t < 0.5) continue;
        sum += miss2, judged++;
    }
    return sqrt(sum / judged / peak);
}

static void error_falls_with_the_sample_rate_for_every_extrapolator(void **state) {
    (void)state;
    static const double rates_Hz[] = {10, 25, 50, 100, 250, 500};
    enum { RATES = sizeof rates_Hz / sizeof *rates_Hz };
    const int seeds = test_is_long() ? 20 : 2;
    for (int w = 0; w < HRT_EXTRAPOLATOR_COUNT; w++)
        for (int kind = 0; kind < LINE_COUNT; kind++)
            for (int seed = 1; seed <= seeds; seed++) {
                double error[RATES];
                for (int r = 0; r < RATES; r++)
                    error[r] = error_of((hrt_extrapolator)w, (line)kind, rates_Hz[r], (uint64_t)seed);
                for (int r = 1; r < RATES; r++)
                    if (!(error[r] < 1.02 * error[r - 1]))
                        fail_msg("%s, %s: %.4f at %g Hz, %.4f at %g", hrt_extrapolator_name((hrt_extrapolator)w),
                                 line_name[kind], error[r - 1], rates_Hz[r - 1], error[r], rates_Hz[r]);
                assert_true(error[RATES - 1] < 0.1 * error[0]);
            }
}

static void every_extrapolator_is_hold_with_a_sample_in_every_tick(void **state) {
    (void)state;
    for (int w = 0; w < HRT_EXTRAPOLATOR_COUNT; w++)
        assert_true(error_of((hrt_extrapolator)w, LINE_EVEN, 500, 1) < 5e-4);
}

static int set_up(void **state) {
    (void)state;
    hrt_params_default(&params);
    return 0;
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(error_falls_with_the_sample_rate_for_every_extrapolator),
        cmocka_unit_test(every_extrapolator_is_hold_with_a_sample_in_every_tick),
    };
    return cmocka_run_group_tests(tests, set_up, NULL);
}
