/* The extrapolator `adaptive`: its weights follow the errors of its extrapolators, and it stays bounded for any
 * sequence. */
#include <math.h>

#include "../fixture.h"
#include "../long.h"
#include "core/internal.h"

enum { LAWS = HRT_ADAPTIVE_LAWS };
static const int64_t TICK_US = 2000, SAMPLE_US = 40000;

static hrt_adaptive state;

static double distance2(const float a[3], const double b[3]) {
    double sum = 0;
    for (int c = 0; c < 3; c++) sum += ((double)a[c] - b[c]) * ((double)a[c] - b[c]);
    return sum;
}

/* Runs the ticks of a sample's period in which extrapolator i errs by miss_N[i] from an oscillating force; then
 * posts the sample, `late` periods after its time. Returns the sum of the blend's squared errors. */
static double period(int64_t at_us, const float miss_N[LAWS], bool with_patch, double *law_error2) {
    double blend_error2 = 0;
    float force[3];
    for (int64_t t = at_us; t < at_us + SAMPLE_US; t += TICK_US) {
        const double true_N[3] = {sin(3e-6 * (double)t), 1, 0.3 * cos(1e-5 * (double)t)};
        float said[LAWS][3];
        for (int i = 0; i < LAWS; i++)
            for (int c = 0; c < 3; c++) said[i][c] = (float)true_N[c] + (c == i % 3 ? miss_N[i] : 0.0f);
        hrt_adaptive_blend(&state, t, with_patch, said, force);
        blend_error2 += distance2(force, true_N);
        for (int i = 0; law_error2 && i < LAWS; i++) law_error2[i] += distance2(said[i], true_N);
    }
    const int64_t t = at_us + SAMPLE_US / 2;
    hrt_adaptive_judge(&state, t, 1e-6f * (float)SAMPLE_US,
                       (const float[3]){(float)sin(3e-6 * (double)t), 1, 0.3f * (float)cos(1e-5 * (double)t)});
    return blend_error2;
}

static void best_extrapolator_gets_the_weight(void **unused) {
    (void)unused;
    for (int best = 0; best < LAWS; best++) {
        hrt_adaptive_reset(&state);
        float miss[LAWS] = {0.2f, 0.2f, 0.2f, 0.2f};
        miss[best] = 0.002f;
        for (int k = 0; k < 12; k++) period(k * SAMPLE_US, miss, true, NULL);
        assert_true(state.weight[best] > 0.98f);
    }
}

static void weight_moves_within_three_samples_to_a_new_best_extrapolator(void **unused) {
    (void)unused;
    hrt_adaptive_reset(&state);
    const float first[LAWS] = {0.2f, 0.002f, 0.2f, 0.2f}, then[LAWS] = {0.2f, 0.2f, 0.002f, 0.2f};
    int64_t at = 0;
    for (int k = 0; k < 50; k++, at += SAMPLE_US) period(at, first, true, NULL);
    assert_true(state.weight[HRT_ADAPTIVE_POSITION] > 0.98f);
    for (int k = 0; k < 10; k++, at += SAMPLE_US) period(at, then, true, NULL);
    assert_true(state.weight[HRT_ADAPTIVE_STIFFNESS] > state.weight[HRT_ADAPTIVE_POSITION]);
}

static void the_patch_is_trusted_first_and_has_no_weight_without_one(void **unused) {
    (void)unused;
    hrt_adaptive_reset(&state);
    const float miss[LAWS] = {0};
    period(0, miss, true, NULL);
    float said[LAWS][3] = {{0}}, force[3];
    hrt_adaptive_reset(&state);
    hrt_adaptive_blend(&state, 0, true, said, force);
    assert_true(state.weight[HRT_ADAPTIVE_PATCH] > 0.95f);
    hrt_adaptive_blend(&state, TICK_US, false, said, force);
    assert_true(state.weight[HRT_ADAPTIVE_PATCH] == 0.0f);
    float sum = 0;
    for (int i = 0; i < LAWS; i++) sum += state.weight[i];
    assert_true(fabsf(sum - 1) < 1e-6f);
}

/* At the first touch all laws miss the sample by about its force: that does not tell them apart. */
static void the_first_sample_in_contact_takes_no_weight_from_the_patch(void **unused) {
    (void)unused;
    float said[LAWS][3] = {{0}}, force[3];
    hrt_adaptive_reset(&state);
    said[HRT_ADAPTIVE_PATCH][2] = 0.001f;
    hrt_adaptive_blend(&state, 0, true, said, force);
    hrt_adaptive_judge(&state, 0, 0.05f, (const float[3]){0, 0, 0.004f});
    hrt_adaptive_blend(&state, TICK_US, true, said, force);
    assert_true(state.weight[HRT_ADAPTIVE_PATCH] > 0.95f);
    for (int i = 0; i < HRT_ADAPTIVE_PATCH; i++) said[i][2] = 0.004f; /* now they have a sample to go on from */
    hrt_adaptive_blend(&state, 2 * TICK_US, true, said, force);
    hrt_adaptive_judge(&state, 2 * TICK_US, 0.05f, (const float[3]){0, 0, 0.004f});
    hrt_adaptive_blend(&state, 3 * TICK_US, true, said, force);
    assert_true(state.weight[HRT_ADAPTIVE_PATCH] < 0.5f);
}

/* One extrapolator is the best throughout: after a few samples the blend is as accurate. */
static void blend_is_near_the_best_extrapolator_if_that_is_constant(void **unused) {
    (void)unused;
    fix_random random = {3};
    const int sequences = test_is_long() ? 5000 : 200;
    double worst = 0;
    for (int s = 0; s < sequences; s++) {
        hrt_adaptive_reset(&state);
        float miss[LAWS];
        double blend = 0, law[LAWS] = {0}, best = INFINITY;
        for (int i = 0; i < LAWS; i++) miss[i] = 0.01f + 0.3f * (float)pow(fix_uniform(&random), 2);
        for (int k = 0; k < 40; k++) {
            const double period_error2 = period(k * SAMPLE_US, miss, true, k < 5 ? NULL : law);
            blend += k < 5 ? 0 : period_error2;
        }
        for (int i = 0; i < LAWS; i++) best = fmin(best, law[i]);
        worst = fmax(worst, sqrt(blend / best));
    }
    printf("    worst RMS over the best law's: %.3f\n", worst);
    assert_true(worst < 1.15);
}

/* The best extrapolator changes at random, like phases of the work. Tracking bound: the loss is at most half more
 * than that of a choice that knows the best one of every period, plus the loss of the worst one for half a period
 * after each change. */
static void blend_follows_a_changing_best_extrapolator(void **unused) {
    (void)unused;
    fix_random random = {5};
    const int sequences = test_is_long() ? 2000 : 100;
    const double most_N = 0.31;
    double worst = 0;
    for (int s = 0; s < sequences; s++) {
        hrt_adaptive_reset(&state);
        double blend = 0, oracle = 0;
        float miss[LAWS];
        int64_t at = 0;
        int changes = 0;
        for (int k = 0; k < 100; k++, at += SAMPLE_US) {
            double law[LAWS] = {0}, best = INFINITY;
            bool changed = false;
            for (int i = 0; i < LAWS; i++)
                if (k == 0 || fix_uniform(&random) < 0.03) {
                    miss[i] =
                        (0.01f + 0.3f * (float)pow(fix_uniform(&random), 4)) * (fix_uniform(&random) < 0.5 ? 1 : -1);
                    changed = true;
                }
            changes += changed;
            blend += period(at, miss, true, law);
            for (int i = 0; i < LAWS; i++) best = fmin(best, law[i]);
            oracle += best;
        }
        const double bound = 1.5 * oracle + 0.5 * changes * (double)(SAMPLE_US / TICK_US) * most_N * most_N;
        worst = fmax(worst, blend / bound);
    }
    printf("    worst loss over the bound: %.3f\n", worst);
    assert_true(worst < 1);
}

static void blend_is_between_its_extrapolators_for_any_input(void **unused) {
    (void)unused;
    fix_random random = {11};
    const int calls = test_is_long() ? 2000000 : 100000;
    hrt_adaptive_reset(&state);
    int64_t now = 1000000;
    for (int k = 0; k < calls; k++) {
        float said[LAWS][3], force[3];
        const float scale = (float)pow(10, 8 * fix_uniform(&random) - 5);
        for (int i = 0; i < LAWS; i++)
            for (int c = 0; c < 3; c++)
                said[i][c] = fix_uniform(&random) < 0.2 ? 0 : scale * (float)fix_signed(&random);
        const bool with_patch = fix_uniform(&random) < 0.5;
        now += fix_uniform(&random) < 0.01 ? (int64_t)(1e9 * fix_uniform(&random))
                                           : (int64_t)(4000 * fix_uniform(&random));
        hrt_adaptive_blend(&state, now, with_patch, said, force);
        for (int c = 0; c < 3; c++) {
            float low = INFINITY, high = -INFINITY;
            for (int i = 0; i < (with_patch ? LAWS : HRT_ADAPTIVE_PATCH); i++)
                low = fminf(low, said[i][c]), high = fmaxf(high, said[i][c]);
            const float rounding = 1e-5f * (fabsf(low) + fabsf(high));
            assert_true(force[c] >= low - rounding && force[c] <= high + rounding);
        }
        if (fix_uniform(&random) < 0.3)
            hrt_adaptive_judge(&state, now - (int64_t)(4e5 * fix_signed(&random)), (float)fix_uniform(&random),
                               said[1]);
    }
}

static void weights_are_kept_without_contact(void **unused) {
    (void)unused;
    hrt_adaptive_reset(&state);
    const float miss[LAWS] = {0.2f, 0.002f, 0.2f, 0.2f};
    for (int k = 0; k < 12; k++) period(k * SAMPLE_US, miss, true, NULL);
    const hrt_adaptive before = state;
    float said[LAWS][3] = {{0}}, force[3];
    for (int64_t t = 12 * SAMPLE_US; t < 1000 * SAMPLE_US; t += SAMPLE_US) {
        hrt_adaptive_blend(&state, t, true, said, force);
        hrt_adaptive_judge(&state, t, 0.04f, force);
    }
    assert_memory_equal(before.loss, state.loss, sizeof state.loss);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(best_extrapolator_gets_the_weight),
        cmocka_unit_test(weight_moves_within_three_samples_to_a_new_best_extrapolator),
        cmocka_unit_test(the_patch_is_trusted_first_and_has_no_weight_without_one),
        cmocka_unit_test(the_first_sample_in_contact_takes_no_weight_from_the_patch),
        cmocka_unit_test(blend_is_near_the_best_extrapolator_if_that_is_constant),
        cmocka_unit_test(blend_follows_a_changing_best_extrapolator),
        cmocka_unit_test(blend_is_between_its_extrapolators_for_any_input),
        cmocka_unit_test(weights_are_kept_without_contact),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
